//! What stands before the rows of a BVH.

use super::frame_time;
use crate::format::source::bvh::{Header, Style};

/// Braces within braces that a reader takes.
pub(crate) const MAX_DEPTH: usize = 512;
/// Joints of all roots together that a reader takes.
pub(crate) const MAX_JOINTS: usize = 4096;

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
