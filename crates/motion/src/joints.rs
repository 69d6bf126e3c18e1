//! Named groups and selections of the SMPL joints.

use crate::rig::{SkeletonMap, map::without_namespace};
use crate::{Error, Result, Skeleton, smpl};
use kinelm_store::suggest::did_you_mean;

/// The thirteen joints of the thesis, by id.
pub const THIRTEEN: [usize; 13] = [0, 1, 2, 4, 5, 7, 8, 16, 17, 18, 19, 20, 21];

/// The thirteen and the joints that bend the trunk: `spine1`, `spine3`, `neck` and the collars, by id. They reproduce
/// all joint positions of CMU's rig; with the thirteen alone hands are 10 to 20 cm off.
pub const EIGHTEEN: [usize; 18] = [0, 1, 2, 3, 4, 5, 7, 8, 9, 12, 13, 14, 16, 17, 18, 19, 20, 21];

/// Hip, knee, ankle and ball of the left leg, then of the right.
pub const LEGS: [[usize; 4]; 2] = [[1, 4, 7, 10], [2, 5, 8, 11]];

/// Joint groups by name.
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

/// Groups of [`GROUPS`] that divide the body: every joint is in one.
pub const PARTS: [&str; 7] = ["root", "spine", "head", "left_arm", "right_arm", "left_leg", "right_leg"];

/// The SMPL ids of a group of [`GROUPS`]; none for another name.
pub fn group(name: &str) -> &'static [usize] {
    GROUPS.iter().find(|(group, _)| *group == name).map_or(&[], |(_, ids)| ids)
}

/// The group of [`PARTS`] that an SMPL joint is in; `None` for other ids.
pub fn part_of(id: usize) -> Option<&'static str> {
    PARTS.into_iter().find(|part| group(part).contains(&id))
}

/// A list for [`parse`] of SMPL ids, in as few groups as it takes. The pelvis is `root`, with its translation.
///
/// ```
/// use kinelm_motion::joints;
///
/// assert_eq!(joints::list_of(&[0, 3, 6, 9, 13, 16, 18, 20, 22, 5]), "root,left_arm,spine,right_knee");
/// assert_eq!(joints::list_of(&(0..24).collect::<Vec<_>>()), "all");
/// ```
pub fn list_of(ids: &[usize]) -> String {
    let mut left: Vec<usize> = (0..smpl::NAMES.len()).filter(|id| ids.contains(id)).collect();
    let mut names = Vec::new();
    // the torso's pelvis comes without a translation
    let mut groups: Vec<_> = GROUPS.iter().filter(|(name, _)| !["torso", "lower_body"].contains(name)).collect();
    // largest first, so that few names suffice; `root` early, since only it brings the translation
    groups.sort_by_key(|(name, ids)| (*name != "all", *name != "root", std::cmp::Reverse(ids.len())));
    for (name, ids) in groups {
        if ids.iter().all(|id| left.contains(id)) {
            names.push((*name).to_owned());
            left.retain(|id| !ids.contains(id));
        }
    }
    // the joint `head` is an id, because its name is a group's
    let of_joint = |id: usize| match by_exact_name(smpl::NAMES[id]) {
        Some(found) if found.joints == [id] => smpl::NAMES[id].to_owned(),
        _ => id.to_string(),
    };
    names.extend(left.into_iter().map(of_joint));
    names.join(",")
}

/// (J) the SMPL joint that each joint of a rig stands for.
pub fn smpl_ids(rig: &Skeleton, map: &SkeletonMap) -> Vec<Option<usize>> {
    let bound = map.bind(rig.names());
    let map = bound.as_ref().unwrap_or(map);
    rig.names().iter().map(|name| (0..smpl::NAMES.len()).find(|&id| map.joint(id) == Some(name))).collect()
}

