//! The settings of a tokenizer in TOML, with single keys set on top.

use crate::{Error, Result};
use kinelm_motion::joints;
use kinelm_store::{input, presets};
use kinelm_tokenizer::TokenizerConfig;
use serde::Deserialize;
use std::path::{Path, PathBuf};
use toml::{Table, Value};

/// Settings of tokenizers.
pub const TOKENIZER: &kinelm_store::presets::Presets = &[
    ("uniform", include_str!("../configs/uniform.toml")),
    ("thesis", include_str!("../configs/thesis.toml")),
    ("quantile", include_str!("../configs/quantile.toml")),
    ("dct-pca", include_str!("../configs/dct-pca.toml")),
    ("lapped", include_str!("../configs/lapped.toml")),
];

/// The keys of a [`TokenizerConfig`], not yet read as one. `joints` may also be text, as `--joints` takes it: `"13"`,
/// `"24"`, or a list of groups, names and ids.
#[derive(Debug, Clone, Default)]
pub struct Settings {
    table: Table,
    /// Where they came from, for messages.
    path: Option<PathBuf>,
}

const HELP: &str = "configs/tokenizer/ has examples with every key";

impl Settings {
    /// The settings of a name that is built in ([`TOKENIZER`]), else those of a file.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Unsupported`] when it is neither, else those of [`Settings::load`].
    pub fn find(name_or_path: &Path) -> Result<Self> {
        match presets::find(TOKENIZER, name_or_path, "tokenizer settings")? {
            Some(text) => Settings::parse(text, name_or_path),
            None => Settings::load(name_or_path),
        }
    }

    /// Reads a file.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`]; [`kinelm_store::Error::File`] with line and column for text that is no TOML.
    pub fn load(path: &Path) -> Result<Self> {
        let text = input::text(path).map_err(Error::io(path))?;
        Settings::parse(&text, path)
    }

    /// Reads the text of a file; `path` is for messages.
    ///
    /// # Errors
    /// [`kinelm_store::Error::File`] with line and column for text that is no TOML; for a scheme that is no table.
    pub fn parse(text: &str, path: &Path) -> Result<Self> {
        let table = text.parse::<Table>().map_err(|e| {
            Error::in_text(path, text, e.span(), e.message(), "the settings of a tokenizer in TOML", HELP)
        })?;
        if let Some(scheme) = table.get("scheme").filter(|scheme| !scheme.is_table()) {
            return Err(Error::file(path, format!("scheme = {scheme}"), "a table [scheme] with a type", HELP));
        }
        Ok(Settings { table, path: Some(path.to_owned()) })
    }

    /// Sets a key of the tokenizer.
    ///
    /// # Panics
    /// For the key `scheme`, which has functions of its own.
    pub fn set(&mut self, key: &str, value: impl Into<Value>) {
        assert_ne!(key, "scheme", "set_scheme and set_in_scheme set it");
        self.table.insert(key.into(), value.into());
    }

    /// Sets the type of the scheme; keys of another type are dropped.
    pub fn set_scheme(&mut self, kind: &str) {
        let scheme = self.scheme();
        if scheme.get("type").and_then(Value::as_str) != Some(kind) {
            *scheme = Table::new();
            scheme.insert("type".into(), kind.into());
        }
    }

    /// Sets a key of the scheme.
    pub fn set_in_scheme(&mut self, key: &str, value: impl Into<Value>) {
        self.scheme().insert(key.into(), value.into());
    }

    /// Sets a key of the scheme written as `key=value`; dots go into tables, and a value that is no TOML is text.
    ///
    /// # Errors
    /// No `=`, an empty key, and a key below one that is no table.
    pub fn set_pair(&mut self, pair: &str) -> Result<()> {
        Ok(presets::set_key(self.scheme(), pair, "tile=60 or joint_transform.type=pca")?)
    }

    /// The scheme's keys; uniform bins if nothing is said.
    fn scheme(&mut self) -> &mut Table {
        let entry = self.table.entry("scheme").or_insert_with(|| Value::Table(Table::new()));
        let scheme = entry.as_table_mut().expect("`parse` refuses a scheme that is no table");
        scheme.entry("type").or_insert_with(|| "uniform".into());
        scheme
    }

    /// The settings without their file's name: what is wrong is not its fault.
    pub fn of_no_file(self) -> Self {
        Settings { path: None, ..self }
    }

