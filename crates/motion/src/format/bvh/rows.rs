//! The rows of a BVH, and their faults.

use super::numbers::row;
use super::text::{BadNumber, Text, number, word_at};
use crate::format::source::bvh::Header;
use crate::{FaultKind, FileError, Warning};
use kinelm_store::counted;

/// The rows of a file.
pub(crate) struct Rows {
    /// Numbers (F, C).
    pub numbers: Vec<f64>,
    /// F, the number of frames.
    pub frames: usize,
    pub warnings: Vec<Warning>,
}

/// Parses the rows that the header declares.
pub(crate) fn parse(text: &Text, head: &Header, lenient: bool) -> Result<Rows, FileError> {
    let bytes = text.bytes;
    let (width, mut at) = (head.width, head.rows_at.min(bytes.len()));
    let declared = usize::try_from(head.declared).unwrap_or(usize::MAX);
    let left = bytes.len() - at;
    // the declared count is trusted only up to what the bytes can hold; typical numbers take over 4 bytes
    let mut numbers = Vec::with_capacity(declared.saturating_mul(width).min(left / 4 + 1));
    let mut frames = 0;
    while frames < declared && width > 0 {
        let start = next_line(bytes, at);
        let first = numbers.len();
        // a row takes at least a digit a number and a blank between: checked before memory for it is used
        if bytes.len() - start < 2 * width - 1 {
            return Slow { text, head, declared, lenient }.rest(numbers, frames, start);
        }
        numbers.resize(first + width, 0.0);
        match row(bytes, start, &mut numbers[first..]) {
            Some(end) => at = end,
            None => {
                numbers.truncate(first);
                return Slow { text, head, declared, lenient }.rest(numbers, frames, start);
            }
        }
        frames += 1;
    }
    if width == 0 && declared > 0 {
        return Slow { text, head, declared, lenient }.rest(numbers, 0, at);
    }
    if width > 0 && declared == 0 && begins_with_number(bytes, at) {
        return undeclared(text, head, at, lenient);
    }
    let mut warnings = extra(text, head, at, lenient)?;
    if declared == 0 {
        warnings.push(Warning { kind: "no_frames", what: "the file declares 0 frames".into() });
    }
    Ok(Rows { numbers, frames, warnings })
}

fn begins_with_number(bytes: &[u8], at: usize) -> bool {
    number(word_at(bytes, next_line(bytes, at))) != Err(BadNumber::Junk)
}

/// Reads the rows after `Frames: 0`, or counts them in a fault.
fn undeclared(text: &Text, head: &Header, at: usize, lenient: bool) -> Result<Rows, FileError> {
    let rows = Slow { text, head, declared: usize::MAX, lenient: true }.rest(Vec::new(), 0, at)?;
    if lenient {
        return Ok(rows);
    }
    let found = format!("Frames: 0 before {}", counted(rows.frames, "rows"));
    let expected = format!("Frames: {}", rows.frames);
    let fault = text.fault(head.pieces[0].len(), FaultKind::FramesZero, found, expected);
    Err(fault.help("correct the number, or read all rows with `lenient`"))
}

/// Skips blanks and line ends.
fn next_line(bytes: &[u8], mut at: usize) -> usize {
    while matches!(bytes.get(at), Some(b' ' | b'\t' | b'\r' | b'\n')) {
        at += 1;
    }
    at
}

/// Warns about rows after the declared ones.
fn extra(text: &Text, head: &Header, at: usize, lenient: bool) -> Result<Vec<Warning>, FileError> {
    let start = next_line(text.bytes, at);
    if start == text.bytes.len() {
        return Ok(Vec::new());
    }
    let word = word_at(text.bytes, start);
    if number(word) == Err(BadNumber::Junk) && !lenient {
        let expected = format!("the end of the file after {} frames", head.declared);
        return Err(text
            .fault(start, FaultKind::UnexpectedWord, text.found(start), expected)
            .help("delete what follows"));
    }
    let lines = text.bytes[start..].split(|b| matches!(b, b'\r' | b'\n'));
    let more = lines.filter(|l| l.iter().any(|b| !matches!(b, b' ' | b'\t'))).count();
    let what = format!("{more} lines more than the {} frames declared: left out", head.declared);
    Ok(vec![Warning { kind: "more_rows", what }])
}

/// The slow path for rows that are not one per line: diagnoses faults and reads wrapped rows.
struct Slow<'a> {
    text: &'a Text<'a>,
    head: &'a Header,
    declared: usize,
    lenient: bool,
}

/// A line with a wrong count of numbers.
struct BadLine {
    row: usize,
    at: usize,
    found: usize,
}

