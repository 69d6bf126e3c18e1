//! Comma-separated values after RFC 4180, with the position of every field.
//!
//! Beyond the RFC: a byte-order mark is dropped; LF, CR LF and CR end lines; blank lines are skipped; blanks around an
//! unquoted field are not part of it.

use crate::{Error, Result};
use kinelm_store::SourcePos;
use std::iter::Peekable;
use std::path::Path;
use std::str::Chars;

/// A field and its position.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Field {
    /// The text without its quotes.
    pub text: String,
    /// Where it begins.
    pub at: SourcePos,
}

/// Columns with the time range that a row is about.
pub const FROM: &str = "from_s";
/// The end of that range.
pub const TO: &str = "to_s";

/// A CSV about clips: a header with the column `clip`, then rows as wide as the header.
#[derive(Debug)]
pub struct ClipTable {
    header: Vec<Field>,
    records: Vec<Vec<Field>>,
}

/// A row of a [`ClipTable`].
#[derive(Debug, Clone, Copy)]
pub struct Row<'a> {
    header: &'a [Field],
    fields: &'a [Field],
}

impl ClipTable {
    /// Parses a table; `columns` says in messages what columns there may be.
    ///
    /// # Errors
    /// [`kinelm_store::Error::File`] with line and column: text that is no CSV; no header, no column `clip`, a column without
    /// a name or named twice, a row of another width.
    pub fn parse(path: &Path, bytes: &[u8], columns: &str) -> Result<ClipTable> {
        let mut records = parse(path, bytes)?.into_iter();
        let Some(header) = records.next() else {
            return Err(Error::file(path, "no line", "a header with the column `clip`", ""));
        };
        for (i, Field { text, at }) in header.iter().enumerate() {
            if text.is_empty() {
                let help = "name the column or remove it";
                return Err(Error::at(at.clone(), "a column without a name", "a name", help));
            }
            if header[..i].iter().any(|column| column.text == *text) {
                return Err(Error::at(at.clone(), format!("column {text} a second time"), "each once", ""));
            }
        }
        if !header.iter().any(|column| column.text == "clip") {
            let names: Vec<&str> = header.iter().map(|column| column.text.as_str()).collect();
            let help = format!("the first line names the columns: {columns}");
            let at = SourcePos { column: 1, ..header[0].at.clone() };
            return Err(Error::at(at, format!("columns {}", names.join(", ")), "a column `clip`", help));
        }
        let records: Vec<Vec<Field>> = records.collect();
        if let Some(record) = records.iter().find(|record| record.len() != header.len()) {
            // the first field too many, or the last of too few
            let at = record[record.len().min(header.len() + 1) - 1].at.clone();
            let (found, expected) = (record.len(), header.len());
            return Err(Error::at(at, format!("{found} fields"), format!("{expected}, as the header has"), ""));
        }
        Ok(ClipTable { header, records })
    }

    /// The columns.
    pub fn header(&self) -> &[Field] {
        &self.header
    }

    /// The rows after the header.
    pub fn rows(&self) -> impl Iterator<Item = Row<'_>> {
        self.records.iter().map(|fields| Row { header: &self.header, fields })
    }
}

impl<'a> Row<'a> {
    /// The field of a column, if the table has the column.
    pub fn field(self, column: &str) -> Option<&'a Field> {
        self.fields().find(|(name, _)| *name == column).map(|(_, field)| field)
    }

    /// All fields with the names of their columns.
    pub fn fields(self) -> impl Iterator<Item = (&'a str, &'a Field)> {
        self.header.iter().map(|column| column.text.as_str()).zip(self.fields)
    }

    /// The position of a column's field, or of the row if the table doesn't have the column.
    pub fn at(self, column: &str) -> SourcePos {
        self.field(column).unwrap_or(&self.fields[0]).at.clone()
    }

    /// The clip's name, with `/` between parts, and the row's line.
    ///
    /// # Errors
    /// [`kinelm_store::Error::File`] for an empty name.
    pub fn clip(self) -> Result<(String, usize)> {
        let at = self.at("clip");
        let clip = self.field("clip").map_or("", |field| &field.text).replace('\\', "/");
        match clip.trim_start_matches("./") {
            "" => Err(Error::at(at, "an empty clip", "a path below the folder of the data", "")),
            clip => Ok((clip.to_owned(), at.line)),
        }
    }

    /// The range in seconds that the row is about, half-open, the end infinite if not given; `None` for all of the clip.
    ///
    /// # Errors
    /// [`kinelm_store::Error::File`] for a text that is no time, or an end that is not after the beginning.
    pub fn range_s(self) -> Result<Option<(f64, f64)>> {
        let seconds = |column: &str| {
            let Some(field) = self.field(column).filter(|field| !field.text.is_empty()) else { return Ok(None) };
            // `abs` turns -0 into 0, which would show in the names of segments
            let s = field.text.parse().ok().filter(|s: &f64| s.is_finite() && *s >= 0.0).map(f64::abs);
            let wrong = || Error::at(field.at.clone(), format!("{column} `{}`", field.text), "seconds, 0 or more", "");
            s.map(Some).ok_or_else(wrong)
        };
        let (from_s, to_s) = match (seconds(FROM)?, seconds(TO)?) {
            (None, None) => return Ok(None),
            (from, to) => (from.unwrap_or(0.0), to.unwrap_or(f64::INFINITY)),
        };
        if to_s <= from_s {
            let found = format!("{TO} `{}`", self.field(TO).map_or("", |field| &field.text));
            return Err(Error::at(self.at(TO), found, format!("more than {FROM}, {from_s}"), ""));
        }
        Ok(Some((from_s, to_s)))
    }
}

