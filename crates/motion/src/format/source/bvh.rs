//! The content of a BVH beyond its clip: header, numbers, and how they are interpreted.

use crate::clip::keep;
use crate::format::{Axes, BvhPosition};
use crate::rotation::Axis;
use crate::{Skeleton, Warning};
use std::ops::Range;
use std::sync::Arc;

/// The content of a BVH beyond its clip: the whole header and the numbers.
#[derive(Debug, Clone, PartialEq)]
pub struct BvhSource {
    /// Everything before the rows.
    pub head: Header,
    /// The numbers (F, C) in the file's unit, angles in degrees.
    pub numbers: Vec<f64>,
    /// F, the number of frames.
    pub frames: usize,
    /// The rate that the rows were read at, frames per second; the file's frame time may state another.
    pub read_fps: f64,
    /// How nodes correspond to the clip's joints.
    pub rig: BvhRig,
    /// The floor before retargeting, metres, if the motion was put on this rig from another.
    pub floor_m: Option<f64>,
}

impl BvhSource {
    /// Leaves the rows of these frames alone, in place. The interpretation stays.
    ///
    /// # Panics
    /// If the range leaves the frames.
    pub(crate) fn keep(&mut self, frames: Range<usize>) {
        self.frames = frames.len();
        keep(&mut self.numbers, frames, self.head.width);
    }

    /// The same without rows.
    pub(crate) fn without_rows(&self) -> BvhSource {
        let BvhSource { head, numbers: _, frames: _, read_fps, rig, floor_m } = self;
        let (head, rig) = (head.clone(), rig.clone());
        BvhSource { head, numbers: Vec::new(), frames: 0, read_fps: *read_fps, rig, floor_m: *floor_m }
    }

    /// The nodes from the clip's root down to the last of its tips; those of its joints and end sites.
    pub(crate) fn body(&self) -> Range<usize> {
        self.head.below(self.rig.joints[0])
    }

    /// The nodes of the ROOT that is read that are no part of the clip and not above it: IK targets, props.
    pub(crate) fn beside(&self) -> impl Iterator<Item = usize> {
        let (body, chain) = (self.body(), self.rig.chain.clone());
        self.head.below(chain[0]).filter(move |n| !body.contains(n) && !chain.contains(n))
    }

    /// Whether all rotation channels from the file's ROOT to the clip's root are exactly 0 in a frame.
    pub(crate) fn root_unturned(&self, frame: usize) -> bool {
        let row = &self.numbers[frame * self.head.width..(frame + 1) * self.head.width];
        self.rig.chain.iter().all(|&node| {
            let n = &self.head.nodes[node];
            let mut turns = n.channels.iter().zip(&row[n.column..]);
            turns.all(|(c, &v)| matches!(c, Channel::Position(_)) || v == 0.0)
        })
    }
}

/// How a BVH's nodes and channels are interpreted as a clip, for reading and for writing back.
#[derive(Debug, Clone, PartialEq)]
pub struct BvhRig {
    /// The nodes from the file's ROOT to the clip's root, inclusive. More than one if what is above the body was composed
    /// into it.
    pub chain: Vec<usize>,
    /// By axis of the file, the node of the chain whose position channel carries the path: the one that varies most.
    pub path: [usize; 3],
    /// The node of each joint (J).
    pub joints: Vec<usize>,
    /// The clip's skeleton, metres, y up.
    pub skeleton: Arc<Skeleton>,
    /// The file's unit in metres.
    pub unit_m: f64,
    /// Whether the unit was inferred from the leg length.
    pub unit_judged: bool,
    /// What position channels do to the OFFSET.
    pub position: BvhPosition,
    /// Joints below the root whose position channels vary, with the largest distance from the mean, metres. It is dropped.
    pub stretch: Vec<(usize, f64)>,
    /// How the file's axes are rotated to the clip's.
    pub axes: Axes,
}

/// A channel of a joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channel {
    /// In the file's unit.
    Position(Axis),
    /// In degrees.
    Rotation(Axis),
}

impl Channel {
    /// The usual spelling of the channel's name.
    pub fn name(self) -> &'static str {
        match self {
            Channel::Position(axis) => ["Xposition", "Yposition", "Zposition"][axis.index()],
            Channel::Rotation(axis) => ["Xrotation", "Yrotation", "Zrotation"][axis.index()],
        }
    }

    pub(crate) fn parse(word: &[u8]) -> Option<Self> {
        let all = [Axis::X, Axis::Y, Axis::Z].into_iter().flat_map(|a| [Channel::Position(a), Channel::Rotation(a)]);
        all.into_iter().find(|c| c.name().as_bytes().eq_ignore_ascii_case(word))
    }
}

/// The kinds of nodes in the hierarchy.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NodeKind {
    /// `ROOT`.
    Root,
    /// `JOINT`.
    Joint,
    /// `End Site`.
    End,
}

/// A root, joint or end site of the file.
#[derive(Debug, Clone, PartialEq)]
pub struct Node {
    /// The kind of node.
    pub kind: NodeKind,
    /// The name in the file; may be empty for an end site.
    pub name: String,
    /// A unique name: `name.2` if the name occurred before; empty for an end site.
    pub unique: String,
    /// The parent node.
    pub parent: Option<usize>,
    /// `OFFSET`, in the file's unit.
    pub offset: [f64; 3],
    /// `CHANNELS`, in the file's order.
    pub channels: Vec<Channel>,
    /// Index of its first channel in a row.
    pub column: usize,
    /// Byte offset of its keyword in the file.
    pub at: usize,
}

/// Line ends and indentation of the file, for writing a new header.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Style {
    pub line_end: String,
    pub indent: String,
}

impl Header {
    /// A node and all nodes below it, which follow it in the file.
    pub(crate) fn below(&self, node: usize) -> Range<usize> {
        // the nodes are in depth-first order, so those below are the run whose parents don't precede the node
        let is_below = |n: &usize| self.nodes[*n].parent.is_some_and(|parent| parent >= node);
        node..(node + 1..self.nodes.len()).find(|n| !is_below(n)).unwrap_or(self.nodes.len())
    }
}

/// Everything before the rows, including the original bytes.
#[derive(Debug, Clone, PartialEq)]
pub struct Header {
    /// Nodes in file order, parents before children.
    pub nodes: Vec<Node>,
    /// C, the number of channels of all roots.
    pub width: usize,
    /// The declared number of frames.
    pub declared: u64,
    /// `Frame Time` as written in the file.
    pub frame_time: String,
    /// Byte offset of the first row.
    pub rows_at: usize,
    /// Warnings about the header.
    pub warnings: Vec<Warning>,
    /// Bytes before the frame count, between it and the frame time, and from there to the end of the line.
    pub(crate) pieces: [Vec<u8>; 3],
    pub(crate) style: Style,
}
