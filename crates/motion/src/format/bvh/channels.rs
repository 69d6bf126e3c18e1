//! A clip as channel values of a BVH rig.

use crate::format::BvhPosition;
use crate::format::source::bvh::{BvhRig, BvhSource, Channel, Node, NodeKind};
use crate::rotation::euler::unwrap_near;
use crate::rotation::{Axis, EulerOrder, Mat3, angle_between};
use crate::{Clip, Quat, Result, Vec3};

const AXES: [Axis; 3] = [Axis::X, Axis::Y, Axis::Z];

/// Offsets that differ by more than this belong to another body, metres.
const SAME_M: f64 = 1e-9;

/// The OFFSETs and channels that a rig lacks for a clip.
struct Lack {
    /// Nodes with another OFFSET.
    offsets: Vec<(usize, Vec3)>,
    /// Channels to add.
    channels: Vec<(usize, Channel)>,
}

impl BvhSource {
    /// This rig with the offsets and channels added that it lacks for a clip in the file's axes.
    ///
    /// # Errors
    /// None for a finite clip.
    pub(super) fn for_clip(&self, clip: &Clip) -> Result<BvhSource> {
        let lack = self.lack(clip)?;
        let mut rig = self.without_rows();
        if lack.offsets.is_empty() && lack.channels.is_empty() {
            return Ok(rig);
        }
        for (node, offset) in lack.offsets {
            rig.head.nodes[node].offset = offset.to_array();
        }
        for (node, channel) in lack.channels {
            let at = match channel {
                // positions before rotations, the usual order
                Channel::Position(_) => 0,
                Channel::Rotation(_) => rig.head.nodes[node].channels.len(),
            };
            rig.head.nodes[node].channels.insert(at, channel);
        }
        rig.head.width = 0;
        for n in &mut rig.head.nodes {
            n.column = rig.head.width;
            rig.head.width += n.channels.len();
        }
        rig.head.write_nodes();
        Ok(rig)
    }

    fn lack(&self, clip: &Clip) -> Result<Lack> {
        let (nodes, rig, skeleton) = (&self.head.nodes, &self.rig, clip.skeleton());
        let own = rig.axes.skeleton_from_y_up(&rig.skeleton)?;
        let mut lack = Lack { offsets: Vec::new(), channels: Vec::new() };
        for (j, &node) in rig.joints.iter().enumerate().skip(1) {
            let want = skeleton.offsets()[j];
            if (want - own.offsets()[j]).length() > SAME_M {
                lack.offsets.push((node, want / rig.unit_m));
            }
        }
        let ends = self.body().filter(|&n| nodes[n].kind == NodeKind::End);
        let (own, its) = (own.ends(), skeleton.ends());
        // end sites pair up by position alone; a clip with others leaves the file's
        if own.len() == its.len() && own.iter().zip(its).all(|(a, b)| a.parent == b.parent) {
            let differ = ends.zip(own.iter().zip(its)).filter(|(_, (a, b))| (a.offset - b.offset).length() > SAME_M);
            lack.offsets.extend(differ.map(|(n, (_, b))| (n, b.offset / rig.unit_m)));
        }
        // each is inserted at the front, so backwards they end up as X, Y, Z
        for axis in [Axis::Z, Axis::Y, Axis::X] {
            let channel = Channel::Position(axis);
            let still = self.still_root()[axis.index()] * rig.unit_m;
            let held = rig.chain.iter().any(|&n| nodes[n].channels.contains(&channel));
            if !held && clip.root().iter().any(|p| (p[axis.index()] - still).abs() > SAME_M) {
                lack.channels.push((rig.joints[0], channel));
            }
        }
        for (j, &node) in rig.joints.iter().enumerate() {
            let axes = turns(&nodes[node]);
            // nodes above the clip's root may rotate it about any axis
            let composed = j == 0 && rig.chain.len() > 1;
            if axes.len() < 3 && (composed || (0..clip.frames()).any(|f| !expressible(&axes, clip.pose(f)[j]))) {
                let missing = order(&axes).0.into_iter().skip(axes.len());
                lack.channels.extend(missing.map(|a| (node, Channel::Rotation(a))));
            }
        }
        Ok(lack)
    }

    /// Position of the clip's root when all channels above and at it are 0, in the file's unit.
    fn still_root(&self) -> Vec3 {
        self.rig.chain.iter().map(|&n| self.still(n)).sum()
    }

