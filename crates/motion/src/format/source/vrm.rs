//! VRM's humanoid: its bones, and the T-pose of a rig by them.
//!
//! Source: VRM Consortium, VRMC_vrm-1.0 (humanoid.md, tpose.md) and VRMC_vrm_animation-1.0.

use crate::{Quat, Skeleton, Vec3};
use std::sync::{Arc, LazyLock};

/// A bone of VRM's humanoid. The eyes, which no animation file has, are left out.
#[derive(Debug, PartialEq, Eq)]
pub(crate) struct Bone {
    /// Its name in VRM 1.0.
    pub name: String,
    /// The bone above, by its place in [`bones`]; where a rig lacks it, the one above that is its parent.
    pub parent: Option<usize>,
    /// The SMPL joint that corresponds to it.
    pub smpl_id: Option<usize>,
    /// Whether every humanoid has it.
    pub is_required: bool,
}

/// Name, the bone above, SMPL joint, whether it is required: the middle of the body.
const MIDDLE: [(&str, &str, Option<usize>, bool); 7] = [
    ("hips", "", Some(0), true),
    ("spine", "hips", Some(3), true),
    ("chest", "spine", Some(6), false),
    ("upperChest", "chest", Some(9), false),
    ("neck", "upperChest", Some(12), false),
    ("head", "neck", Some(15), true),
    ("jaw", "head", None, false),
];
/// Those of a side, without `left` or `right`; the SMPL joint is the left one. A bone above that has a side begins with a
/// capital.
const SIDE: [(&str, &str, usize, bool); 8] = [
    ("UpperLeg", "hips", 1, true),
    ("LowerLeg", "UpperLeg", 4, true),
    ("Foot", "LowerLeg", 7, true),
    ("Toes", "Foot", 10, false),
    ("Shoulder", "upperChest", 13, false),
    ("UpperArm", "Shoulder", 16, true),
    ("LowerArm", "UpperArm", 18, true),
    ("Hand", "LowerArm", 20, true),
];
const FINGERS: [&str; 5] = ["Thumb", "Index", "Middle", "Ring", "Little"];

/// The bones, each after the one above it.
pub(crate) fn bones() -> &'static [Bone] {
    static BONES: LazyLock<Vec<Bone>> = LazyLock::new(|| {
        let mut all: Vec<Bone> = Vec::new();
        let mut add = |name: String, parent: &str, smpl_id, is_required| {
            let parent = all.iter().position(|bone| bone.name == parent);
            all.push(Bone { name, parent, smpl_id, is_required });
        };
        for (name, parent, id, is_required) in MIDDLE {
            add(name.to_owned(), parent, id, is_required);
        }
        for (right, side) in ["left", "right"].into_iter().enumerate() {
            for (name, parent, id, is_required) in SIDE {
                let has_side = parent.starts_with(char::is_uppercase);
                let parent = if has_side { format!("{side}{parent}") } else { parent.to_owned() };
                // SMPL's right joint follows its left one
                add(format!("{side}{name}"), &parent, Some(id + right), is_required);
            }
            for finger in FINGERS {
                let mut parent = format!("{side}Hand");
                let parts = if finger == "Thumb" { ["Metacarpal", "Proximal"] } else { ["Proximal", "Intermediate"] };
                for part in parts.into_iter().chain(["Distal"]) {
                    let name = format!("{side}{finger}{part}");
                    add(name.clone(), &parent, None, false);
                    parent = name;
                }
            }
        }
        all
    });
    &BONES
}

/// The place of a bone in [`bones`], by its name in VRM 1.0.
pub(crate) fn bone(name: &str) -> Option<usize> {
    bones().iter().position(|bone| bone.name == name)
}

/// The place of a bone in [`bones`], by its name in VRM 0, which calls the parts of a thumb as those of a finger.
pub(crate) fn bone_of_vrm_0(name: &str) -> Option<usize> {
    match name.split_once("Thumb") {
        Some((side, "Proximal")) => bone(&format!("{side}ThumbMetacarpal")),
        Some((side, "Intermediate")) => bone(&format!("{side}ThumbProximal")),
        _ => bone(name),
    }
}

/// The SMPL joints of a trunk, from the lowest up.
const TRUNK: [usize; 3] = [3, 6, 9];
/// Its bones.
const TRUNK_BONES: [&str; 3] = ["spine", "chest", "upperChest"];

/// By SMPL id: which of these bones is that joint. A trunk of two bones has SMPL's lowest and highest.
pub(crate) fn roles<T: Copy>(of: &[(usize, T)]) -> [Option<T>; 24] {
    let mut roles = [None; 24];
    for &(n, joint) in of {
        if let Some(id) = bones()[n].smpl_id {
            roles[id] = Some(joint);
        }
    }
    if roles[9].is_none() {
        (roles[9], roles[6]) = (roles[6], None);
    }
    roles
}

