//! Comma-separated values after RFC 4180, with the place of every field.
//!
//! Beyond the RFC: a byte-order mark is dropped; LF, CR LF and CR end lines; blank lines are skipped; blanks around an
//! unquoted field are not part of it.

use crate::{Error, Result};
use kinelm_store::SourcePos;
use std::iter::Peekable;
use std::path::Path;
use std::str::Chars;

/// A field and where it begins.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Field {
    /// Its text, quotes removed.
    pub text: String,
    /// Where it begins.
    pub at: SourcePos,
}

/// The records of a file, blank lines left out.
///
/// # Errors
/// [`kinelm_store::Error::File`] with line and column: bytes that are not UTF-8, a quote that is never closed, text after a closing
/// quote, a quote inside an unquoted field.
pub fn parse(path: &Path, bytes: &[u8]) -> Result<Vec<Vec<Field>>> {
    let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
    let text = std::str::from_utf8(bytes).map_err(|e| not_utf8(path, &bytes[..e.valid_up_to()]))?;
    let mut reader = Reader { path, chars: text.chars().peekable(), line: 1, column: 1 };
    let mut records = Vec::new();
    while reader.chars.peek().is_some() {
        let record = reader.record()?;
        if record.len() > 1 || !record[0].text.is_empty() {
            records.push(record);
        }
    }
    Ok(records)
}

fn not_utf8(path: &Path, before: &[u8]) -> Error {
    let text = String::from_utf8_lossy(before);
    let line = text.lines().count().max(1);
    let column = text.lines().last().map_or(0, |l| l.chars().count()) + 1;
    let at = SourcePos { path: path.to_owned(), line, column };
    Error::at(at, "a byte that is not UTF-8", "UTF-8 text", "save the file as UTF-8")
}

struct Reader<'a> {
    path: &'a Path,
    chars: Peekable<Chars<'a>>,
    line: usize,
    column: usize,
}

impl Reader<'_> {
    fn place(&self) -> SourcePos {
        SourcePos { path: self.path.to_owned(), line: self.line, column: self.column }
    }

    fn next(&mut self) -> Option<char> {
        let c = self.chars.next()?;
        // CR LF is one line end: the LF counts it
        if c == '\n' || (c == '\r' && self.chars.peek() != Some(&'\n')) {
            (self.line, self.column) = (self.line + 1, 1);
        } else {
            self.column += 1;
        }
        Some(c)
    }

    /// The fields up to the end of a line, which is taken too.
    fn record(&mut self) -> Result<Vec<Field>> {
        let mut record = Vec::new();
        loop {
            while matches!(self.chars.peek(), Some(' ' | '\t')) {
                self.next();
            }
            let at = self.place();
            let text = if self.chars.peek() == Some(&'"') { self.quoted()? } else { self.unquoted()? };
            record.push(Field { text, at });
            match self.next() {
                Some(',') => {}
                Some('\r') => {
                    if self.chars.peek() == Some(&'\n') {
                        self.next();
                    }
                    return Ok(record);
                }
                _ => return Ok(record),
            }
        }
    }

    fn unquoted(&mut self) -> Result<String> {
        let mut text = String::new();
        while let Some(&c) = self.chars.peek() {
            match c {
                ',' | '\n' | '\r' => break,
                '"' => {
                    let help = "put the whole field in quotes and double those inside";
                    return Err(Error::at(self.place(), "a quote inside a field", "a field without quotes", help));
                }
                _ => text.extend(self.next()),
            }
        }
        text.truncate(text.trim_end_matches([' ', '\t']).len());
        Ok(text)
    }

    fn quoted(&mut self) -> Result<String> {
        let (open, mut text) = (self.place(), String::new());
        self.next();
        loop {
            match self.next() {
                Some('"') if self.chars.peek() == Some(&'"') => text.extend(self.next()),
                Some('"') => break,
                Some(c) => text.push(c),
                None => return Err(Error::at(open, "a quote that is never closed", "a closing quote", "")),
            }
        }
        while matches!(self.chars.peek(), Some(' ' | '\t')) {
            self.next();
        }
        match self.chars.peek().copied() {
            None | Some(',' | '\n' | '\r') => Ok(text),
            Some(c) => {
                let help = "double a quote that belongs to the field";
                Err(Error::at(self.place(), format!("`{c}` after a closing quote"), "a comma or the line's end", help))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn texts(bytes: &[u8]) -> Vec<Vec<String>> {
        let records = parse(Path::new("l.csv"), bytes).unwrap();
        records.into_iter().map(|r| r.into_iter().map(|f| f.text).collect()).collect()
    }

    fn error(bytes: &[u8]) -> String {
        parse(Path::new("l.csv"), bytes).unwrap_err().to_string()
    }

    #[test]
    fn fields_quotes_and_line_ends() {
        assert_eq!(texts(b"a,b\nc,d"), [["a", "b"], ["c", "d"]]);
        assert_eq!(texts(b"\xEF\xBB\xBFa , b\r\n\"c,\"\"x\"\"\n\" , d\r\r\n\n"), [["a", "b"], ["c,\"x\"\n", "d"]]);
        assert_eq!(texts(b"a,,\n,\n"), [vec!["a", "", ""], vec!["", ""]]);
        assert_eq!(texts(b""), Vec::<Vec<String>>::new());
    }

    #[test]
    fn places_count_from_one_over_every_line_end() {
        let records = parse(Path::new("l.csv"), "é,b\r\n\"x\ny\",  z\rq".as_bytes()).unwrap();
        let places: Vec<_> = records.iter().flatten().map(|f| (f.text.as_str(), f.at.line, f.at.column)).collect();
        assert_eq!(places, [("é", 1, 1), ("b", 1, 3), ("x\ny", 2, 1), ("z", 3, 6), ("q", 4, 1)]);
    }

    #[test]
    fn faults_have_their_place() {
        assert!(error(b"a,b\nc,\"d\n").starts_with("l.csv:2:3: found a quote that is never closed"));
        assert!(error(b"a,b\n\"c\"d,e").starts_with("l.csv:2:4: found `d` after"));
        assert!(error(b"a,b\nc,d\"e\"").starts_with("l.csv:2:4: found a quote inside"));
        assert!(error(b"ab\ncd\xFF").starts_with("l.csv:2:3: found a byte"));
    }

    proptest! {
        #[test]
        fn what_is_quoted_is_read(rows in prop::collection::vec(prop::collection::vec("[a-c \",\r\n]{0,6}", 2..4), 0..5)) {
            let quote = |f: &String| format!("\"{}\"", f.replace('"', "\"\""));
            let lines: Vec<String> = rows.iter().map(|r| r.iter().map(quote).collect::<Vec<_>>().join(",")).collect();
            prop_assert_eq!(texts(lines.join("\r\n").as_bytes()), rows);
        }

        #[test]
        fn no_bytes_panic(bytes in prop::collection::vec(any::<u8>(), 0..60)) {
            let _ = parse(Path::new("l.csv"), &bytes);
        }
    }
}
