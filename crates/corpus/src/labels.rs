//! What is known of a clip beside its motion: from a CSV, from names, or from the names that data sets are known by.

use super::csv::{self, Field};
use super::pattern::{self, Pattern, without_extension};
use super::record::Split;
use super::rows::{FROM, Row, TO, at_column, time_of};
use super::timed::Timed;
use crate::{Error, Result};
use kinelm_store::input;
use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

/// Columns and pattern fields that are no labels.
const RESERVED: [&str; 9] = ["clip", "split", "take", "fps", "skip", "floor", "music_from", FROM, TO];

/// Pattern fields that name a file and nothing that could be learned.
const NO_LABEL: [&str; 2] = ["set", "id"];

/// Field and value of a label that is written `FIELD=VALUE`.
///
/// # Errors
/// [`kinelm_store::Error::Call`] with what it says, for text of another form.
pub fn pair(text: &str) -> Result<(String, String)> {
    match text.split_once('=') {
        Some((field, value)) if !field.is_empty() && !value.is_empty() => Ok((field.into(), value.into())),
        _ => Err(Error::call(format!("`{text}`; expected FIELD=VALUE, such as genre=salsa"))),
    }
}

/// What one clip's row or name says.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Known {
    /// Field to value; empty values are left out.
    pub labels: BTreeMap<String, String>,
    /// The part of the experiment, if stated.
    pub split: Option<Split>,
    /// The recording, if stated.
    pub take: Option<String>,
    /// The true source rate, if stated.
    pub fps: Option<f64>,
    /// Source frames to leave out at the start, if stated.
    pub skip: Option<usize>,
    /// Where the floor is, metres, if stated.
    pub floor: Option<f64>,
    /// The time of its music at which it begins, seconds, if stated.
    pub music_from_s: Option<f64>,
    /// Labels that hold for a time alone.
    pub timed: Vec<Timed>,
}

/// Where labels come from.
#[derive(Debug, Clone)]
pub enum Labels {
    /// A CSV.
    Table(Table),
    /// A pattern over names.
    Pattern(Pattern),
    /// The patterns that are tried by themselves: AIST++, Bandai, `{genre}/{take}.bvh`.
    Auto,
}

impl Labels {
    /// Reads what `--labels` was given: a pattern if it holds a brace, nothing (`Auto`) if it is empty, else a CSV.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`] when the file can't be read; [`kinelm_store::Error::File`] with line and column where it is wrong;
    /// [`kinelm_store::Error::Call`] for a pattern that is none.
    pub fn parse(text: &str) -> Result<Self> {
        if text.is_empty() {
            return Ok(Labels::Auto);
        }
        if text.contains(['{', '}']) {
            return Ok(Labels::Pattern(Pattern::parse(text)?));
        }
        let path = Path::new(text);
        if !path.exists() {
            return Err(Error::call(format!("labels {text}: no such file; a pattern has fields such as {{genre}}")));
        }
        Ok(Labels::Table(Table::load(path)?))
    }

    /// What is known of the file at `path` below its folder (`/` between parts, with extension), and by which rule.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Call`] when a name holds a split, rate or number that is none.
    pub fn find(&self, path: &str) -> Result<Option<(Known, Rule)>> {
        match self {
            Labels::Table(table) => Ok(table.find(path).map(|row| (table.rows[row].known.clone(), Rule::Row(row)))),
            Labels::Pattern(pattern) => {
                let known = pattern.find(path).map(|found| from_fields(found, path)).transpose()?;
                Ok(known.map(|k| (k, Rule::Pattern)))
            }
            Labels::Auto => auto(path),
        }
    }
}

/// How something came to be known.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rule {
    /// The row of this index of a CSV.
    Row(usize),
    /// The pattern given.
    Pattern,
    /// The name grammar of AIST++.
    Aist,
    /// `dataset-{set}_{content}_{style}_{id}`.
    Bandai,
    /// `{genre}/{take}.bvh`.
    GenreFolder,
}

