//! Conversion of a motion to another rig, another rate, or fewer moving joints.

#[cfg(feature = "amass")]
use crate::format::body_model::BodyModel;
use crate::format::{self, ReadOptions};
use crate::joints::Selection;
use crate::resample::{Method, resample};
use crate::retarget::{self, Retarget};
use crate::rig::{Humanoid, SkeletonMap};
use crate::{Clip, Error, Motion, Quat, Result, Skeleton, Source, Vec3, smpl};
use std::path::Path;
use std::sync::Arc;

/// A rig to put motion on.
#[derive(Debug, Clone)]
pub enum TargetRig {
    /// SMPL's 24 joints with these offsets.
    Smpl(Arc<Skeleton>),
    /// The rig of a motion file; see [`TargetRig::of_motion`].
    OfFile(Box<Motion>),
}

impl TargetRig {
    /// Resolves the name `smpl` (the neutral body), or reads a body model (`SMPL_*.npz`) or the rig of a motion file, which
    /// `options` are for.
    ///
    /// # Errors
    /// [`Unsupported`](kinelm_store::Error::Unsupported) when it is none of these; errors of reading the file, and those of
    /// [`TargetRig::of_motion`].
    pub fn load(name_or_path: &str, options: &ReadOptions) -> Result<TargetRig> {
        if name_or_path == "smpl" {
            return Ok(TargetRig::Smpl(smpl::neutral()));
        }
        let path = Path::new(name_or_path);
        if let Some(map) = SkeletonMap::builtin(name_or_path).filter(|_| !path.exists()) {
            let why = "a map of joint names has no bones; give a motion file of that rig instead";
            return Err(Error::unsupported(format!("rig {}", map.name), why));
        }
        if !path.exists() {
            let why = "no such file; give smpl, a body model (SMPL_*.npz) or a motion file on that rig";
            return Err(Error::unsupported(format!("rig {name_or_path:?}"), why));
        }
        let bytes = kinelm_store::input::bytes(path).map_err(Error::io(path))?;
        #[cfg(feature = "amass")]
        if let Ok(body) = BodyModel::parse(path, &bytes).and_then(|model| model.body(&[])) {
            return Ok(TargetRig::Smpl(body.skeleton));
        }
        TargetRig::of_motion(format::parse(path, &bytes, options)?)
    }

    /// The motion whose rig it is; `None` for SMPL's body.
    pub fn motion(&self) -> Option<&Motion> {
        match self {
            TargetRig::Smpl(_) => None,
            TargetRig::OfFile(motion) => Some(motion),
        }
    }

    /// The rig of a motion.
    ///
    /// # Errors
    /// [`Error::Clip`] with the motion's name for a rig that no map fits or that stands in no reference pose.
    pub fn of_motion(motion: Motion) -> Result<TargetRig> {
        let stands = motion.humanoid().and_then(Humanoid::pose).map(drop);
        stands.map_err(|e| e.in_clip(&motion.path))?;
        Ok(TargetRig::OfFile(Box::new(motion)))
    }
}

/// Options of [`convert`].
#[derive(Debug, Clone, Default)]
pub struct ConvertOptions {
    /// Frames per second; the motion's own if not given.
    pub fps: Option<f64>,
    /// The rig; the motion's own if not given.
    pub rig: Option<TargetRig>,
    /// The SMPL joints that go on moving; the others get their rest rotation.
    pub joints: Option<Selection>,
    /// The treatment of the path over the floor.
    pub place: Place,
}

/// Where a converted motion stands.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Place {
    /// Where it was.
    #[default]
    Own,
    /// Moved so that its first frame stands at x = z = 0.
    AtOrigin,
    /// At x = z = 0 in every frame, for engines that move the character themselves; heights stay.
    InPlace,
}

impl Place {
    /// The clip at its place.
    fn put(self, clip: &Clip) -> Result<Clip> {
        let first = clip.root().first().copied().unwrap_or_default();
        let moved = |p: &Vec3| match self {
            Place::Own => *p,
            Place::AtOrigin => Vec3::new(p.x - first.x, p.y, p.z - first.z),
            Place::InPlace => Vec3::new(0.0, p.y, 0.0),
        };
        let root = clip.root().iter().map(moved).collect();
        Clip::new(clip.skeleton().clone(), clip.fps(), root, clip.rotations().to_vec())
    }
}

