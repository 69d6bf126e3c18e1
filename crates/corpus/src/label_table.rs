//! A label CSV: a header with the column `clip`, then a row per clip, or several with time ranges.

use super::clip_info::{ClipInfo, RESERVED};
use super::csv::{ClipTable, Row};
use super::item::TimedLabels;
use super::pattern::without_extension;
use crate::{Error, Result};
use kinelm_store::input;
use std::collections::HashMap;
use std::path::{Path, PathBuf};

const COLUMNS: &str = "clip, and any of split, take, fps, skip, floor, music_from, from_s, to_s and your labels";

/// A label CSV.
#[derive(Debug, Clone)]
pub struct LabelTable {
    path: PathBuf,
    clips: Vec<Entry>,
    by_name: HashMap<String, usize>,
}

/// All rows of a clip together.
#[derive(Debug, Clone)]
struct Entry {
    name: String,
    /// The first line of the clip.
    line: usize,
    info: ClipInfo,
    /// The line of the row without a time range, if there is one.
    whole: Option<usize>,
}

impl LabelTable {
    /// Reads a CSV.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`]; [`kinelm_store::Error::File`] with line and column: those of `ClipTable::parse`; a clip
    /// with two rows without time ranges; a split, rate, skip or time that is none; of several rows of a clip, two values of
    /// a label at one time, or two values of split, take, rate, skip or floor.
    pub fn load(path: &Path) -> Result<Self> {
        LabelTable::parse(path, &input::bytes(path).map_err(Error::io(path))?)
    }

    /// [`LabelTable::load`] of bytes; `path` is for messages.
    ///
    /// # Errors
    /// [`kinelm_store::Error::File`] as there.
    pub fn parse(path: &Path, bytes: &[u8]) -> Result<Self> {
        let csv = ClipTable::parse(path, bytes, COLUMNS)?;
        for column in csv.header() {
            // `Split` would silently become a label that gives the split away
            let lower = column.text.to_lowercase();
            if lower != column.text && RESERVED.contains(&lower.as_str()) {
                return Err(Error::at(column.at.clone(), format!("column {}", column.text), format!("`{lower}`"), ""));
            }
        }
        let mut table = LabelTable { path: path.to_owned(), clips: Vec::new(), by_name: HashMap::new() };
        csv.rows().try_for_each(|row| table.add(row))?;
        Ok(table)
    }

    fn add(&mut self, row: Row) -> Result<()> {
        let mut info = ClipInfo::default();
        for (column, field) in row.fields() {
            let wrong = |expected| Error::at(field.at.clone(), format!("{column} `{}`", field.text), expected, "");
            info.set(column, &field.text).map_err(wrong)?;
        }
        let (name, line) = row.clip()?;
        let range_s = row.range_s()?;
        if let Some((from_s, to_s)) = range_s {
            info.timed = vec![TimedLabels { from_s, to_s, labels: std::mem::take(&mut info.labels), line }];
        }
        let whole = range_s.is_none().then_some(line);
        let Some(&known) = self.by_name.get(&name) else {
            self.by_name.insert(name.clone(), self.clips.len());
            self.clips.push(Entry { name, line, info, whole });
            return Ok(());
        };
        let entry = &mut self.clips[known];
        if let Some((first, _)) = entry.whole.zip(whole) {
            let found = format!("clip {name} a second time (first in line {first})");
            let help = "take one of the two out, or say from_s and to_s";
            return Err(Error::at(row.at("clip"), found, "a row a clip", help));
        }
        entry.merge(info, whole, row)
    }

    /// The rows of a path below the folder of the data: by the path with its extension, else without.
    pub(super) fn find(&self, path: &str) -> Option<(usize, &ClipInfo)> {
        let known = self.by_name.get(path).or_else(|| self.by_name.get(without_extension(path)))?;
        Some((*known, &self.clips[*known].info))
    }