const BANDAI: &str = "dataset-{set}_{content}_{style}_{id}";
const GENRE_FOLDER: &str = "{genre}/{take}.bvh";

impl Rule {
    /// The rule in the user's terms.
    pub fn describe(self) -> &'static str {
        match self {
            Rule::Row(_) => "the CSV",
            Rule::Pattern => "the pattern",
            Rule::Aist => "the names of AIST++",
            Rule::Bandai => BANDAI,
            Rule::GenreFolder => GENRE_FOLDER,
        }
    }
}

/// The patterns that are tried by themselves. They never shorten a take to less than the file's own path (but for the
/// camera of AIST++), since folders that number their clips from 1 would then share takes.
fn auto(path: &str) -> Result<Option<(Known, Rule)>> {
    let stem = without_extension(path);
    if let Some((labels, take)) = pattern::aist_name(stem.rsplit('/').next().unwrap_or(stem)) {
        return Ok(Some((Known { labels, take: Some(take), ..Known::default() }, Rule::Aist)));
    }
    for (text, rule) in [(BANDAI, Rule::Bandai), (GENRE_FOLDER, Rule::GenreFolder)] {
        let pattern = Pattern::parse(text)?;
        // a deeper path than the pattern's is another data set's
        let depth_fits = pattern.depth() == 1 || path.split('/').count() == pattern.depth();
        if let Some(found) = pattern.find(path).filter(|_| depth_fits) {
            let known = Known { take: None, ..from_fields(found, path)? };
            return Ok(Some((known, rule)));
        }
    }
    Ok(None)
}

fn from_fields(found: BTreeMap<String, String>, path: &str) -> Result<Known> {
    let mut known = Known::default();
    for (field, value) in found {
        if [FROM, TO].contains(&field.as_str()) {
            return Err(Error::call(format!("{path}: a {field} by the pattern; expected it in a CSV, as a column")));
        }
        if !NO_LABEL.contains(&field.as_str()) {
            let what = |expected| Error::call(format!("{path}: {field} `{value}` by the pattern; expected {expected}"));
            known.set(&field, &value).map_err(what)?;
        }
    }
    Ok(known)
}

impl Known {
    /// Takes one value; an empty one says nothing. The error is what was expected.
    fn set(&mut self, field: &str, value: &str) -> std::result::Result<(), &'static str> {
        if value.is_empty() {
            return Ok(());
        }
        match field {
            "clip" => {}
            "split" => self.split = Some(value.parse().map_err(|_| "train, valid or test")?),
            "take" => self.take = Some(value.to_owned()),
            "fps" => {
                let fps: Option<f64> = value.parse().ok().filter(|f: &f64| f.is_finite() && *f > 0.0);
                self.fps = Some(fps.ok_or("a positive number of frames per second")?);
            }
            "floor" => {
                let floor: Option<f64> = value.parse().ok().filter(|f: &f64| f.is_finite());
                self.floor = Some(floor.ok_or("a height in metres")?);
            }
            "music_from" => {
                let from: Option<f64> = value.parse().ok().filter(|f: &f64| f.is_finite() && *f >= 0.0);
                self.music_from_s = Some(from.ok_or("seconds, 0 or more")?);
            }
            FROM | TO => {}
            "skip" => self.skip = Some(value.parse().map_err(|_| "a whole number of frames")?),
            _ => {
                self.labels.insert(field.to_owned(), value.to_owned());
            }
        }
        Ok(())
    }
}

/// A label CSV: a header with the column `clip`, then a row a clip.
#[derive(Debug, Clone)]
pub struct Table {
    path: PathBuf,
    rows: Vec<Row>,
    by_clip: HashMap<String, usize>,
}

impl Table {
    /// Reads a CSV.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`]; [`kinelm_store::Error::File`] with line and column: no header, no `clip` column, a column without a name or
    /// named twice, a row of another width, a clip named twice or not at all, a split, rate or skip that is none; of rows
    /// with times, a time that is none, a label at a time at which another row has told it, two rows that state another
    /// split, take, rate, skip or floor of one clip.
    pub fn load(path: &Path) -> Result<Self> {
        Table::parse(path, &input::bytes(path).map_err(Error::io(path))?)
    }