/// Converts a motion. Without any option set it is returned unchanged.
///
/// Joints are selected on the SMPL body, so `joints` without a rig puts the motion on the neutral SMPL body.
///
/// # Errors
/// Errors of retargeting (no skeleton map fits) and of [`resample`].
///
/// ```
/// use kinelm_motion::convert::{ConvertOptions, convert};
/// use kinelm_motion::{Motion, joints, synth};
///
/// let clip = synth::corpus(1, 1, 2.0, 60.0)?.remove(0).clip;
/// let arms = joints::parse("root,arms")?;
/// let options = ConvertOptions { fps: Some(20.0), joints: Some(arms), ..Default::default() };
/// let slow = convert(Motion::new("dance.json", clip), &options)?;
/// assert_eq!((slow.clip.fps(), slow.clip.frames()), (20.0, 40));
/// assert_eq!(slow.clip.pose(7)[4], kinelm_motion::Quat::IDENTITY, "the knee is at rest");
/// # Ok::<(), kinelm_motion::Error>(())
/// ```
pub fn convert(mut motion: Motion, options: &ConvertOptions) -> Result<Motion> {
    let rest = motion.warnings.iter().any(|w| w.kind == "rest_frame") && format::has_rest_frame(&motion);
    let neutral = options.joints.is_some().then(|| TargetRig::Smpl(smpl::neutral()));
    if let Some(selection) = &options.joints {
        // before the clip changes: the floor is detected on the rig that stands on it
        let floor_m = format::floor_height(&motion)?;
        let clip = keep_joints(&retarget::to_smpl(&motion)?, selection)?;
        motion = motion.with_clip(clip).with_source(Source::Retargeted { floor_m });
    }
    if let Some(rig) = options.rig.as_ref().or(neutral.as_ref()) {
        motion = on_rig(motion, rig)?;
    }
    if let Some(fps) = options.fps {
        let clip = if rest { after_rest(&motion.clip, fps)? } else { resample(&motion.clip, fps, Method::Smooth)? };
        motion = motion.with_clip(clip);
    }
    if options.place != Place::Own {
        let clip = options.place.put(&motion.clip)?;
        motion = motion.with_clip(clip);
    }
    Ok(motion)
}

/// Resamples a clip whose frame 0 is a rest pose: frame 0 is copied, because a low pass would smear it into the motion.
fn after_rest(clip: &Clip, fps: f64) -> Result<Clip> {
    let rest = clip.slice(0..1);
    let moving = resample(&clip.slice(1..clip.frames()), fps, Method::Smooth)?;
    let root = [rest.root(), moving.root()].concat();
    Clip::new(clip.skeleton().clone(), fps, root, [rest.rotations(), moving.rotations()].concat())
}

/// Offsets of two rigs nearer than this, metres, are the same: a BVH's digits leave less.
const SAME_OFFSET_M: f64 = 1e-4;

/// Whether two skeletons have the same joints at the same places, whatever these are called.
fn is_same(a: &Skeleton, b: &Skeleton) -> bool {
    let near = |(a, b): (&Vec3, &Vec3)| a.distance(*b) < SAME_OFFSET_M;
    // where the root stands at rest, its path says
    a.parents() == b.parents() && a.offsets().iter().zip(b.offsets()).skip(1).all(near)
}

/// Puts a motion on another rig, by way of SMPL-24; on its own rig, as another file has it, all of its joints stay.
///
/// # Errors
/// Errors of retargeting: no skeleton map fits the motion's rig.
pub fn on_rig(motion: Motion, rig: &TargetRig) -> Result<Motion> {
    let floor_m = format::floor_height(&motion)?;
    if let TargetRig::OfFile(like) = rig
        && is_same(motion.clip.skeleton(), like.clip.skeleton())
    {
        let clip = motion.clip.clone().with_skeleton(like.clip.skeleton().clone())?;
        return Ok(motion.with_clip(clip).with_source(source_of(like, floor_m)));
    }
    let clip = retarget::to_smpl(&motion)?;
    match rig {
        TargetRig::Smpl(body) => {
            let clip = if clip.skeleton() == body {
                clip
            } else {
                // the path scales with the legs, as between any two rigs
                Retarget::new(Humanoid::neutral(), body.clone())?.with_floor(floor_m).to_smpl(&clip)?
            };
            Ok(motion.with_clip(clip).with_source(Source::Retargeted { floor_m }))
        }
        TargetRig::OfFile(like) => {
            let back = Retarget::new(like.humanoid()?, clip.skeleton().clone())?.with_floor(floor_m);
            Ok(motion.with_clip(back.to_rig(&clip)?).with_source(source_of(like, floor_m)))
        }
    }
}

/// The source of a motion that was put on the rig of another.
fn source_of(like: &Motion, floor_m: f64) -> Source {
    let mut source = like.source.clone();
    match &mut source {
        Source::Bvh(bvh) => bvh.floor_m = Some(floor_m),
        Source::Glb(glb) => glb.floor_m = Some(floor_m),
        Source::Vrma(vrma) => vrma.floor_m = Some(floor_m),
        Source::Plain | Source::Turned(_) => source = Source::Retargeted { floor_m },
        _ => {}
    }
    source
}

