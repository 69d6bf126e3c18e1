//! What is known of a clip beside its motion: labels, split, take and how its file is read. It comes from a CSV, from a
//! pattern over names, or from the names of known data sets.

use super::clip_info::ClipInfo;
use super::label_table::LabelTable;
use super::pattern::{self, Pattern, without_extension};
use crate::{Error, Result};
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;
use std::path::Path;
use std::str::FromStr;
use std::sync::LazyLock;

/// A label that clips must have, `field=value`.
///
/// ```
/// let filter: kinelm_corpus::labels::LabelFilter = "genre=salsa".parse()?;
/// assert_eq!((filter.field.as_str(), filter.value.as_str()), ("genre", "salsa"));
/// # kinelm_corpus::Result::<()>::Ok(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct LabelFilter {
    /// The field.
    pub field: String,
    /// Its value.
    pub value: String,
}

impl FromStr for LabelFilter {
    type Err = Error;

    fn from_str(text: &str) -> Result<LabelFilter> {
        match text.split_once('=') {
            Some((field, value)) if !field.is_empty() && !value.is_empty() => {
                Ok(LabelFilter { field: field.into(), value: value.into() })
            }
            _ => Err(Error::invalid("a label", format!("`{text}`"), "FIELD=VALUE, such as genre=salsa")),
        }
    }
}

impl fmt::Display for LabelFilter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}={}", self.field, self.value)
    }
}

impl LabelFilter {
    /// Whether these labels have it.
    pub fn allows(&self, labels: &BTreeMap<String, String>) -> bool {
        labels.get(&self.field) == Some(&self.value)
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
            return Err(Error::invalid_parameter("labels", format!("`{text}`: no such file"), expected));
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
    pub(crate) fn describe(self) -> &'static str {
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
    use crate::record::Split;

    fn known(labels: &Labels, path: &str) -> Option<(String, Option<String>, Rule)> {
        let (k, rule) = labels.find(path).unwrap()?;
        let labels: Vec<String> = k.labels.iter().map(|(f, v)| format!("{f}={v}")).collect();
        Some((labels.join(" "), k.take, rule))
    }

    #[test]
    fn label_filters_are_parsed() {
        let only: LabelFilter = "genre=salsa".parse().unwrap();
        assert_eq!((only.field.as_str(), only.value.as_str()), ("genre", "salsa"));
        for wrong in ["genre", "=salsa", "genre="] {
            assert!(wrong.parse::<LabelFilter>().unwrap_err().to_string().contains("expected FIELD=VALUE"));
        }
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
