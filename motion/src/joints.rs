//! Groups and subsets of the SMPL joints.

use crate::retarget;
use crate::suggest::did_you_mean;
use crate::{Error, Result, Skeleton, smpl};

/// The thesis's thirteen joints, by id.
pub const THIRTEEN: [usize; 13] = [0, 1, 2, 4, 5, 7, 8, 16, 17, 18, 19, 20, 21];

/// Those and what bends the trunk: `spine1`, `spine3`, `neck` and the collars, by id. On CMU's rig no
/// joint stands elsewhere than with all 24; with the thirteen hands are 10 to 20 cm off.
pub const EIGHTEEN: [usize; 18] = [0, 1, 2, 3, 4, 5, 7, 8, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21];

/// Hip, knee, ankle and ball of the left leg, then of the right.
pub const LEGS: [[usize; 4]; 2] = [[1, 4, 7, 10], [2, 5, 8, 11]];

/// The groups by name.
pub const GROUPS: &[(&str, &[usize])] = &[
    ("root", &[0]),
    ("left_leg", &LEGS[0]),
    ("right_leg", &LEGS[1]),
    ("legs", &[1, 2, 4, 5, 7, 8, 10, 11]),
    ("left_arm", &[13, 16, 18, 20, 22]),
    ("right_arm", &[14, 17, 19, 21, 23]),
    ("arms", &[13, 14, 16, 17, 18, 19, 20, 21, 22, 23]),
    ("hands", &[20, 21, 22, 23]),
    ("feet", &[7, 8, 10, 11]),
    ("spine", &[3, 6, 9]),
    ("torso", &[0, 3, 6, 9]),
    ("head", &[12, 15]),
    ("upper_body", &[3, 6, 9, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23]),
    ("lower_body", &[0, 1, 2, 4, 5, 7, 8, 10, 11]),
    ("all", &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23]),
];

/// A set of SMPL joints.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Selection {
    /// Ids, ascending, each once.
    pub joints: Vec<usize>,
    /// Whether the root's translation belongs to it: when `root`, `all`, `24`, `18` or `13` is named, but not with the bare joint
    /// `pelvis` nor with the groups that hold joint 0 among others.
    pub translation: bool,
}

/// The joints of a list such as `13`, `18`, `24`, `root,right_arm`, `left_knee,7`.
///
/// Parts are the numbers `13`, `18` and `24` alone, groups of [`GROUPS`], SMPL joint names, or ids. `head` alone is the group.
/// Where a name is both, it is SMPL's; `rig:NAME` is a rig's own alone, which [`in_smpl_names`] takes.
///
/// # Errors
/// [`Error::Call`] naming the part that is none of these, with what there is.
pub fn parse(list: &str) -> Result<Selection> {
    match list.trim() {
        "13" => return Ok(Selection { joints: THIRTEEN.to_vec(), translation: true }),
        "18" => return Ok(Selection { joints: EIGHTEEN.to_vec(), translation: true }),
        "24" => return Ok(Selection { joints: (0..24).collect(), translation: true }),
        _ => {}
    }
    let mut selection = Selection { joints: Vec::new(), translation: false };
    for part in parts(list) {
        if let Some((name, ids)) = GROUPS.iter().find(|(n, _)| *n == part) {
            selection.joints.extend_from_slice(ids);
            selection.translation |= matches!(*name, "root" | "all");
        } else if let Some(id) = smpl::NAMES.iter().position(|n| *n == part) {
            selection.joints.push(id);
        } else if let Some(id) = part.parse::<usize>().ok().filter(|&id| id < 24) {
            selection.joints.push(id);
        } else {
            return Err(unknown(part, &[]));
        }
    }
    selection.joints.sort_unstable();
    selection.joints.dedup();
    Ok(selection)
}

/// The parts of a list between its commas; in `rig:"NAME"` the name may have some.
fn parts(list: &str) -> impl Iterator<Item = &str> {
    let mut quoted = false;
    let apart = move |c: char| {
        quoted ^= c == '"';
        c == ',' && !quoted
    };
    list.split(apart).map(str::trim)
}

/// NAME of `rig:"NAME"` or `rig:NAME`.
fn of_rig_alone(part: &str) -> Option<&str> {
    let name = part.strip_prefix(RIG)?;
    Some(name.strip_prefix('"').and_then(|name| name.strip_suffix('"')).unwrap_or(name))
}

