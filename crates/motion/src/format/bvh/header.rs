//! What stands before the rows of a BVH.

use super::frame_time;
use crate::Warning;
use crate::rotation::Axis;

/// Braces within braces that a reader takes.
pub(crate) const MAX_DEPTH: usize = 512;
/// Joints of all roots together that a reader takes.
pub(crate) const MAX_JOINTS: usize = 4096;

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

impl Header {
    /// Frames per second by the text of the frame time.
    pub fn fps(&self) -> f64 {
        frame_time::rate(&self.frame_time).unwrap_or(1.0)
    }
}

/// The line end at a byte; empty where there is none.
pub(crate) fn line_end_at(bytes: &[u8], at: usize) -> &'static str {
    match bytes.get(at..) {
        Some([b'\r', b'\n', ..]) => "\r\n",
        Some([b'\r', ..]) => "\r",
        Some([b'\n', ..]) => "\n",
        _ => "",
    }
}

/// The line end of the first row (empty where there is none), and the first indent of the header.
pub(crate) fn style(header: &[u8], rows: &[u8]) -> Style {
    let row = rows.iter().position(|b| !b.is_ascii_whitespace()).unwrap_or(rows.len());
    let end = rows[row..].iter().position(|b| matches!(b, b'\r' | b'\n')).map_or(rows.len(), |i| row + i);
    let mut lines = header.split(|b| matches!(b, b'\r' | b'\n'));
    let indented = lines.find(|l| matches!(l, [b' ' | b'\t', ..])).unwrap_or(b"  ");
    let blanks = indented.iter().take_while(|b| matches!(b, b' ' | b'\t')).take(8);
    Style { line_end: line_end_at(rows, end).into(), indent: blanks.map(|&b| b as char).collect() }
}
