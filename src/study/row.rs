//! The rows of a study: names and settings of tokenizers.

use crate::{Error, Result};
use kinelm_motion::{Place, joints};
use kinelm_tokenizer::{RootRotation, SchemeConfig, TokenizerConfig};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::path::Path;
use toml::Spanned;

/// The rows that a study of so many joints has unless told, and their file: `study.toml`, or with fewer than 24
/// `study-13.toml`, where components are fewer in proportion.
pub fn default_rows(joints: usize) -> (&'static str, &'static str) {
    match joints {
        24 => (include_str!("../../configs/tokenizer/study.toml"), "configs/tokenizer/study.toml"),
        _ => (include_str!("../../configs/tokenizer/study-13.toml"), "configs/tokenizer/study-13.toml"),
    }
}

/// One tokenizer that a study measures.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Row {
    /// Letters, digits, `-`, `_`, `.` and `+`; each once.
    pub name: String,
    /// Rows of one group are one curve in the pictures.
    pub group: String,
    /// What is fitted.
    pub config: TokenizerConfig,
}

/// What rows have that state nothing else.
#[derive(Debug, Clone, PartialEq)]
pub struct RowDefaults {
    /// SMPL ids, ascending.
    pub joints: Vec<usize>,
    /// Frames per second.
    pub fps: f64,
}

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct File {
    row: Vec<Spanned<toml::Table>>,
}

/// A row as it is written.
#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
struct Written {
    name: String,
    group: Option<String>,
    joints: Option<Joints>,
    fps: Option<f64>,
    root_rotation: Option<RootRotation>,
    merges: Option<u32>,
    scheme: SchemeConfig,
}

/// `[0, 1, 4]` or what `--joints` takes.
#[derive(Deserialize)]
#[serde(untagged)]
enum Joints {
    Ids(Vec<usize>),
    List(String),
}

/// The rows of a TOML text: `[[row]]` tables with a `name`, perhaps a `group`, and the settings of a tokenizer, `scheme`
/// among them. `path` is for messages.
///
/// # Errors
/// [`Error::File`] with line, row and key for what is no such table, unknown keys, values outside their limits, a name
/// that stands twice, and a file without rows.
pub fn parse(text: &str, path: &Path, defaults: &RowDefaults) -> Result<Vec<Row>> {
    let file: File = toml::from_str(text).map_err(|e| wrong(text, path, e.span(), e.message(), "a file of rows"))?;
    let mut rows: Vec<Row> = Vec::with_capacity(file.row.len());
    let mut lines: HashMap<String, usize> = HashMap::new();
    for table in file.row {
        let span = table.span();
        let name = table.get_ref().get("name").and_then(toml::Value::as_str).unwrap_or("without a name").to_string();
        let found = |what: String| wrong(text, path, Some(span.clone()), &format!("row {name}: {what}"), "a row");
        let row = one(table.into_inner(), defaults).map_err(found)?;
        let line = line_of(text, span.start);
        if let Some(before) = lines.insert(row.name.clone(), line) {
            return Err(found(format!("the name of the row in line {before} again")));
        }
        rows.push(row);
    }
    if rows.is_empty() {
        return Err(Error::file(path, "no rows", "at least one [[row]]", HELP));
    }
    Ok(rows)
}

const HELP: &str = "configs/tokenizer/study.toml is an example";

fn one(table: toml::Table, defaults: &RowDefaults) -> std::result::Result<Row, String> {
    let written: Written = table.try_into().map_err(|e: toml::de::Error| e.to_string().trim().replace('\n', " "))?;
    let usable = |c: char| c.is_ascii_alphanumeric() || "-_.+".contains(c);
    if written.name.is_empty() || written.name.starts_with('.') || !written.name.chars().all(usable) {
        return Err(format!("name is {:?}; expected letters, digits, -, _, . and +, no . first", written.name));
    }
    let joints = match written.joints {
        None => defaults.joints.clone(),
        Some(Joints::Ids(ids)) => ids,
        Some(Joints::List(list)) => joints::parse(&list).map_err(|e| format!("joints: {e}"))?.joints,
    };
    let config = TokenizerConfig {
        joints,
        fps: written.fps.unwrap_or(defaults.fps),
        root_rotation: written.root_rotation.unwrap_or_default(),
        merges: written.merges.unwrap_or(0),
        scheme: written.scheme,
    };
    config.validate().map_err(|e| e.to_string())?;
    let group = written.group.unwrap_or_else(|| scheme_name(&config.scheme));
    Ok(Row { name: written.name, group, config })
}

