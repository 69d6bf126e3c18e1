//! One file to a clip that a tokenizer takes.

use super::gather::Item;
use super::record::{Jumps, hex};
use crate::{Error, Result};
use kinelm_motion::format::{self, ReadOptions, RestFrame};
use kinelm_motion::inspect::figures::{JOINT_JUMP_RAD, root_jumps};
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::rotation::angle_between;
use kinelm_motion::{Clip, Motion, retarget};
use sha2::{Digest, Sha256};
use std::fs::File;
use std::path::Path;

/// A clip on the 24 SMPL joints at the rate wanted.
#[derive(Debug, Clone)]
pub struct Loaded {
    /// What moves.
    pub clip: Clip,
    /// As it was read: the file's rig and rate, and what was odd.
    pub motion: Motion,
    /// SHA-256 of the file.
    pub sha256: String,
    /// The frame of the file that `motion` begins with.
    pub first_frame: usize,
}

impl Loaded {
    /// Steps of the root and of joints in the source that no body makes, in centimetres and degrees: of the root those
    /// of [`root_jumps`]; of joints those of more than 25 degrees in one frame and 1,500 degrees a second, whatever
    /// stands around them, because joints that flicker do so frame after frame.
    pub fn jumps(&self) -> [Option<Jumps>; 2] {
        let clip = &self.motion.clip;
        let names = clip.skeleton().names();
        let root = root_jumps(clip).into_iter().map(|(frame, metres)| (frame, 0, metres * 100.0)).collect();
        let joints = joint_jumps(clip).into_iter().map(|(frame, j, angle)| (frame, j, angle.to_degrees())).collect();
        [root, joints].map(|steps: Vec<(usize, usize, f64)>| {
            let &(frame, joint, largest) = steps.iter().max_by(|a, b| a.2.total_cmp(&b.2))?;
            let frame = frame + self.first_frame;
            let largest = (largest * 100.0).round() / 100.0;
            Some(Jumps { steps: steps.len(), largest, frame, joint: names[joint].clone() })
        })
    }
}

/// Reads an item's file, brings it onto the neutral SMPL-24 body and to `fps` frames per second. The rate and the
/// frames to skip that the item's labels state overrule those of `options`.
///
/// # Errors
/// What reading and retargeting fail with, the file named; [`Error::File`] for a clip without frames.
pub fn load_item(item: &Item, options: &ReadOptions, fps: f64) -> Result<Loaded> {
    let options = item_options(item, options);
    let (motion, clip) = load_clip(&item.path, &options, fps)?;
    if clip.frames() == 0 {
        return Err(Error::file(&item.path, "no frames", "at least one", ""));
    }
    let rest = options.rest == RestFrame::Drop && motion.warnings.iter().any(|w| w.kind == "rest_frame");
    let first_frame = options.skip + usize::from(rest);
    Ok(Loaded { clip, sha256: hash_file(&item.path)?, motion, first_frame })
}

/// A file on the neutral SMPL-24 body at `fps` frames per second, and the motion as it was read.
///
/// # Errors
/// What reading and retargeting fail with, the file named.
pub fn load_clip(path: &Path, options: &ReadOptions, fps: f64) -> Result<(Motion, Clip)> {
    let motion = format::read(path, options)?;
    let clip = retarget::to_smpl(&motion, options.map.as_deref())?;
    let clip = resample(&clip, fps, Method::Auto)?;
    Ok((motion, clip))
}

/// The reading options with what the item's labels state.
pub fn item_options(item: &Item, options: &ReadOptions) -> ReadOptions {
    ReadOptions {
        fps_source: item.fps.or(options.fps_source),
        skip: item.skip.unwrap_or(options.skip),
        ..options.clone()
    }
}

/// No joint turns faster, degrees a second: 25 degrees in a frame at 60 fps.
const JOINT_SPEED_DEG_S: f64 = 1500.0;