/// The records of a file without its blank lines.
///
/// # Errors
/// [`kinelm_store::Error::File`] with line and column: bytes that are not UTF-8, a quote that is never closed, text after a
/// closing quote, a quote inside an unquoted field.
fn parse(path: &Path, bytes: &[u8]) -> Result<Vec<Vec<Field>>> {
    let bytes = bytes.strip_prefix(b"\xEF\xBB\xBF").unwrap_or(bytes);
    let text = std::str::from_utf8(bytes).map_err(|e| not_utf8(path, &bytes[..e.valid_up_to()]))?;
    let mut reader = Reader { path, chars: text.chars().peekable(), line: 1, column: 1 };
    let mut records = Vec::new();
    while reader.chars.peek().is_some() {
        let record = reader.record()?;
        // a blank line parses as one empty field
        if record.len() > 1 || !record[0].text.is_empty() {
            records.push(record);
        }
    }
    Ok(records)
}

/// The error of a text that is UTF-8 up to the end of `valid`.
fn not_utf8(path: &Path, valid: &[u8]) -> Error {
    let text = String::from_utf8_lossy(valid);
    // lines as the reader counts them
    let mut before = Reader { path, chars: text.chars().peekable(), line: 1, column: 1 };
    while before.next().is_some() {}
    Error::at(before.pos(), "a byte that is not UTF-8", "UTF-8 text", "save the file as UTF-8")
}

struct Reader<'a> {
    path: &'a Path,
    chars: Peekable<Chars<'a>>,
    line: usize,
    column: usize,
}

impl Reader<'_> {
    fn pos(&self) -> SourcePos {
        SourcePos { path: self.path.to_owned(), line: self.line, column: self.column }
    }

    fn next(&mut self) -> Option<char> {
        let c = self.chars.next()?;
        // of CR LF, the LF ends the line
        if c == '\n' || (c == '\r' && self.chars.peek() != Some(&'\n')) {
            (self.line, self.column) = (self.line + 1, 1);
        } else {
            self.column += 1;
        }
        Some(c)
    }

    /// Reads the fields up to and with the end of a line.
    fn record(&mut self) -> Result<Vec<Field>> {
        let mut record = Vec::new();
        loop {
            while matches!(self.chars.peek(), Some(' ' | '\t')) {
                self.next();
            }
            let at = self.pos();
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
                    return Err(Error::at(self.pos(), "a quote inside a field", "a field without quotes", help));
                }
                _ => text.extend(self.next()),
            }
        }
        text.truncate(text.trim_end_matches([' ', '\t']).len());
        Ok(text)
    }

    fn quoted(&mut self) -> Result<String> {
        let (open, mut text) = (self.pos(), String::new());
        self.next();
        loop {
            match self.next() {
                // two quotes inside a field are one (RFC 4180)
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
                Err(Error::at(self.pos(), format!("`{c}` after a closing quote"), "a comma or the line's end", help))
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
    fn positions_count_from_one_over_every_line_end() {
        let records = parse(Path::new("l.csv"), "é,b\r\n\"x\ny\",  z\rq".as_bytes()).unwrap();
        let positions: Vec<_> = records.iter().flatten().map(|f| (f.text.as_str(), f.at.line, f.at.column)).collect();
        assert_eq!(positions, [("é", 1, 1), ("b", 1, 3), ("x\ny", 2, 1), ("z", 3, 6), ("q", 4, 1)]);
    }

    #[test]
    fn errors_have_positions() {
        assert!(error(b"a,b\nc,\"d\n").starts_with("l.csv:2:3: found a quote that is never closed"));
        assert!(error(b"a,b\n\"c\"d,e").starts_with("l.csv:2:4: found `d` after"));
        assert!(error(b"a,b\nc,d\"e\"").starts_with("l.csv:2:4: found a quote inside"));
        assert!(error(b"ab\ncd\xFF").starts_with("l.csv:2:3: found a byte"));
        assert!(error(b"ab\rcd\n\xFF").starts_with("l.csv:3:1: found a byte"));
    }

    proptest! {
        #[test]
        fn quoted_fields_are_read(rows in prop::collection::vec(prop::collection::vec("[a-c \",\r\n]{0,6}", 2..4), 0..5)) {
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
