//! Interpretation of channels as a clip: docs/motion-files.md, "What the numbers mean".

use super::text::Text;
use super::unit;
use crate::format::source::bvh::{BvhRig, Channel, Header, Node, NodeKind};
use crate::format::{Axes, BvhPosition, ReadOptions, motion_root};
use crate::rig::{FoundMap, map_if_any};
use crate::rotation::Axis;
use crate::{Clip, EndSite, FaultKind, Quat, Result, Skeleton, Vec3, Warning};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// Position channels within this of their mean are a constant offset, metres.
const STILL_M: f64 = 0.0005;
/// Stretch up to this is dropped without a warning, metres.
const STRETCH_M: f64 = 0.005;

/// The rows of a file with its nodes.
pub(crate) struct Frames<'a> {
    pub nodes: &'a [Node],
    pub width: usize,
    pub frames: usize,
    pub numbers: &'a [f64],
    pub position: BvhPosition,
}

impl Frames<'_> {
    pub fn row(&self, frame: usize) -> &[f64] {
        &self.numbers[frame * self.width..(frame + 1) * self.width]
    }

    /// Position of a node in its parent's frame, in the file's unit.
    pub fn place(&self, node: usize, row: &[f64]) -> Vec3 {
        let n = &self.nodes[node];
        let mut p = n.offset;
        for (channel, &v) in n.channels.iter().zip(&row[n.column..]) {
            if let Channel::Position(axis) = channel {
                match self.position {
                    BvhPosition::Replace => p[axis.index()] = v,
                    BvhPosition::Add => p[axis.index()] += v,
                }
            }
        }
        Vec3::from_array(p)
    }

    /// Rotation of a node in its parent's frame: intrinsic, in channel order.
    pub fn turn(&self, node: usize, row: &[f64]) -> Quat {
        let n = &self.nodes[node];
        let mut turns = n.channels.iter().zip(&row[n.column..]).filter_map(|(c, v)| match c {
            Channel::Rotation(axis) => Some(axis.turn(v.to_radians())),
            Channel::Position(_) => None,
        });
        // no product with identity, which could flip the sign of a zero
        let first = turns.next().unwrap_or(Quat::IDENTITY);
        turns.fold(first, |q, t| q * t)
    }

    /// Whether a node's channels have the same bits in both rows.
    fn is_same(&self, node: usize, a: &[f64], b: &[f64]) -> bool {
        let n = &self.nodes[node];
        let columns = n.column..n.column + n.channels.len();
        a[columns.clone()].iter().zip(&b[columns]).all(|(a, b)| a.to_bits() == b.to_bits())
    }

    /// Position, in the file's unit, and rotation of the last node of a chain from a ROOT down, in the file's world.
    pub fn along(&self, chain: &[usize], row: &[f64]) -> (Vec3, Quat) {
        let here = |&node: &usize| (self.place(node, row), self.turn(node, row));
        // `reduce`, not `fold` from identity: a node without any above must not change by a bit
        chain.iter().map(here).reduce(|(p, q), (place, turn)| (p + q * place, q * turn)).unwrap_or_default()
    }

    pub fn moves(&self, node: usize) -> bool {
        self.nodes[node].channels.iter().any(|c| matches!(c, Channel::Position(_)))
    }

    /// Mean position over the frames and the largest distance from it; exactly its position for a node that never moves.
    pub fn mean_place(&self, node: usize) -> (Vec3, f64) {
        if !self.moves(node) || self.frames == 0 {
            return (Vec3::from_array(self.nodes[node].offset), 0.0);
        }
        let positions = || (0..self.frames).map(|f| self.place(node, self.row(f)));
        let first = self.place(node, self.row(0));
        // relative to the first, so that the mean of a constant is the constant, without rounding
        let mean = first + positions().map(|p| p - first).sum::<Vec3>() / self.frames as f64;
        (mean, positions().map(|p| p.distance(mean)).fold(0.0, f64::max))
    }
}