/// In front of a name that is a rig's own.
const RIG: &str = "rig:";

/// The names of a rig's joints, each with the SMPL joint that it stands for.
fn own_names<'a>(rig: &'a Skeleton, map: Option<&str>) -> Option<Vec<(&'a str, Option<usize>)>> {
    let map = retarget::map_for(rig, map).ok()?;
    let map = map.bind(rig.names()).unwrap_or(map);
    let stands_for = |name: &str| (0..24).find(|&id| map.joint(id) == Some(name));
    Some(rig.names().iter().map(|n| (n.as_str(), stands_for(n))).collect())
}

/// A list in which joints of a rig may stand by its own names, such as `root,RightArm` or `rig:"Head"`, as a list that
/// [`parse`] takes: each becomes the SMPL joint that it stands for. What is a part without a rig stays as it is.
///
/// # Errors
/// As [`parse`]; a joint of the rig that stands for no SMPL joint.
pub fn in_smpl_names(list: &str, rig: &Skeleton, map: Option<&str>) -> Result<String> {
    let known = parse(list);
    let own = match own_names(rig, map) {
        Some(own) if known.is_err() => own,
        _ => return known.map(|_| list.to_owned()),
    };
    let with: Vec<&str> = own.iter().filter(|(_, id)| id.is_some()).map(|(n, _)| *n).collect();
    let in_smpl = |part: &str| {
        let name = match of_rig_alone(part) {
            None if parse(part).is_ok() => return Ok(part.to_owned()),
            name => name.unwrap_or(part),
        };
        match own.iter().find(|(n, _)| *n == name) {
            // the joint `head` by its id: its name means the group
            Some((_, Some(id))) if GROUPS.iter().any(|(n, _)| *n == smpl::NAMES[*id]) => Ok(id.to_string()),
            Some((_, Some(id))) => Ok(smpl::NAMES[*id].to_owned()),
            Some((name, None)) => Err(Error::Call(format!(
                "{name} of the rig stands for no SMPL joint; joints that do are {}",
                with.join(" ")
            ))),
            None if of_rig_alone(part).is_some() => {
                let meant = did_you_mean(name, with.iter().copied());
                Err(Error::Call(format!("no joint {name:?} in the rig{meant}; its own are {}", with.join(" "))))
            }
            None => Err(unknown(name, &with)),
        }
    };
    Ok(parts(list).map(in_smpl).collect::<Result<Vec<_>>>()?.join(","))
}

/// The parts of a list that are SMPL's and a rig's own at once and mean other joints there: `(part, SMPL's name of the rig's)`.
pub fn meant_twice(list: &str, rig: &Skeleton, map: Option<&str>) -> Vec<(String, &'static str)> {
    let own = own_names(rig, map).unwrap_or_default();
    let other = |part: &str| {
        let (_, id) = own.iter().find(|(name, _)| *name == part)?;
        let meant = parse(part).ok()?.joints;
        id.filter(|id| meant != [*id]).map(|id| (part.to_owned(), smpl::NAMES[id]))
    };
    parts(list).filter_map(other).collect()
}

/// What is said of such a part.
pub fn say_meant_twice(part: &str, own: &str) -> String {
    format!("{part} is SMPL's here; the rig's own joint of that name, its {own}, is rig:{part}")
}