/// The bones of a rig with these joints by SMPL id. A chest is what is next above the spine, whichever of SMPL's joints.
pub(crate) fn bones_of_roles<T: Copy>(roles: &[Option<T>; 24]) -> Vec<(usize, T)> {
    let trunk = TRUNK
        .iter()
        .filter_map(|&id| roles[id])
        .zip(TRUNK_BONES)
        .filter_map(|(joint, name)| Some((bone(name)?, joint)));
    let others = bones().iter().enumerate().filter_map(|(n, bone)| {
        let id = bone.smpl_id.filter(|id| !TRUNK.contains(id))?;
        Some((n, roles[id]?))
    });
    let mut all: Vec<(usize, T)> = trunk.chain(others).collect();
    all.sort_by_key(|(n, _)| *n);
    all
}

/// A rig in VRM's T-pose: facing +z, soles at y = 0, metres.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct TPose {
    /// The rig's bones, each after the one above it.
    pub bones: Vec<PosedBone>,
    /// How high the lowest joint of its feet is above its soles.
    pub sole_m: f64,
}

/// A joint of a rig that is a bone of VRM's, in the T-pose.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) struct PosedBone {
    /// Which bone, of [`bones`].
    pub bone: usize,
    /// The joint of the rig.
    pub joint: usize,
    /// Its rotation in the world, from the rig's rest pose.
    pub turn: Quat,
    /// Its place in the world.
    pub place: Vec3,
}

impl TPose {
    /// By bone, the place in the list of the nearest bone above that the rig has.
    pub fn parents(&self) -> Vec<Option<usize>> {
        let own = |n: usize| self.bones.iter().position(|bone| bone.bone == n);
        let above = |bone: &PosedBone| {
            let mut next = bones()[bone.bone].parent;
            while let Some(n) = next {
                if own(n).is_some() {
                    return own(n);
                }
                next = bones()[n].parent;
            }
            None
        };
        self.bones.iter().map(above).collect()
    }

    /// The required bones that the rig lacks.
    pub fn missing(&self) -> Vec<&'static str> {
        let has = |n: usize| self.bones.iter().any(|own| own.bone == n);
        let missing = bones().iter().enumerate().filter(|(n, bone)| bone.is_required && !has(*n));
        missing.map(|(_, bone)| bone.name.as_str()).collect()
    }
}

/// The rig of a VRM animation, for writing another one on it.
#[derive(Debug, Clone, PartialEq)]
pub struct VrmaSource {
    /// The rig of its clip.
    pub(crate) skeleton: Arc<Skeleton>,
    /// How it rests.
    pub(crate) pose: TPose,
    /// The floor found before a clip was put on this rig, metres; retargeting doesn't move it.
    pub(crate) floor_m: Option<f64>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_bone_has_the_one_above_it() {
        let bones = bones();
        assert_eq!((bones.len(), bones.iter().filter(|bone| bone.is_required).count()), (53, 15));
        for (n, bone) in bones.iter().enumerate() {
            assert_eq!(bone.parent.is_none(), n == 0, "{}", bone.name);
            assert!(bone.parent.is_none_or(|parent| parent < n), "{}", bone.name);
        }
        let above = |name: &str| bones[bones[bone(name).unwrap()].parent.unwrap()].name.as_str();
        assert_eq!((above("rightShoulder"), above("leftUpperLeg")), ("upperChest", "hips"));
        assert_eq!((above("leftThumbDistal"), above("rightIndexProximal")), ("leftThumbProximal", "rightHand"));
        assert_eq!(bones[bone("rightHand").unwrap()].smpl_id, Some(21));
        assert_eq!(bone_of_vrm_0("leftThumbProximal"), bone("leftThumbMetacarpal"));
        assert_eq!(bone_of_vrm_0("rightThumbIntermediate"), bone("rightThumbProximal"));
        assert_eq!((bone("leftEye"), bone_of_vrm_0("leftThumbDistal")), (None, bone("leftThumbDistal")));
    }

    #[test]
    fn a_trunk_of_two_joints_is_spine_and_chest() {
        let named = |of: &[(usize, usize)]| of.iter().map(|(n, j)| (bones()[*n].name.as_str(), *j)).collect::<Vec<_>>();
        let mut own = [None; 24];
        (own[0], own[3], own[9]) = (Some(5), Some(6), Some(7));
        let two = bones_of_roles(&own);
        assert_eq!(named(&two), [("hips", 5), ("spine", 6), ("chest", 7)]);
        assert_eq!(roles(&two), own);
        own[6] = Some(8);
        let three = bones_of_roles(&own);
        assert_eq!(named(&three), [("hips", 5), ("spine", 6), ("chest", 8), ("upperChest", 7)]);
        assert_eq!(roles(&three), own);
    }
}
