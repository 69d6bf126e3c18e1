//! The rows: text to numbers, in one pass and exactly as `str::parse` would.
//!
//! A number whose digits make an integer below 2^53 and whose power of ten is at most 22 is that integer times or over an
//! exact power of ten: one rounding, so the nearest double (Clinger, "How to read floating point numbers accurately",
//! 1990). Digits are taken eight at a time from a 64-bit word. All else goes to `str::parse`.

use super::header::Head;
use super::text::{BadNumber, Text, number, word_at};
use crate::{FileError, Kind, Warning};

/// 10^0 to 10^22: the powers that 64 bits hold exactly.
const POWERS: [f64; 23] = [
    1e0, 1e1, 1e2, 1e3, 1e4, 1e5, 1e6, 1e7, 1e8, 1e9, 1e10, 1e11, 1e12, 1e13, 1e14, 1e15, 1e16, 1e17, 1e18, 1e19, 1e20,
    1e21, 1e22,
];
/// 10^0 to 10^8 as integers.
const INTEGERS: [u64; 9] = [1, 10, 100, 1_000, 10_000, 100_000, 1_000_000, 10_000_000, 100_000_000];
/// A number that the fast way reads has at most so many bytes: sign, 8 digits, point, 8 digits, e, sign, 3 digits, and a
/// word more that is loaded in vain.
const WINDOW: usize = 32;

/// The rows of a file.
pub(crate) struct Rows {
    /// (F, C).
    pub numbers: Vec<f64>,
    /// F.
    pub frames: usize,
    pub warnings: Vec<Warning>,
}

/// Reads the rows that the head declares.
pub(crate) fn parse(text: &Text, head: &Head, lenient: bool) -> Result<Rows, FileError> {
    let bytes = text.bytes;
    let (width, mut at) = (head.width, head.rows_at);
    let declared = usize::try_from(head.declared).unwrap_or(usize::MAX);
    let left = bytes.len() - at;
    let mut numbers = Vec::with_capacity(declared.saturating_mul(width).min(left / 4 + 1));
    let mut frames = 0;
    while frames < declared && width > 0 {
        let start = next_line(bytes, at);
        let first = numbers.len();
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
    let warnings = extra(text, head, at, lenient)?;
    Ok(Rows { numbers, frames, warnings })
}

/// From after one row to the first mark of the next.
fn next_line(bytes: &[u8], mut at: usize) -> usize {
    while matches!(bytes.get(at), Some(b' ' | b'\t' | b'\r' | b'\n')) {
        at += 1;
    }
    at
}

/// Fills `out` with the numbers of one line; the byte after them, or `None` if the line isn't exactly that.
fn row(bytes: &[u8], mut at: usize, out: &mut [f64]) -> Option<usize> {
    for value in out {
        while matches!(bytes.get(at), Some(b' ' | b'\t')) {
            at += 1;
        }
        let (v, len) = match bytes.get(at..at + WINDOW) {
            Some(window) => match fast(window.try_into().ok()?) {
                Some(done) => done,
                None => careful(bytes, at)?,
            },
            None => careful(bytes, at)?,
        };
        *value = v;
        at += len;
    }
    while matches!(bytes.get(at), Some(b' ' | b'\t')) {
        at += 1;
    }
    matches!(bytes.get(at), None | Some(b'\r' | b'\n')).then_some(at)
}

/// The number at a byte by the standard library, and its length.
#[cold]
fn careful(bytes: &[u8], at: usize) -> Option<(f64, usize)> {
    let word = word_at(bytes, at);
    Some((number(word).ok()?, word.len()))
}

fn load(window: &[u8; WINDOW], at: usize) -> u64 {
    match window.get(at..at + 8) {
        Some(w) => u64::from_le_bytes([w[0], w[1], w[2], w[3], w[4], w[5], w[6], w[7]]),
        None => 0,
    }
}

/// How many of the eight characters are digits before the first that is not, and the value of these.
#[inline(always)]
fn digits(word: u64) -> (usize, u64) {
    const ZEROS: u64 = 0x3030_3030_3030_3030;
    const HIGH: u64 = 0x8080_8080_8080_8080;
    let values = word ^ ZEROS;
    // a byte above 9 sets its high bit: 0x76 + 10 = 0x80. A carry out of a byte only follows one that is no digit.
    let stop = (values.wrapping_add(0x7676_7676_7676_7676) | values) & HIGH;
    let count = (stop.trailing_zeros() / 8) as usize;
    if count == 0 {
        return (0, 0);
    }
    // the first character is the lowest byte; moved up, missing characters in front are zeros
    let v = values << (64 - 8 * count);
    let v = v.wrapping_mul(10).wrapping_add(v >> 8) & 0x00FF_00FF_00FF_00FF;
    let v = v.wrapping_mul(100).wrapping_add(v >> 16) & 0x0000_FFFF_0000_FFFF;
    let v = v.wrapping_mul(10_000).wrapping_add(v >> 32) & 0xFFFF_FFFF;
    (count, v)
}

/// The number at the start of a window, and its length; `None` if this way isn't provably exact, or it is no number.
#[inline(always)]
fn fast(window: &[u8; WINDOW]) -> Option<(f64, usize)> {
    let negative = window[0] == b'-';
    let mut at = usize::from(negative);
    let (whole, mut mantissa) = digits(load(window, at));
    at += whole;
    let mut places = 0;
    if window[at] == b'.' {
        let (fraction, value) = digits(load(window, at + 1));
        mantissa = mantissa * INTEGERS[fraction] + value;
        places = fraction;
        at += 1 + fraction;
        if whole + fraction == 0 {
            return None;
        }
    } else if whole == 0 {
        return None;
    }
    let mut exponent = -(places as i32);
    if window[at] | 0x20 == b'e' {
        let (e, len) = exponent_at(window, at + 1)?;
        exponent += e;
        at += len + 1;
    }
    // a ninth digit, or anything else that a number doesn't end with
    if !matches!(window[at], b' ' | b'\t' | b'\r' | b'\n') || mantissa > 1 << 53 {
        return None;
    }
    let value = mantissa as f64;
    let value = if exponent < 0 {
        value / *POWERS.get(exponent.unsigned_abs() as usize)?
    } else {
        value * *POWERS.get(exponent as usize)?
    };
    Some((if negative { -value } else { value }, at))
}

/// A sign and one to three digits.
fn exponent_at(window: &[u8; WINDOW], at: usize) -> Option<(i32, usize)> {
    let sign = matches!(window[at], b'+' | b'-');
    let from = at + usize::from(sign);
    let (mut value, mut len) = (0, 0);
    while len < 3 && window[from + len].is_ascii_digit() {
        value = value * 10 + i32::from(window[from + len] - b'0');
        len += 1;
    }
    (len > 0).then_some((if window[at] == b'-' { -value } else { value }, len + usize::from(sign)))
}

/// Rows that follow the declared ones.
fn extra(text: &Text, head: &Head, at: usize, lenient: bool) -> Result<Vec<Warning>, FileError> {
    let start = next_line(text.bytes, at);
    if start == text.bytes.len() {
        return Ok(Vec::new());
    }
    let word = word_at(text.bytes, start);
    if number(word) == Err(BadNumber::Junk) && !lenient {
        let expected = format!("the end of the file after {} frames", head.declared);
        return Err(text.fault(start, Kind::UnexpectedWord, text.found(start), expected).help("delete what follows"));
    }
    let lines = text.bytes[start..].split(|b| matches!(b, b'\r' | b'\n'));
    let more = lines.filter(|l| l.iter().any(|b| !matches!(b, b' ' | b'\t'))).count();
    let what = format!("{more} lines more than the {} frames declared: left out", head.declared);
    Ok(vec![Warning { kind: "more_rows", what }])
}

/// The way for what is not one row a line: it finds out what is wrong, or that rows are wrapped.
struct Slow<'a> {
    text: &'a Text<'a>,
    head: &'a Head,
    declared: usize,
    lenient: bool,
}