/// The frame that a step leads to, the joint, and radians.
fn joint_jumps(clip: &Clip) -> Vec<(usize, usize, f64)> {
    let limit = JOINT_JUMP_RAD.max(JOINT_SPEED_DEG_S.to_radians() / clip.fps());
    // half the angle, by the dot product: enough to pass over nearly all steps
    let near = (limit / 2.0).cos() + 1e-6;
    let mut found = Vec::new();
    for frame in 1..clip.frames() {
        for (joint, (a, b)) in clip.pose(frame - 1).iter().zip(clip.pose(frame)).enumerate() {
            if a.dot(*b).abs() < near {
                let angle = angle_between(*a, *b);
                if angle > limit {
                    found.push((frame, joint, angle));
                }
            }
        }
    }
    found
}

fn hash_file(path: &Path) -> Result<String> {
    let mut hash = Sha256::new();
    let mut file = File::open(path).map_err(Error::io(path))?;
    std::io::copy(&mut file, &mut hash).map_err(Error::io(path))?;
    Ok(hex(hash))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn labels_overrule_the_options() {
        let options = ReadOptions { fps_source: Some(30.0), skip: 3, lenient: true, ..ReadOptions::default() };
        let read = item_options(&Item::default(), &options);
        assert_eq!(read, options);
        let read = item_options(&Item { fps: Some(60.0), skip: Some(0), ..Item::default() }, &options);
        assert_eq!((read.fps_source, read.skip, read.lenient), (Some(60.0), 0, true));
    }

    #[test]
    fn a_salsa_is_read_at_its_true_rate() {
        let Some(dir) = kinelm_shared_data::set("cmu-dance", "corpus::load") else { return };
        let item = Item { path: dir.join("salsa/01.bvh"), fps: Some(60.0), ..Item::default() };
        let options = ReadOptions { skip: 10, ..ReadOptions::default() };
        let loaded = load_item(&item, &options, 20.0).unwrap();
        let source = format::read(&item.path, &ReadOptions::default()).unwrap().clip.frames();
        assert_eq!(loaded.clip.frames(), (source - 10 - 1) / 3 + 1);
        assert_eq!((loaded.clip.joints(), loaded.clip.fps(), loaded.sha256.len()), (24, 20.0, 64));
    }

    #[test]
    fn the_glitches_of_the_salsas_are_found() {
        let Some(dir) = kinelm_shared_data::set("cmu-dance", "corpus::load jumps") else { return };
        let load = |clip: &str, skip, fps| {
            let item = Item { path: dir.join(clip), fps: Some(fps), ..Item::default() };
            load_item(&item, &ReadOptions { skip, rest: RestFrame::Drop, ..ReadOptions::default() }, 20.0).unwrap()
        };
        // the data's README: root steps above 5 cm in these, the largest of all 17.3 cm
        let mut largest: f64 = 0.0;
        for n in ["03", "04", "06", "09", "10", "13", "15"] {
            let [root, _] = load(&format!("salsa/{n}.bvh"), 10, 60.0).jumps();
            let root = root.unwrap_or_else(|| panic!("salsa/{n}"));
            assert!(root.frame > 10 && root.largest > 5.0 && root.joint == "hip", "salsa/{n}: {root:?}");
            largest = largest.max(root.largest);
        }
        assert!((largest - 17.3).abs() < 0.05, "{largest}");
        let [root, joints] = load("indian/07.bvh", 10, 120.0).jumps();
        assert_eq!(root, None);
        let joints = joints.expect("the README counts 56 frames, of both thighs");
        assert!(joints.steps >= 56 && joints.joint.ends_with("Thigh"), "{joints:?}");
        // frames count from the file's first, whether it was skipped or dropped as a rest pose
        assert_eq!(load("salsa/04.bvh", 0, 60.0).first_frame, 1);
        let frame = |skip| load("salsa/04.bvh", skip, 60.0).jumps()[0].clone().map(|j| j.frame);
        assert_eq!(frame(10), frame(20));
    }
}
