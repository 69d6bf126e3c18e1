//! Ranges of clips that a corpus does without: rows `clip,from_s,to_s,why` of a CSV, as `kinelm corpus clean` writes them.
//!
//! Times are those of [`super::timed`]: seconds of the clip as it is read, half-open. A clip out of whose middle a range is
//! taken becomes two, so that no window goes over the gap.

use super::csv::{self, Field};
use super::gather::Gathered;
use super::record::LeftOut;
use super::rows::{FROM, TO, time_of};
use super::splits::some_of;
use crate::{Error, Result};
use kinelm_store::{counted, input};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// The columns; all but `clip` may be missing.
const COLUMNS: [&str; 4] = ["clip", FROM, TO, "why"];

/// A range of an item, seconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Range {
    /// Its first second, 0 or more.
    pub from_s: f64,
    /// The second behind its last; infinite: to the clip's end.
    pub to_s: f64,
    /// The line of the CSV that says so.
    pub line: usize,
}

/// A row, and its line.
type Row = (LeftOut, usize);

/// Gives items the ranges of a CSV; says how many, and which rows have no clip. Returns those that have one, for the
/// corpus to tell.
///
/// # Errors
/// [`kinelm_store::Error::Io`]; [`kinelm_store::Error::File`] with line and column: no header, no column `clip`, columns of other names, a row of
/// another width or without a clip, a time that is none.
pub fn leave_out(gathered: &mut Gathered, path: &Path) -> Result<Vec<LeftOut>> {
    let rows = parse(path, &input::bytes(path).map_err(Error::io(path))?)?;
    let mut by_clip: BTreeMap<&str, Vec<&Row>> = BTreeMap::new();
    rows.iter().for_each(|row| by_clip.entry(&row.0.clip).or_default().push(row));
    let mut known = BTreeSet::new();
    for item in &mut gathered.items {
        let Some((clip, rows)) = by_clip.get_key_value(item.name.as_str()) else { continue };
        known.insert(*clip);
        let range = |(row, line): &&Row| {
            let to_s = row.to_s.unwrap_or(f64::INFINITY);
            Range { from_s: row.from_s, to_s, line: *line }
        };
        item.left_out.extend(rows.iter().map(range));
    }
    let (with, without): (Vec<&Row>, Vec<&Row>) = rows.iter().partition(|(row, _)| known.contains(row.clip.as_str()));
    let csv = path.display();
    let (ranges, clips) = (counted(with.len(), "ranges"), counted(known.len(), "clips"));
    gathered.said.push(format!("{csv}: {ranges} of {clips} left out"));
    if !without.is_empty() {
        let lines: Vec<String> = without.iter().map(|(row, line)| format!("{} (line {line})", row.clip)).collect();
        let lines: Vec<&str> = lines.iter().map(String::as_str).collect();
        gathered.said.push(format!("{csv}: {} rows have no file: {}", without.len(), some_of(&lines)));
    }
    Ok(with.into_iter().map(|(row, _)| row.clone()).collect())
}

fn parse(path: &Path, bytes: &[u8]) -> Result<Vec<Row>> {
    let mut records = csv::parse(path, bytes)?.into_iter();
    let Some(header) = records.next() else {
        return Err(Error::file(path, "no line", "a header with the column `clip`", ""));
    };
    if let Some(odd) = header.iter().find(|c| !COLUMNS.contains(&c.text.as_str())) {
        let expected = format!("columns {}", COLUMNS.join(", "));
        return Err(Error::at(odd.at.clone(), format!("column `{}`", odd.text), expected, ""));
    }
    if let Some(i) = (1..header.len()).find(|&i| header[..i].iter().any(|c| c.text == header[i].text)) {
        let found = format!("column {} a second time", header[i].text);
        return Err(Error::at(header[i].at.clone(), found, "each once", ""));
    }
    if !header.iter().any(|c| c.text == COLUMNS[0]) {
        return Err(Error::at(header[0].at.clone(), "no column `clip`", "a column `clip`", ""));
    }
    records.map(|record| row(&header, &record)).collect()
}