/// The `type` that a scheme has in files.
pub fn scheme_name(scheme: &SchemeConfig) -> String {
    let value = serde_json::to_value(scheme).unwrap_or_default();
    value["type"].as_str().unwrap_or("scheme").to_string()
}

fn line_of(text: &str, at: usize) -> usize {
    text.bytes().take(at).filter(|&b| b == b'\n').count() + 1
}

fn wrong(text: &str, path: &Path, span: Option<std::ops::Range<usize>>, found: &str, expected: &str) -> Error {
    let before = &text[..span.as_ref().map_or(0, |s| s.start.min(text.len()))];
    let line = if span.is_some() { line_of(text, before.len()) } else { 0 };
    let column = before.chars().rev().take_while(|&c| c != '\n').count() + 1;
    Error::at(Place { path: path.to_owned(), line, column }, found, expected, HELP)
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::joints::THIRTEEN;

    fn defaults() -> RowDefaults {
        RowDefaults { joints: THIRTEEN.to_vec(), fps: 60.0 }
    }

    fn said(text: &str) -> String {
        parse(text, Path::new("rows.toml"), &defaults()).unwrap_err().to_string()
    }

    #[test]
    fn shipped_rows_hold() {
        let [all, few] = [24, 13].map(|joints| {
            let (text, path) = default_rows(joints);
            parse(text, Path::new(path), &defaults()).unwrap()
        });
        assert_eq!(all.len(), few.len());
        let bins = |rows: &[Row]| rows.iter().filter(|r| r.group == "uniform").count();
        assert_eq!((bins(&all), bins(&few)), (9, 9), "as many as the published figure of error against bins needs");
    }

    #[test]
    fn rows_state_what_they_want_otherwise() {
        let text = "[[row]]\nname = \"a\"\nscheme = { type = \"uniform\", bins = 60 }\n\
                    [[row]]\nname = \"b\"\ngroup = \"slow\"\nfps = 20\njoints = \"root,left_arm\"\n\
                    scheme = { type = \"uniform\" }\n\
                    [[row]]\nname = \"c\"\njoints = [0, 4]\nscheme = { type = \"uniform\" }\n";
        let rows = parse(text, Path::new("rows.toml"), &defaults()).unwrap();
        assert_eq!(rows[0].config, TokenizerConfig::uniform(&THIRTEEN, 60.0, 60));
        assert_eq!(rows[0].group, "uniform");
        assert_eq!((rows[1].config.fps, rows[1].group.as_str()), (20.0, "slow"));
        assert_eq!(rows[1].config.joints, [0, 13, 16, 18, 20, 22]);
        assert_eq!(rows[2].config.joints, [0, 4]);
    }

    #[test]
    fn wrong_rows_are_named_with_file_row_and_key() {
        let good = "[[row]]\nname = \"a\"\nscheme = { type = \"uniform\" }\n";
        let e = said(&format!("{good}\n[[row]]\nname = \"b\"\nscheme = {{ type = \"uniform\", bin = 3 }}\n"));
        assert!(e.starts_with("rows.toml:5:1: found row b: unknown field `bin`"), "{e}");
        let e = said("[[row]]\nname = \"b\"\nfsp = 3\nscheme = { type = \"uniform\" }\n");
        assert!(e.contains("row b: unknown field `fsp`"), "{e}");
        let e = said("[[row]]\nname = \"b\"\nscheme = { type = \"uniform\", bins = 1 }\n");
        assert!(e.contains("row b: tokenizer setting bins: found 1, expected 2 to 21054"), "{e}");
        let e = said("[[row]]\nname = \"b\"\njoints = \"wing\"\nscheme = { type = \"uniform\" }\n");
        assert!(e.contains("row b: joints: ") && e.contains("wing"), "{e}");
        let e = said(&good.repeat(2));
        assert!(e.starts_with("rows.toml:4:1: found row a: the name of the row in line 1 again"), "{e}");
        assert!(
            said("[[row]]\nscheme = { type = \"uniform\" }\n").contains("row without a name: missing field `name`")
        );
        assert!(said(&good.replace("\"a\"", "\"../a\"")).contains("name is \"../a\""));
        assert!(said("[[rows]]\n").contains("unknown field `rows`"));
        assert!(said("row = []\n").contains("no rows"));
        assert!(said("[[row]\n").starts_with("rows.toml:1:"));
    }
}
