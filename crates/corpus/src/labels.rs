//! What is known of a clip beside its motion: labels, split, take and how its file is read. It comes from a CSV, from a
//! pattern over names, or from the names of known data sets.

use super::csv::{FROM, TO};
use super::label_table::LabelTable;
use super::pattern::{self, Pattern, without_extension};
use super::record::Split;
use super::segments::TimedLabels;
use crate::{Error, Result};
use std::collections::BTreeMap;
use std::path::Path;
use std::str::FromStr;
use std::sync::LazyLock;

/// Columns and pattern fields that are no labels.
pub(super) const RESERVED: [&str; 9] = ["clip", "split", "take", "fps", "skip", "floor", "music_from", FROM, TO];

/// Pattern fields that name a file and nothing that could be learned.
const NO_LABEL: [&str; 2] = ["set", "id"];

/// Parses a label `FIELD=VALUE`.
///
/// # Errors
/// [`kinelm_store::Error::Invalid`] for text of another form.
///
/// ```
/// assert_eq!(kinelm_corpus::labels::parse_pair("genre=salsa")?, ("genre".into(), "salsa".into()));
/// # Ok::<(), kinelm_corpus::Error>(())
/// ```
pub fn parse_pair(text: &str) -> Result<(String, String)> {
    match text.split_once('=') {
        Some((field, value)) if !field.is_empty() && !value.is_empty() => Ok((field.into(), value.into())),
        _ => Err(Error::invalid("a label", format!("`{text}`"), "FIELD=VALUE, such as genre=salsa")),
    }
}

/// What is known of one clip.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ClipInfo {
    /// Values by field; empty values are left out.
    pub labels: BTreeMap<String, String>,
    /// The split, if stated.
    pub split: Option<Split>,
    /// The recording, if stated.
    pub take: Option<String>,
    /// The true source rate, if stated.
    pub fps: Option<f64>,
    /// Source frames to skip at the start, if stated.
    pub skip: Option<usize>,
    /// The height of the floor in metres, if stated.
    pub floor: Option<f64>,
    /// The time of its music at which the clip begins, in seconds, if stated.
    pub music_from_s: Option<f64>,
    /// Labels of parts of the clip.
    pub timed: Vec<TimedLabels>,
}

impl ClipInfo {
    /// Sets one value; an empty one says nothing. The error is what was expected.
    pub(super) fn set(&mut self, field: &str, value: &str) -> std::result::Result<(), &'static str> {
        fn number<T: FromStr>(
            value: &str,
            is_valid: impl Fn(&T) -> bool,
            expected: &'static str,
        ) -> std::result::Result<Option<T>, &'static str> {
            value.parse().ok().filter(is_valid).map(Some).ok_or(expected)
        }
        if value.is_empty() {
            return Ok(());
        }
        let is_rate = |f: &f64| f.is_finite() && *f > 0.0;
        let is_time = |s: &f64| s.is_finite() && *s >= 0.0;
        match field {
            "clip" | FROM | TO => {}
            "split" => self.split = number(value, |_| true, "train, valid or test")?,
            "take" => self.take = Some(value.to_owned()),
            "fps" => self.fps = number(value, is_rate, "a positive number of frames per second")?,
            "floor" => self.floor = number(value, |m: &f64| m.is_finite(), "a height in metres")?,
            "music_from" => self.music_from_s = number(value, is_time, "seconds, 0 or more")?,
            "skip" => self.skip = number(value, |_| true, "a whole number of frames")?,
            _ => {
                self.labels.insert(field.to_owned(), value.to_owned());
            }
        }
        Ok(())
    }

    /// What the fields of a pattern say of the file at `path`.
    fn from_fields(fields: BTreeMap<String, String>, path: &str) -> Result<ClipInfo> {
        let mut info = ClipInfo::default();
        for (field, value) in fields {
            let wrong = |expected| {
                let found = format!("`{value}` by the pattern");
                Error::in_clip(path)(Error::invalid(format!("the {field}"), found, expected))
            };
            if [FROM, TO].contains(&field.as_str()) {
                return Err(wrong("a column of a CSV"));
            }
            if !NO_LABEL.contains(&field.as_str()) {
                info.set(&field, &value).map_err(wrong)?;
            }
        }
        Ok(info)
    }
}

