//! Inference of a BVH's unit from the length of the legs, else from the size of the body.

use super::text::Text;
use crate::format::source::bvh::{BvhRig, Header, NodeKind};
use crate::format::{BvhPosition, ReadOptions, size};
use crate::rig::SkeletonMap;
use crate::{Clip, FaultKind, Result, Vec3, Warning};
use std::ops::Range;
use std::path::Path;

/// The unit in metres of a file, with a doubt if it isn't sure. `whole` is everything below the ROOT, with its clip, in the
/// file's unit; `map` is the map that fits it.
///
/// # Errors
/// [`FaultKind::UnitUnknown`] when neither the legs nor the size of the body show it.
pub(crate) fn judge(
    path: &Path,
    head: &Header,
    whole: &BvhRig,
    clip: &Clip,
    map: Option<&SkeletonMap>,
    options: &ReadOptions,
) -> Result<(f64, Option<Warning>)> {
    let rig = clip.skeleton();
    let node = |joint: usize| whole.joints[joint];
    let joint = |node: &usize| whole.joints.binary_search(node).ok();
    let range = head.below(whole.chain[0]);
    let leg = match map.and_then(|map| size::leg(rig, map)) {
        Some(leg) => Some(leg),
        None => leg_by_words(head, range).map(|leg| leg.iter().filter_map(joint).collect()),
    };
    let length = |leg: &Vec<usize>| leg.iter().map(|&j| rig.offsets()[j].length()).sum::<f64>();
    let by_offset =
        |leg: &Vec<usize>| leg.iter().map(|&j| Vec3::from_array(head.nodes[node(j)].offset).length()).sum::<f64>();
    // a leg whose OFFSETs alone give a unit is no child's: its position channels are meant to be added
    let added = options.bvh_position == BvhPosition::Replace
        && leg.as_ref().is_some_and(|leg| size::unit_of_leg(length(leg)).is_none())
        && leg.as_ref().map(by_offset).and_then(size::unit_of_leg).is_some();
    let found = match &leg {
        Some(leg) if !added => size::unit(length(leg), || size::height(clip, map)),
        Some(_) => None,
        None => size::unit_of_extent(size::extent(clip)),
    };
    if let Some(found) = found {
        return Ok(found);
    }
    let help = match added {
        true => "the OFFSETs alone would tell; these look like added positions: give `bvh_position` add",
        false => size::GIVE_UNIT,
    };
    let found = match &leg {
        Some(leg) => format!("a leg of {:.4} from hip to ankle", length(leg)),
        None => format!("no joints whose names say hip, knee and ankle, and a body of {:.4}", size::extent(clip)),
    };
    let expected = "a leg of 0.6-1.1 (m), 12-19 (CMU units), 23-45 (inches), 60-110 (cm) or 600-1100 (mm)";
    let at = head.nodes[whole.chain[0]].at;
    let fault = Text::new(path, &head.pieces[0]).fault(at, FaultKind::UnitUnknown, found, expected);
    Err(fault.help(help).into())
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
    // a foot is the ankle in most rigs, but the ball in rigs that name an ankle: named ankles first
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
            (file(2.6, ["a", "b", "c"], ""), "no joints whose names"),
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
