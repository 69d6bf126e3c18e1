//! Text files as bytes: positions, decoding, line ends, single numbers.

use crate::{FaultKind, FileError};
use kinelm_store::SourcePos;
use std::path::Path;

/// A file's bytes, with path and encoding for messages.
#[derive(Clone, Copy)]
pub(crate) struct Text<'a> {
    pub path: &'a Path,
    pub bytes: &'a [u8],
    /// Whether it is valid UTF-8; otherwise it is decoded as Latin-1.
    utf8: bool,
}

impl<'a> Text<'a> {
    pub fn new(path: &'a Path, bytes: &'a [u8]) -> Self {
        Text { path, bytes, utf8: std::str::from_utf8(bytes).is_ok() }
    }

    /// The start of the text, after a byte-order mark if there is one.
    pub fn start(&self) -> usize {
        if self.bytes.starts_with(b"\xEF\xBB\xBF") { 3 } else { 0 }
    }

    /// Decodes a part.
    pub fn decode(&self, part: &[u8]) -> String {
        match std::str::from_utf8(part) {
            Ok(s) if self.utf8 => s.to_owned(),
            _ => part.iter().map(|&b| b as char).collect(),
        }
    }

    /// Line and column of a byte offset, from 1. CR LF, LF and CR end a line.
    pub fn place(&self, at: usize) -> SourcePos {
        let before = &self.bytes[self.start().min(at)..at.min(self.bytes.len())];
        let (mut line, mut begin) = (1, 0);
        for (i, &b) in before.iter().enumerate() {
            // CR LF counts once, at its LF; a CR alone ended lines on old Macs
            let crlf = b == b'\r' && self.bytes.get(self.start() + i + 1) == Some(&b'\n');
            if b == b'\n' || (b == b'\r' && !crlf) {
                line += 1;
                begin = i + 1;
            }
        }
        let column = before[begin..].iter().filter(|&&b| !self.utf8 || b & 0xC0 != 0x80).count() + 1;
        SourcePos { path: self.path.to_owned(), line, column }
    }

    /// A fault at a byte offset.
    pub fn fault(
        &self,
        at: usize,
        kind: FaultKind,
        found: impl Into<String>,
        expected: impl Into<String>,
    ) -> FileError {
        FileError::new(self.place(at), kind, found, expected)
    }

    /// Describes what is at a byte offset: the word, the end of the line, or the end of the file.
    pub fn found(&self, at: usize) -> String {
        let word = word_at(self.bytes, at);
        match self.bytes.get(at) {
            None => "the end of the file".into(),
            Some(b'\r' | b'\n') => "the end of the line".into(),
            Some(b'{' | b'}') => format!("{:?}", char::from(self.bytes[at])),
            Some(_) => self.quote(word),
        }
    }

    /// A part in quotes, shortened and with unprintable characters escaped.
    pub fn quote(&self, part: &[u8]) -> String {
        let text: String = self.decode(&part[..part.len().min(160)]);
        let short: String = text.chars().take(40).collect();
        if short.len() < text.len() { format!("{short:?}...") } else { format!("{short:?}") }
    }
}

/// The word at a byte offset, up to a blank, a line end or a brace.
pub(crate) fn word_at(bytes: &[u8], at: usize) -> &[u8] {
    let rest = bytes.get(at..).unwrap_or_default();
    let end = rest.iter().position(|b| matches!(b, b' ' | b'\t' | b'\r' | b'\n' | b'{' | b'}'));
    &rest[..end.unwrap_or(rest.len())]
}

/// Why a word is no valid number.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum BadNumber {
    /// NaN, an infinity, `1.#QNAN`, or one too large for 64 bits.
    NotFinite,
    /// A comma where the decimal point should be.
    Comma,
    /// Anything else.
    Junk,
}

impl BadNumber {
    pub fn help(self) -> &'static str {
        match self {
            BadNumber::NotFinite => "repair the frame, or leave it out",
            BadNumber::Comma => "this looks like a decimal comma; BVH has decimal points",
            BadNumber::Junk => "write a number such as -1.5",
        }
    }
}

/// Parses a whole word as a number.
pub(crate) fn number(word: &[u8]) -> Result<f64, BadNumber> {
    let plain = match word {
        [b'+' | b'-', rest @ ..] => rest,
        rest => rest,
    };
    // `str::parse` also takes `inf`, `nan` and `infinity`, which are faults here
    let starts = matches!(plain, [b'0'..=b'9' | b'.', ..]);
    if let (true, Ok(text)) = (starts, std::str::from_utf8(word))
        && let Ok(value) = text.parse::<f64>()
    {
        return if value.is_finite() { Ok(value) } else { Err(BadNumber::NotFinite) };
    }
    let lower = plain.to_ascii_lowercase();
    if [&b"nan"[..], b"inf", b"1.#"].iter().any(|p| lower.starts_with(p)) {
        return Err(BadNumber::NotFinite);
    }
    let parts: Vec<&[u8]> = plain.split(|&b| b == b',').collect();
    let comma = parts.len() == 2 && matches!(plain, [b'0'..=b'9' | b',', ..]) && {
        let dotted = word.iter().map(|&b| if b == b',' { b'.' } else { b }).collect();
        String::from_utf8(dotted).is_ok_and(|s| s.parse::<f64>().is_ok())
    };
    Err(if comma { BadNumber::Comma } else { BadNumber::Junk })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn places_count_every_line_end_once() {
        let t = Text::new(Path::new("x"), b"\xEF\xBB\xBFa\r\nb\rc\n\xC3\xA9d");
        let at = |i| (t.place(i).line, t.place(i).column);
        assert_eq!([at(3), at(6), at(8), at(10), at(12)], [(1, 1), (2, 1), (3, 1), (4, 1), (4, 2)]);
        let latin = Text::new(Path::new("x"), b"\xE9\xE9d");
        assert_eq!(latin.place(2).column, 3);
        assert_eq!(latin.decode(b"\xE9"), "é");
    }

    #[test]
    fn numbers() {
        for (word, value) in [("+1", 1.0), (".5", 0.5), ("5.", 5.0), ("1E-7", 1e-7), ("-0", 0.0), ("-1.5e2", -150.0)] {
            assert_eq!(number(word.as_bytes()), Ok(value), "{word}");
        }
        for word in ["nan", "-NaN", "inf", "+Infinity", "1.#QNAN", "-1.#IND", "1e999"] {
            assert_eq!(number(word.as_bytes()), Err(BadNumber::NotFinite), "{word}");
        }
        for word in ["0,5", "-12,25", "1,5e3", ",5"] {
            assert_eq!(number(word.as_bytes()), Err(BadNumber::Comma), "{word}");
        }
        for word in ["", ".", "-", "x", "1.2.3", "0x10", "1_000", "1,2,3", "e5", "--1", "é"] {
            assert_eq!(number(word.as_bytes()), Err(BadNumber::Junk), "{word}");
        }
    }
}
