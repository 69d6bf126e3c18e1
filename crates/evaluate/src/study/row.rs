//! The rows of a study: names and settings of tokenizers.

use crate::{Error, Result};
use kinelm_corpus::settings;
use kinelm_tokenizer::{SchemeConfig, TokenizerConfig};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;
use std::path::Path;
use toml::Spanned;

/// The default rows of a study of this many joints, and their file: `study.toml`, or with fewer than 24
/// `study-13.toml`, where components are fewer in proportion.
pub fn default_rows(joints: usize) -> (&'static str, &'static str) {
    match joints {
        24 => (include_str!("../../configs/study.toml"), "configs/tokenizer/study.toml"),
        _ => (include_str!("../../configs/study-13.toml"), "configs/tokenizer/study-13.toml"),
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

/// The rows of a TOML text: `[[row]]` tables with a `name`, perhaps a `group`, and the settings of a tokenizer, `scheme`
/// among them. `path` is for messages.
///
/// # Errors
/// [`kinelm_store::Error::File`] with line, row and key for what is no such table, unknown keys, values outside their limits, a name
/// that is repeated, and a file without rows.
pub fn parse(text: &str, path: &Path, defaults: &RowDefaults) -> Result<Vec<Row>> {
    let wrong = |span, found: &str, expected| Error::in_text(path, text, span, found, expected, HELP);
    let file: File = toml::from_str(text).map_err(|e| wrong(e.span(), e.message(), "a file of rows"))?;
    let mut rows: Vec<Row> = Vec::with_capacity(file.row.len());
    let mut lines: HashMap<String, usize> = HashMap::new();
    for table in file.row {
        let span = table.span();
        let name = table.get_ref().get("name").and_then(toml::Value::as_str).unwrap_or("without a name").to_string();
        let found = |what: String| wrong(Some(span.clone()), &format!("row {name}: {what}"), "a row");
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

fn one(mut table: toml::Table, defaults: &RowDefaults) -> std::result::Result<Row, String> {
    // removed: what remains are settings of a tokenizer, which refuses keys that it doesn't know
    let mut text = |key: &str| match table.remove(key) {
        Some(toml::Value::String(text)) => Ok(Some(text)),
        Some(other) => Err(format!("{key} is {other}; expected text")),
        None => Ok(None),
    };
    let name = text("name")?.ok_or("missing field `name`")?;
    let group = text("group")?;
    let usable = |c: char| c.is_ascii_alphanumeric() || "-_.+".contains(c);
    if name.is_empty() || name.starts_with('.') || !name.chars().all(usable) {
        return Err(format!("name is {name:?}; expected letters, digits, -, _, . and +, no . first"));
    }
    if !table.contains_key("scheme") {
        return Err("missing field `scheme`".into());
    }
    let ids = defaults.joints.iter().map(|&j| toml::Value::from(j as i64));
    table.entry("joints").or_insert_with(|| ids.collect::<Vec<_>>().into());
    table.entry("fps").or_insert(defaults.fps.into());
    let config = settings::read(table).map_err(|e| e.trim().replace('\n', " "))?;
    let group = group.unwrap_or_else(|| scheme_name(&config.scheme));
    Ok(Row { name, group, config })
}

/// The `type` that a scheme has in files.
pub fn scheme_name(scheme: &SchemeConfig) -> String {
    let value = serde_json::to_value(scheme).unwrap_or_default();
    value["type"].as_str().unwrap_or("scheme").to_string()
}

fn line_of(text: &str, at: usize) -> usize {
    text.bytes().take(at).filter(|&b| b == b'\n').count() + 1
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::joints::THIRTEEN;

    fn defaults() -> RowDefaults {
        RowDefaults { joints: THIRTEEN.to_vec(), fps: 60.0 }
    }

    fn refusal(text: &str) -> String {
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
        let e = refusal(&format!("{good}\n[[row]]\nname = \"b\"\nscheme = {{ type = \"uniform\", bin = 3 }}\n"));
        assert!(e.starts_with("rows.toml:5:1: found row b: unknown field `bin`"), "{e}");
        let e = refusal("[[row]]\nname = \"b\"\nfsp = 3\nscheme = { type = \"uniform\" }\n");
        assert!(e.contains("row b: unknown field `fsp`"), "{e}");
        let e = refusal("[[row]]\nname = \"b\"\nscheme = { type = \"uniform\", bins = 1 }\n");
        assert!(e.contains("row b: tokenizer setting bins: found 1, expected 2 to 21054"), "{e}");
        let e = refusal("[[row]]\nname = \"b\"\njoints = \"wing\"\nscheme = { type = \"uniform\" }\n");
        assert!(e.contains("row b: joints: ") && e.contains("wing"), "{e}");
        let e = refusal(&good.repeat(2));
        assert!(e.starts_with("rows.toml:4:1: found row a: the name of the row in line 1 again"), "{e}");
        assert!(
            refusal("[[row]]\nscheme = { type = \"uniform\" }\n").contains("row without a name: missing field `name`")
        );
        assert!(refusal(&good.replace("\"a\"", "\"../a\"")).contains("name is \"../a\""));
        assert!(refusal("[[row]]\nname = \"b\"\n").contains("row b: missing field `scheme`"));
        assert!(refusal("[[row]]\nname = \"b\"\nscheme = { bins = 3 }\n").contains("row b: missing field `type`"));
        assert!(refusal("[[rows]]\n").contains("unknown field `rows`"));
        assert!(refusal("row = []\n").contains("no rows"));
        assert!(refusal("[[row]\n").starts_with("rows.toml:1:"));
    }
}
