//! Channels to a clip: PROTOCOLS 1.3.

use super::header::{Channel, Head, Node, NodeKind};
use super::text::Text;
use super::unit;
use crate::format::{BvhPosition, ReadOptions};
use crate::{Clip, EndSite, Error, Kind, Quat, Result, Skeleton, Vec3, Warning};
use std::ops::Range;
use std::path::Path;
use std::sync::Arc;

/// Position channels that stay within this of their mean are a bone's offset, metres.
const STILL_M: f64 = 0.0005;
/// Stretch that is dropped silently up to this, metres.
const STRETCH_M: f64 = 0.005;

/// How a file's nodes and channels are a clip: what was decided on reading, and holds for writing back.
#[derive(Debug, Clone, PartialEq)]
pub struct Rig {
    /// The nodes from the file's ROOT to the clip's root, both included: one where nothing was folded.
    pub chain: Vec<usize>,
    /// (J) node of each joint.
    pub joints: Vec<usize>,
    /// The clip's skeleton, metres.
    pub skeleton: Arc<Skeleton>,
    /// Metres of the file's unit.
    pub unit_m: f64,
    /// Whether the unit was judged by the legs.
    pub unit_judged: bool,
    /// What position channels do to the OFFSET.
    pub position: BvhPosition,
    /// Per joint below the root whose position channels vary: the largest distance from their mean, metres, dropped.
    pub stretch: Vec<(usize, f64)>,
}

/// The rows of a file as frames of its nodes.
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

    /// Place of a node in its parent at a row, in the file's unit.
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

    /// Rotation of a node in its parent at a row: the turns in the order of the channels, intrinsic.
    pub fn turn(&self, node: usize, row: &[f64]) -> Quat {
        let n = &self.nodes[node];
        let mut turns = n.channels.iter().zip(&row[n.column..]).filter_map(|(c, v)| match c {
            Channel::Rotation(axis) => Some(axis.turn(v.to_radians())),
            Channel::Position(_) => None,
        });
        let first = turns.next().unwrap_or(Quat::IDENTITY);
        turns.fold(first, |q, t| q * t)
    }

    fn moves(&self, node: usize) -> bool {
        self.nodes[node].channels.iter().any(|c| matches!(c, Channel::Position(_)))
    }

    /// Mean place over the frames, and the largest distance from it; of one that never moves exactly its place.
    pub fn mean_place(&self, node: usize) -> (Vec3, f64) {
        if !self.moves(node) || self.frames == 0 {
            return (Vec3::from_array(self.nodes[node].offset), 0.0);
        }
        let places = || (0..self.frames).map(|f| self.place(node, self.row(f)));
        let first = self.place(node, self.row(0));
        let mean = first + places().map(|p| p - first).sum::<Vec3>() / self.frames as f64;
        (mean, places().map(|p| p.distance(mean)).fold(0.0, f64::max))
    }
}

/// The nodes of the root that is asked for: itself and all under it.
pub(crate) fn choose_root(path: &Path, head: &Head, options: &ReadOptions) -> Result<Range<usize>> {
    let is_root = |i: &usize| head.nodes[*i].kind == NodeKind::Root;
    let roots: Vec<usize> = (0..head.nodes.len()).filter(is_root).collect();
    let at = match &options.root {
        None => 0,
        Some(name) => {
            let unique = roots.iter().position(|&r| &head.nodes[r].unique == name);
            let found = unique.or_else(|| roots.iter().position(|&r| &head.nodes[r].name == name));
            found.ok_or_else(|| {
                let all: Vec<_> = roots.iter().map(|&r| format!("{:?}", head.nodes[r].unique)).collect();
                let text = Text::new(path, &head.pieces[0]);
                let at = roots.first().map_or(0, |&r| head.nodes[r].at);
                let fault = text.fault(at, Kind::RootUnknown, format!("no ROOT {name:?}"), "a ROOT of the file");
                fault.help(format!("there are {}", all.join(", ")))
            })?
        }
    };
    let end = roots.get(at + 1).copied().unwrap_or(head.nodes.len());
    Ok(roots.get(at).copied().unwrap_or(0)..end)
}