    fn still(&self, node: usize) -> Vec3 {
        let n = &self.head.nodes[node];
        let mut p = n.offset;
        for c in &n.channels {
            if let (Channel::Position(axis), BvhPosition::Replace) = (c, self.rig.position) {
                p[axis.index()] = 0.0;
            }
        }
        Vec3::from_array(p)
    }

    /// The channels (F, C) of a clip in the file's axes. Nodes of other roots and beside the body get the rows of `old` at
    /// the same time, or between two; so does what is above the clip's root, but for the channels that carry the path.
    pub(super) fn rows(&self, clip: &Clip, old: &BvhSource) -> Vec<f64> {
        self.rows_with(clip, old, None, |_, _| {})
    }

    /// Like [`BvhSource::rows`]; `change` may modify each row before the next one is made. With the number of frames that an
    /// edit leaves out at its start, frame by frame what is above keeps the file's row.
    pub(super) fn rows_with(
        &self,
        clip: &Clip,
        old: &BvhSource,
        before: Option<usize>,
        mut change: impl FnMut(usize, &mut [f64]),
    ) -> Vec<f64> {
        let width = self.head.width;
        let mut numbers = vec![0.0; clip.frames() * width];
        let own = self.head.below(self.rig.chain[0]);
        let others = (0..self.head.nodes.len()).filter(|n| !own.contains(n));
        let others: Vec<usize> = others.chain(self.beside()).collect();
        let above = self.kept_above(before.is_some());
        let metres = self.rig.unit_m;
        for f in 0..clip.frames() {
            let (earlier, rest) = numbers.split_at_mut(f * width);
            let row = &mut rest[..width];
            let previous = earlier.len().checked_sub(width).map(|at| &earlier[at..]);
            let at = row_at(f, clip, old, before);
            self.copy(&others, old, at, row);
            match above.is_empty() {
                true => self.rest_below_path(row),
                false => self.copy(&above, old, at, row),
            }
            self.place_root(clip.root()[f] / metres, row);
            for (j, &node) in self.rig.joints.iter().enumerate() {
                let turn = clip.pose(f)[j];
                if j > 0 {
                    self.place_bone(node, clip.skeleton().offsets()[j] / metres, row);
                    self.turn(node, turn, previous, row);
                } else {
                    let above = &self.rig.chain[..self.rig.chain.len() - 1];
                    // read from this row, into which the nodes above were copied already
                    let above = self.as_frames().along(above, row).1;
                    self.turn(node, above.conjugate() * turn, previous, row);
                }
            }
            change(f, row);
        }
        numbers
    }

    /// The nodes of the chain whose rows are copied from the file: all in an edit, and where other nodes descend from
    /// them. Otherwise channels above the path are 0, and so is all of the chain in a motion that was put on this rig.
    fn kept_above(&self, is_edit: bool) -> Vec<usize> {
        let chain = &self.rig.chain;
        if chain.len() == 1 || (self.floor_m.is_some() && !is_edit) {
            return Vec::new();
        }
        let first = chain.iter().position(|n| self.rig.path.contains(n)).unwrap_or(0);
        let all = is_edit || self.beside().next().is_some();
        chain[if all { 0 } else { first }..].to_vec()
    }

    /// Puts the nodes between the path and the clip's root at their rest positions.
    fn rest_below_path(&self, row: &mut [f64]) {
        let below = self.rig.chain.iter().skip_while(|n| !self.rig.path.contains(n)).skip(1);
        below.for_each(|&node| self.place_bone(node, Vec3::from_array(self.head.nodes[node].offset), row));
    }

    /// Copies channels of `old` at a row, or between it and the next.
    fn copy(&self, nodes: &[usize], old: &BvhSource, at: Option<(usize, f64)>, row: &mut [f64]) {
        let Some((first, share)) = at else { return };
        let frames = old.as_frames();
        let (from, to) = (frames.row(first), frames.row((first + 1).min(old.frames - 1)));
        for &n in nodes {
            let was = &old.head.nodes[n];
            for (channel, at) in was.channels.iter().zip(was.column..) {
                let step = match channel {
                    Channel::Position(_) => to[at] - from[at],
                    // the shorter way round
                    Channel::Rotation(_) => (to[at] - from[at] + 180.0).rem_euclid(360.0) - 180.0,
                };
                let value = if share > 0.0 { from[at] + share * step } else { from[at] };
                self.set(n, *channel, value, row);
            }
        }
    }