    /// [`Table::load`] of bytes; `path` is for messages.
    ///
    /// # Errors
    /// [`kinelm_store::Error::File`] as there.
    pub fn parse(path: &Path, bytes: &[u8]) -> Result<Self> {
        let mut records = csv::parse(path, bytes)?.into_iter();
        let Some(header) = records.next() else {
            return Err(Error::file(path, "no line", "a header with the column `clip`", ""));
        };
        let clip_column = check_header(path, &header)?;
        let mut table = Table { path: path.to_owned(), rows: Vec::new(), by_clip: HashMap::new() };
        for record in records {
            table.add(&header, clip_column, &record)?;
        }
        Ok(table)
    }

    fn add(&mut self, header: &[Field], clip_column: usize, record: &[Field]) -> Result<()> {
        if record.len() != header.len() {
            let at = record[record.len().min(header.len() + 1) - 1].at.clone();
            let (found, expected) = (record.len(), header.len());
            return Err(Error::at(at, format!("{found} fields"), format!("{expected}, as the header has"), ""));
        }
        let mut known = Known::default();
        for (column, field) in header.iter().zip(record) {
            known.set(&column.text, &field.text).map_err(|expected| {
                Error::at(field.at.clone(), format!("{} `{}`", column.text, field.text), expected, "")
            })?;
        }
        let field = &record[clip_column];
        let clip = field.text.replace('\\', "/").trim_start_matches("./").to_owned();
        if clip.is_empty() {
            return Err(Error::at(field.at.clone(), "an empty clip", "a path below the folder of the data", ""));
        }
        let line = field.at.line;
        let time = time_of(header, record)?;
        if let Some((from_s, to_s)) = time {
            known.timed = vec![Timed { from_s, to_s, labels: std::mem::take(&mut known.labels), line }];
        }
        let whole = time.is_none().then_some(line);
        match self.by_clip.get(&clip) {
            None => {
                self.by_clip.insert(clip.clone(), self.rows.len());
                self.rows.push(Row { clip, line, known, whole });
            }
            Some(&other) => {
                let row = &mut self.rows[other];
                if let Some((first, _)) = row.whole.zip(whole) {
                    let found = format!("clip {clip} a second time (first in line {first})");
                    let help = "take one of the two out, or say from_s and to_s";
                    return Err(Error::at(field.at.clone(), found, "a row a clip", help));
                }
                row.merge(&known, |column| at_column(header, record, column))?;
                row.known.timed.extend(known.timed);
                row.known.labels.extend(known.labels);
                row.whole = row.whole.or(whole);
            }
        }
        Ok(())
    }

    /// The row of a path below the folder of the data: with its extension, else without.
    fn find(&self, path: &str) -> Option<usize> {
        self.by_clip.get(path).or_else(|| self.by_clip.get(without_extension(path))).copied()
    }

    /// The file it was read from.
    pub fn path(&self) -> &Path {
        &self.path
    }

    /// The clips of rows that `used` doesn't hold, each as `clip (line n)`.
    pub fn unused(&self, used: impl Fn(usize) -> bool) -> Vec<String> {
        let rows = self.rows.iter().enumerate().filter(|(i, _)| !used(*i));
        rows.map(|(_, row)| format!("{} (line {})", row.clip, row.line)).collect()
    }
}