/// The part of a file that is read.
pub(crate) struct Chosen {
    /// The nodes of a ROOT and of everything below it.
    pub range: Range<usize>,
    /// The node that the caller named as the clip's root.
    pub joint: Option<usize>,
}

/// The ROOT, or joint of one, that `root` of the options names; without it the first ROOT.
pub(crate) fn choose_root(path: &Path, head: &Header, options: &ReadOptions) -> Result<Chosen> {
    let nodes = &head.nodes;
    let roots: Vec<usize> = (0..nodes.len()).filter(|i| nodes[*i].kind == NodeKind::Root).collect();
    let first = roots.first().copied().unwrap_or(0);
    let Some(name) = &options.root else { return Ok(Chosen { range: head.below(first), joint: None }) };
    let unique = roots.iter().find(|&&r| nodes[r].unique == *name);
    if let Some(&root) = unique.or_else(|| roots.iter().find(|&&r| nodes[r].name == *name)) {
        return Ok(Chosen { range: head.below(root), joint: None });
    }
    let joints: Vec<usize> = (0..nodes.len()).filter(|i| nodes[*i].kind == NodeKind::Joint).collect();
    let unique: Vec<usize> = joints.iter().copied().filter(|&n| nodes[n].unique == *name).collect();
    let named: Vec<usize> = joints.iter().copied().filter(|&n| nodes[n].name == *name).collect();
    let root_of = |n: usize| roots.iter().copied().rfind(|r| *r < n).unwrap_or(first);
    let fault = |at: usize, found: String, expected: &str, help: String| {
        let text = Text::new(path, &head.pieces[0]);
        text.fault(nodes.get(at).map_or(0, |n| n.at), FaultKind::RootUnknown, found, expected).help(help)
    };
    // `name.2` may be a joint's own name too: names in the file come before those made unique
    match (named.as_slice(), unique.as_slice()) {
        ([joint], _) | ([], [joint]) => Ok(Chosen { range: head.below(root_of(*joint)), joint: Some(*joint) }),
        ([_, _, ..], _) => {
            let both: Vec<String> = named
                .iter()
                .map(|&n| format!("{:?} below ROOT {:?}", nodes[n].unique, nodes[root_of(n)].unique))
                .collect();
            let found = format!("{} joints {name:?}", named.len());
            let help = format!("there are {}: give the ROOT's name", both.join(" and "));
            Err(fault(named[0], found, "one joint, or a ROOT", help).into())
        }
        _ => {
            let all: Vec<_> = roots.iter().map(|&r| format!("{:?}", nodes[r].unique)).collect();
            let help = format!("its ROOTs are {}", all.join(", "));
            Err(fault(first, format!("no ROOT or joint {name:?}"), "a ROOT or joint of the file", help).into())
        }
    }
}

/// The interpretation of a file's nodes: the rig, a clip on it in the file's axes, and the map that fits it, if any.
pub(crate) struct Decided {
    pub rig: BvhRig,
    pub clip: Clip,
    pub found: Option<FoundMap>,
    pub warnings: Vec<Warning>,
}

