//! The unit of a BVH, judged by the length of a leg.

use super::header::{Head, NodeKind};
use super::text::Text;
use crate::format::ReadOptions;
use crate::retarget::SkeletonMap;
use crate::{Kind, Result, Vec3};
use std::ops::Range;
use std::path::Path;

/// Leg lengths, hip to knee to ankle, and the metres of the unit they are in.
const LEGS: [(Range<f64>, f64); 5] =
    [(0.6..1.1, 1.0), (12.0..19.0, 0.0564444), (23.0..45.0, 0.0254), (60.0..110.0, 0.01), (600.0..1100.0, 0.001)];

/// Metres of the unit of a file whose nodes `range` have these rest `offset`s.
pub(crate) fn judge(
    path: &Path,
    head: &Head,
    range: Range<usize>,
    offset: impl Fn(usize) -> Vec3,
    options: &ReadOptions,
) -> Result<f64> {
    let leg = match mapped_leg(head, range.clone(), options)? {
        Some(leg) => Some(leg),
        None => leg_by_words(head, range.clone()),
    };
    let leg = leg.map(|bones| bones.iter().map(|&n| offset(n).length()).sum::<f64>());
    let unit = leg.and_then(|l| LEGS.iter().find(|(lengths, _)| lengths.contains(&l)));
    if let Some((_, metres)) = unit {
        return Ok(*metres);
    }
    let found = match leg {
        Some(l) => format!("a leg of {l:.4} from hip to ankle"),
        None => "no joints whose names say hip, knee and ankle".into(),
    };
    let expected = "a leg of 0.6-1.1 (m), 12-19 (CMU units), 23-45 (inches), 60-110 (cm) or 600-1100 (mm)";
    let at = head.nodes[range.start].at;
    let fault = Text::new(path, &head.pieces[0]).fault(at, Kind::UnitUnknown, found, expected);
    Err(fault.help("give the unit: --unit m|cm|mm|in|cmu").into())
}

/// The nodes below a hip down to its ankle by the skeleton map that is given, or the shipped one that fits.
fn mapped_leg(head: &Head, range: Range<usize>, options: &ReadOptions) -> Result<Option<Vec<usize>>> {
    let joints: Vec<usize> = range.filter(|&n| head.nodes[n].kind != NodeKind::End).collect();
    let names: Vec<String> = joints.iter().map(|&n| head.nodes[n].unique.clone()).collect();
    let map = match &options.map {
        Some(name) => Some(SkeletonMap::by_name_or_file(name)?.bind_any(&names)),
        None => SkeletonMap::detect(&names),
    };
    let Some(map) = map else { return Ok(None) };
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

/// The nodes below a hip down to its ankle, by what rigs commonly call them; for rigs that no map knows.
fn leg_by_words(head: &Head, range: Range<usize>) -> Option<Vec<usize>> {
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
            // "leg" alone is the shin where the thigh is called up-leg
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