/// What a part of a list is told that is nothing, with the rig's own names if there is one.
fn unknown(part: &str, own: &[&str]) -> Error {
    let groups: Vec<_> = GROUPS.iter().map(|(n, _)| *n).collect();
    let names = groups.iter().chain(&smpl::NAMES).chain(own).copied();
    let meant = did_you_mean(part, names);
    let own = if own.is_empty() { String::new() } else { format!("; the rig's own are {}", own.join(" ")) };
    let (groups, joints) = (groups.join(" "), smpl::NAMES.join(" "));
    Error::Call(format!("no joint or group {part:?}{meant}; groups are {groups}; joints are {joints}{own}"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists() {
        assert_eq!(parse("13").unwrap().joints, THIRTEEN);
        let trunk = parse("spine1,spine3,neck,left_collar,right_collar").unwrap().joints;
        let mut more = [THIRTEEN.as_slice(), &trunk].concat();
        more.sort_unstable();
        assert_eq!(parse("18").unwrap(), Selection { joints: more, translation: true });
        assert_eq!(
            parse("root, right_arm").unwrap(),
            Selection { joints: vec![0, 14, 17, 19, 21, 23], translation: true }
        );
        assert_eq!(parse("7,left_knee").unwrap(), Selection { joints: vec![4, 7], translation: false });
        assert!(parse("left_wing").unwrap_err().to_string().contains("left_wing"));
        assert!(parse("").is_err());
        assert!(parse("24,0").is_err());
    }

    #[test]
    fn new_groups_and_slips_of_the_hand() {
        assert_eq!(parse("hands,feet").unwrap().joints, [7, 8, 10, 11, 20, 21, 22, 23]);
        assert_eq!(parse("spine").unwrap(), Selection { joints: vec![3, 6, 9], translation: false });
        let message = parse("root,rigth_arm").unwrap_err().to_string();
        assert!(message.contains("no joint or group \"rigth_arm\"; did you mean right_arm?; groups are"), "{message}");
        assert!(!parse("wing").unwrap_err().to_string().contains("did you mean"));
    }

    /// A rig by its joints and their parents.
    fn rig(joints: &[(&str, Option<usize>)]) -> Skeleton {
        let (names, parents) = joints.iter().map(|(n, p)| ((*n).to_owned(), *p)).unzip();
        Skeleton::new(names, parents, vec![crate::Vec3::ZERO; joints.len()], Vec::new()).unwrap()
    }

    #[test]
    fn a_rig_s_own_names_stand_for_smpl_joints() {
        let bandai = rig(&[
            ("joint_Root", None),
            ("Hips", Some(0)),
            ("Spine", Some(1)),
            ("Chest", Some(2)),
            ("Neck", Some(3)),
            ("Head", Some(4)),
            ("UpperArm_L", Some(3)),
            ("LowerArm_L", Some(6)),
            ("Hand_L", Some(7)),
            ("UpperArm_R", Some(3)),
            ("LowerArm_R", Some(9)),
            ("Hand_R", Some(10)),
            ("UpperLeg_L", Some(1)),
            ("LowerLeg_L", Some(12)),
            ("Foot_L", Some(13)),
            ("UpperLeg_R", Some(1)),
            ("LowerLeg_R", Some(15)),
            ("Foot_R", Some(16)),
        ]);
        let of = |list: &str| in_smpl_names(list, &bandai, None);
        assert_eq!(of("root, UpperArm_R,LowerArm_R").unwrap(), "root,right_shoulder,right_elbow");
        // a group is the group, whatever joints the rig has; what needs no rig is left alone
        assert_eq!([of("head,Hand_R").unwrap(), of("13").unwrap()], ["head,right_wrist", "13"]);
        assert_eq!(of("Head,Chest").unwrap(), "15,spine3");
        assert_eq!(of("rig:Head, rig:\"Hand_R\",hands").unwrap(), "15,right_wrist,hands");
        let message = of("rig:head").unwrap_err().to_string();
        assert!(message.contains("no joint \"head\" in the rig") && !message.contains("groups"), "{message}");
        assert!(parse("rig:Head").is_err());
        let message = of("joint_Root").unwrap_err().to_string();
        assert!(
            message.contains("joint_Root of the rig stands for no SMPL joint; joints that do are Hips"),
            "{message}"
        );
        let message = of("UperArm_R").unwrap_err().to_string();
        assert!(
            message.contains("did you mean UpperArm_R?") && message.contains("the rig's own are Hips"),
            "{message}"
        );
        assert!(in_smpl_names("tail", &rig(&[("a", None)]), None).is_err());
        assert_eq!(in_smpl_names("legs", &rig(&[("a", None)]), None).unwrap(), "legs");
        // the smpl rig's own head is the joint, and `head` the group
        let smpl = smpl::neutral();
        assert_eq!(meant_twice("head,left_knee,legs", &smpl, None), [("head".to_owned(), "head")]);
        assert_eq!(in_smpl_names("rig:head,left_knee", &smpl, None).unwrap(), "15,left_knee");
    }

    #[test]
    fn groups_are_mirror_images() {
        let of = |n: &str| parse(n).unwrap().joints;
        for (l, r) in [("left_leg", "right_leg"), ("left_arm", "right_arm")] {
            let mut m: Vec<_> = of(l).iter().map(|&j| smpl::MIRROR[j]).collect();
            m.sort_unstable();
            assert_eq!(m, of(r));
        }
    }
}
