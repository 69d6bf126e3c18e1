//! Ranges of clips that a corpus does without: rows `clip,from_s,to_s,why` of a CSV, as `kinelm corpus clean` writes them.
//!
//! Times are seconds of the clip as it is read, half-open. A clip becomes two if a range in its middle is excluded, so that
//! no window spans the gap.

use super::csv::{ClipTable, FROM, TO};
use super::dataset::Dataset;
use super::item::TimeRange;
use super::record::ExcludedRange;
use super::splits::abbreviated;
use crate::{Error, Result};
use kinelm_store::{counted, input};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// The columns; all but `clip` may be missing.
const COLUMNS: [&str; 4] = ["clip", FROM, TO, "why"];

/// A row and its line.
type Row = (ExcludedRange, usize);

/// Adds the ranges of a CSV to the items of a dataset, and notes how many there are and which rows have no clip. Returns the
/// ranges of clips in the dataset, for [`super::BuildOptions::excluded`].
///
/// # Errors
/// [`kinelm_store::Error::Io`]; [`kinelm_store::Error::File`] with line and column: those of `ClipTable::parse`, columns of
/// other names, a bad time.
pub fn exclude(dataset: &mut Dataset, path: &Path) -> Result<Vec<ExcludedRange>> {
    let rows = parse(path, &input::bytes(path).map_err(Error::io(path))?)?;
    let mut by_clip: BTreeMap<&str, Vec<&Row>> = BTreeMap::new();
    rows.iter().for_each(|row| by_clip.entry(&row.0.clip).or_default().push(row));
    let mut known = BTreeSet::new();
    for item in &mut dataset.items {
        let Some((clip, rows)) = by_clip.get_key_value(item.name.as_str()) else { continue };
        known.insert(*clip);
        let range = |(row, line): &&Row| {
            let to_s = row.to_s.unwrap_or(f64::INFINITY);
            TimeRange { from_s: row.from_s, to_s, line: *line }
        };
        item.excluded.extend(rows.iter().map(range));
    }
    let (with, without): (Vec<&Row>, Vec<&Row>) = rows.iter().partition(|(row, _)| known.contains(row.clip.as_str()));
    let csv = path.display();
    let (ranges, clips) = (counted(with.len(), "ranges"), counted(known.len(), "clips"));
    dataset.notes.push(format!("{csv}: {ranges} of {clips} excluded"));
    if !without.is_empty() {
        let lines: Vec<String> = without.iter().map(|(row, line)| format!("{} (line {line})", row.clip)).collect();
        let lines: Vec<&str> = lines.iter().map(String::as_str).collect();
        dataset.notes.push(format!("{csv}: {} rows have no file: {}", without.len(), abbreviated(&lines)));
    }
    Ok(with.into_iter().map(|(row, _)| row.clone()).collect())
}

fn parse(path: &Path, bytes: &[u8]) -> Result<Vec<Row>> {
    let columns = COLUMNS.join(", ");
    let table = ClipTable::parse(path, bytes, &columns)?;
    if let Some(other) = table.header().iter().find(|c| !COLUMNS.contains(&c.text.as_str())) {
        let expected = format!("columns {columns}");
        return Err(Error::at(other.at.clone(), format!("column `{}`", other.text), expected, ""));
    }
    let parse = |row: super::csv::Row| {
        let (clip, line) = row.clip()?;
        // a row without times excludes all of its clip
        let (from_s, to_s) = row.range_s()?.unwrap_or((0.0, f64::INFINITY));
        let why = row.field(COLUMNS[3]).map_or(String::new(), |field| field.text.clone());
        Ok((ExcludedRange { clip, from_s, to_s: to_s.is_finite().then_some(to_s), why }, line))
    };
    table.rows().map(parse).collect()
}