    /// The settings as a whole.
    ///
    /// # Errors
    /// A key that is unknown or of a wrong type, a value outside its limits, joints that nobody knows: a fault of the
    /// file, or of the call where there was no file.
    pub fn config(mut self) -> Result<TokenizerConfig> {
        let path = self.path.take();
        let wrong = |wrong: Wrong| match &path {
            Some(path) => {
                let expected = wrong.expected.unwrap_or_else(|| "the settings of a tokenizer".into());
                Error::file(path, wrong.found, expected, HELP)
            }
            None => Error::unsupported_parameter("settings", format!("{}; {HELP}", wrong.text)),
        };
        // a scheme without a type gets the default one
        if self.table.contains_key("scheme") {
            self.scheme();
        }
        checked(self.table).map_err(wrong)
    }
}

/// What is wrong with settings.
struct Wrong {
    found: String,
    /// What a key's value may be, if that is it.
    expected: Option<String>,
    /// All of it in a sentence.
    text: String,
}

impl From<String> for Wrong {
    fn from(text: String) -> Wrong {
        Wrong { found: text.clone(), expected: None, text }
    }
}

/// The settings of a table's keys, `joints` perhaps as text; what is wrong otherwise.
pub fn read(table: Table) -> std::result::Result<TokenizerConfig, String> {
    checked(table).map_err(|wrong| wrong.text)
}

fn checked(mut table: Table) -> std::result::Result<TokenizerConfig, Wrong> {
    if let Some(Value::String(list)) = table.get("joints") {
        let selection = joints::parse(list).map_err(|e| format!("joints: {e}"))?;
        let ids: Vec<Value> = selection.joints.iter().map(|&j| Value::from(j as i64)).collect();
        table.insert("joints".into(), ids.into());
    }
    let config = TokenizerConfig::deserialize(table).map_err(|e| e.message().to_string())?;
    config.validate().map_err(|e| {
        let text = e.to_string();
        match e {
            kinelm_tokenizer::Error::Setting { field, found, expected } => {
                Wrong { found: format!("{field} = {found}"), expected: Some(expected), text }
            }
            _ => text.into(),
        }
    })?;
    Ok(config)
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_tokenizer::SchemeConfig;

    fn of(text: &str) -> Result<TokenizerConfig> {
        Settings::parse(text, Path::new("t.toml"))?.config()
    }

    #[test]
    fn a_file_and_flags_on_top() {
        let config = of("joints = \"root, left_knee\"\nfps = 30.0\n[scheme]\nbins = 60\n").unwrap();
        assert_eq!(config, TokenizerConfig::uniform(&[0, 4], 30.0, 60));
        assert_eq!(of("").unwrap(), TokenizerConfig::default());
        let mut settings = Settings::parse("[scheme]\nbins = 60", Path::new("t.toml")).unwrap();
        settings.set("fps", 25.0);
        settings.set_in_scheme("bins", 90);
        settings.set_scheme("uniform");
        let config = settings.config().unwrap();
        assert_eq!(config.fps, 25.0);
        assert!(matches!(config.scheme, SchemeConfig::Uniform(u) if u.bins == 90));
    }

    #[test]
    fn what_is_wrong_is_named() {
        let error = |text: &str| of(text).unwrap_err().to_string();
        assert!(error("fps = 30\nfps = 20").starts_with("t.toml:2:1"), "{}", error("fps = 30\nfps = 20"));
        assert!(error("fpss = 30").contains("fpss"));
        assert!(error("[scheme]\nbinz = 60").contains("binz"));
        assert!(error("[scheme]\ntype = \"magic\"").contains("magic"));
        assert!(error("[scheme]\nbins = 1").contains("2 to 21054"));
        assert!(error("joints = \"tail\"").contains("tail"));
        assert!(error("scheme = \"lapped\"").contains("expected a table [scheme]"));
        let mut pairs = Settings::default();
        pairs.set_pair("bins=72").unwrap();
        pairs.set_pair("form=edge").unwrap();
        assert!(
            pairs.set_pair("bins.more=1").is_err() && pairs.set_pair("bins").is_err() && pairs.set_pair("=1").is_err()
        );
        assert!(matches!(pairs.config().unwrap().scheme, SchemeConfig::Uniform(u) if u.bins == 72));
        let mut flags = Settings::default();
        flags.set_in_scheme("tile", 60);
        assert!(flags.config().unwrap_err().to_string().contains("tile"));
    }

    #[test]
    fn the_kept_files_are_good() {
        let dir = Path::new(env!("CARGO_MANIFEST_DIR")).join("configs");
        let mut files = 0;
        for entry in std::fs::read_dir(&dir).unwrap() {
            Settings::load(&entry.unwrap().path()).unwrap().config().unwrap();
            files += 1;
        }
        assert!(files >= 5);
    }
}