/// A selection of SMPL joints, and of what the root does.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Selection {
    /// Joint ids, ascending, without duplicates.
    pub joints: Vec<usize>,
    /// Whether the way over the floor is selected, x, z and the turn about the vertical: by `path`, `root`, `all`, `24`, `18`
    /// or `13`, but not by the joint `pelvis` or by a group that merely contains joint 0.
    pub path: bool,
    /// Whether the root's height is selected: by `height`, and by all that has the root with its path.
    pub height: bool,
    /// Whether the pelvis's tilt is selected without its turn: by `tilt`. With joint 0 it is selected anyway.
    pub tilt: bool,
}

/// What the root does, by name; the pelvis as a joint is `pelvis`, and all of it is `root`.
pub const ROOT_PARTS: [&str; 3] = ["path", "height", "tilt"];

impl Selection {
    /// Joints, of which the root comes with its path and height.
    pub fn of(joints: Vec<usize>) -> Selection {
        let root = joints.contains(&0);
        Selection { joints, path: root, height: root, tilt: false }
    }

    /// Joints without path and height.
    pub fn in_place(joints: Vec<usize>) -> Selection {
        Selection { joints, ..Selection::default() }
    }

    /// Whether a part of the root is selected without the pelvis as a joint.
    pub fn has_part_of_root(&self) -> bool {
        (self.path || self.height || self.tilt) && !self.joints.contains(&0)
    }
}

/// Parses a joint list such as `13`, `18`, `24`, `root,right_arm` or `left_knee,7`.
///
/// The list is one of the numbers `13`, `18` and `24`, or parts separated by commas: a group of [`GROUPS`], one of
/// [`ROOT_PARTS`], an SMPL joint name in any letter case, or a joint id. `head` is the group. Names of another rig, also as
/// `rig:NAME`, must be translated first by [`to_smpl_names`].
///
/// # Errors
/// [`Unsupported`](kinelm_store::Error::Unsupported) for an unknown part; the message lists groups and joints.
///
/// ```
/// use kinelm_motion::joints;
///
/// let legs = joints::parse("left_leg,right_knee")?;
/// assert_eq!(legs.joints, [1, 4, 5, 7, 10]);
/// assert!(joints::parse("left_wing").is_err());
/// # Ok::<(), kinelm_motion::Error>(())
/// ```
pub fn parse(list: &str) -> Result<Selection> {
    match list.trim() {
        "13" => return Ok(Selection::of(THIRTEEN.to_vec())),
        "18" => return Ok(Selection::of(EIGHTEEN.to_vec())),
        "24" => return Ok(Selection::of((0..24).collect())),
        _ => {}
    }
    let mut selection = Selection::default();
    for part in parts(list) {
        let found = by_exact_name(part).or_else(|| parse_part(part, str::eq_ignore_ascii_case));
        let found = found.ok_or_else(|| unknown(part, &[]))?;
        selection.joints.extend(found.joints);
        selection.path |= found.path;
        selection.height |= found.height;
        selection.tilt |= found.tilt;
    }
    selection.joints.sort_unstable();
    selection.joints.dedup();
    Ok(selection)
}

/// Splits a list at its commas, but not inside the quotes of `rig:"NAME"`.
fn parts(list: &str) -> impl Iterator<Item = &str> {
    let mut quoted = false;
    let separates = move |c: char| {
        quoted ^= c == '"';
        c == ',' && !quoted
    };
    list.split(separates).map(str::trim)
}

/// The NAME in `rig:"NAME"` or `rig:NAME`.
fn rig_name(part: &str) -> Option<&str> {
    let name = part.strip_prefix(RIG)?;
    Some(name.strip_prefix('"').and_then(|name| name.strip_suffix('"')).unwrap_or(name))
}

/// The prefix of a name that belongs to the rig.
const RIG: &str = "rig:";