/// Decides what the nodes mean, from the rows. The axes are the file's own; they are decided on the clip.
pub(crate) fn decide(path: &Path, head: &Header, frames: &Frames, fps: f64, options: &ReadOptions) -> Result<Decided> {
    let Chosen { range, joint } = choose_root(path, head, options)?;
    let nodes = &head.nodes;
    let means: Vec<(Vec3, f64)> = range.clone().map(|n| frames.mean_place(n)).collect();
    let mean = |n: usize| means[n - range.start];
    let rig = |chain: Vec<usize>, unit_m: f64| -> Result<BvhRig> {
        let root = *chain.last().unwrap_or(&range.start);
        let body = head.below(root);
        let joints: Vec<usize> = body.clone().filter(|&n| nodes[n].kind != NodeKind::End).collect();
        // kinematics ignores the root's offset: the file's own doesn't depend on the frames
        let offset = |n: usize| if n == root { Vec3::from_array(nodes[n].offset) } else { mean(n).0 };
        let skeleton = skeleton(nodes, &joints, body, |n| offset(n) * unit_m).map_err(|e| e.in_clip(path))?;
        let stretch =
            |(j, &n): (usize, &usize)| (j > 0 && mean(n).1 * unit_m > STILL_M).then(|| (j, mean(n).1 * unit_m));
        let stretch: Vec<(usize, f64)> = joints.iter().enumerate().filter_map(stretch).collect();
        let (position, path, skeleton) = (options.bvh_position, path_nodes(frames, &chain), skeleton.into());
        let (unit_judged, axes) = (options.unit.metres().is_none(), Axes::OWN);
        Ok(BvhRig { chain, path, joints, skeleton, unit_m, unit_judged, position, stretch, axes })
    };
    // all joints below the ROOT in the file's unit: the rig is recognised by their hierarchy and rotations
    let whole = rig(vec![range.start], 1.0)?;
    // a mirrored body would be recognised with left and right exchanged
    let unmirrored = |clip: Clip| Axes::OWN.mirrored(options.mirror_axis).to_y_up(clip);
    let on =
        |rig: &BvhRig| clip(rig, rig.skeleton.clone(), frames, fps).and_then(unmirrored).map_err(|e| e.in_clip(path));
    let clip = on(&whole)?;
    let given = options.map.as_deref();
    let mut found = map_if_any(&clip, given)?;
    let (unit_m, doubt) = match options.unit.metres() {
        Some(metres) => (metres, None),
        None => unit::judge(path, head, &whole, &clip, found.as_ref().map(|found| &found.map), options)?,
    };
    let moves = |j: usize| mean(whole.joints[j]).1 * unit_m > STILL_M;
    let joint = joint.and_then(|joint| whole.joints.binary_search(&joint).ok());
    let root = whole.joints[motion_root::choose(&clip, joint, &mut found, given, moves)?];
    let mut chain: Vec<usize> = std::iter::successors(Some(root), |&n| nodes[n].parent).collect();
    chain.reverse();
    let rig = rig(chain, unit_m)?;
    let (clip, found) = if rig.chain.len() == 1 {
        (clip.scaled(unit_m).map_err(|e| e.in_clip(path))?, found)
    } else {
        // its reference pose is that of the rig without what was above
        let clip = on(&rig)?;
        let found = motion_root::map_below(&clip, found, given)?;
        (clip, found)
    };
    let mut warnings: Vec<Warning> = doubt.into_iter().collect();
    let at = whole.joints.binary_search(&root).unwrap_or(0);
    warnings.extend(motion_root::beside(&whole.skeleton, at, |j| mean(whole.joints[j]).1 * unit_m));
    warnings.extend(left_out(&rig, &clip));
    Ok(Decided { rig, clip, found, warnings })
}

/// By axis, the node of a chain whose position channel varies most; of nodes that vary as little the innermost, and the
/// clip's root where none has that channel.
fn path_nodes(frames: &Frames, chain: &[usize]) -> [usize; 3] {
    let last = chain.last().copied().unwrap_or(0);
    [Axis::X, Axis::Y, Axis::Z].map(|axis| {
        let channel = Channel::Position(axis);
        let holds = chain.iter().rev().copied().filter(|&n| frames.nodes[n].channels.contains(&channel));
        if chain.len() == 1 {
            return last;
        }
        let spread = |n: usize| {
            let values = (0..frames.frames).map(|f| frames.place(n, frames.row(f))[axis.index()]);
            let (low, high) = values.fold((f64::MAX, f64::MIN), |(low, high), x| (low.min(x), high.max(x)));
            high - low
        };
        let measured = holds.map(|n| (n, spread(n)));
        // strictly greater, and from the clip's root upwards: ties go to the innermost
        measured.reduce(|best, other| if other.1 > best.1 { other } else { best }).map_or(last, |(n, _)| n)
    })
}