/// Formats ranges as such a CSV.
pub fn to_csv(ranges: &[ExcludedRange]) -> String {
    // blanks around a field without quotes would be dropped when it is read
    let quoted = |text: &str| match text.contains([',', '"', '\n', '\r']) || text.trim() != text {
        true => format!("\"{}\"", text.replace('"', "\"\"")),
        false => text.to_owned(),
    };
    let row = |range: &ExcludedRange| {
        let to_s = range.to_s.map_or(String::new(), |s| s.to_string());
        format!("{},{},{to_s},{}\n", quoted(&range.clip), range.from_s, quoted(&range.why))
    };
    COLUMNS.join(",") + "\n" + &ranges.iter().map(row).collect::<String>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Item;
    use crate::segments::split_items;

    fn range(clip: &str, from_s: f64, to_s: Option<f64>, why: &str) -> ExcludedRange {
        ExcludedRange { clip: clip.into(), from_s, to_s, why: why.into() }
    }

    #[test]
    fn written_ranges_are_parsed() {
        let rows = [
            range("a/b", 0.05, Some(1.25), "knee, 170 degrees"),
            range("c d", 2.0, None, " \"x\""),
            range("é", 0.0, None, ""),
        ];
        let read = parse(Path::new("l.csv"), to_csv(&rows).as_bytes()).unwrap();
        assert_eq!(
            read.iter().map(|(row, line)| (row.clone(), *line)).collect::<Vec<_>>(),
            [(rows[0].clone(), 2), (rows[1].clone(), 3), (rows[2].clone(), 4),]
        );
        assert_eq!(parse(Path::new("l.csv"), b"clip\n./a\\b\n").unwrap()[0].0, range("a/b", 0.0, None, ""));
    }

    #[test]
    fn errors_have_positions() {
        let error = |text: &str| parse(Path::new("l.csv"), text.as_bytes()).unwrap_err().to_string();
        for (text, expected) in [
            ("", "l.csv: found no line"),
            ("clip,to\n", "l.csv:1:6: found column `to`, expected columns clip, from_s, to_s, why"),
            ("clip,why,why\n", "l.csv:1:10: found column why a second time"),
            ("from_s,to_s\n", "l.csv:1:1: found columns from_s, to_s, expected a column `clip`"),
            ("clip,from_s,to_s\na,1\n", "l.csv:2:3: found 2 fields"),
            ("clip,from_s,to_s\na,1,2\n,1,2\n", "l.csv:3:1: found an empty clip"),
            ("clip,from_s,to_s\na,x,2\n", "l.csv:2:3: found from_s `x`"),
            ("clip,from_s,to_s\na,2,1\n", "l.csv:2:5: found to_s `1`, expected more than from_s, 2"),
        ] {
            assert!(error(text).starts_with(expected), "{text:?}: {}", error(text));
        }
    }

    #[test]
    fn ranges_split_clips_and_rows_without_a_clip_are_noted() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("l.csv");
        std::fs::write(&path, "clip,from_s,to_s,why\na,1,2,odd\nb,,,\nnone,0,1,\na,1.5,3,\n").unwrap();
        let item = |name: &str| Item { name: name.into(), ..Item::default() };
        let mut dataset = Dataset { items: ["a", "b", "c"].map(item).into(), ..Dataset::default() };
        let excluded = exclude(&mut dataset, &path).unwrap();
        assert_eq!(
            excluded,
            [range("a", 1.0, Some(2.0), "odd"), range("b", 0.0, None, ""), range("a", 1.5, Some(3.0), "")]
        );
        assert!(dataset.notes[0].ends_with("l.csv: 3 ranges of 2 clips excluded"), "{:?}", dataset.notes);
        assert!(dataset.notes[1].ends_with("l.csv: 1 rows have no file: none (line 4)"), "{:?}", dataset.notes);
        let names: Vec<String> = split_items(&dataset.items).into_iter().map(|i| i.name).collect();
        assert_eq!(names, ["a@0s-1s", "a@3s-end", "c"]);
    }
}