    /// The file that it was read from.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The clips for which `is_used` is false, each as `clip (line n)`.
    pub(crate) fn unused(&self, is_used: impl Fn(usize) -> bool) -> Vec<String> {
        let clips = self.clips.iter().enumerate().filter(|(i, _)| !is_used(*i));
        clips.map(|(_, clip)| format!("{} (line {})", clip.name, clip.line)).collect()
    }
}

impl Entry {
    /// Adds another row of the clip.
    fn merge(&mut self, other: ClipInfo, whole: Option<usize>, row: Row) -> Result<()> {
        let info = &mut self.info;
        let agree = [
            ("split", agree(&mut info.split, &other.split)),
            ("take", agree(&mut info.take, &other.take)),
            ("fps", agree(&mut info.fps, &other.fps)),
            ("skip", agree(&mut info.skip, &other.skip)),
            ("floor", agree(&mut info.floor, &other.floor)),
            ("music_from", agree(&mut info.music_from_s, &other.music_from_s)),
        ];
        if let Some((column, _)) = agree.into_iter().find(|(_, agree)| !agree) {
            let (found, help) = (format!("another {column} than in line {}", self.line), "state it in one of the rows");
            return Err(Error::at(row.at(column), found, format!("one {column} a clip"), help));
        }
        let always = |info: &ClipInfo, line: usize| {
            let (from_s, to_s, labels) = (0.0, f64::INFINITY, info.labels.clone());
            TimedLabels { from_s, to_s, labels, line }
        };
        // a row without times holds at all times, so one comparison covers both kinds of rows
        let (known_always, other_always) = (always(info, self.whole.unwrap_or(self.line)), always(&other, 0));
        for known in info.timed.iter().chain([&known_always]) {
            for new in other.timed.iter().chain([&other_always]).filter(|new| new.overlaps(known)) {
                if let Some(field) = new.labels.keys().find(|field| known.labels.contains_key(*field)) {
                    let found = format!("{field} at a time at which line {} states it", known.line);
                    let help = "times are half-open: let one row end where the next begins";
                    return Err(Error::at(row.at(field), found, "a value of a field at a time", help));
                }
            }
        }
        info.timed.extend(other.timed);
        info.labels.extend(other.labels);
        self.whole = self.whole.or(whole);
        Ok(())
    }
}