/// A line whose count of numbers is wrong.
struct BadLine {
    row: usize,
    at: usize,
    found: usize,
}

impl Slow<'_> {
    /// Goes on with row `frames` at byte `at`, the rows before it read.
    fn rest(&self, mut numbers: Vec<f64>, frames: usize, mut at: usize) -> Result<Rows, FileError> {
        let (bytes, width) = (self.text.bytes, self.head.width);
        let wanted = self.declared.saturating_mul(width);
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
                    // a number that the end of the file cuts is a cut file, not a wrong number
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
        self.judge(numbers, bad, whole, row, wanted, at)
    }

    /// The word at a byte; braces have no meaning here.
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
        wanted: usize,
        at: usize,
    ) -> Result<Rows, FileError> {
        let width = self.head.width;
        if let Some(bad) = bad {
            if numbers.len() == wanted {
                let what = format!("rows are wrapped over lines, from row {} on: read by count", bad.row);
                let warnings = vec![Warning { kind: "rows_wrapped", what }];
                return Ok(Rows { numbers, frames: self.declared, warnings });
            }
            // the last line of a file that was cut
            let last = bad.row + 1 == lines && bad.found < width && bad.row < self.declared;
            if !last {
                return Err(self.row_width(&bad));
            }
            return self.short(numbers, whole, bad.found);
        }
        if width == 0 || whole / width < self.declared {
            return self.short(numbers, whole, 0);
        }
        numbers.truncate(wanted);
        let warnings = extra(self.text, self.head, at, self.lenient)?;
        Ok(Rows { numbers, frames: self.declared, warnings })
    }

    fn row_width(&self, bad: &BadLine) -> FileError {
        let (row, found) = (bad.row, bad.found);
        let expected = format!("{} in each row, one for each channel of the joints", self.head.width);
        self.text.fault(bad.at, Kind::RowWidth, format!("{found} numbers in row {row}"), expected)
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
        let fault = self.text.fault(end, Kind::FramesShort, found, expected);
        Err(fault.help("the file may be cut; --lenient keeps the whole rows"))
    }

    fn bad_number(&self, at: usize, row: usize, column: usize, why: BadNumber) -> FileError {
        let (word, nodes) = (self.word(at), &self.head.nodes);
        let after = word.first().is_some_and(|b| b.is_ascii_alphabetic() || matches!(b, b'#' | b'/' | b'{' | b'}'));
        if why == BadNumber::Junk && column == 0 && after {
            let expected = format!("row {row} of {}, numbers only", self.head.declared);
            let fault = self.text.fault(at, Kind::UnexpectedWord, self.text.quote(word), expected);
            return fault.help(if word[0] == b'#' || word[0] == b'/' { "BVH has no comments" } else { "" });
        }
        let holder = nodes.iter().find(|n| (n.column..n.column + n.channels.len()).contains(&column));
        let place = match holder {
            Some(n) => format!("joint {:?}, channel {}", n.unique, n.channels[column - n.column].name()),
            None => format!("number {column} of the row"),
        };
        let expected = format!("a finite number for frame {row}, {place}");
        self.text.fault(at, Kind::NumberBad, self.text.quote(word), expected).help(why.help())
    }
}

/// Whether a word can be the front part of a number.
fn cut_number(word: &[u8]) -> bool {
    let mut longer = word.to_vec();
    longer.push(b'0');
    number(&longer).is_ok()
}
