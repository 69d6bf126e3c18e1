//! What a file of VRM's says of its figure: which joint is which, and how it stands in the T-pose.

use super::super::file::humanoid::{Humanoid, Kind};
use super::super::file::tree::{Tree, split};
use crate::format::posed::Figure;
use crate::format::source::vrm::{PosedBone, TPose, roles};
use crate::rig::Feet;
use crate::{Quat, Warning};

/// Half a turn about y: VRM 0 looks along -z.
const ABOUT: Quat = Quat::from_xyzw(0.0, 1.0, 0.0, 0.0);

/// The warning about a face and a gaze, which no clip has.
pub(super) fn face_dropped() -> Warning {
    Warning { kind: "face_dropped", what: "expressions and gaze of the animation are left out".into() }
}

/// By SMPL id, which of these nodes is the joint.
pub(super) fn roles_of(humanoid: &Humanoid, joints: &[usize]) -> [Option<usize>; 24] {
    let place = |&(bone, node): &(usize, usize)| Some((bone, joints.iter().position(|&j| j == node)?));
    roles(&humanoid.bones.iter().filter_map(place).collect::<Vec<_>>())
}

/// The T-pose, in which by its specification a file of VRM's is saved, of a clip's joints: of the figure's `joints`, those
/// that `of_clip` names. Lengths are in so many metres; feet are those of the clip's rig, where they are known.
pub(super) fn pose(
    humanoid: &Humanoid,
    tree: &Tree,
    (figure, joints, of_clip): (&Figure, &[usize], &[usize]),
    (metres, feet): (f64, Option<Feet>),
) -> TPose {
    let world = tree.world(None);
    let about = if humanoid.kind == Kind::Vrm0 { ABOUT } else { Quat::IDENTITY };
    let posed = |&(bone, node): &(usize, usize)| {
        let of_figure = joints.iter().position(|&j| j == node)?;
        let joint = of_clip.iter().position(|&j| j == of_figure)?;
        let (turn, place) = split(&world[node]);
        let turn = (about * turn * figure.rest[of_figure].0.inverse()).normalize();
        Some(PosedBone { bone, joint, turn, place: about * place * metres })
    };
    let bones: Vec<PosedBone> = humanoid.bones.iter().filter_map(posed).collect();
    // soles are at 0, and the clip's rig ends at a joint of its feet
    let above = |feet: Feet| Some(bones.iter().find(|bone| bone.joint == feet.pelvis)?.place.y - feet.pelvis_m);
    let sole_m = feet.and_then(above).unwrap_or(0.0);
    TPose { bones, sole_m }
}