/// A source of labels.
#[derive(Debug, Clone)]
pub enum Labels {
    /// A CSV.
    Table(LabelTable),
    /// A pattern over names.
    Pattern(Pattern),
    /// The names of AIST++, of Bandai's data sets, and `{genre}/{take}.bvh`, tried in this order.
    Auto,
}

impl Labels {
    /// Parses the name of a source: a pattern if it holds a brace, `Auto` if it is empty, else the path of a CSV.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`] when the file can't be read; [`kinelm_store::Error::File`] with line and column where it
    /// is wrong; [`kinelm_store::Error::Invalid`] for a bad pattern or a file that doesn't exist.
    pub fn parse(text: &str) -> Result<Self> {
        if text.is_empty() {
            return Ok(Labels::Auto);
        }
        if text.contains(['{', '}']) {
            return Ok(Labels::Pattern(Pattern::parse(text)?));
        }
        let path = Path::new(text);
        if !path.exists() {
            let expected = "the path of a CSV, or a pattern with fields such as {genre}";
            return Err(Error::invalid("`labels`", format!("`{text}`: no such file"), expected));
        }
        Ok(Labels::Table(LabelTable::load(path)?))
    }

    /// What is known of the file at `path` below its folder (`/` between parts, with extension), and the rule that says so.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Invalid`] when a name holds a bad split, rate or number.
    pub fn find(&self, path: &str) -> Result<Option<(ClipInfo, Rule)>> {
        match self {
            Labels::Table(table) => Ok(table.find(path).map(|(row, info)| (info.clone(), Rule::Row(row)))),
            Labels::Pattern(pattern) => {
                let info = pattern.find(path).map(|fields| ClipInfo::from_fields(fields, path)).transpose()?;
                Ok(info.map(|info| (info, Rule::Pattern)))
            }
            Labels::Auto => auto(path),
        }
    }
}

/// How a clip got its labels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Rule {
    /// By the clip of this index in a CSV.
    Row(usize),
    /// By the pattern given.
    Pattern,
    /// By the name grammar of AIST++.
    Aist,
    /// By `dataset-{set}_{content}_{style}_{id}`.
    Bandai,
    /// By `{genre}/{take}.bvh`.
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

/// Tries the names of known data sets. But for the camera of AIST++ they never make a take shorter than the file's own path:
/// folders that number their clips from 1 would share takes.
fn auto(path: &str) -> Result<Option<(ClipInfo, Rule)>> {
    static PATTERNS: LazyLock<[Pattern; 2]> =
        LazyLock::new(|| [BANDAI, GENRE_FOLDER].map(|text| Pattern::parse(text).expect("a fixed pattern")));
    let stem = without_extension(path);
    if let Some((labels, take)) = pattern::aist_name(stem.rsplit('/').next().unwrap_or(stem)) {
        return Ok(Some((ClipInfo { labels, take: Some(take), ..ClipInfo::default() }, Rule::Aist)));
    }
    let [bandai, genre_folder] = &*PATTERNS;
    let bandai = bandai.find(path).map(|fields| (fields, Rule::Bandai));
    // deeper folders are another data set's
    let genre_folder = || genre_folder.find(path).filter(|_| path.matches('/').count() == 1);
    let Some((fields, rule)) = bandai.or_else(|| Some((genre_folder()?, Rule::GenreFolder))) else { return Ok(None) };
    Ok(Some((ClipInfo { take: None, ..ClipInfo::from_fields(fields, path)? }, rule)))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn known(labels: &Labels, path: &str) -> Option<(String, Option<String>, Rule)> {
        let (k, rule) = labels.find(path).unwrap()?;
        let labels: Vec<String> = k.labels.iter().map(|(f, v)| format!("{f}={v}")).collect();
        Some((labels.join(" "), k.take, rule))
    }

    #[test]
    fn known_names_need_no_pattern() {
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
    fn a_pattern_may_have_reserved_fields() {
        let labels = Labels::parse("{split}/{genre}_{take}").unwrap();
        let (k, _) = labels.find("x/test/salsa_07.bvh").unwrap().unwrap();
        assert_eq!((k.split, k.take.as_deref()), (Some(Split::Test), Some("07")));
        assert_eq!(k.labels.len(), 1);
        let e = labels.find("dev/salsa_07.bvh").unwrap_err().to_string();
        assert!(e.contains("the split is `dev` by the pattern; expected train, valid or test"), "{e}");
        assert!(Labels::parse("no/such.csv").unwrap_err().to_string().contains("no such file"));
    }
}
