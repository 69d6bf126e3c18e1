//! Evidence that a file's position channels are meant to be added to the OFFSETs.

use super::BvhSource;
use crate::format::BvhPosition;
use crate::format::contact::FRAMES;
use crate::series::nearest_quantile as quantile;
use crate::{Clip, GlobalPose, Warning};

/// A floor is at y = 0 if it is nearer than this fraction of the way from the root to the farthest tip.
const AT_ZERO: f64 = 0.2;
/// A floor is elsewhere if it is lower by more than this fraction of that way.
const ELSEWHERE: f64 = 0.4;

/// The doubt that position channels replace OFFSETs: those of most joints are far shorter than their OFFSETs, or the body
/// is far below y = 0 and would stand there if the OFFSETs above its root were added. `clip` is that of the source.
pub(super) fn doubt(source: &BvhSource, clip: &Clip) -> Option<Warning> {
    if source.rig.position == BvhPosition::Add {
        return None;
    }
    let below = source.position_channels();
    let short = below.iter().filter(|channels| channels.looks_added).count();
    let why = if 2 * short > below.len() {
        format!("the position channels of {short} joints are far shorter than their OFFSETs")
    } else {
        let [replaced, added] = floors(source, clip)?;
        format!("the body is at y = {replaced:.2} m, and with the root's OFFSET added to its position at {added:.2} m")
    };
    let what = format!("{why}: these look like added positions; try `bvh_position` add");
    Some(Warning { kind: "positions_added", what })
}

/// The lowest height of the body with replaced and with added positions of the root, if these show that they are added.
fn floors(source: &BvhSource, clip: &Clip) -> Option<[f64; 2]> {
    let frames = source.as_frames();
    let has_offset = |&&node: &&usize| frames.nodes[node].offset != [0.0; 3] && frames.moves(node);
    source.rig.chain.iter().find(has_offset)?;
    let root = |position: BvhPosition, f: usize| {
        let frames = super::Frames { position, ..source.as_frames() };
        let (root, _) = frames.along(&source.rig.chain, frames.row(f));
        source.rig.axes.position_to_y_up(root * source.rig.unit_m).y
    };
    let mut pose = GlobalPose::default();
    let (mut lowest, mut shifts) = (Vec::new(), Vec::new());
    for f in (0..source.frames).step_by(source.frames.div_ceil(FRAMES).max(1)) {
        pose.set(clip.skeleton(), clip.root()[f], clip.pose(f));
        lowest.push(pose.positions.iter().map(|p| p.y).fold(f64::MAX, f64::min));
        shifts.push(root(BvhPosition::Add, f) - root(BvhPosition::Replace, f));
    }
    let (reach, replaced) = (source.reach_m(), quantile(lowest, 0.05));
    // adding the OFFSETs above the root shifts the whole body, so its lowest point needs no second pose
    let added = replaced + quantile(shifts, 0.5);
    (replaced < -ELSEWHERE * reach && added.abs() < AT_ZERO * reach).then_some([replaced, added])
}

#[cfg(test)]
mod tests {
    use crate::format::{BvhPosition, ReadOptions, Up, bvh};
    use crate::{Motion, Vec3, synth};
    use std::path::Path;

    /// A dance as a BVH whose root has `offset`, centimetres, and moves relative to it if `relative`.
    fn file(offset: Vec3, relative: bool) -> String {
        let clip = synth::corpus(3, 1, 2.0, 30.0).unwrap().remove(0).clip;
        let away = if relative { -0.01 * offset } else { Vec3::ZERO };
        let root = clip.root().iter().map(|p| *p + away).collect();
        let clip = crate::Clip::new(clip.skeleton().clone(), 30.0, root, clip.rotations().to_vec()).unwrap();
        let motion = Motion::new("x", clip);
        let text = String::from_utf8(bvh::to_bytes(&motion).unwrap()).unwrap();
        let at = text.find("OFFSET").unwrap();
        let end = at + text[at..].find('\n').unwrap();
        format!("{}OFFSET {} {} {}{}", &text[..at], offset.x, offset.y, offset.z, &text[end..])
    }

    fn read(text: &str, bvh_position: BvhPosition) -> Motion {
        let options = ReadOptions { bvh_position, up: Up::Y, ..Default::default() };
        bvh::read(Path::new("x.bvh"), text.as_bytes(), &options).unwrap()
    }

    #[test]
    fn a_root_that_moves_relative_to_its_offset_is_doubted() {
        for offset in [Vec3::Y * 95.0, Vec3::new(120.0, 97.0, -40.0)] {
            let text = file(offset, true);
            let motion = read(&text, BvhPosition::Replace);
            assert_eq!(motion.warnings.iter().map(|w| w.kind).collect::<Vec<_>>(), ["positions_added"]);
            assert!(motion.warnings[0].what.contains("try `bvh_position` add"), "{:?}", motion.warnings);
            let added = read(&text, BvhPosition::Add);
            assert_eq!(added.warnings, []);
            assert!((added.clip.root()[0].y - 0.97).abs() < 0.1);
            assert_eq!(read(&file(offset, false), BvhPosition::Replace).warnings, [], "an OFFSET that is replaced");
        }
        assert_eq!(read(&file(Vec3::ZERO, false), BvhPosition::Replace).warnings, []);
    }
}
