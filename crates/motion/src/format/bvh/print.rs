//! Printing of a BVH.

use crate::format::source::bvh::{Header, Node, NodeKind, Style};
use crate::{Error, Result};
use std::io::Write;

/// The complete text of a file.
///
/// # Errors
/// Those of [`not_finite`].
pub(crate) fn print(head: &Header, frame_time: &str, frames: usize, numbers: &[f64]) -> Result<Vec<u8>> {
    not_finite(head, numbers)?;
    let line_end = head.style.line_end.as_bytes();
    let mut out = print_head(head, frame_time, frames, numbers.len());
    for row in numbers.chunks_exact(head.width.max(1)) {
        for (i, &v) in row.iter().enumerate() {
            if i > 0 {
                out.push(b' ');
            }
            push_number(&mut out, v);
        }
        out.extend_from_slice(line_end);
    }
    Ok(out)
}

/// Refuses OFFSETs and rows with numbers that are not finite.
///
/// # Errors
/// [`Invalid`](kinelm_store::Error::Invalid) with the joint or the frame.
pub(super) fn not_finite(head: &Header, numbers: &[f64]) -> Result<()> {
    let bad = |x: &f64| !x.is_finite();
    let offsets = head
        .nodes
        .iter()
        .find_map(|node| Some((format!("an OFFSET of {}", node.name), *node.offset.iter().find(|x| bad(x))?)));
    let rows = || {
        numbers.iter().position(bad).map(|at| (format!("a number of frame {}", at / head.width.max(1)), numbers[at]))
    };
    match offsets.or_else(rows) {
        None => Ok(()),
        Some((what, found)) => {
            let found = format!("{found} in the unit of the BVH");
            Err(Error::invalid(what, found, "a finite number, as of a body of some metres"))
        }
    }
}

/// Prints the header, reserving memory for `numbers` numbers.
pub(super) fn print_head(head: &Header, frame_time: &str, frames: usize, numbers: usize) -> Vec<u8> {
    let [before, between, after] = &head.pieces;
    let mut out = Vec::with_capacity(before.len() + 100 + numbers * 11);
    out.extend_from_slice(before);
    out.extend_from_slice(frames.to_string().as_bytes());
    out.extend_from_slice(between);
    out.extend_from_slice(frame_time.as_bytes());
    out.extend_from_slice(after);
    // a file of 0 frames may end right after its frame time
    if !after.ends_with(b"\n") && !after.ends_with(b"\r") {
        out.extend_from_slice(head.style.line_end.as_bytes());
    }
    out
}

/// Appends a number with six decimals; zero has no sign.
pub(super) fn push_number(out: &mut Vec<u8>, v: f64) {
    // below it, at most 9 digits, the point and 6 decimals fill the buffer's 16 bytes
    if v.abs() >= 1e8 {
        // writing to a Vec can't fail
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

impl Header {
    /// Prints the hierarchy anew after its nodes have changed.
    pub(super) fn write_nodes(&mut self) {
        let old = &self.pieces[0];
        // from the end, because a joint may be called Motion
        let motion = old.windows(6).rposition(|w| w.eq_ignore_ascii_case(b"MOTION")).unwrap_or(old.len());
        let mut first = hierarchy(&self.nodes, &self.style);
        first.extend_from_slice(&old[motion..]);
        self.pieces[0] = first;
    }
}

/// The text of a hierarchy.
pub(crate) fn hierarchy(nodes: &[Node], style: &Style) -> Vec<u8> {
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
