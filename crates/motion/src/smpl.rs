//! The model rig: SMPL's 24 joints with the bone lengths of a neutral body of this project.

use crate::{Error, Result, Skeleton, Vec3};
use std::sync::{Arc, LazyLock};

/// Joint names, by id.
pub const NAMES: [&str; 24] = [
    "pelvis",
    "left_hip",
    "right_hip",
    "spine1",
    "left_knee",
    "right_knee",
    "spine2",
    "left_ankle",
    "right_ankle",
    "spine3",
    "left_foot",
    "right_foot",
    "neck",
    "left_collar",
    "right_collar",
    "head",
    "left_shoulder",
    "right_shoulder",
    "left_elbow",
    "right_elbow",
    "left_wrist",
    "right_wrist",
    "left_hand",
    "right_hand",
];

/// Parents, by id; -1 for the pelvis.
pub const PARENTS: [i32; 24] = [-1, 0, 0, 0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 9, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21];

/// The joint on the other side, by id; middle joints map to themselves.
pub const MIRROR: [usize; 24] = [0, 2, 1, 3, 5, 4, 6, 8, 7, 9, 11, 10, 12, 14, 13, 15, 17, 16, 19, 18, 21, 20, 23, 22];

/// Hips and shoulders, left and right.
const ACROSS: [(usize, usize); 2] = [(1, 2), (16, 17)];

/// Rest offsets in metres of an adult of 1.70 m, in round figures, in a T-pose.
const OFFSETS: [[f64; 3]; 24] = [
    [0.0, 0.0, 0.0],
    [0.09, -0.08, 0.0],
    [-0.09, -0.08, 0.0],
    [0.0, 0.12, 0.0],
    [0.0, -0.41, 0.0],
    [0.0, -0.41, 0.0],
    [0.0, 0.13, 0.0],
    [0.0, -0.42, -0.03],
    [0.0, -0.42, -0.03],
    [0.0, 0.06, 0.0],
    [0.0, -0.06, 0.13],
    [0.0, -0.06, 0.13],
    [0.0, 0.21, -0.02],
    [0.07, 0.12, -0.01],
    [-0.07, 0.12, -0.01],
    [0.0, 0.09, 0.03],
    [0.11, 0.03, 0.0],
    [-0.11, 0.03, 0.0],
    [0.26, 0.0, 0.0],
    [-0.26, 0.0, 0.0],
    [0.25, 0.0, 0.0],
    [-0.25, 0.0, 0.0],
    [0.08, 0.0, 0.0],
    [-0.08, 0.0, 0.0],
];

/// Height of the pelvis above the floor when the neutral body stands on its foot joints, metres.
pub const STANDING_PELVIS_M: f64 = 0.97;

/// Position of the rest pelvis in SMPL's axes, metres, used without a body model.
pub const REST_PELVIS: Vec3 = Vec3::new(0.00, -0.21, 0.03);

/// Whether a skeleton has SMPL's joints: names and parents.
pub(crate) fn is_rig(skeleton: &Skeleton) -> bool {
    let parents = skeleton.parents().iter().map(|p| p.map_or(-1, |p| p as i32));
    skeleton.names() == NAMES && parents.eq(PARENTS)
}

/// Checks that `what` has SMPL's joints.
///
/// # Errors
/// [`Invalid`](kinelm_store::Error::Invalid) for another skeleton.
pub(crate) fn check_rig(what: &str, skeleton: &Skeleton) -> Result<()> {
    if is_rig(skeleton) {
        return Ok(());
    }
    let found = format!("one of {} joints from {}", skeleton.joints(), skeleton.names()[0]);
    Err(Error::invalid(what.to_string(), found, "SMPL's 24 joints; retarget it first"))
}

/// The neutral skeleton: 24 joints, no end sites.
pub fn neutral() -> Arc<Skeleton> {
    static NEUTRAL: LazyLock<Arc<Skeleton>> = LazyLock::new(|| {
        let names = NAMES.iter().map(|n| n.to_string()).collect();
        let parents = PARENTS.iter().map(|&p| usize::try_from(p).ok()).collect();
        let offsets = OFFSETS.iter().map(|&o| Vec3::from_array(o)).collect();
        Arc::new(Skeleton::new(names, parents, offsets, Vec::new()).expect("the constant tables are a tree"))
    });
    NEUTRAL.clone()
}

/// Where a body on SMPL-24 faces, radians from +z towards +x; `None` where it has no direction on the ground.
///
/// From hips and shoulders together: docs/measures.md, "Space and heading".
///
/// # Panics
/// With fewer than 18 places.
pub fn heading_of(frame: &[Vec3]) -> Option<f64> {
    let across = ACROSS.iter().fold(Vec3::ZERO, |sum, &(left, right)| sum + (frame[left] - frame[right]));
    let forward = across.cross(Vec3::Y);
    let forward = Vec3::new(forward.x, 0.0, forward.z);
    (forward.length() >= 1e-6).then(|| forward.x.atan2(forward.z))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{GlobalPose, Quat};

    #[test]
    fn the_neutral_body_stands_on_its_feet() {
        let s = neutral();
        let p = GlobalPose::new(&s, Vec3::new(0.0, STANDING_PELVIS_M, 0.0), &[Quat::IDENTITY; 24]).positions;
        assert!(p[10].y.abs() < 1e-12 && p[11].y.abs() < 1e-12);
        assert!((p[15].y - 1.58).abs() < 0.021, "head joint at {}", p[15].y);
    }

    #[test]
    fn mirror_is_an_involution_that_respects_the_tree() {
        for j in 0..24 {
            assert_eq!(MIRROR[MIRROR[j]], j);
            if j > 0 {
                assert_eq!(MIRROR[PARENTS[j] as usize], PARENTS[MIRROR[j]] as usize);
            }
        }
    }
}
