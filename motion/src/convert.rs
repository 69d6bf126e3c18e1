//! From a file's motion to the rig, rate and joints wanted.

#[cfg(feature = "amass")]
use crate::format::body_model::BodyModel;
use crate::format::{self, ReadOptions};
use crate::joints::Selection;
use crate::resample::{Method, resample};
use crate::retarget::{self, Retarget, SkeletonMap};
use crate::{Clip, Error, Motion, Quat, Result, Skeleton, Source, smpl};
use std::path::Path;
use std::sync::Arc;

/// A rig that motion can be put on.
#[derive(Debug, Clone)]
pub enum Rig {
    /// The 24 SMPL joints with these offsets.
    Smpl(Arc<Skeleton>),
    /// The rig of a motion file.
    Like(Box<Motion>),
}

impl Rig {
    /// The rig of `smpl` (the neutral body), of a body model (`SMPL_*.npz`), or of a motion file.
    ///
    /// # Errors
    /// [`Error::Call`] when it is none of these, and what reading the file fails with.
    pub fn find(name_or_path: &str, options: &ReadOptions) -> Result<Rig> {
        if name_or_path == "smpl" {
            return Ok(Rig::Smpl(smpl::neutral()));
        }
        let path = Path::new(name_or_path);
        if let Some(map) = SkeletonMap::builtin(name_or_path).filter(|_| !path.exists()) {
            return Err(Error::Call(format!(
                "{} is a map of joint names, it has no bones; give a motion file of that rig instead",
                map.name
            )));
        }
        if !path.exists() {
            return Err(Error::Call(format!(
                "no rig {name_or_path:?}; expected smpl, a body model (SMPL_*.npz), or a motion file whose rig is meant"
            )));
        }
        let bytes = std::fs::read(path).map_err(Error::io(path))?;
        #[cfg(feature = "amass")]
        if let Ok(body) = BodyModel::parse(path, &bytes).and_then(|model| model.body(&[])) {
            return Ok(Rig::Smpl(body.skeleton));
        }
        Ok(Rig::Like(Box::new(format::parse(path, &bytes, options)?)))
    }
}

/// What is to become of a motion.
#[derive(Debug, Clone, Default)]
pub struct Wanted {
    /// Frames per second.
    pub fps: Option<f64>,
    /// The rig; the motion's own if none is given.
    pub rig: Option<Rig>,
    /// The joints that go on moving, on the SMPL body; the others stand at rest.
    pub joints: Option<Selection>,
}

/// The motion on the rig, at the rate, with the joints wanted. With nothing wanted it is the motion itself.
///
/// Joints are chosen on the SMPL body, so with `joints` and no rig the motion is put on it.
///
/// # Errors
/// A rig that no skeleton map knows, and a rate that is none.
pub fn convert(motion: Motion, wanted: &Wanted, map: Option<&str>) -> Result<Motion> {
    let mut motion = motion;
    let neutral = wanted.joints.is_some().then(|| Rig::Smpl(smpl::neutral()));
    if let Some(selection) = &wanted.joints {
        motion.clip = keep_joints(&retarget::to_smpl(&motion, map)?, selection)?;
        motion.source = Source::Plain;
    }
    if let Some(rig) = wanted.rig.as_ref().or(neutral.as_ref()) {
        motion = on_rig(motion, rig, map)?;
    }
    if let Some(fps) = wanted.fps {
        motion.clip = resample(&motion.clip, fps, Method::Auto)?;
    }
    Ok(motion)
}

/// The motion on another rig, by way of SMPL-24.
///
/// # Errors
/// A rig that no skeleton map knows.
pub fn on_rig(motion: Motion, rig: &Rig, map: Option<&str>) -> Result<Motion> {
    match rig {
        Rig::Smpl(body) => {
            let clip = retarget::to_smpl(&motion, map)?;
            let clip = if clip.skeleton() == body {
                clip
            } else {
                // positions grow with the legs, as they do from any rig to another
                let neutral = retarget::map_for(clip.skeleton(), Some("smpl"))?;
                Retarget::new(clip.skeleton(), &neutral, body.clone())?.to_smpl(&clip)?
            };
            Ok(Motion { clip, source: Source::Plain, ..motion })
        }
        Rig::Like(like) => {
            let clip = retarget::to_smpl(&motion, map)?;
            let to = like.clip.skeleton();
            let back = Retarget::new(to, &retarget::map_for(to, map)?, clip.skeleton().clone())?;
            Ok(Motion { clip: back.to_rig(&clip)?, source: like.source.clone(), ..motion })
        }
    }
}

/// A clip on SMPL-24 whose other joints stand at rest.
fn keep_joints(clip: &Clip, selection: &Selection) -> Result<Clip> {
    let keep = |(i, &q): (usize, &Quat)| if selection.joints.contains(&(i % 24)) { q } else { Quat::IDENTITY };
    let rotations = clip.rotations().iter().enumerate().map(keep).collect();
    Clip::new(clip.skeleton().clone(), clip.fps(), clip.root().to_vec(), rotations)
}
