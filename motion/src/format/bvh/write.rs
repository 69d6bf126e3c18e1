//! Clips to BVH: back onto the rig they came from, or onto a plain one.

use super::header::{Channel, Head, Node, NodeKind, Style};
use super::meaning::Rig;
use super::{BvhSource, frame_time};
use crate::format::{BvhPosition, atomic};
use crate::rotation::euler::unwrap_near;
use crate::rotation::{Axis, EulerOrder};
use crate::{Clip, Error, Motion, Quat, Result, Skeleton, Source, Vec3};
use std::io::Write;
use std::path::Path;
use std::sync::Arc;

/// Braces within braces that a reader takes.
const MAX_DEPTH: usize = 512;
/// Offsets that differ by more than this are another body, metres.
const SAME_M: f64 = 1e-9;

/// Writes a motion: on the rig of its BVH source where the joints are still the same, else on a plain one in centimetres.
///
/// A clip untouched since reading is written from the file's own numbers. The file appears whole or not at all.
///
/// # Errors
/// [`Error::Io`], and [`Error::Call`] for a clip that no BVH can hold (nesting, a rate below 1).
pub fn write(path: &Path, motion: &Motion) -> Result<()> {
    atomic::write(path, &to_bytes(motion)?)
}

/// The bytes that [`write()`] writes.
///
/// # Errors
/// [`Error::Call`] for a clip that no BVH can hold (nesting, a rate below 1).
pub fn to_bytes(motion: &Motion) -> Result<Vec<u8>> {
    match &motion.source {
        Source::Bvh(source) if source.fits(&motion.clip) => source.to_bytes(&motion.clip),
        _ => BvhSource::plain(motion.clip.skeleton())?.to_bytes(&motion.clip),
    }
}

impl BvhSource {
    /// A rig without frames for clips that come from no BVH: centimetres, the root with six channels, the others with
    /// `Zrotation Xrotation Yrotation`, an end site under every leaf.
    ///
    /// # Errors
    /// [`Error::Call`] when a chain of joints or their number is more than a BVH reader takes.
    pub fn plain(skeleton: &Arc<Skeleton>) -> Result<Self> {
        plain(skeleton)
    }

    /// Whether a clip has this rig's joints: the same names and parents.
    pub fn fits(&self, clip: &Clip) -> bool {
        let (own, its) = (&self.rig.skeleton, clip.skeleton());
        own.names() == its.names() && own.parents() == its.parents()
    }

    /// Writes any clip with this rig's joints, at the clip's own rate and with as many frames as it has.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Call`] when the joints are others or the rate is below 1.
    pub fn write_clip(&self, path: &Path, clip: &Clip) -> Result<()> {
        atomic::write(path, &self.to_bytes(clip)?)
    }

    /// The bytes that [`BvhSource::write_clip`] writes.
    ///
    /// # Errors
    /// [`Error::Call`] when the joints are others or the rate is below 1.
    pub fn to_bytes(&self, clip: &Clip) -> Result<Vec<u8>> {
        if !self.fits(clip) {
            let (own, its) = (self.rig.skeleton.joints(), clip.joints());
            return Err(Error::Call(format!(
                "a clip of {its} joints for a rig of {own}; expected the same names and parents"
            )));
        }
        let time = if self.fps() == clip.fps() { self.head.frame_time.clone() } else { frame_time::text(clip.fps())? };
        if self.is_untouched(clip) {
            return Ok(print(&self.head, &time, clip.frames(), &self.numbers));
        }
        let rig = self.for_clip(clip);
        let numbers = rig.rows(clip, self);
        Ok(print(&rig.head, &time, clip.frames(), &numbers))
    }
}

/// What a clip's body needs of a rig that the rig doesn't have.
struct Lack {
    /// Nodes whose OFFSET is another.
    offsets: Vec<(usize, Vec3)>,
    /// Channels to be added.
    channels: Vec<(usize, Channel)>,
}

