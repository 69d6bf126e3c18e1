//! Lines and words of both files.

use crate::{Error, FaultKind, FileError};
use kinelm_store::SourcePos;
use std::path::Path;

/// A line's number from 1 and its words, each with its column.
pub(super) struct Line<'a> {
    pub path: &'a Path,
    pub number: usize,
    pub words: Vec<(usize, &'a str)>,
}

/// The lines of a text that have words. `#` begins a comment; commas and parentheses are blanks.
pub(super) fn lines<'a>(path: &'a Path, text: &'a str) -> impl Iterator<Item = Line<'a>> {
    let blank = |c: char| c.is_whitespace() || matches!(c, ',' | '(' | ')');
    text.lines().enumerate().filter_map(move |(i, line)| {
        let own = line.split('#').next().unwrap_or_default();
        let mut words = Vec::new();
        let mut from = None;
        for (at, c) in own.char_indices().chain([(own.len(), ' ')]) {
            match (from, blank(c)) {
                (None, false) => from = Some(at),
                (Some(start), true) => {
                    words.push((own[..start].chars().count() + 1, &own[start..at]));
                    from = None;
                }
                _ => {}
            }
        }
        (!words.is_empty()).then_some(Line { path, number: i + 1, words })
    })
}

impl<'a> Line<'a> {
    /// The first word in lower case.
    pub fn key(&self) -> String {
        self.words.first().map(|w| w.1.to_ascii_lowercase()).unwrap_or_default()
    }

    /// The words after the first.
    pub fn rest(&self) -> impl Iterator<Item = &'a str> + '_ {
        self.words.iter().skip(1).map(|w| w.1)
    }

    /// A fault at the word `n`, or at the line's first one.
    pub fn fault(&self, n: usize, kind: FaultKind, found: impl Into<String>, expected: impl Into<String>) -> Error {
        let column = self.words.get(n).or(self.words.first()).map_or(1, |w| w.0);
        let at = SourcePos { path: self.path.to_owned(), line: self.number, column };
        FileError::new(at, kind, found, expected).into()
    }

    /// The word `n` as a finite number.
    pub fn number(&self, n: usize) -> Result<f64, Error> {
        let word = self.words.get(n).map_or("the end of the line", |w| w.1);
        match word.parse::<f64>() {
            Ok(x) if x.is_finite() => Ok(x),
            Ok(_) => Err(self.fault(n, FaultKind::NotFinite, word, "a finite number")),
            Err(_) => Err(self.fault(n, FaultKind::NumberBad, word, "a number")),
        }
    }

    /// The words `n`, `n + 1` and `n + 2` as numbers.
    pub fn three(&self, n: usize) -> Result<[f64; 3], Error> {
        Ok([self.number(n)?, self.number(n + 1)?, self.number(n + 2)?])
    }
}