fn skeleton(nodes: &[Node], joints: &[usize], range: Range<usize>, offset: impl Fn(usize) -> Vec3) -> Result<Skeleton> {
    let joint = |node: Option<usize>| node.and_then(|n| joints.binary_search(&n).ok());
    let names = joints.iter().map(|&n| nodes[n].unique.clone()).collect();
    let parents = joints.iter().map(|&n| joint(nodes[n].parent)).collect();
    let ends = range.filter(|&n| nodes[n].kind == NodeKind::End);
    let ends = ends.filter_map(|n| Some(EndSite { parent: joint(nodes[n].parent)?, offset: offset(n) }));
    Skeleton::new(names, parents, joints.iter().map(|&n| offset(n)).collect(), ends.collect())
}

/// How far positions that the clip has no room for would move its joints.
fn left_out(rig: &BvhRig, clip: &Clip) -> Option<Warning> {
    let large: Vec<_> = rig.stretch.iter().filter(|(_, m)| *m > STRETCH_M).collect();
    let (joint, most) = large.iter().max_by(|a, b| a.1.total_cmp(&b.1))?;
    let what = format!(
        "bones of {} joints change their length; their mean is taken, which leaves out up to {most:.3} m, at {}",
        large.len(),
        clip.skeleton().names()[*joint],
    );
    Some(Warning { kind: "stretch_dropped", what })
}

