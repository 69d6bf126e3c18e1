//! Inference of a BVH's unit from the leg length.

use super::text::Text;
use crate::format::source::bvh::{Header, NodeKind};
use crate::format::{BvhPosition, ReadOptions};
use crate::rig::map_if_any;
use crate::{FaultKind, Result, Skeleton, Vec3};
use std::ops::{Range, RangeInclusive};
use std::path::Path;

/// Ranges of leg lengths, hip to knee to ankle, and the unit in metres that they indicate.
const LEGS: [(RangeInclusive<f64>, f64); 5] =
    [(0.6..=1.1, 1.0), (12.0..=19.0, 0.0564444), (23.0..=45.0, 0.0254), (60.0..=110.0, 0.01), (600.0..=1100.0, 0.001)];

/// The unit in metres that a leg of this length, hip to knee to ankle, indicates.
pub(crate) fn unit_of_leg(length: f64) -> Option<f64> {
    LEGS.iter().find(|(lengths, _)| lengths.contains(&length)).map(|(_, metres)| *metres)
}

/// The unit in metres of a file whose nodes `range` have these rest `offset`s.
pub(crate) fn judge(
    path: &Path,
    head: &Header,
    range: Range<usize>,
    offset: impl Fn(usize) -> Vec3,
    options: &ReadOptions,
) -> Result<f64> {
    let leg = match mapped_leg(head, range.clone(), options)? {
        Some(leg) => Some(leg),
        None => leg_by_words(head, range.clone()),
    };
    let length = |offset: &dyn Fn(usize) -> Vec3| {
        leg.as_ref().map(|bones| bones.iter().map(|&n| offset(n).length()).sum::<f64>())
    };
    let unit = |length: Option<f64>| length.and_then(unit_of_leg);
    let by_offset = length(&|n| Vec3::from_array(head.nodes[n].offset));
    let leg = length(&offset);
    if let Some(metres) = unit(leg) {
        return Ok(metres);
    }
    let help = match (options.bvh_position, unit(by_offset)) {
        (BvhPosition::Replace, Some(_)) => {
            "the OFFSETs alone would tell; these look like added positions: give `bvh_position` add"
        }
        _ => "give `unit`: m, cm, mm, in or cmu",
    };
    let found = match leg {
        Some(l) => format!("a leg of {l:.4} from hip to ankle"),
        None => "no joints whose names say hip, knee and ankle".into(),
    };
    let expected = "a leg of 0.6-1.1 (m), 12-19 (CMU units), 23-45 (inches), 60-110 (cm) or 600-1100 (mm)";
    let at = head.nodes[range.start].at;
    let fault = Text::new(path, &head.pieces[0]).fault(at, FaultKind::UnitUnknown, found, expected);
    Err(fault.help(help).into())
}

/// The nodes from below a hip to its ankle, by the given skeleton map or the built-in one that fits.
fn mapped_leg(head: &Header, range: Range<usize>, options: &ReadOptions) -> Result<Option<Vec<usize>>> {
    let joints: Vec<usize> = range.filter(|&n| head.nodes[n].kind != NodeKind::End).collect();
    let names: Vec<String> = joints.iter().map(|&n| head.nodes[n].unique.clone()).collect();
    let parent = |n: usize| head.nodes[n].parent.and_then(|p| joints.iter().position(|&j| j == p));
    let offsets = joints.iter().map(|&n| Vec3::from_array(head.nodes[n].offset)).collect();
    let parents = joints.iter().map(|&n| parent(n)).collect();
    let rig = Skeleton::new(names.clone(), parents, offsets, Vec::new())?;
    let Some(map) = map_if_any(&rig, None, options.map.as_deref())? else { return Ok(None) };
    let node = |smpl: usize| {
        let name = map.joint(smpl)?;
        names.iter().position(|n| n == name).map(|i| joints[i])
    };
    let leg = |[hip, knee, ankle]: [usize; 3]| {
        let (hip, knee, ankle) = (node(hip)?, node(knee)?, node(ankle)?);
        let mut bones = Vec::new();
        let mut at = ankle;
        while at != hip {
            bones.push(at);
            at = head.nodes[at].parent?;
        }
        bones.contains(&knee).then_some(bones)
    };
    // left, else right: hip, knee, ankle by SMPL id
    Ok(leg([1, 4, 7]).or_else(|| leg([2, 5, 8])))
}

