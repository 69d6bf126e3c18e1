//! Groups and subsets of the SMPL joints.

use crate::{Error, Result, smpl};

/// The thesis's thirteen joints, by id.
pub const THIRTEEN: [usize; 13] = [0, 1, 2, 4, 5, 7, 8, 16, 17, 18, 19, 20, 21];

/// The groups by name.
pub const GROUPS: &[(&str, &[usize])] = &[
    ("root", &[0]),
    ("left_leg", &[1, 4, 7, 10]),
    ("right_leg", &[2, 5, 8, 11]),
    ("legs", &[1, 2, 4, 5, 7, 8, 10, 11]),
    ("left_arm", &[13, 16, 18, 20, 22]),
    ("right_arm", &[14, 17, 19, 21, 23]),
    ("arms", &[13, 14, 16, 17, 18, 19, 20, 21, 22, 23]),
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
    /// Whether the root's translation belongs to it: when `root`, `all`, `24` or `13` is named, but not with the bare joint
    /// `pelvis` nor with the groups that hold joint 0 among others.
    pub translation: bool,
}

/// The joints of a list such as `13`, `24`, `root,right_arm`, `left_knee,7`.
///
/// Parts are the numbers `13` and `24` alone, groups of [`GROUPS`], joint names, or ids. `head` alone is the group.
///
/// # Errors
/// [`Error::Call`] naming the part that is none of these, with what there is.
pub fn parse(list: &str) -> Result<Selection> {
    match list.trim() {
        "13" => return Ok(Selection { joints: THIRTEEN.to_vec(), translation: true }),
        "24" => return Ok(Selection { joints: (0..24).collect(), translation: true }),
        _ => {}
    }
    let mut selection = Selection { joints: Vec::new(), translation: false };
    for part in list.split(',').map(str::trim) {
        if let Some((name, ids)) = GROUPS.iter().find(|(n, _)| *n == part) {
            selection.joints.extend_from_slice(ids);
            selection.translation |= matches!(*name, "root" | "all");
        } else if let Some(id) = smpl::NAMES.iter().position(|n| *n == part) {
            selection.joints.push(id);
        } else if let Some(id) = part.parse::<usize>().ok().filter(|&id| id < 24) {
            selection.joints.push(id);
        } else {
            let groups: Vec<_> = GROUPS.iter().map(|(n, _)| *n).collect();
            return Err(Error::Call(format!(
                "no joint or group {part:?}; groups are {}; joints are {}",
                groups.join(" "),
                smpl::NAMES.join(" ")
            )));
        }
    }
    selection.joints.sort_unstable();
    selection.joints.dedup();
    Ok(selection)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lists() {
        assert_eq!(parse("13").unwrap().joints, THIRTEEN);
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
    fn groups_are_mirror_images() {
        let of = |n: &str| parse(n).unwrap().joints;
        for (l, r) in [("left_leg", "right_leg"), ("left_arm", "right_arm")] {
            let mut m: Vec<_> = of(l).iter().map(|&j| smpl::MIRROR[j]).collect();
            m.sort_unstable();
            assert_eq!(m, of(r));
        }
    }
}