impl BvhSource {
    /// This rig, with the offsets and channels that it lacks for a clip.
    fn for_clip(&self, clip: &Clip) -> BvhSource {
        let lack = self.lack(clip);
        let mut rig = BvhSource { numbers: Vec::new(), frames: 0, ..self.slice(0..0) };
        if lack.offsets.is_empty() && lack.channels.is_empty() {
            return rig;
        }
        for (node, offset) in lack.offsets {
            rig.head.nodes[node].offset = offset.to_array();
        }
        for (node, channel) in lack.channels {
            let at = match channel {
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
        let old = &self.head.pieces[0];
        let motion = old.windows(6).rposition(|w| w.eq_ignore_ascii_case(b"MOTION")).unwrap_or(old.len());
        let mut first = hierarchy(&rig.head.nodes, &rig.head.style);
        first.extend_from_slice(&old[motion..]);
        rig.head.pieces[0] = first;
        rig
    }

    fn lack(&self, clip: &Clip) -> Lack {
        let (nodes, rig, skeleton) = (&self.head.nodes, &self.rig, clip.skeleton());
        let mut lack = Lack { offsets: Vec::new(), channels: Vec::new() };
        for (j, &node) in rig.joints.iter().enumerate().skip(1) {
            let want = skeleton.offsets()[j];
            if (want - rig.skeleton.offsets()[j]).length() > SAME_M {
                lack.offsets.push((node, want / rig.unit_m));
            }
        }
        let ends = (rig.joints[0]..nodes.len()).filter(|&n| nodes[n].kind == NodeKind::End);
        let (own, its) = (rig.skeleton.ends(), skeleton.ends());
        if own.len() == its.len() && own.iter().zip(its).all(|(a, b)| a.parent == b.parent) {
            let differ = ends.zip(own.iter().zip(its)).filter(|(_, (a, b))| (a.offset - b.offset).length() > SAME_M);
            lack.offsets.extend(differ.map(|(n, (_, b))| (n, b.offset / rig.unit_m)));
        }
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
            if axes.len() < 3 && (0..clip.frames()).any(|f| !expressible(&axes, clip.pose(f)[j])) {
                let missing = order(&axes).0.into_iter().skip(axes.len());
                lack.channels.extend(missing.map(|a| (node, Channel::Rotation(a))));
            }
        }
        lack
    }

    /// Where the clip's root stands when all channels above and at it are 0, in the file's unit.
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

    /// The channels (F, C) of a clip. Nodes of other roots take the rows of `old` that are nearest in time.
    fn rows(&self, clip: &Clip, old: &BvhSource) -> Vec<f64> {
        let width = self.head.width;
        let mut numbers = vec![0.0; clip.frames() * width];
        let root = self.rig.chain[0];
        let own = |mut n: usize| {
            while let Some(parent) = self.head.nodes[n].parent {
                n = parent;
            }
            n == root
        };
        let others: Vec<usize> = (0..self.head.nodes.len()).filter(|&n| !own(n)).collect();
        let (still, metres) = (self.still_root(), self.rig.unit_m);
        for f in 0..clip.frames() {
            let (before, rest) = numbers.split_at_mut(f * width);
            let row = &mut rest[..width];
            let previous = before.len().checked_sub(width).map(|at| &before[at..]);
            self.place_others(&others, old, nearest_row(f, clip, old), row);
            self.place_root(clip.root()[f] / metres - still, row);
            for (j, &node) in self.rig.joints.iter().enumerate() {
                if j > 0 {
                    self.place_bone(node, clip.skeleton().offsets()[j] / metres, row);
                }
                self.turn(node, clip.pose(f)[j], previous, row);
            }
        }
        numbers
    }

    fn place_others(&self, others: &[usize], old: &BvhSource, frame: Option<usize>, row: &mut [f64]) {
        let Some(frame) = frame else { return };
        let from = old.as_frames();
        let from = from.row(frame);
        for &n in others {
            let (new, was) = (&self.head.nodes[n], &old.head.nodes[n]);
            row[new.column..new.column + new.channels.len()]
                .copy_from_slice(&from[was.column..was.column + was.channels.len()]);
        }
    }

    /// Puts the root where it is: each component into the innermost node that has its channel.
    fn place_root(&self, from_still: Vec3, row: &mut [f64]) {
        for axis in [Axis::X, Axis::Y, Axis::Z] {
            let holds = |n: &&usize| self.head.nodes[**n].channels.contains(&Channel::Position(axis));
            if let Some(&node) = self.rig.chain.iter().rev().find(holds) {
                self.set(node, Channel::Position(axis), from_still[axis.index()], row);
            }
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

/// The row of `old` that is nearest in time to a frame of a clip.
fn nearest_row(frame: usize, clip: &Clip, old: &BvhSource) -> Option<usize> {
    let last = old.frames.checked_sub(1)?;
    if clip.frames() == old.frames {
        return Some(frame);
    }
    Some(((frame as f64 / clip.fps() * old.fps()).round() as usize).min(last))
}

/// The axes of a node's rotation channels, in their order.
fn turns(node: &Node) -> Vec<Axis> {
    let axis = |c: &Channel| match c {
        Channel::Rotation(axis) => Some(*axis),
        Channel::Position(_) => None,
    };
    node.channels.iter().filter_map(axis).collect()
}

/// The order of some axes, filled up with those that are missing.
fn order(axes: &[Axis]) -> EulerOrder {
    let mut all = axes.to_vec();
    all.extend([Axis::X, Axis::Y, Axis::Z].into_iter().filter(|a| !axes.contains(a)));
    EulerOrder([all[0], all[1], all[2]])
}

/// Whether turns about these axes alone make a rotation, within 1e-4 degrees.
fn expressible(axes: &[Axis], q: Quat) -> bool {
    let order = order(axes);
    let mut angles = order.from_quat(q, 0.0);
    angles[axes.len()..].fill(0.0);
    crate::rotation::angle_between(order.to_quat(angles), q) < 1e-4f64.to_radians()
}

/// The whole text of a file.
fn print(head: &Head, frame_time: &str, frames: usize, numbers: &[f64]) -> Vec<u8> {
    let [before, between, after] = &head.pieces;
    let line_end = head.style.line_end.as_bytes();
    let mut out = Vec::with_capacity(before.len() + 100 + numbers.len() * 11);
    out.extend_from_slice(before);
    out.extend_from_slice(frames.to_string().as_bytes());
    out.extend_from_slice(between);
    out.extend_from_slice(frame_time.as_bytes());
    out.extend_from_slice(after);
    if !after.ends_with(b"\n") && !after.ends_with(b"\r") {
        out.extend_from_slice(line_end);
    }
    for row in numbers.chunks_exact(head.width.max(1)) {
        for (i, &v) in row.iter().enumerate() {
            if i > 0 {
                out.push(b' ');
            }
            push_number(&mut out, v);
        }
        out.extend_from_slice(line_end);
    }
    out
}

/// Appends a number with six decimals; one that rounds to zero has no sign.
fn push_number(out: &mut Vec<u8>, v: f64) {
    if v.abs() >= 1e8 {
        // a Vec takes every write
        let _ = write!(out, "{v:.6}");
        return;
    }
    let millionths = (v * 1e6).round() as i64;
    if millionths < 0 {
        out.push(b'-');
    }
    let (whole, mut fraction) = (millionths.unsigned_abs() / 1_000_000, millionths.unsigned_abs() % 1_000_000);
    let mut digits = [b'0'; 16];
    let mut at = digits.len();
    for _ in 0..6 {
        at -= 1;
        digits[at] = b'0' + (fraction % 10) as u8;
        fraction /= 10;
    }
    at -= 1;
    digits[at] = b'.';
    let mut whole = whole;
    loop {
        at -= 1;
        digits[at] = b'0' + (whole % 10) as u8;
        whole /= 10;
        if whole == 0 {
            break;
        }
    }
    out.extend_from_slice(&digits[at..]);
}

/// The text of a hierarchy.
fn hierarchy(nodes: &[Node], style: &Style) -> Vec<u8> {
    let mut text = format!("HIERARCHY{}", style.line_end);
    let mut open: Vec<usize> = Vec::new();
    let line = |text: &mut String, depth: usize, what: &str| {
        text.extend(std::iter::repeat_n(style.indent.as_str(), depth));
        text.push_str(what);
        text.push_str(&style.line_end);
    };
    for (i, n) in nodes.iter().enumerate() {
        while open.last().copied() != n.parent && open.pop().is_some() {
            line(&mut text, open.len(), "}");
        }
        let keyword = match n.kind {
            NodeKind::Root => "ROOT ",
            NodeKind::Joint => "JOINT ",
            NodeKind::End if n.name.is_empty() => "End Site",
            NodeKind::End => "End Site ",
        };
        let depth = open.len();
        line(&mut text, depth, &format!("{keyword}{}", n.name));
        line(&mut text, depth, "{");
        let [x, y, z] = n.offset;
        let mut offset = b"OFFSET".to_vec();
        for v in [x, y, z] {
            offset.push(b' ');
            push_number(&mut offset, v);
        }
        line(&mut text, depth + 1, &String::from_utf8_lossy(&offset));
        if n.kind != NodeKind::End {
            let names: String = n.channels.iter().map(|c| format!(" {}", c.name())).collect();
            line(&mut text, depth + 1, &format!("CHANNELS {}{names}", n.channels.len()));
        }
        open.push(i);
    }
    while open.pop().is_some() {
        line(&mut text, open.len(), "}");
    }
    text.into_bytes()
}

fn plain(skeleton: &Arc<Skeleton>) -> Result<BvhSource> {
    const METRES: f64 = 0.01;
    let mut children = vec![Vec::new(); skeleton.joints()];
    for (j, parent) in skeleton.parents().iter().enumerate().rev() {
        parent.iter().for_each(|&p| children[p].push(j));
    }
    let mut nodes: Vec<Node> = Vec::new();
    let mut joints = vec![0; skeleton.joints()];
    let mut width = 0;
    let mut next = vec![(0, None, 1)];
    while let Some((j, parent, depth)) = next.pop() {
        if depth >= MAX_DEPTH || nodes.len() >= 2 * 4096 {
            let (what, joints) = (&skeleton.names()[j], skeleton.joints());
            return Err(Error::Call(format!(
                "{what:?} at depth {depth} of {joints} joints is more than a BVH reader takes"
            )));
        }
        let node = nodes.len();
        joints[j] = node;
        let offset = if j == 0 { Vec3::ZERO } else { skeleton.offsets()[j] / METRES };
        let kind = if j == 0 { NodeKind::Root } else { NodeKind::Joint };
        let mut channels: Vec<Channel> = [Axis::Z, Axis::X, Axis::Y].map(Channel::Rotation).to_vec();
        if j == 0 {
            channels.splice(0..0, [Axis::X, Axis::Y, Axis::Z].map(Channel::Position));
        }
        let name = printable(&skeleton.names()[j], j);
        let count = channels.len();
        let unique = name.clone();
        nodes.push(Node { kind, name, unique, parent, offset: offset.to_array(), channels, column: width, at: 0 });
        width += count;
        for tip in tips(skeleton, j, children[j].is_empty()) {
            nodes.push(Node {
                kind: NodeKind::End,
                name: String::new(),
                unique: String::new(),
                parent: Some(node),
                offset: (tip / METRES).to_array(),
                channels: Vec::new(),
                column: width,
                at: 0,
            });
        }
        next.extend(children[j].iter().map(|&c| (c, Some(node), depth + 1)));
    }
    let style = Style { line_end: "\n".into(), indent: "  ".into() };
    let mut first = hierarchy(&nodes, &style);
    first.extend_from_slice(b"MOTION\nFrames: ");
    let head = Head {
        nodes,
        width,
        declared: 0,
        frame_time: "1".into(),
        rows_at: 0,
        warnings: Vec::new(),
        pieces: [first, b"\nFrame Time: ".to_vec(), b"\n".to_vec()],
        style,
    };
    let rig = Rig {
        chain: vec![0],
        joints,
        skeleton: skeleton.clone(),
        unit_m: METRES,
        unit_judged: false,
        position: BvhPosition::Replace,
        stretch: Vec::new(),
    };
    Ok(BvhSource { head, numbers: Vec::new(), frames: 0, rig })
}

/// The end sites of a joint; of a leaf that has none a short tip that continues the bone.
fn tips(skeleton: &Skeleton, joint: usize, leaf: bool) -> Vec<Vec3> {
    let own: Vec<Vec3> = skeleton.ends().iter().filter(|e| e.parent == joint).map(|e| e.offset).collect();
    if !own.is_empty() || !leaf {
        return own;
    }
    let bone = if joint == 0 { Vec3::ZERO } else { skeleton.offsets()[joint] };
    let tip = if bone.length() > 1e-6 { bone * 0.3 } else { Vec3::new(0.0, 0.02, 0.0) };
    vec![tip]
}

/// A name that a reader takes: no braces, no line ends, no blanks around it.
fn printable(name: &str, joint: usize) -> String {
    let plain: String = name.chars().map(|c| if matches!(c, '{' | '\r' | '\n') { '_' } else { c }).collect();
    let plain = plain.trim_matches([' ', '\t']);
    if plain.is_empty() { format!("joint{joint}") } else { plain.to_owned() }
}