/// The names of the rig's joints with the ids of the SMPL joints that they map to.
fn rig_joints<'a>(rig: &'a Skeleton, map: Option<&SkeletonMap>) -> Option<Vec<(&'a str, Option<usize>)>> {
    let ids = smpl_ids(rig, map?);
    Some(rig.names().iter().map(String::as_str).zip(ids).collect())
}

/// Translates a joint list that may use a rig's own names, such as `root,RightArm` or `rig:"Head"`, to a list for
/// [`parse`]. Parts that `parse` accepts stay as they are.
///
/// Names may lack their namespace (`LeftArm` for `mixamorig:LeftArm`) and differ in letter case. The order of precedence
/// is: an exact name, a joint without its namespace, a group in another case, a joint in another case.
///
/// # Errors
/// As [`parse`]; a joint of the rig that maps to no SMPL joint; a name that fits two joints.
pub fn to_smpl_names(list: &str, rig: &Skeleton, map: Option<&SkeletonMap>) -> Result<String> {
    // names that `parse` knows exactly are SMPL's, even where the rig has a joint of that name
    let is_plain = matches!(list.trim(), "13" | "18" | "24") || parts(list).all(|part| by_exact_name(part).is_some());
    let own = match rig_joints(rig, map) {
        Some(own) if !is_plain => own,
        _ => return parse(list).map(|_| list.to_owned()),
    };
    Ok(parts(list).map(|part| part_to_smpl(part, &own)).collect::<Result<Vec<_>>>()?.join(","))
}

/// Translates one part, given the rig's joints and their SMPL ids.
fn part_to_smpl(part: &str, own: &[(&str, Option<usize>)]) -> Result<String> {
    let (alone, name) = (rig_name(part), rig_name(part).unwrap_or(part));
    if alone.is_none() && by_exact_name(part).is_some() {
        return Ok(part.to_owned());
    }
    let with: Vec<&str> = own.iter().filter(|(_, id)| id.is_some()).map(|(n, _)| *n).collect();
    // the joint `head` is written as its id, because its name is a group's
    let of_id = |id: usize| match GROUPS.iter().any(|(n, _)| *n == smpl::NAMES[id]) {
        true => id.to_string(),
        false => smpl::NAMES[id].to_owned(),
    };
    let of_rig = |is: fn(&str, &str) -> bool| -> Result<Option<String>> {
        let (mut meant, others): (Vec<_>, Vec<_>) =
            own.iter().copied().filter(|(own, _)| is(own, name)).partition(|(_, id)| id.is_some());
        // unless `rig:` or an exact match excludes it, SMPL's joint of that name competes, so that doubt is reported
        if alone.is_none() && meant.iter().all(|(own, _)| *own != name) {
            let known: Vec<Option<usize>> = meant.iter().map(|(_, id)| *id).collect();
            let smpl = (0..24).filter(|&id| is(smpl::NAMES[id], name) && !known.contains(&Some(id)));
            meant.extend(smpl.map(|id| (smpl::NAMES[id], Some(id))));
        }
        match (&meant[..], &others[..]) {
            ([(_, id)], _) => Ok(id.map(of_id)),
            ([(a, _), (b, _), ..], _) => Err(ambiguous(name, a, b)),
            ([], [(other, _), ..]) => {
                let why = format!("maps to no SMPL joint; joints that do are {}", with.join(" "));
                Err(Error::unsupported(format!("joint {other}"), why))
            }
            ([], []) => Ok(None),
        }
    };
    let group = GROUPS.iter().find(|(group, _)| alone.is_none() && group.eq_ignore_ascii_case(name));
    if let Some(found) = of_rig(|a, b| a == b)?.or(of_rig(is_but_for_namespace)?) {
        return Ok(found);
    }
    if let Some((group, _)) = group {
        return Ok((*group).to_owned());
    }
    match of_rig(is_but_for_case)? {
        Some(found) => Ok(found),
        None if alone.is_some() => {
            let hint = did_you_mean(name, with.iter().copied());
            let why = format!("not in the rig{hint}; its joints are {}", with.join(" "));
            Err(Error::unsupported(format!("joint {name:?}"), why))
        }
        None => Err(unknown(name, &with)),
    }
}

