//! The two lines after a hierarchy, `Frames:` and `Frame Time:`, which complete the header.

use super::frame_time;
use super::grammar::{Parser, Step};
use super::text::word_at;
use crate::format::source::bvh::{Header, NodeKind, Style};
use crate::{FaultKind, FileError, Warning};

/// Numbers of a file that a reader accepts.
const MAX_NUMBERS: u64 = 1 << 31;

impl Header {
    /// Frames per second, inferred from the text of the frame time.
    pub fn fps(&self) -> f64 {
        frame_time::rate(&self.frame_time).unwrap_or(1.0)
    }
}

impl<'a> Parser<'a> {
    /// Parses `Frames:` and `Frame Time:`.
    pub fn motion(mut self, lenient: bool) -> Step<Header> {
        let (count_at, count) =
            self.declaration(&["Frames"], FaultKind::FramesMissing, "Frames: and the number of frames")?;
        let declared = match std::str::from_utf8(count).ok().filter(|w| w.bytes().all(|b| b.is_ascii_digit())) {
            None | Some("") => {
                let expected = "the number of frames, a whole number";
                let fault = self.text.fault(count_at, FaultKind::NumberBad, self.text.found(count_at), expected);
                return Err(fault.help("count the rows that follow"));
            }
            // a count beyond u64 becomes the largest, which is refused below unless `lenient`
            Some(digits) => digits.parse::<u64>().unwrap_or(u64::MAX),
        };
        // a count is hostile until the rows are there; `lenient` reads what is there and needs no count
        let numbers = declared.checked_mul(self.width.max(1) as u64);
        if numbers.is_none_or(|n| n > MAX_NUMBERS) && !lenient {
            let found = format!("{} frames of {} channels", self.text.decode(count), self.width);
            let fault = self.text.fault(count_at, FaultKind::TooLarge, found, "at most 2147483648 numbers in a file");
            return Err(fault.help("if the count is wrong, `lenient` reads the rows that are there"));
        }
        let count_end = self.at;
        self.line_is_over("the end of the line after the number of frames")?;
        let expected = "Frame Time: and the seconds of a frame";
        let (time_at, time) = self.declaration(&["Frame", "Time"], FaultKind::FrameTimeMissing, expected)?;
        frame_time::check(time).map_err(|(expected, help)| {
            self.text.fault(time_at, FaultKind::FrameTimeBad, self.text.found(time_at), expected).help(help)
        })?;
        let time_end = self.at;
        self.line_is_over("the end of the line after the frame time")?;
        // one line end belongs to the header's last piece; blank lines after it are rows' white space
        let line_end = line_end_at(self.text.bytes, self.at);
        self.at += line_end.len();
        let bytes = self.text.bytes;
        let pieces =
            [bytes[..count_at].to_vec(), bytes[count_end..time_at].to_vec(), bytes[time_end..self.at].to_vec()];
        let mut style = style(&bytes[..count_at], bytes.get(self.at..).unwrap_or_default());
        if style.line_end.is_empty() {
            style.line_end = if line_end.is_empty() { "\n".into() } else { line_end.into() };
        }
        let warnings = self.warnings();
        Ok(Header {
            nodes: self.nodes,
            width: self.width,
            declared,
            frame_time: String::from_utf8_lossy(time).into_owned(),
            rows_at: self.at,
            warnings,
            pieces,
            style,
        })
    }

    /// Parses words, an optional colon and a value; returns the value with its position.
    fn declaration(&mut self, words: &[&str], missing: FaultKind, expected: &str) -> Step<(usize, &'a [u8])> {
        self.skip(false);
        let start = self.at;
        for word in words {
            self.blanks();
            let rest = &self.text.bytes[self.at..];
            if !rest.get(..word.len()).is_some_and(|w| w.eq_ignore_ascii_case(word.as_bytes())) {
                return Err(self.missing(start, missing, expected));
            }
            self.at += word.len();
        }
        let after = self.at;
        self.blanks();
        if self.byte() == Some(b':') {
            self.at += 1;
            self.blanks();
        // without a colon at least a blank has to separate the value, or `Frames2` would pass
        } else if after == self.at && !matches!(self.byte(), None | Some(b'\r' | b'\n')) {
            return Err(self.missing(start, missing, expected));
        }
        let (at, word) = (self.at, word_at(self.text.bytes, self.at));
        self.at += word.len();
        Ok((at, word))
    }

    fn missing(&self, at: usize, kind: FaultKind, expected: &str) -> FileError {
        let fault = self.text.fault(at, kind, self.text.found(at), expected);
        fault.help("MOTION is followed by a line Frames: and a line Frame Time:")
    }

    fn line_is_over(&mut self, expected: &str) -> Step {
        self.blanks();
        match self.byte() {
            None | Some(b'\r' | b'\n') => Ok(()),
            Some(_) => Err(self.unexpected(self.at, expected)),
        }
    }

    fn warnings(&self) -> Vec<Warning> {
        let mut all = Vec::new();
        // only the first few get a line number, because finding it scans the file
        let place =
            |(i, &at): (usize, &usize)| if i < 5 { self.text.place(at).line.to_string() } else { String::new() };
        let comments: Vec<_> = self.oddities.comments.iter().enumerate().map(place).collect();
        let mut add = |kind, list: &[String], what: &str, done: &str| {
            if !list.is_empty() {
                let some = list[..list.len().min(5)].join(", ");
                let more = if list.len() > 5 { format!(" and {} more", list.len() - 5) } else { String::new() };
                all.push(Warning { kind, what: format!("{what} {some}{more}: {done}") });
            }
        };
        add("comment_skipped", &comments, "comments on line", "BVH has none; skipped");
        add("duplicate_name", &self.oddities.twice, "names that stand twice:", "each is told apart by a number");
        add("no_channels", &self.oddities.channelless, "no CHANNELS in", "read as 0 channels");
        add("missing_end_site", &self.oddities.tipless, "no end site under", "a leaf without a tip");
        let roots: Vec<_> =
            self.nodes.iter().filter(|n| n.kind == NodeKind::Root).map(|n| format!("{:?}", n.unique)).collect();
        if roots.len() > 1 {
            add("several_roots", &roots, "more than one ROOT:", "one is read; `root` takes another");
        }
        all
    }
}

/// The line end at a byte offset; empty if there is none.
fn line_end_at(bytes: &[u8], at: usize) -> &'static str {
    match bytes.get(at..) {
        Some([b'\r', b'\n', ..]) => "\r\n",
        Some([b'\r', ..]) => "\r",
        Some([b'\n', ..]) => "\n",
        _ => "",
    }
}

/// The line end of the first row (empty if there is none), and the first indentation of the header.
fn style(header: &[u8], rows: &[u8]) -> Style {
    let row = rows.iter().position(|b| !b.is_ascii_whitespace()).unwrap_or(rows.len());
    let end = rows[row..].iter().position(|b| matches!(b, b'\r' | b'\n')).map_or(rows.len(), |i| row + i);
    let mut lines = header.split(|b| matches!(b, b'\r' | b'\n'));
    let indented = lines.find(|l| matches!(l, [b' ' | b'\t', ..])).unwrap_or(b"  ");
    let blanks = indented.iter().take_while(|b| matches!(b, b' ' | b'\t')).take(8);
    Style { line_end: line_end_at(rows, end).into(), indent: blanks.map(|&b| b as char).collect() }
}
