//! Motions on the neutral SMPL-24 body, on which the model works.

use super::{Retarget, is_same, smpl_leg_m};
use crate::format::{floor_height, known_floor};
use crate::rig::{Floor, Humanoid};
use crate::{Clip, Motion, Result, Skeleton, Source, Vec3, smpl};

/// Whether clips of this rig are on the neutral SMPL-24 body already: then [`to_smpl`] returns their numbers bit for bit.
pub(crate) fn is_on_neutral(rig: &Skeleton) -> bool {
    is_same(rig, &smpl::neutral())
}

/// Puts a motion on the neutral SMPL-24 body.
///
/// The path is scaled with the legs about the motion's floor ([`floor_height`]). Motions of AMASS and AIST++ keep their
/// rotations, which are valid for every SMPL body.
///
/// # Errors
/// [`Error::Clip`](crate::Error::Clip) with the file's name for the errors of [`Motion::humanoid`] and [`Retarget::new`].
pub fn to_smpl(motion: &Motion) -> Result<Clip> {
    OntoNeutral::of(motion)?.clip(&motion.clip)
}

/// The way of a motion onto the neutral SMPL-24 body, and of other clips on its rig.
#[derive(Debug, Clone)]
pub struct OntoNeutral {
    way: Way,
    /// The floor that was detected for it; `None` where it is known or not needed.
    floor: Option<Floor>,
}

#[derive(Debug, Clone)]
enum Way {
    /// The clip is on the body.
    Same,
    /// Rotations stay; the path of the pelvis, which stands `from_m` high, is scaled about the floor to stand at `on_m`.
    Scaled { scale: f64, floor_m: f64, on_m: f64, from_m: f64 },
    /// From bone to bone.
    Retargeted(Box<Retarget>),
}

impl OntoNeutral {
    /// The way of a motion, about its floor.
    ///
    /// # Errors
    /// Those of [`to_smpl`].
    pub fn of(motion: &Motion) -> Result<OntoNeutral> {
        OntoNeutral::about_floor(motion).map_err(|e| e.in_clip(&motion.path))
    }

    fn about_floor(motion: &Motion) -> Result<OntoNeutral> {
        let (rig, neutral) = (motion.clip.skeleton(), smpl::neutral());
        let is_smpl_file = matches!(motion.source, Source::Amass { .. } | Source::Aist { .. }) && smpl::is_rig(rig);
        if (!motion.has_own_map() || is_smpl_file) && is_on_neutral(rig) {
            return Ok(OntoNeutral { way: Way::Same, floor: None });
        }
        // after the early return: a clip on the neutral body needs neither map nor floor
        let humanoid = motion.humanoid()?;
        let floor = if known_floor(motion).is_none() { Some(motion.floor()?.clone()) } else { None };
        let way = if is_smpl_file {
            let scale = smpl_leg_m(&neutral) / smpl_leg_m(rig);
            let [on_m, from_m] = [Humanoid::neutral(), humanoid].map(|body| body.feet().map(|feet| feet.pelvis_m));
            Way::Scaled { scale, floor_m: floor_height(motion)?, on_m: on_m?, from_m: from_m? }
        } else {
            Way::Retargeted(Box::new(Retarget::new(humanoid, neutral)?.with_floor(floor_height(motion)?)))
        };
        Ok(OntoNeutral { way, floor })
    }

    /// The way of the same motion lowered by `by_m` metres: about the floor that is detected then.
    pub fn when_lowered(mut self, by_m: f64) -> OntoNeutral {
        let Some(height_m) = self.floor.as_ref().map(|floor| floor.height_when_lowered(by_m)) else { return self };
        self.way = match self.way {
            Way::Same => Way::Same,
            Way::Scaled { scale, on_m, from_m, .. } => Way::Scaled { scale, floor_m: height_m, on_m, from_m },
            Way::Retargeted(retarget) => Way::Retargeted(Box::new(retarget.with_floor(height_m))),
        };
        self
    }

    /// A clip on the motion's rig on the neutral body.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) when the clip is not on that rig.
    pub fn clip(&self, clip: &Clip) -> Result<Clip> {
        match &self.way {
            Way::Same => clip.clone().with_skeleton(smpl::neutral()),
            Way::Retargeted(retarget) => retarget.to_smpl(clip),
            Way::Scaled { scale, floor_m, on_m, from_m } => {
                // floor + scale (y - floor - from_m) + on_m: heights of the pelvis above its standing height are scaled
                let raise = floor_m * (1.0 - scale) + on_m - scale * from_m;
                let root = clip.root().iter().map(|p| *p * *scale + Vec3::Y * raise).collect();
                Clip::new(smpl::neutral(), clip.fps(), root, clip.rotations().to_vec())
            }
        }
    }
}