/// Finds a joint of a rig by its exact name, else without the namespace, else in another letter case.
///
/// # Errors
/// An unknown name, with the joints there are; a name that fits two joints.
pub fn find_in_rig(rig: &Skeleton, name: &str) -> Result<usize> {
    for is in [|a: &str, b: &str| a == b, is_but_for_namespace, is_but_for_case] {
        let found: Vec<usize> = (0..rig.joints()).filter(|&joint| is(&rig.names()[joint], name)).collect();
        match found[..] {
            [] => {}
            [joint] => return Ok(joint),
            [a, b, ..] => {
                return Err(ambiguous(name, &rig.names()[a], &rig.names()[b]));
            }
        }
    }
    let hint = did_you_mean(name, rig.names().iter().map(String::as_str));
    let why = format!("unknown; there are {}{hint}", rig.names().join(", "));
    Err(Error::unsupported(format!("joint {name:?}"), why))
}

fn ambiguous(name: &str, a: &str, b: &str) -> Error {
    Error::unsupported(format!("joint {name:?}"), format!("may be {a} or {b}; give the whole name"))
}

fn is_but_for_namespace(a: &str, b: &str) -> bool {
    without_namespace(a) == without_namespace(b)
}

fn is_but_for_case(a: &str, b: &str) -> bool {
    without_namespace(a).eq_ignore_ascii_case(without_namespace(b))
}

/// Parses one part of a list without a rig, comparing names by `is`.
fn parse_part(part: &str, is: impl Fn(&str, &str) -> bool) -> Option<Selection> {
    if let Some((name, ids)) = GROUPS.iter().find(|(group, _)| is(group, part)) {
        let is_whole = matches!(*name, "root" | "all");
        return Some(if is_whole { Selection::of(ids.to_vec()) } else { Selection::in_place(ids.to_vec()) });
    }
    if let Some(name) = ROOT_PARTS.into_iter().find(|name| is(name, part)) {
        let [path, height, tilt] = ROOT_PARTS.map(|own| own == name);
        return Some(Selection { joints: Vec::new(), path, height, tilt });
    }
    let id = smpl::NAMES.iter().position(|name| is(name, part));
    let id = id.or_else(|| part.parse::<usize>().ok().filter(|&id| id < 24))?;
    Some(Selection::in_place(vec![id]))
}

/// Parses one part by exact names.
fn by_exact_name(part: &str) -> Option<Selection> {
    parse_part(part, |a, b| a == b)
}

/// The parts of a list that name both an SMPL joint or group and a different joint of the rig, as
/// `(part, SMPL name of the rig's joint)`.
pub fn ambiguous_names(list: &str, rig: &Skeleton, map: Option<&SkeletonMap>) -> Vec<(String, &'static str)> {
    let own = rig_joints(rig, map).unwrap_or_default();
    let other = |part: &str| {
        let (_, id) = own.iter().find(|(name, _)| *name == part)?;
        let meant = by_exact_name(part)?.joints;
        id.filter(|id| meant != [*id]).map(|id| (part.to_owned(), smpl::NAMES[id]))
    };
    parts(list).filter_map(other).collect()
}

/// A note for the user about such a part.
pub fn ambiguity_note(part: &str, own: &str) -> String {
    format!("{part} is SMPL's here; the rig's own joint of that name, its {own}, is rig:{part}")
}