/// The clip of the rows, in the file's axes.
pub(crate) fn clip(rig: &BvhRig, skeleton: Arc<Skeleton>, frames: &Frames, fps: f64) -> Result<Clip> {
    let mut root = Vec::with_capacity(frames.frames);
    let mut rotations = Vec::with_capacity(frames.frames * rig.joints.len());
    for f in 0..frames.frames {
        let row = frames.row(f);
        let (p, q) = frames.along(&rig.chain, row);
        root.push(p * rig.unit_m);
        rotations.push(q);
        let before = f.checked_sub(1).map(|f| frames.row(f));
        for &n in &rig.joints[1..] {
            // many joints of a body rest, fingers for whole clips: what doesn't change isn't computed again
            let rests = before.is_some_and(|before| frames.is_same(n, before, row));
            rotations.push(if rests { rotations[rotations.len() - rig.joints.len()] } else { frames.turn(n, row) });
        }
    }
    Clip::new(skeleton, fps, root, rotations)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::{ReadOptions, Unit, bvh};
    use crate::{Error, Motion, Source};

    const XYZ: &str = "Xposition Yposition Zposition";

    fn metres() -> ReadOptions {
        ReadOptions { unit: Unit::METRE, ..Default::default() }
    }

    fn read(text: &str, options: &ReadOptions) -> Result<Motion> {
        bvh::read(Path::new("x.bvh"), text.as_bytes(), options)
    }

    fn source(m: &Motion) -> &bvh::BvhSource {
        let Source::Bvh(source) = &m.source else { panic!("a BVH") };
        source
    }

    /// A root with six channels, rotations in this order, and a child at 0 10 0 with these channels.
    fn two(order: &str, child: &str, rows: &[&str]) -> String {
        let count = child.split_whitespace().count();
        format!(
            "HIERARCHY\nROOT a\n{{\nOFFSET 0 0 0\nCHANNELS 6 {XYZ} {order}\nJOINT b\n{{\nOFFSET 0 10 0\nCHANNELS {count} {child}\n\
             End Site\n{{\nOFFSET 0 1 0\n}}\n}}\n}}\nMOTION\nFrames: {}\nFrame Time: 0.05\n{}\n",
            rows.len(),
            rows.join("\n")
        )
    }

    fn child_at(text: &str, options: &ReadOptions) -> Vec3 {
        read(text, options).unwrap().clip.global_pose(0).positions[1]
    }

    #[test]
    fn turns_are_intrinsic_in_the_order_of_the_channels() {
        let (zxy, xzy) = ("Zrotation Xrotation Yrotation", "Xrotation Zrotation Yrotation");
        for (order, row, want) in [
            (zxy, "1 2 3 90 0 0", Vec3::new(-9.0, 2.0, 3.0)),
            (zxy, "1 2 3 90 90 0", Vec3::new(1.0, 2.0, 13.0)),
            (xzy, "1 2 3 90 90 0", Vec3::new(-9.0, 2.0, 3.0)),
        ] {
            assert!(child_at(&two(order, "", &[row]), &metres()).distance(want) < 1e-12, "{order} {row}");
        }
    }

    #[test]
    fn position_channels_replace_or_add_component_by_component() {
        let text = |child, row| two("Zrotation Xrotation Yrotation", child, &[row]);
        let add = ReadOptions { bvh_position: BvhPosition::Add, ..metres() };
        let three = text(XYZ, "0 0 0 0 0 0 1 2 3");
        assert_eq!(child_at(&three, &metres()), Vec3::new(1.0, 2.0, 3.0));
        assert_eq!(child_at(&three, &add), Vec3::new(1.0, 12.0, 3.0));
        let one = text("Yposition", "0 0 0 0 0 0 2");
        assert_eq!(child_at(&one, &metres()), Vec3::new(0.0, 2.0, 0.0));
        assert_eq!(child_at(&one, &add), Vec3::new(0.0, 12.0, 0.0));
        // positions apply before rotations, in any channel order
        let mixed = text("Xrotation Xposition Yposition Zposition", "0 0 0 0 0 0 90 1 2 3");
        assert_eq!(child_at(&mixed, &metres()), Vec3::new(1.0, 2.0, 3.0));
    }

    #[test]
    fn the_first_moving_only_child_is_the_root_of_the_motion() {
        let order = "Zrotation Xrotation Yrotation";
        let child = format!("{XYZ} {order}");
        let rows = ["5 0 0 90 0 0 1 0 0 0 90 0", "5 0 0 90 0 0 2 0 0 0 0 0"];
        let m = read(&two(order, &child, &rows), &metres()).unwrap();
        assert_eq!(m.clip.skeleton().names(), ["b"]);
        assert_eq!(source(&m).rig.chain, [0, 1]);
        assert!(m.clip.root()[0].distance(Vec3::new(5.0, 1.0, 0.0)) < 1e-12);
        assert!(m.clip.root()[1].distance(Vec3::new(5.0, 2.0, 0.0)) < 1e-12);
        let y = m.clip.pose(0)[0] * Vec3::Y;
        assert!(y.distance(Vec3::Z) < 1e-12);

        // a changed clip: zeros in the ROOT's channels, the whole transform in the child's
        let mut changed = m.clone();
        let root = m.clip.root().iter().map(|p| *p + Vec3::Z).collect();
        changed.clip = Clip::new(m.clip.skeleton().clone(), 20.0, root, m.clip.rotations().to_vec()).unwrap();
        let bytes = bvh::to_bytes(&changed).unwrap();
        let text = String::from_utf8(bytes.clone()).unwrap();
        let row = text.lines().rev().nth(1).unwrap();
        assert!(
            row.starts_with("0.000000 0.000000 0.000000 0.000000 0.000000 0.000000 5.000000 1.000000 1.000000"),
            "{row}"
        );
        let back = read(&text, &metres()).unwrap();
        assert!(back.clip.root()[0].distance(changed.clip.root()[0]) < 1e-6);
        assert_eq!(bvh::to_bytes(&back).unwrap(), bytes);
    }

    #[test]
    fn a_still_child_is_no_root_and_its_place_is_its_offset() {
        let order = "Zrotation Xrotation Yrotation";
        let still = two(order, XYZ, &["0 0 0 0 0 0 1.0004 2 3", "9 0 0 0 0 0 1 2 3"]);
        let m = read(&still, &metres()).unwrap();
        assert_eq!(m.clip.joints(), 2);
        assert!(m.clip.skeleton().offsets()[1].distance(Vec3::new(1.0002, 2.0, 3.0)) < 1e-12);
        assert!(m.warnings.is_empty() && source(&m).rig.stretch.is_empty());
    }

    #[test]
    fn stretch_is_dropped_and_said() {
        // a joint that carries less than a third of the others is not the root of the motion
        let file = |low: f64| {
            format!(
                "HIERARCHY\nROOT a {{ OFFSET 0 0 0 CHANNELS 0 JOINT b\n{{ OFFSET 0 9 0 CHANNELS 1 Yposition End Site {{ OFFSET 0 1 0 }} }}\n\
                 JOINT c\n{{ OFFSET 0 1 0 CHANNELS 0 End Site {{ OFFSET 0 1 0 }} }} }}\nMOTION\nFrames: 2\nFrame Time: 0.05\n{low}\n10\n"
            )
        };
        let m = read(&file(9.996), &metres()).unwrap();
        assert!((source(&m).rig.stretch[0].1 - 0.002).abs() < 1e-12 && m.warnings.is_empty());
        let m = read(&file(9.98), &metres()).unwrap();
        assert!((source(&m).position_channels()[0].stretch_m - 0.01).abs() < 1e-12);
        assert_eq!(m.warnings[0].kind, "stretch_dropped");
        assert!((m.clip.skeleton().offsets()[1].y - 9.99).abs() < 1e-12);
    }

    #[test]
    fn a_second_root_is_read_when_it_is_named() {
        let root =
            |name: &str| format!("ROOT {name}\n{{ OFFSET 0 0 0 CHANNELS 3 {XYZ}\nEnd Site {{ OFFSET 0 1 0 }} }}\n");
        let text = format!(
            "HIERARCHY\n{}{}MOTION\nFrames: 2\nFrame Time: 0.1\n1 2 3 4 5 6\n1 2 3 7 8 9\n",
            root("one"),
            root("two")
        );
        let m = read(&text, &metres()).unwrap();
        assert_eq!((m.clip.root()[0], m.warnings[0].kind), (Vec3::new(1.0, 2.0, 3.0), "several_roots"));
        let named = |n: &str| read(&text, &ReadOptions { root: Some(n.into()), ..metres() });
        let m = named("two").unwrap();
        assert_eq!(m.clip.root()[1], Vec3::new(7.0, 8.0, 9.0));
        let e = named("three").unwrap_err();
        assert_eq!(e.fault(), Some(FaultKind::RootUnknown));
        assert!(e.to_string().contains("\"one\", \"two\""), "{e}");

        // the other root keeps its numbers; at another rate those nearest in time
        let mut faster = m.clone();
        faster.clip = Clip::new(m.clip.skeleton().clone(), 20.0, vec![Vec3::ONE; 3], vec![Quat::IDENTITY; 3]).unwrap();
        let bytes = bvh::to_bytes(&faster).unwrap();
        let rows: Vec<_> = std::str::from_utf8(&bytes).unwrap().lines().rev().take(3).collect();
        assert!(rows.iter().all(|r| *r == "1.000000 2.000000 3.000000 1.000000 1.000000 1.000000"), "{rows:?}");
        let touched = named("one").unwrap();
        let flat =
            Clip::new(touched.clip.skeleton().clone(), 10.0, vec![Vec3::ZERO; 2], vec![Quat::IDENTITY; 2]).unwrap();
        let bytes = source(&touched).to_bytes(&flat).unwrap();
        assert!(
            bytes.ends_with(b"4.000000 5.000000 6.000000\n0.000000 0.000000 0.000000 7.000000 8.000000 9.000000\n")
        );
    }

    #[test]
    fn added_positions_are_suspected() {
        let text = two("Zrotation Xrotation Yrotation", XYZ, &["0 0 0 0 0 0 0.1 0 0", "0 0 0 0 0 0 0.1 0 0"]);
        let m = read(&text, &metres()).unwrap();
        let p = &source(&m).position_channels()[0];
        assert!(p.looks_added && (p.off_m - 9.9).abs() < 1e-12);
    }

    #[test]
    fn numbers_beyond_a_clip_are_an_error() {
        let text =
            two("Zrotation Xrotation Yrotation", XYZ, &["1e308 0 0 0 0 0 1e308 2 3", "-1e308 0 0 0 0 0 -1e308 2 3"]);
        assert!(matches!(read(&text, &metres()), Err(Error::Clip { .. })));
    }
}