/// The index of the clip column.
fn check_header(path: &Path, header: &[Field]) -> Result<usize> {
    for (i, column) in header.iter().enumerate() {
        if column.text.is_empty() {
            return Err(Error::at(
                column.at.clone(),
                "a column without a name",
                "a name",
                "name the column or remove it",
            ));
        }
        if header[..i].iter().any(|c| c.text == column.text) {
            return Err(Error::at(column.at.clone(), format!("column {} a second time", column.text), "each once", ""));
        }
        // `Split` would silently become a label that gives the split away
        let lower = column.text.to_lowercase();
        if lower != column.text && RESERVED.contains(&lower.as_str()) {
            return Err(Error::at(column.at.clone(), format!("column {}", column.text), format!("`{lower}`"), ""));
        }
    }
    header.iter().position(|c| c.text == "clip").ok_or_else(|| {
        let names: Vec<&str> = header.iter().map(|c| c.text.as_str()).collect();
        let help = "the first line names the columns: clip, and any of split, take, fps, skip, floor, music_from, from_s, to_s and \
                    your labels";
        Error::at(
            kinelm_store::SourcePos { path: path.to_owned(), line: header[0].at.line, column: 1 },
            format!("columns {}", names.join(", ")),
            "a column `clip`",
            help,
        )
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(text: &str) -> Result<Table> {
        Table::parse(Path::new("l.csv"), text.as_bytes())
    }

    fn known(labels: &Labels, path: &str) -> Option<(String, Option<String>, Rule)> {
        let (k, rule) = labels.find(path).unwrap()?;
        let labels: Vec<String> = k.labels.iter().map(|(f, v)| format!("{f}={v}")).collect();
        Some((labels.join(" "), k.take, rule))
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
        assert_eq!(labels.find("indian/02.bvh").unwrap().unwrap().0, Known::default());
        assert_eq!(labels.find("indian/02.npz").unwrap(), None);
        assert_eq!(t.unused(|row| row == 1), ["salsa/01 (line 2)"]);
    }

    #[test]
    fn faults_have_their_place() {
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
                "l.csv:4:3: found x at a time at which line 2 tells it",
            ),
            ("clip,x,to_s\na,b,\na,c,2\n", "l.csv:3:3: found x at a time at which line 2 tells it"),
            ("clip,x,to_s\na,b,2\na,b,\n", "l.csv:3:3: found x at a time at which line 2 tells it"),
            ("clip,music_from,to_s\na,2,2\na,5,3\n", "l.csv:3:3: found another music_from than in line 2"),
            ("clip,take,to_s\na,t,2\na,u,3\n", "l.csv:3:3: found another take than in line 2"),
        ] {
            let e = table(text).unwrap_err().to_string();
            assert!(e.starts_with(start), "{e}");
        }
    }

    #[test]
    fn names_are_tried_by_themselves() {
        let auto = Labels::parse("").unwrap();
        let (labels, take, rule) = known(&auto, "motions/gKR_sFM_cAll_d30_mKR2_ch15.pkl").unwrap();
        assert!(labels.contains("genre=krump") && labels.contains("camera=cAll"), "{labels}");
        assert_eq!((take.as_deref(), rule), (Some("gKR_sFM_d30_mKR2_ch15"), Rule::Aist));
        let bandai = known(&auto, "dataset-2_walk-left_not-confident_012.bvh");
        assert_eq!(bandai, Some(("content=walk-left style=not-confident".into(), None, Rule::Bandai)));
        assert_eq!(known(&auto, "salsa/07.bvh"), Some(("genre=salsa".into(), None, Rule::GenreFolder)));
        assert_eq!(known(&auto, "a/salsa/07.bvh"), None);
        assert_eq!(known(&auto, "07.bvh"), None);
    }

    #[test]
    fn a_pattern_may_name_what_is_reserved() {
        let labels = Labels::parse("{split}/{genre}_{take}").unwrap();
        let (k, _) = labels.find("x/test/salsa_07.bvh").unwrap().unwrap();
        assert_eq!((k.split, k.take.as_deref()), (Some(Split::Test), Some("07")));
        assert_eq!(k.labels.len(), 1);
        let e = labels.find("dev/salsa_07.bvh").unwrap_err().to_string();
        assert!(e.contains("split `dev` by the pattern; expected train, valid or test"), "{e}");
        assert!(Labels::parse("no/such.csv").unwrap_err().to_string().contains("no such file"));
    }
}