impl Slow<'_> {
    /// Continues with row `frames` at byte `at`, after the rows parsed so far.
    fn rest(&self, mut numbers: Vec<f64>, frames: usize, mut at: usize) -> Result<Rows, FileError> {
        let (bytes, width) = (self.text.bytes, self.head.width);
        let expected = self.declared.saturating_mul(width);
        let mut bad: Option<BadLine> = None;
        let (mut row, mut whole) = (frames, numbers.len());
        loop {
            at = next_line(bytes, at);
            if at == bytes.len() || (bad.is_none() && row >= self.declared) {
                break;
            }
            let line = at;
            let mut found = 0;
            while !matches!(bytes.get(at), None | Some(b'\r' | b'\n')) {
                let word = self.word(at);
                match number(word) {
                    Ok(value) => {
                        numbers.push(value);
                        found += 1;
                    }
                    // a number cut by the end of the file means a truncated file, not a bad number
                    Err(BadNumber::Junk) if at + word.len() == bytes.len() && cut_number(word) => {}
                    Err(why) => return Err(self.bad_number(at, row, found, why)),
                }
                at += word.len();
                while matches!(bytes.get(at), Some(b' ' | b'\t')) {
                    at += 1;
                }
            }
            if found != width && bad.is_none() {
                bad = Some(BadLine { row, at: line, found });
            } else if bad.is_none() {
                whole = numbers.len();
            }
            row += 1;
        }
        self.judge(numbers, bad, whole, row, expected, at)
    }

    /// The word at a byte offset; braces have no meaning here.
    fn word(&self, at: usize) -> &[u8] {
        let rest = &self.text.bytes[at..];
        let end = rest.iter().position(|b| matches!(b, b' ' | b'\t' | b'\r' | b'\n'));
        &rest[..end.unwrap_or(rest.len())]
    }

    fn judge(
        &self,
        mut numbers: Vec<f64>,
        bad: Option<BadLine>,
        whole: usize,
        lines: usize,
        expected: usize,
        at: usize,
    ) -> Result<Rows, FileError> {
        let width = self.head.width;
        if let Some(bad) = bad {
            // the total is right, so the rows were only wrapped
            if numbers.len() == expected {
                let what = format!("rows are wrapped over lines, from row {} on: read by count", bad.row);
                let warnings = vec![Warning { kind: "rows_wrapped", what }];
                return Ok(Rows { numbers, frames: self.declared, warnings });
            }
            // the last line of a truncated file
            let last = bad.row + 1 == lines && bad.found < width && bad.row < self.declared;
            if !last {
                return Err(self.row_width(&bad));
            }
            return self.short(numbers, whole, bad.found);
        }
        if width == 0 || whole / width < self.declared {
            return self.short(numbers, whole, 0);
        }
        numbers.truncate(expected);
        let warnings = extra(self.text, self.head, at, self.lenient)?;
        Ok(Rows { numbers, frames: self.declared, warnings })
    }

    fn row_width(&self, bad: &BadLine) -> FileError {
        let (row, found) = (bad.row, bad.found);
        let expected = format!("{} in each row, one for each channel of the joints", self.head.width);
        let fault = self.text.fault(bad.at, FaultKind::RowWidth, format!("{found} numbers in row {row}"), expected);
        fault.help("mend the row, or delete it and count one frame less")
    }

    fn short(&self, mut numbers: Vec<f64>, whole: usize, cut: usize) -> Result<Rows, FileError> {
        let width = self.head.width;
        let frames = whole.checked_div(width).unwrap_or(0);
        let begun = if cut > 0 { format!(" and {cut} of the {width} numbers of another") } else { String::new() };
        if self.lenient {
            numbers.truncate(whole);
            let what = format!("{frames} rows{begun}, {} declared: the whole rows are kept", self.head.declared);
            return Ok(Rows { numbers, frames, warnings: vec![Warning { kind: "frames_short", what }] });
        }
        let found = match width {
            0 => "0 rows, since no joint has channels".into(),
            _ => format!("{frames} rows{begun}"),
        };
        let expected = format!("{} rows, as Frames: declares", self.head.declared);
        let end = self.text.bytes.len();
        let fault = self.text.fault(end, FaultKind::FramesShort, found, expected);
        Err(fault.help("the file may be cut; `lenient` keeps the whole rows"))
    }

    fn bad_number(&self, at: usize, row: usize, column: usize, why: BadNumber) -> FileError {
        let (word, nodes) = (self.word(at), &self.head.nodes);
        let after = word.first().is_some_and(|b| b.is_ascii_alphabetic() || matches!(b, b'#' | b'/' | b'{' | b'}'));
        if why == BadNumber::Junk && column == 0 && after {
            let expected = format!("row {row} of {}, numbers only", self.head.declared);
            let fault = self.text.fault(at, FaultKind::UnexpectedWord, self.text.quote(word), expected);
            return fault.help(if word[0] == b'#' || word[0] == b'/' { "BVH has no comments" } else { "" });
        }
        let holder = nodes.iter().find(|n| (n.column..n.column + n.channels.len()).contains(&column));
        let place = match holder {
            Some(n) => format!("joint {:?}, channel {}", n.unique, n.channels[column - n.column].name()),
            None => format!("number {column} of the row"),
        };
        let expected = format!("a finite number for frame {row}, {place}");
        self.text.fault(at, FaultKind::NumberBad, self.text.quote(word), expected).help(why.help())
    }
}

/// Whether a word can be the beginning of a number.
fn cut_number(word: &[u8]) -> bool {
    let mut longer = word.to_vec();
    longer.push(b'0');
    number(&longer).is_ok()
}