fn row(header: &[Field], record: &[Field]) -> Result<Row> {
    if record.len() != header.len() {
        let at = record[record.len().min(header.len() + 1) - 1].at.clone();
        let (found, expected) = (record.len(), header.len());
        return Err(Error::at(at, format!("{found} fields"), format!("{expected}, as the header has"), ""));
    }
    let text = |column: &str| header.iter().position(|c| c.text == column).map_or("", |i| &record[i].text);
    let clip = text(COLUMNS[0]).replace('\\', "/").trim_start_matches("./").to_owned();
    if clip.is_empty() {
        return Err(Error::at(record[0].at.clone(), "an empty clip", "a clip's name, as labels have it", ""));
    }
    let (from_s, to_s) = time_of(header, record)?.unwrap_or((0.0, f64::INFINITY));
    let left_out = LeftOut { clip, from_s, to_s: to_s.is_finite().then_some(to_s), why: text(COLUMNS[3]).into() };
    Ok((left_out, record[0].at.line))
}

/// Such a CSV.
pub fn to_csv(rows: &[LeftOut]) -> String {
    let quoted = |text: &str| match text.contains([',', '"', '\n', '\r']) || text.trim() != text {
        true => format!("\"{}\"", text.replace('"', "\"\"")),
        false => text.to_owned(),
    };
    let row = |row: &LeftOut| {
        let to_s = row.to_s.map_or(String::new(), |s| s.to_string());
        format!("{},{},{to_s},{}\n", quoted(&row.clip), row.from_s, quoted(&row.why))
    };
    COLUMNS.join(",") + "\n" + &rows.iter().map(row).collect::<String>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Item;
    use crate::timed::in_pieces;

    fn left(clip: &str, from_s: f64, to_s: Option<f64>, why: &str) -> LeftOut {
        LeftOut { clip: clip.into(), from_s, to_s, why: why.into() }
    }

    #[test]
    fn what_is_written_is_read() {
        let rows = [
            left("a/b", 0.05, Some(1.25), "knee, 170 degrees"),
            left("c d", 2.0, None, " \"x\""),
            left("é", 0.0, None, ""),
        ];
        let read = parse(Path::new("l.csv"), to_csv(&rows).as_bytes()).unwrap();
        assert_eq!(
            read.iter().map(|(row, line)| (row.clone(), *line)).collect::<Vec<_>>(),
            [(rows[0].clone(), 2), (rows[1].clone(), 3), (rows[2].clone(), 4),]
        );
        assert_eq!(parse(Path::new("l.csv"), b"clip\n./a\\b\n").unwrap()[0].0, left("a/b", 0.0, None, ""));
    }

    #[test]
    fn faults_have_their_place() {
        let error = |text: &str| parse(Path::new("l.csv"), text.as_bytes()).unwrap_err().to_string();
        for (text, expected) in [
            ("", "l.csv: found no line"),
            ("clip,to\n", "l.csv:1:6: found column `to`, expected columns clip, from_s, to_s, why"),
            ("clip,why,why\n", "l.csv:1:10: found column why a second time"),
            ("from_s,to_s\n", "l.csv:1:1: found no column `clip`"),
            ("clip,from_s,to_s\na,1\n", "l.csv:2:3: found 2 fields"),
            ("clip,from_s,to_s\na,1,2\n,1,2\n", "l.csv:3:1: found an empty clip"),
            ("clip,from_s,to_s\na,x,2\n", "l.csv:2:3: found from_s `x`"),
            ("clip,from_s,to_s\na,2,1\n", "l.csv:2:5: found to_s `1`, expected more than from_s, 2"),
        ] {
            assert!(error(text).starts_with(expected), "{text:?}: {}", error(text));
        }
    }

    #[test]
    fn ranges_cut_clips_and_rows_without_a_clip_are_said() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("l.csv");
        std::fs::write(&path, "clip,from_s,to_s,why\na,1,2,odd\nb,,,\nnone,0,1,\na,1.5,3,\n").unwrap();
        let item = |name: &str| Item { name: name.into(), ..Item::default() };
        let mut gathered = Gathered { items: ["a", "b", "c"].map(item).into(), ..Gathered::default() };
        let kept = leave_out(&mut gathered, &path).unwrap();
        assert_eq!(kept, [left("a", 1.0, Some(2.0), "odd"), left("b", 0.0, None, ""), left("a", 1.5, Some(3.0), "")]);
        assert!(gathered.said[0].ends_with("l.csv: 3 ranges of 2 clips left out"), "{:?}", gathered.said);
        assert!(gathered.said[1].ends_with("l.csv: 1 rows have no file: none (line 4)"), "{:?}", gathered.said);
        let names: Vec<String> = in_pieces(&gathered.items).into_iter().map(|i| i.name).collect();
        assert_eq!(names, ["a@0s-1s", "a@3s-end", "c"]);
    }
}