/// The nodes from below a hip to its ankle, by common joint names; for rigs that no map fits.
fn leg_by_words(head: &Header, range: Range<usize>) -> Option<Vec<usize>> {
    let plain = |n: usize| -> String {
        let name = &head.nodes[n].name;
        let name = name.rsplit(':').next().unwrap_or(name);
        name.chars().filter(|c| c.is_ascii_alphanumeric()).map(|c| c.to_ascii_lowercase()).collect()
    };
    let any = |n: usize, words: &[&str]| words.iter().any(|w| plain(n).contains(w));
    let mut ankles =
        range.filter(|&n| head.nodes[n].kind != NodeKind::End && any(n, &["foot", "ankle"])).collect::<Vec<_>>();
    ankles.sort_by_key(|&n| !any(n, &["ankle"]));
    for ankle in ankles {
        let mut chain = vec![ankle];
        let mut at = head.nodes[ankle].parent;
        while let Some(n) = at {
            // "leg" alone is the shin in rigs that call the thigh up-leg
            let thigh = any(n, &["thigh", "upleg", "upperleg"]) || (any(n, &["hip"]) && head.nodes[n].parent.is_some());
            if thigh && chain.len() >= 2 {
                chain.reverse();
                return Some(chain);
            }
            if thigh || !any(n, &["knee", "shin", "calf", "leg", "foot", "ankle"]) {
                break;
            }
            chain.push(n);
            at = head.nodes[n].parent;
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::bvh;
    use crate::{Motion, Source};

    /// A file with a leg of 0.82 `scale` and these names of hip, knee and ankle.
    fn file(scale: f64, [hip, knee, ankle]: [&str; 3], position: &str) -> String {
        let bone = 0.41 * scale;
        let channels = if position.is_empty() { "CHANNELS 0" } else { "CHANNELS 3 Xposition Yposition Zposition" };
        format!(
            "HIERARCHY\nROOT body {{ OFFSET 0 0 0 CHANNELS 0\nJOINT {hip}\n{{ OFFSET 0.1 0 0 CHANNELS 0\n\
             JOINT {knee}\n{{ OFFSET 0 {bone} 0 {channels}\nJOINT {ankle}\n{{ OFFSET 0 {bone} 0 CHANNELS 1 Xrotation \
             End Site {{ OFFSET 0 1 0 }} }} }} }} }}\nMOTION\nFrames: 1\nFrame Time: 0.05\n{position} 0\n"
        )
    }

    fn read(text: &str, options: &ReadOptions) -> Result<Motion> {
        bvh::read(Path::new("x.bvh"), text.as_bytes(), options)
    }

    #[test]
    fn a_leg_tells_the_unit() {
        let names = ["LeftUpLeg", "LeftLeg", "LeftFoot"];
        for (scale, want) in [(1.0, 1.0), (100.0, 0.01), (1000.0, 0.001), (1.0 / 0.0254, 0.0254), (17.7, 0.0564444)] {
            let motion = read(&file(scale, names, ""), &ReadOptions::default()).unwrap();
            let Source::Bvh(source) = motion.source else { panic!("a BVH") };
            assert_eq!((source.rig.unit_m, source.rig.unit_judged), (want, true), "{scale}");
        }
    }

    #[test]
    fn names_of_many_rigs() {
        for names in [
            ["LeftHip", "LeftKnee", "LeftAnkle"],
            ["lThigh", "lShin", "lFoot"],
            ["thigh.L", "calf.L", "foot.L"],
            ["rig:L_UpperLeg", "rig:L_LowerLeg", "rig:L_Ankle"],
        ] {
            assert!(read(&file(100.0, names, ""), &ReadOptions::default()).is_ok(), "{names:?}");
        }
    }

    #[test]
    fn what_tells_nothing_is_an_error_with_its_place() {
        let names = ["LeftHip", "LeftKnee", "LeftAnkle"];
        for (text, expected) in [
            (file(5.0, names, ""), "a leg of 4.1000"),
            (file(1.0, ["a", "b", "c"], ""), "no joints whose names"),
            (file(1.0, names, "0 0 0"), "`bvh_position` add"),
        ] {
            let e = read(&text, &ReadOptions::default()).unwrap_err();
            assert_eq!(e.fault(), Some(FaultKind::UnitUnknown));
            assert!(e.to_string().contains("x.bvh:2:1") && e.to_string().contains(expected), "{e}");
        }
        let options = ReadOptions { bvh_position: BvhPosition::Add, ..Default::default() };
        assert!(read(&file(1.0, names, "0 0 0"), &options).is_ok());
    }
}
