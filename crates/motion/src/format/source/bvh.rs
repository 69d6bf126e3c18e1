//! What a BVH says beside its clip: header, numbers, and how they were understood.

use crate::format::{Axes, BvhPosition};
use crate::rotation::Axis;
use crate::{Skeleton, Warning};
use std::ops::Range;
use std::sync::Arc;

/// What a BVH says beside its clip: the whole header and the numbers themselves.
#[derive(Debug, Clone, PartialEq)]
pub struct BvhSource {
    /// Everything before the rows.
    pub head: Header,
    /// (F, C) the numbers as they stand in the file: lengths in its unit, angles in degrees.
    pub numbers: Vec<f64>,
    /// F.
    pub frames: usize,
    /// How the nodes are the clip's joints.
    pub rig: BvhRig,
    /// Of a motion that was put on this rig from another: where its floor was found before that, metres.
    pub floor_m: Option<f64>,
}

impl BvhSource {
    /// The rows of a range of frames; the decisions of reading stay.
    ///
    /// # Panics
    /// If the range leaves the frames.
    pub fn slice(&self, frames: Range<usize>) -> Self {
        let c = self.head.width;
        BvhSource {
            head: self.head.clone(),
            numbers: self.numbers[frames.start * c..frames.end * c].to_vec(),
            frames: frames.len(),
            rig: self.rig.clone(),
            floor_m: self.floor_m,
        }
    }

    /// Whether the rotation channels from the file's ROOT to the clip's root are all exactly 0 in a frame.
    pub(crate) fn root_unturned(&self, frame: usize) -> bool {
        let row = &self.numbers[frame * self.head.width..(frame + 1) * self.head.width];
        self.rig.chain.iter().all(|&node| {
            let n = &self.head.nodes[node];
            let mut turns = n.channels.iter().zip(&row[n.column..]);
            turns.all(|(c, &v)| matches!(c, Channel::Position(_)) || v == 0.0)
        })
    }
}

/// How a file's nodes and channels are a clip: what was decided on reading, and holds for writing back.
#[derive(Debug, Clone, PartialEq)]
pub struct BvhRig {
    /// The nodes from the file's ROOT to the clip's root, both included: one where nothing was folded.
    pub chain: Vec<usize>,
    /// (J) node of each joint.
    pub joints: Vec<usize>,
    /// The clip's skeleton, metres, y up.
    pub skeleton: Arc<Skeleton>,
    /// Metres of the file's unit.
    pub unit_m: f64,
    /// Whether the unit was judged by the legs.
    pub unit_judged: bool,
    /// What position channels do to the OFFSET.
    pub position: BvhPosition,
    /// Per joint below the root whose position channels vary: the largest distance from their mean, metres, dropped.
    pub stretch: Vec<(usize, f64)>,
    /// How the file's axes are turned to make the clip's.
    pub axes: Axes,
}

/// One channel of a joint.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Channel {
    /// In the file's unit.
    Position(Axis),
    /// In degrees.
    Rotation(Axis),
}

impl Channel {
    /// The name as BVH files usually write it.
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

/// What a node of the hierarchy is.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum NodeKind {
    /// `ROOT`.
    Root,
    /// `JOINT`.
    Joint,
    /// `End Site`.
    End,
}

/// A root, joint or end site, as the file has it.
#[derive(Debug, Clone, PartialEq)]
pub struct Node {
    /// What it is.
    pub kind: NodeKind,
    /// The name as found; may be empty for an end site.
    pub name: String,
    /// The name that stands once: of a joint whose name occurred before, `name.2`. Of an end site empty.
    pub unique: String,
    /// The node around it.
    pub parent: Option<usize>,
    /// `OFFSET`, in the file's unit.
    pub offset: [f64; 3],
    /// `CHANNELS`, in the file's order.
    pub channels: Vec<Channel>,
    /// Place of its first channel in a row.
    pub column: usize,
    /// Byte of its keyword in the file.
    pub at: usize,
}

/// How the file ends its lines and indents them, for a header that has to be written anew.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) struct Style {
    pub line_end: String,
    pub indent: String,
}

/// Everything before the rows, with the bytes themselves where they are written back.
#[derive(Debug, Clone, PartialEq)]
pub struct Header {
    /// Nodes in file order, parents before children.
    pub nodes: Vec<Node>,
    /// C, the numbers of a row: the channels of all roots.
    pub width: usize,
    /// The frames that the file declares.
    pub declared: u64,
    /// `Frame Time` as it stands there.
    pub frame_time: String,
    /// Byte where the rows start.
    pub rows_at: usize,
    /// What was odd.
    pub warnings: Vec<Warning>,
    /// Bytes before the frame count, between it and the frame time, and after that to the end of the line.
    pub(crate) pieces: [Vec<u8>; 3],
    pub(crate) style: Style,
}