    /// Puts the clip's root at `place`, in the file's unit, by the channels that carry the path.
    fn place_root(&self, place: Vec3, row: &mut [f64]) {
        let BvhRig { chain, path, .. } = &self.rig;
        for (axis, &node) in AXES.into_iter().zip(path) {
            self.set(node, Channel::Position(axis), 0.0, row);
        }
        // with the path's channels at 0, this is what they have to add
        let mut by = place - self.as_frames().along(chain, row).0;
        if chain.len() > 1 {
            // the ways along which the three channels move the root
            let frames = self.as_frames();
            let way = |axis: Axis| {
                let above = chain.iter().take_while(|n| **n != path[axis.index()]);
                above.fold(Quat::IDENTITY, |turn, &n| turn * frames.turn(n, row)) * Vec3::AXES[axis.index()]
            };
            let ways = Mat3::from_cols(way(Axis::X), way(Axis::Y), way(Axis::Z));
            // parallel ways have no inverse; the numbers are then not finite, and `not_finite` refuses them
            by = ways.inverse() * by;
        }
        for (axis, &node) in AXES.into_iter().zip(path) {
            self.set(node, Channel::Position(axis), by[axis.index()], row);
        }
    }

    fn place_bone(&self, node: usize, offset: Vec3, row: &mut [f64]) {
        for axis in [Axis::X, Axis::Y, Axis::Z] {
            let value = match self.rig.position {
                BvhPosition::Replace => offset[axis.index()],
                BvhPosition::Add => offset[axis.index()] - self.head.nodes[node].offset[axis.index()],
            };
            self.set(node, Channel::Position(axis), value, row);
        }
    }

    fn turn(&self, node: usize, q: Quat, previous: Option<&[f64]>, row: &mut [f64]) {
        let n = &self.head.nodes[node];
        let axes = turns(n);
        if axes.is_empty() {
            return;
        }
        let place = |axis: Axis| n.channels.iter().position(|c| *c == Channel::Rotation(axis)).map(|i| n.column + i);
        let before = |axis: Axis| previous.zip(place(axis)).map(|(row, i)| row[i].to_radians());
        let order = order(&axes);
        // in gimbal lock only the sum of two angles is defined: the third stays as in the previous frame
        let third = before(order.0[2]).unwrap_or(0.0);
        for (axis, angle) in order.0.into_iter().zip(order.from_quat(q, third)) {
            let angle = before(axis).map_or(angle, |b| unwrap_near(angle, b));
            self.set(node, Channel::Rotation(axis), angle.to_degrees(), row);
        }
    }

    fn set(&self, node: usize, channel: Channel, value: f64, row: &mut [f64]) {
        let n = &self.head.nodes[node];
        if let Some(i) = n.channels.iter().position(|c| *c == channel) {
            row[n.column + i] = value;
        }
    }
}

/// Where a frame of a clip is among the rows of `old`: a row, and the share of the way to the next; its last row after its
/// end. An edit, with the number of frames that it leaves out at its start, goes row by row, and so does a clip of as many
/// frames.
fn row_at(frame: usize, clip: &Clip, old: &BvhSource, before: Option<usize>) -> Option<(usize, f64)> {
    let last = old.frames.checked_sub(1)?;
    let at = match before {
        Some(before) => (before + frame) as f64,
        None if clip.frames() == old.frames => frame as f64,
        None => frame as f64 / clip.fps() * old.read_fps,
    };
    // `at as usize` truncates, so the share is the fraction, and no row after the last is read
    Some(if at >= last as f64 { (last, 0.0) } else { (at as usize, at.fract()) })
}

/// The axes of a node's rotation channels, in order.
fn turns(node: &Node) -> Vec<Axis> {
    let axis = |c: &Channel| match c {
        Channel::Rotation(axis) => Some(*axis),
        Channel::Position(_) => None,
    };
    node.channels.iter().filter_map(axis).collect()
}

/// An order that starts with these axes and ends with the missing ones.
fn order(axes: &[Axis]) -> EulerOrder {
    let mut all = axes.to_vec();
    all.extend([Axis::X, Axis::Y, Axis::Z].into_iter().filter(|a| !axes.contains(a)));
    EulerOrder([all[0], all[1], all[2]])
}