/// Whether two rows don't contradict each other; `known` takes over a value that only `other` has.
fn agree<T: Clone + PartialEq>(known: &mut Option<T>, other: &Option<T>) -> bool {
    if known.is_none() {
        known.clone_from(other);
    }
    other.is_none() || known == other
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::labels::{Labels, Rule};
    use crate::record::Split;
    use std::collections::BTreeMap;

    fn table(text: &str) -> Result<LabelTable> {
        LabelTable::parse(Path::new("l.csv"), text.as_bytes())
    }

    #[test]
    fn a_row_is_found_with_and_without_extension() {
        let t =
            table("clip,split,genre,take,fps,skip\nsalsa/01,train,salsa,t1,60,10\n.\\indian\\02.bvh,,,,,\n").unwrap();
        let labels = Labels::Table(t.clone());
        let (k, rule) = labels.find("salsa/01.bvh").unwrap().unwrap();
        assert_eq!(rule, Rule::Row(0));
        assert_eq!((k.split, k.take.as_deref(), k.fps, k.skip), (Some(Split::Train), Some("t1"), Some(60.0), Some(10)));
        assert_eq!(k.labels, BTreeMap::from([("genre".into(), "salsa".into())]));
        assert_eq!(labels.find("indian/02.bvh").unwrap().unwrap().0, ClipInfo::default());
        assert_eq!(labels.find("indian/02.npz").unwrap(), None);
        assert_eq!(t.unused(|row| row == 1), ["salsa/01 (line 2)"]);
    }

    #[test]
    fn errors_have_positions() {
        for (text, start) in [
            ("", "l.csv: found no line"),
            ("name,genre\n", "l.csv:1:1: found columns name, genre, expected a column `clip`"),
            ("clip,,x\n", "l.csv:1:6: found a column without a name"),
            ("clip,x,x\n", "l.csv:1:8: found column x a second time"),
            ("clip,Split\n", "l.csv:1:6: found column Split, expected `split`"),
            ("clip,x\na,b\nc\n", "l.csv:3:1: found 1 fields, expected 2"),
            ("clip,x\na,b,c\n", "l.csv:2:5: found 3 fields, expected 2"),
            ("clip,split\na,tarin\n", "l.csv:2:3: found split `tarin`, expected train, valid or test"),
            ("clip,fps\na,-60\n", "l.csv:2:3: found fps `-60`"),
            ("clip,fps\na,NaN\n", "l.csv:2:3: found fps `NaN`"),
            ("clip,skip\na,1.5\n", "l.csv:2:3: found skip `1.5`"),
            ("clip,floor\na,low\n", "l.csv:2:3: found floor `low`"),
            ("clip,music_from\na,-1\n", "l.csv:2:3: found music_from `-1`, expected seconds, 0 or more"),
            ("clip,x\n,b\n", "l.csv:2:1: found an empty clip"),
            ("clip,x\na,b\na,c\n", "l.csv:3:1: found clip a a second time (first in line 2)"),
            ("clip,from_s\na,-1\n", "l.csv:2:3: found from_s `-1`, expected seconds, 0 or more"),
            ("clip,to_s\na,later\n", "l.csv:2:3: found to_s `later`"),
            ("clip,from_s,to_s\na,2,2\n", "l.csv:2:5: found to_s `2`, expected more than from_s, 2"),
            ("clip,From_s\n", "l.csv:1:6: found column From_s, expected `from_s`"),
            (
                "clip,x,from_s,to_s\na,b,1,3\nb,c,,\na,c,2.5,4\n",
                "l.csv:4:3: found x at a time at which line 2 states it",
            ),
            ("clip,x,to_s\na,b,\na,c,2\n", "l.csv:3:3: found x at a time at which line 2 states it"),
            ("clip,x,to_s\na,b,2\na,b,\n", "l.csv:3:3: found x at a time at which line 2 states it"),
            ("clip,music_from,to_s\na,2,2\na,5,3\n", "l.csv:3:3: found another music_from than in line 2"),
            ("clip,take,to_s\na,t,2\na,u,3\n", "l.csv:3:3: found another take than in line 2"),
        ] {
            let e = table(text).unwrap_err().to_string();
            assert!(e.starts_with(start), "{e}");
        }
    }

    #[test]
    fn rows_of_a_clip_are_merged() {
        let t = table(
            "clip,split,genre,mood,from_s,to_s\na,train,salsa,,0,2\nb,,waltz,,,\na,,waltz,,2,\na,train,,glad,,\na,,house,,,0\n",
        );
        assert!(t.unwrap_err().to_string().starts_with("l.csv:6:12: found to_s `0`"));
        let t = table("clip,split,genre,mood,from_s,to_s\na,,salsa,,0,2\nb,,waltz,,,\na,,waltz,,2,\na,train,,glad,,\n");
        let (k, rule) = Labels::Table(t.unwrap()).find("a.bvh").unwrap().unwrap();
        let shown = |labels: &BTreeMap<String, String>| format!("{labels:?}");
        assert_eq!(
            (rule, k.split, shown(&k.labels)),
            (Rule::Row(0), Some(Split::Train), "{\"mood\": \"glad\"}".into())
        );
        let timed: Vec<_> = k.timed.iter().map(|t| (t.from_s, t.to_s, shown(&t.labels), t.line)).collect();
        let expected = [(0.0, 2.0, "salsa", 2), (2.0, f64::INFINITY, "waltz", 4)];
        assert_eq!(
            timed,
            expected.map(|(from, to, genre, line)| (from, to, format!("{{\"genre\": {genre:?}}}"), line))
        );
    }
}
