//! The T-pose of any rig: its reference pose with straight arms and legs, on the floor.

use crate::format::source::vrm::{PosedBone, TPose, bones_of_roles};
use crate::rig::reference::LIMBS;
use crate::rig::{Feet, Humanoid, ReferencePose};
use crate::rotation::swing;
use crate::{Quat, Result, Vec3};

/// A rig in VRM's T-pose: arms along x, legs straight down, soles on the floor as in its reference pose, the hips at x = z = 0.
///
/// # Errors
/// Those of [`Humanoid::pose`].
pub(super) fn of_rig(humanoid: &Humanoid) -> Result<TPose> {
    let (rig, reference) = (humanoid.rig(), humanoid.pose()?);
    let ReferencePose { joints, mut local, mut global } = reference.into_owned();
    let root = rig.offsets()[0];
    let ankles = [7, 8].map(|id: usize| joints[id].map(|joint| (joint, global.rotations[joint])));
    // `LIMBS` has upper bones before lower ones
    for (upper, lower) in LIMBS {
        let (Some(from), Some(to)) = (joints[upper], joints[lower]) else { continue };
        let towards = match upper {
            16 | 18 => Vec3::X,
            17 | 19 => Vec3::NEG_X,
            _ => Vec3::NEG_Y,
        };
        let straight = swing(global.positions[to] - global.positions[from], towards) * global.rotations[from];
        local[from] = below(rig.parents()[from].map(|p| global.rotations[p]), straight);
        global.set(rig, root, &local);
    }
    for (ankle, turn) in ankles.into_iter().flatten() {
        local[ankle] = below(rig.parents()[ankle].map(|p| global.rotations[p]), turn);
        global.set(rig, root, &local);
    }
    let pose = ReferencePose { joints, local, global };
    let feet = Feet::from_pose(rig, &pose);
    let hips = pose.global.positions[feet.pelvis];
    let moved = Vec3::new(0.0, feet.pelvis_m, 0.0) - hips;
    let posed = |(bone, joint): (usize, usize)| PosedBone {
        bone,
        joint,
        turn: pose.global.rotations[joint],
        place: pose.global.positions[joint] + moved,
    };
    Ok(TPose { bones: bones_of_roles(&pose.joints).into_iter().map(posed).collect(), sole_m: 0.0 })
}

/// A rotation in the world as one below `above`.
fn below(above: Option<Quat>, turn: Quat) -> Quat {
    above.map_or(turn, |above| above.conjugate() * turn).normalize()
}