/// Whether rotations about these axes alone can express a rotation, within 1e-4 degrees.
fn expressible(axes: &[Axis], q: Quat) -> bool {
    let order = order(axes);
    let mut angles = order.from_quat(q, 0.0);
    angles[axes.len()..].fill(0.0);
    angle_between(order.to_quat(angles), q) < 1e-4f64.to_radians()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::{ReadOptions, Unit, bvh};
    use crate::{Motion, Skeleton, Source};
    use std::path::Path;
    use std::sync::Arc;

    const XYZ: &str = "Xposition Yposition Zposition";

    fn options() -> ReadOptions {
        ReadOptions { unit: Unit::METRE, ..Default::default() }
    }

    fn read(bytes: &[u8], options: &ReadOptions) -> Motion {
        bvh::read(Path::new("x.bvh"), bytes, options).unwrap()
    }

    /// A root with a hinge joint, with these channels.
    fn rig(root: &str, hinge: &str, row: &str) -> Motion {
        let count = |c: &str| c.split_whitespace().count();
        let text = format!(
            "HIERARCHY\r\nROOT a\r\n{{\r\n\tOFFSET 0 1 0\r\n\tCHANNELS {} {root}\r\n\tJOINT b\r\n\t{{\r\n\t\tOFFSET 0 2 0\r\n\
             \t\tCHANNELS {} {hinge}\r\n\t\tEnd Site\r\n\t\t{{\r\n\t\t\tOFFSET 0 1 0\r\n\t\t}}\r\n\t}}\r\n}}\r\nmotion\r\n\
             Frames:\t1\r\nFrame Time:\t0.05\r\n{row}\r\n",
            count(root),
            count(hinge)
        );
        read(text.as_bytes(), &options())
    }

    fn source(m: &Motion) -> &BvhSource {
        let Source::Bvh(source) = &m.source else { panic!("a BVH") };
        source
    }

    /// Writes a clip on a rig and reads it again.
    fn through(rig: &Motion, clip: &Clip, options: &ReadOptions) -> (String, Clip) {
        let bytes = source(rig).to_bytes(clip).unwrap();
        let back = read(&bytes, options);
        assert_eq!(bvh::to_bytes(&back).unwrap(), bytes);
        for f in 0..clip.frames() {
            let (a, b) = (clip.global_pose(f), back.clip.global_pose(f));
            for j in 0..clip.joints() {
                assert!(a.positions[j].distance(b.positions[j]) < 1e-5, "frame {f} joint {j}");
                assert!(angle_between(a.rotations[j], b.rotations[j]) < 1e-6, "frame {f} joint {j}");
            }
        }
        (String::from_utf8(bytes).unwrap(), back.clip)
    }

    fn clip(rig: &Motion, root: Vec<Vec3>, rotations: Vec<Quat>) -> Clip {
        Clip::new(rig.clip.skeleton().clone(), 20.0, root, rotations).unwrap()
    }

    #[test]
    fn channels_that_a_clip_needs_are_added() {
        let rig = rig("Yrotation", "Xrotation", "10 20");
        let same =
            clip(&rig, vec![Vec3::Y; 2], vec![Axis::Y.turn(1.0), Axis::X.turn(0.5), Quat::IDENTITY, Quat::IDENTITY]);
        let (text, _) = through(&rig, &same, &options());
        assert!(text.contains("CHANNELS 1 Xrotation\r\n"), "{text}");

        let other = clip(
            &rig,
            vec![Vec3::ONE; 2],
            vec![Axis::Y.turn(1.0), Axis::Z.turn(0.5), Quat::IDENTITY, Axis::Y.turn(0.1)],
        );
        let (text, _) = through(&rig, &other, &options());
        assert!(text.contains("\tCHANNELS 3 Xposition Zposition Yrotation\r\n"), "{text}");
        assert!(text.contains("\t\tCHANNELS 3 Xrotation Yrotation Zrotation\r\n"), "{text}");
        assert!(text.contains("motion\r\nFrames:\t2\r\nFrame Time:\t0.05\r\n"), "{text}");
    }

    #[test]
    fn another_body_has_other_offsets() {
        let rig = rig(&format!("{XYZ} Zrotation Xrotation Yrotation"), "Xrotation", "0 1 0 0 0 0 20");
        let s = rig.clip.skeleton();
        let longer = Skeleton::new(
            s.names().to_vec(),
            s.parents().to_vec(),
            vec![Vec3::ZERO, Vec3::Y * 3.0],
            vec![s.ends()[0].clone()],
        );
        let c = Clip::new(Arc::new(longer.unwrap()), 20.0, vec![Vec3::X], vec![Quat::IDENTITY; 2]).unwrap();
        let (text, back) = through(&rig, &c, &options());
        assert!(text.contains("\t\tOFFSET 0.000000 3.000000 0.000000\r\n"), "{text}");
        assert_eq!(back.skeleton().ends(), s.ends());
    }

    #[test]
    fn turns_run_on_and_poles_keep_the_third_angle() {
        let rig =
            rig(&format!("{XYZ} Zrotation Xrotation Yrotation"), "Zrotation Xrotation Yrotation", "0 1 0 0 0 0 0 0 20");
        let order = EulerOrder([Axis::Z, Axis::X, Axis::Y]);
        let deg = |a: [f64; 3]| order.to_quat(a.map(f64::to_radians));
        let turning = |i: usize| Axis::Z.turn((50.0 * i as f64).to_radians());
        let rotations = vec![
            turning(0),
            deg([10.0, 80.0, 30.0]),
            turning(1),
            deg([12.0, 90.0, 31.0]),
            turning(2),
            deg([14.0, 90.0, 35.0]),
            turning(3),
            deg([16.0, 80.0, 40.0]),
            turning(4),
            deg([16.0, 70.0, 170.0]),
            turning(5),
            deg([16.0, 60.0, -170.0]),
        ];
        let (text, _) = through(&rig, &clip(&rig, vec![Vec3::ZERO; 6], rotations), &options());
        let rows: Vec<Vec<f64>> = text
            .lines()
            .skip_while(|l| !l.starts_with("Frame Time"))
            .skip(1)
            .map(|l| l.split(' ').map(|w| w.parse().unwrap()).collect())
            .collect();
        let column = |c: usize| rows.iter().map(|r| r[c]).collect::<Vec<f64>>();
        assert_eq!(column(3), [0.0, 50.0, 100.0, 150.0, 200.0, 250.0]);
        assert_eq!(column(8), [30.0, 30.0, 30.0, 40.0, 170.0, 190.0]);
        // in gimbal lock only the sum of the outer angles is determined: 12 + 31, 14 + 35
        assert_eq!(column(6)[..4], [10.0, 13.0, 19.0, 16.0]);
    }

    #[test]
    fn added_positions_are_written_as_added() {
        let text = format!(
            "HIERARCHY\nROOT a {{ OFFSET 0 1 0 CHANNELS 3 {XYZ} JOINT c\n{{ OFFSET 1 0 0 CHANNELS 1 Xrotation }} JOINT b\n{{ OFFSET 0 2 0 CHANNELS 4 {XYZ} Xrotation }} }}\n\
             MOTION\nFrames: 1\nFrame Time: 0.05\n5 5 5 0 0.5 0 0 0\n"
        );
        let add = ReadOptions { bvh_position: BvhPosition::Add, ..options() };
        let rig = read(text.as_bytes(), &add);
        assert_eq!(rig.clip.root()[0], Vec3::new(5.0, 6.0, 5.0));
        let c = clip(&rig, vec![Vec3::new(1.0, 2.0, 3.0)], vec![Quat::IDENTITY, Axis::X.turn(1.0), Quat::IDENTITY]);
        let (text, _) = through(&rig, &c, &add);
        assert!(
            text.contains("\n1.000000 1.000000 3.000000 57.295780 0.500000 0.000000 0.000000 0.000000\n"),
            "{text}"
        );
    }

    #[test]
    fn another_rate_has_another_frame_time() {
        let rig = rig(&format!("{XYZ} Zrotation Xrotation Yrotation"), "Xrotation", "0 1 0 0 0 0 20");
        for fps in [20.0, 30.0, 60.0, 23.976, 1000.0] {
            let c = rig.clip.clone().with_fps(fps).unwrap();
            let bytes = source(&rig).to_bytes(&c).unwrap();
            assert!((read(&bytes, &options()).clip.fps() / fps - 1.0).abs() < 1e-15);
        }
        let other = Clip::new(crate::smpl::neutral(), 20.0, vec![], vec![]).unwrap();
        assert!(source(&rig).to_bytes(&other).is_err());
    }
}