/// The error of an unknown part, with the joints of the rig if there is one.
fn unknown(part: &str, own: &[&str]) -> Error {
    let groups: Vec<_> = GROUPS.iter().map(|(n, _)| *n).collect();
    let names = groups.iter().chain(&smpl::NAMES).chain(own).copied();
    let hint = did_you_mean(part, names);
    let own = if own.is_empty() { String::new() } else { format!("; joints of the rig are {}", own.join(" ")) };
    let (groups, joints) = (groups.join(" "), smpl::NAMES.join(" "));
    let why = format!("unknown{hint}; groups are {groups}; joints are {joints}{own}");
    Error::unsupported(format!("joint or group {part:?}"), why)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rig::map_for;

    fn translated(list: &str, rig: &Skeleton) -> Result<String> {
        to_smpl_names(list, rig, map_for(rig, None).ok().as_ref())
    }

    #[test]
    fn lists() {
        assert_eq!(parse("13").unwrap().joints, THIRTEEN);
        let trunk = parse("spine1,spine3,neck,left_collar,right_collar").unwrap().joints;
        let mut more = [THIRTEEN.as_slice(), &trunk].concat();
        more.sort_unstable();
        assert_eq!(parse("18").unwrap(), Selection::of(more));
        assert_eq!(parse("root, right_arm").unwrap(), Selection::of(vec![0, 14, 17, 19, 21, 23]));
        assert_eq!(parse("7,left_knee").unwrap(), Selection::in_place(vec![4, 7]));
        assert!(parse("left_wing").unwrap_err().to_string().contains("left_wing"));
        assert!(parse("").is_err());
        assert!(parse("24,0").is_err());
    }

    #[test]
    fn new_groups_and_slips_of_the_hand() {
        assert_eq!(parse("hands,feet").unwrap().joints, [7, 8, 10, 11, 20, 21, 22, 23]);
        assert_eq!(parse("spine").unwrap(), Selection::in_place(vec![3, 6, 9]));
        let message = parse("root,rigth_arm").unwrap_err().to_string();
        assert!(
            message.contains("joint or group \"rigth_arm\": unknown; did you mean right_arm?; groups are"),
            "{message}"
        );
        assert!(!parse("wing").unwrap_err().to_string().contains("did you mean"));
    }

    /// A rig from its joints and their parents.
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
        let of = |list: &str| translated(list, &bandai);
        assert_eq!(of("root, UpperArm_R,LowerArm_R").unwrap(), "root,right_shoulder,right_elbow");
        // a group wins over a joint of the same name; parts without need of a rig stay as they are
        assert_eq!([of("head,Hand_R").unwrap(), of("13").unwrap()], ["head,right_wrist", "13"]);
        assert_eq!(of("Head,Chest").unwrap(), "15,spine3");
        assert_eq!(of("rig:Head, rig:\"Hand_R\",hands").unwrap(), "15,right_wrist,hands");
        let message = of("rig:haed").unwrap_err().to_string();
        assert!(message.contains("joint \"haed\": not in the rig") && !message.contains("groups"), "{message}");
        assert!(parse("rig:Head").is_err());
        let message = of("joint_Root").unwrap_err().to_string();
        assert!(message.contains("joint joint_Root: maps to no SMPL joint; joints that do are Hips"), "{message}");
        let message = of("UperArm_R").unwrap_err().to_string();
        assert!(
            message.contains("did you mean UpperArm_R?") && message.contains("joints of the rig are Hips"),
            "{message}"
        );
        assert!(translated("tail", &rig(&[("a", None)])).is_err());
        assert_eq!(translated("legs", &rig(&[("a", None)])).unwrap(), "legs");
        // on the smpl rig `head` is a joint and a group
        let smpl = smpl::neutral();
        assert_eq!(
            ambiguous_names("head,left_knee,legs", &smpl, map_for(&smpl, None).ok().as_ref()),
            [("head".to_owned(), "head")]
        );
        assert_eq!(translated("rig:head,left_knee", &smpl).unwrap(), "15,left_knee");
    }

    #[test]
    fn namespaces_and_case_are_seen_through() {
        assert_eq!(parse("Left_Arm,ROOT").unwrap(), parse("left_arm,root").unwrap());
        assert_eq!(parse("Left_Knee").unwrap().joints, [4]);
        let names = "Hips Spine Spine1 Spine2 Neck Head LeftShoulder LeftArm LeftForeArm LeftHand RightShoulder RightArm \
                     RightForeArm RightHand LeftUpLeg LeftLeg LeftFoot LeftToeBase RightUpLeg RightLeg RightFoot RightToeBase";
        let named = |prefix: &str, more: &[&str]| {
            let names: Vec<String> = names.split_whitespace().map(|name| format!("{prefix}{name}")).collect();
            let all = names.iter().map(String::as_str).chain(more.iter().copied());
            rig(&all.enumerate().map(|(i, name)| (name, i.checked_sub(1))).collect::<Vec<_>>())
        };
        let mixamo = named("mixamorig:", &[]);
        let of = |list: &str| translated(list, &mixamo).unwrap();
        assert_eq!(of("LeftArm,mixamorig:LeftArm,leftarm"), "left_shoulder,left_shoulder,left_shoulder");
        assert_eq!(
            [of("Head"), of("HEAD"), of("head")],
            ["15", "head", "head"],
            "a group before a joint in another case"
        );
        assert_eq!([of("rig:head"), of("LEFT_ARM"), of("Left_Knee")], ["15", "left_arm", "left_knee"]);
        assert_eq!(find_in_rig(&mixamo, "leftARM").unwrap(), 7);
        // an exact name wins; two joints that fit equally well are named
        let two = named("", &["HEAD", "leftarm", "Bob:Prop", "Tom:Prop"]);
        let of = |list: &str| translated(list, &two);
        assert_eq!(of("LeftArm").unwrap(), "left_shoulder");
        assert_eq!(find_in_rig(&two, "leftarm").unwrap(), 23);
        for (name, message) in
            [("LEFTARM", "\"LEFTARM\": may be LeftArm or leftarm"), ("Prop", "\"Prop\": may be Bob:Prop or Tom:Prop")]
        {
            assert!(find_in_rig(&two, name).unwrap_err().to_string().contains(message));
        }
        assert!(of("leftarm").unwrap_err().to_string().contains("joint leftarm: maps to no SMPL joint"));
        let both = named("", &["Left_Knee"]);
        assert_eq!(translated("left_knee", &both).unwrap(), "left_knee");
        let smpl: Vec<_> = smpl::NAMES.iter().enumerate().map(|(i, name)| (*name, i.checked_sub(1))).collect();
        let loud = rig(&smpl
            .iter()
            .map(|(name, parent)| (name.to_uppercase(), *parent))
            .collect::<Vec<_>>()
            .iter()
            .map(|(name, parent)| (name.as_str(), *parent))
            .collect::<Vec<_>>());
        assert_eq!(translated("Left_Knee,LEFT_ANKLE", &loud).unwrap(), "left_knee,left_ankle");
    }

    #[test]
    fn lists_are_parsed_as_they_were_made() {
        for part in 0..24 {
            assert!(part_of(part).is_some_and(|name| group(name).contains(&part)), "{part}");
        }
        assert_eq!((part_of(24), PARTS.map(|name| group(name).len()).iter().sum::<usize>()), (None, 24));
        // every subset of some, and of all but some
        for bits in 0..1u32 << 12 {
            let some: Vec<usize> = (0..12).filter(|bit| bits >> bit & 1 == 1).map(|bit| 2 * bit + 1).collect();
            let others: Vec<usize> = (0..24).filter(|id| !some.contains(id)).collect();
            for ids in [some, others].iter().filter(|ids| !ids.is_empty()) {
                let selection = parse(&list_of(ids)).unwrap();
                assert_eq!(
                    (&selection.joints, selection.path && selection.height),
                    (ids, ids.contains(&0)),
                    "{}",
                    list_of(ids)
                );
            }
        }
        assert_eq!([list_of(&[15]), list_of(&[12, 15]), list_of(&[])], ["15", "head", ""]);
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
