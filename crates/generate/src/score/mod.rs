//! How believable a stretch of a dance is: what of its motion goes beyond what train clips do.
//!
//! [`Measures`] are taken of a clip on SMPL-24 at the model's rate, with its floor at y = 0. [`Limits`] say what is usual of
//! train clips, and what none of them does; a [`Scorer`] compares. docs/generation.md, "Looking ahead".

mod limits;
#[cfg(test)]
mod tests;

pub use limits::{Limits, Usual};

use crate::Result;
use kinelm_motion::Clip;
use kinelm_motion::feet::leg::Leg;
use kinelm_motion::metric::{Balance, BalanceFrame, Extremes, Ground, Skate};
use kinelm_motion::rig::{Feet, Humanoid};
use std::ops::Range;

/// Seconds of a block, of which several are sampled.
pub const BLOCK_S: f64 = 2.0;
/// Seconds before a block that are measured with it: feet in contact are locked where they came down.
pub const BEFORE_S: f64 = 2.0;
/// What the score of a stretch rises by where it does what no train clip does, besides the share by which it goes beyond.
const NEVER: f64 = 4.0;

/// Measures of a stretch of a dance.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Measures {
    /// Mean distance of the centre of mass outside the support over the frames with a contact, cm.
    pub outside_cm: f64,
    /// Share of them in which it is more than 15 cm.
    pub outside_share: f64,
    /// Share of the frames with a foot kicked up.
    pub kick_share: f64,
    /// Share of the steps of feet on the floor that slide; 1 where no foot ever stands.
    pub slide_share: f64,
    /// Mean depth of the lowest foot in the floor beyond 2 cm, cm.
    pub penetration_cm: f64,
    /// Mean speed of the coded joints, cm/s.
    pub speed_cm_s: f64,
    /// Jerk over speed, 1/s².
    pub shake: f64,
    /// Share of the frames into which a coded joint [snaps](Extremes).
    pub snap_share: f64,
    /// The most that the coded joints do.
    pub most: Extremes,
    /// The least height of the pelvis, metres.
    pub lowest_m: f64,
}

/// Takes [`Measures`].
#[derive(Debug, Clone)]
pub struct Scorer {
    joints: Vec<usize>,
    feet: Feet,
    legs: [Leg; 2],
    has_feet: bool,
}

impl Scorer {
    /// Of dances of which these SMPL joints are coded.
    ///
    /// # Errors
    /// None on SMPL-24.
    pub fn new(joints: &[usize]) -> Result<Scorer> {
        Ok(Scorer {
            joints: joints.to_vec(),
            feet: coded_feet(joints)?,
            legs: Leg::of(Humanoid::neutral())?,
            has_feet: true,
        })
    }

    /// The same of dances whose legs were given: balance, kicks and feet are 0, as nothing of them was invented.
    pub fn without_feet(self) -> Scorer {
        Scorer { has_feet: false, ..self }
    }

    /// Whether balance, kicks and feet are measured.
    pub fn has_feet(&self) -> bool {
        self.has_feet
    }

    /// Measures `frames` of a clip. What is before and after them says where feet are in contact.
    pub fn measures(&self, clip: &Clip, frames: Range<usize>) -> Measures {
        let mut found = if self.has_feet { self.on_feet(clip, frames.clone()) } else { Measures::default() };
        self.of_joints(clip, frames, &mut found);
        found
    }

    /// Balance, kicks, and feet on the floor.
    fn on_feet(&self, clip: &Clip, frames: Range<usize>) -> Measures {
        let part = clip.slice(frames.clone());
        let fps = clip.fps();
        let balance = Balance::of_frames(&BalanceFrame::of(&self.legs, clip)[frames]);
        let pelvis: Vec<f64> = part.root().iter().map(|p| p.y).collect();
        let ground = Ground::of(&self.feet.clearance(&part), &pelvis, fps);
        Measures {
            outside_cm: balance.outside_cm().unwrap_or(0.0),
            outside_share: balance.outside_share().unwrap_or(0.0),
            kick_share: balance.kick_share().unwrap_or(0.0),
            slide_share: Skate::of(&self.feet, &part).share().unwrap_or(1.0),
            penetration_cm: ground.penetration_cm().unwrap_or(0.0),
            ..Measures::default()
        }
    }

    /// How the joints move.
    fn of_joints(&self, clip: &Clip, frames: Range<usize>, found: &mut Measures) {
        found.lowest_m = clip.root()[frames.clone()].iter().map(|p| p.y).fold(f64::INFINITY, f64::min);
        // the steps into the stretch's first frames count too: a snap between two blocks is one
        let before = frames.start.min(3);
        let (part, count) = (clip.slice(frames.start - before..frames.end), frames.len());
        found.most = Extremes::of(&part, &self.joints, before..part.frames());
        found.snap_share = found.most.snaps as f64 / count.max(1) as f64;
        let (places, joints, fps) = (part.positions(), part.joints(), clip.fps());
        let (mut speed, mut jerk) = (0.0, 0.0);
        let steps = before.max(1)..part.frames();
        for (f, &joint) in steps.clone().flat_map(|f| self.joints.iter().map(move |joint| (f, joint))) {
            let at = |back: usize| places[(f - back) * joints + joint];
            speed += (at(0) - at(1)).length() * fps;
            if f >= 3 {
                jerk += (at(0) - at(1) * 3.0 + at(2) * 3.0 - at(3)).length() * fps.powi(3);
            }
        }
        found.speed_cm_s = 100.0 * speed / (steps.len() * self.joints.len()).max(1) as f64;
        found.shake = if speed > 0.0 { jerk / speed } else { 0.0 };
    }

    /// Measures of the windows of a real clip: as long as a block of look-ahead, half of it apart. A clip of less than half a
    /// window has none.
    pub fn windows(&self, clip: &Clip) -> Vec<Measures> {
        let frames = |s: f64| ((s * clip.fps()).round() as usize).max(1);
        let (window, hop) = (frames(BLOCK_S).min(clip.frames()), frames(BLOCK_S / 2.0));
        let starts = (0..=clip.frames() - window).step_by(hop).filter(|_| window >= hop);
        let measured = |start: usize| {
            // as much before it as is looked at before a block
            let before = start.min(frames(BEFORE_S));
            self.measures(&clip.slice(start - before..start + window), before..before + window)
        };
        starts.map(measured).collect()
    }

    /// The score of a stretch, 0 at best: what its measures go beyond what is usual, in the usual spreads, and what no train
    /// clip does.
    pub fn score(&self, found: &Measures, limits: &Limits) -> f64 {
        let usual = limits.usual(found).map(|(x, usual)| usual.map_or(0.0, |usual| usual.beyond(x)));
        let never = limits.never(found).into_iter().flatten().map(|by| NEVER + by);
        usual.iter().sum::<f64>() + never.sum::<f64>()
    }
}

/// The feet of the model's body as far as they are coded: of the thirteen joints the ankles. Where none is, the ankles.
///
/// # Errors
/// None on SMPL-24.
pub fn coded_feet(joints: &[usize]) -> Result<Feet> {
    let mut feet = Humanoid::neutral().feet()?;
    let coded = feet.joints.iter().any(|(j, _)| joints.contains(j));
    // 7 and 8 are the ankles
    feet.joints.retain(|(j, _)| if coded { joints.contains(j) } else { matches!(j, 7 | 8) });
    Ok(feet)
}