/// Sets the joints of an SMPL-24 clip that aren't selected to their rest rotation.
fn keep_joints(clip: &Clip, selection: &Selection) -> Result<Clip> {
    let keep = |(i, &q): (usize, &Quat)| if selection.joints.contains(&(i % 24)) { q } else { Quat::IDENTITY };
    let rotations = clip.rotations().iter().enumerate().map(keep).collect();
    Clip::new(clip.skeleton().clone(), clip.fps(), clip.root().to_vec(), rotations)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::RestFrame;
    use crate::{Vec3, synth};

    #[test]
    fn a_kept_rest_pose_stays_out_of_the_low_pass() {
        let dance = synth::corpus(5, 1, 2.0, 60.0).unwrap().remove(0).clip;
        let away = |clip: &Clip, frames: std::ops::Range<usize>| {
            let clip = clip.slice(frames);
            // away from the origin, with a turned root
            let root = clip.root().iter().map(|p| *p + Vec3::X).collect();
            let turn = |(i, q): (usize, &Quat)| if i % 24 == 0 { Quat::from_rotation_y(1.0) * *q } else { *q };
            let rotations = clip.rotations().iter().enumerate().map(turn).collect();
            Clip::new(clip.skeleton().clone(), 60.0, root, rotations).unwrap()
        };
        let moving = away(&dance, 30..100);
        let mut pose = vec![Quat::IDENTITY; 24];
        pose[16] = Quat::from_rotation_z(1.2);
        let root = [&[Vec3::ZERO], moving.root()].concat();
        let clip = Clip::new(smpl::neutral(), 60.0, root, [&pose, moving.rotations()].concat()).unwrap();
        let folder = tempfile::tempdir().unwrap();
        // an .npz has z up: its rest pose has an unrotated root only to rounding
        for name in [
            "a.json",
            #[cfg(feature = "amass")]
            "a.npz",
        ] {
            let path = folder.path().join(name);
            let motion = Motion::new(&*path, clip.clone());
            format::write(&path, &motion).unwrap();
            let motion = format::read(&path, &ReadOptions { rest: RestFrame::Keep, ..Default::default() }).unwrap();
            assert!(motion.warnings.iter().any(|w| w.kind == "rest_frame"), "{name}: {:?}", motion.warnings);
            let options = ConvertOptions { fps: Some(20.0), ..Default::default() };
            let slow = convert(motion.clone(), &options).unwrap().clip;
            assert_eq!((slow.root()[0], slow.pose(0)), (motion.clip.root()[0], motion.clip.pose(0)), "{name}");
            let without = resample(&motion.clip.slice(1..motion.clip.frames()), 20.0, Method::Auto).unwrap();
            assert_eq!(slow.slice(1..slow.frames()), without, "{name}");
        }
    }

    #[test]
    fn a_dance_on_its_own_rig_keeps_every_joint() {
        let clip = synth::corpus(5, 1, 1.0, 30.0).unwrap().remove(0).clip;
        // hands turn, which no retargeting carries over
        let turn = |(i, q): (usize, &Quat)| if i % 24 == 22 { Quat::from_rotation_x(0.5) } else { *q };
        let rotations: Vec<Quat> = clip.rotations().iter().enumerate().map(turn).collect();
        let dance = Clip::new(clip.skeleton().clone(), 30.0, clip.root().to_vec(), rotations.clone()).unwrap();
        let of = |scale: f64| {
            let offsets = clip.skeleton().offsets().iter().map(|&o| o * scale).collect();
            let (names, parents) = (clip.skeleton().names().to_vec(), clip.skeleton().parents().to_vec());
            let rig = Arc::new(Skeleton::new(names, parents, offsets, clip.skeleton().ends().to_vec()).unwrap());
            let clip = Clip::new(rig, 30.0, clip.root().to_vec(), clip.rotations().to_vec()).unwrap();
            let like = TargetRig::of_motion(Motion::new("like.json", clip)).unwrap();
            on_rig(Motion::new("a.json", dance.clone()), &like).unwrap().clip
        };
        let (same, larger) = (of(1.0 + 1e-6), of(1.1));
        assert_eq!((same.rotations(), same.root()), (&*rotations, dance.root()));
        assert!(same.skeleton() != dance.skeleton() && larger.root() != dance.root());
    }

    #[test]
    fn places() {
        let clip = crate::synth::corpus(1, 1, 2.0, 20.0).unwrap().remove(0).clip;
        let far: Vec<Vec3> = clip.root().iter().map(|p| *p + Vec3::new(3.0, 0.0, -2.0)).collect();
        let clip = Clip::new(clip.skeleton().clone(), 20.0, far, clip.rotations().to_vec()).unwrap();
        let motion = Motion::new("a.json", clip);
        let put = |place| convert(motion.clone(), &ConvertOptions { place, ..Default::default() }).unwrap().clip;
        let (own, origin, still) = (put(Place::Own), put(Place::AtOrigin), put(Place::InPlace));
        assert_eq!(own, motion.clip);
        let first = own.root()[0];
        for (f, p) in own.root().iter().enumerate() {
            assert_eq!(origin.root()[f], Vec3::new(p.x - first.x, p.y, p.z - first.z));
            assert_eq!(still.root()[f], Vec3::new(0.0, p.y, 0.0));
        }
        assert_eq!(still.rotations(), own.rotations());
    }
}