/// What the nodes mean, judged by the rows.
pub(crate) fn decide(path: &Path, head: &Head, frames: &Frames, options: &ReadOptions) -> Result<(Rig, Vec<Warning>)> {
    let range = choose_root(path, head, options)?;
    let nodes = &head.nodes;
    let means: Vec<(Vec3, f64)> = range.clone().map(|n| frames.mean_place(n)).collect();
    let mean = |n: usize| means[n - range.start];
    let (unit_m, unit_judged) = match options.unit.metres() {
        Some(m) => (m, false),
        None => (unit::judge(path, head, range.clone(), |n| mean(n).0, options)?, true),
    };
    let chain = chain(nodes, range.clone(), |n| mean(n).1 * unit_m > STILL_M);
    let root = *chain.last().unwrap_or(&range.start);
    let joints: Vec<usize> = (root..range.end).filter(|&n| nodes[n].kind != NodeKind::End).collect();
    let skeleton = skeleton(nodes, &joints, root..range.end, |n| mean(n).0 * unit_m);
    let skeleton = skeleton.map_err(|e| Error::Clip { clip: path.display().to_string(), what: e.to_string() })?;
    let stretch = |(j, &n): (usize, &usize)| (j > 0 && mean(n).1 * unit_m > STILL_M).then(|| (j, mean(n).1 * unit_m));
    let stretch: Vec<(usize, f64)> = joints.iter().enumerate().filter_map(stretch).collect();
    let warnings = stretch_warning(&skeleton, &stretch);
    let position = options.bvh_position;
    let rig = Rig { chain, joints, skeleton: Arc::new(skeleton), unit_m, unit_judged, position, stretch };
    Ok((rig, warnings))
}

/// From the ROOT down while a node's only child is a joint that moves: that joint is the root of the motion.
fn chain(nodes: &[Node], range: Range<usize>, moves: impl Fn(usize) -> bool) -> Vec<usize> {
    let mut chain = vec![range.start];
    let mut at = range.start;
    loop {
        let mut children = (at + 1..range.end).filter(|&n| nodes[n].parent == Some(at));
        match (children.next(), children.next()) {
            (Some(child), None) if nodes[child].kind == NodeKind::Joint && moves(child) => {
                chain.push(child);
                at = child;
            }
            _ => return chain,
        }
    }
}

fn skeleton(nodes: &[Node], joints: &[usize], range: Range<usize>, offset: impl Fn(usize) -> Vec3) -> Result<Skeleton> {
    let joint = |node: Option<usize>| node.and_then(|n| joints.binary_search(&n).ok());
    let names = joints.iter().map(|&n| nodes[n].unique.clone()).collect();
    let parents = joints.iter().map(|&n| joint(nodes[n].parent)).collect();
    let ends = range.filter(|&n| nodes[n].kind == NodeKind::End);
    let ends = ends.filter_map(|n| Some(EndSite { parent: joint(nodes[n].parent)?, offset: offset(n) }));
    Skeleton::new(names, parents, joints.iter().map(|&n| offset(n)).collect(), ends.collect())
}

fn stretch_warning(skeleton: &Skeleton, stretch: &[(usize, f64)]) -> Vec<Warning> {
    let large: Vec<_> = stretch.iter().filter(|(_, m)| *m > STRETCH_M).collect();
    let Some((joint, most)) = large.iter().max_by(|a, b| a.1.total_cmp(&b.1)) else { return Vec::new() };
    let what = format!(
        "bones of {} joints change their length, most {:?} by {:.1} mm; their mean is taken",
        large.len(),
        skeleton.names()[*joint],
        most * 1000.0
    );
    vec![Warning { kind: "stretch_dropped", what }]
}

/// The clip of a rig's rows.
pub(crate) fn clip(rig: &Rig, frames: &Frames, fps: f64) -> Result<Clip> {
    let mut root = Vec::with_capacity(frames.frames);
    let mut rotations = Vec::with_capacity(frames.frames * rig.joints.len());
    for f in 0..frames.frames {
        let row = frames.row(f);
        let (mut p, mut q) = (frames.place(rig.chain[0], row), frames.turn(rig.chain[0], row));
        for &node in &rig.chain[1..] {
            p += q * frames.place(node, row);
            q *= frames.turn(node, row);
        }
        root.push(p * rig.unit_m);
        rotations.push(q);
        rotations.extend(rig.joints[1..].iter().map(|&n| frames.turn(n, row)));
    }
    Clip::new(rig.skeleton.clone(), fps, root, rotations)
}
