//! Built-in settings, by the names of their files.
//!
//! A built-in name takes precedence; `./NAME` is a file of that name.

use crate::suggest::did_you_mean;
use crate::{Error, Result, Subject, input};
use serde::Serialize;
use serde::de::DeserializeOwned;
use std::path::Path;
use toml::{Table, Value};

/// Names and texts of settings.
pub type Presets = [(&'static str, &'static str)];

/// The names of settings, separated by commas.
pub fn listed(presets: &Presets) -> String {
    presets.iter().map(|(name, _)| *name).collect::<Vec<_>>().join(", ")
}

/// The built-in settings of a name, or those of a TOML file; `folder` of configs/ has examples of `what`.
///
/// # Errors
/// [`Error::Unsupported`] when it is neither; a file that can't be read; unknown keys.
pub fn read<T: DeserializeOwned>(
    presets: &'static Presets,
    name_or_path: &Path,
    folder: &str,
    what: &str,
) -> Result<T> {
    let text = match find(presets, name_or_path, "settings")? {
        Some(text) => text.to_owned(),
        None => input::text(name_or_path).map_err(Error::io(name_or_path))?,
    };
    toml::from_str(&text).map_err(|e| {
        let help = format!("configs/{folder}/ has examples with every key");
        Error::in_text(name_or_path, &text, e.span(), e.message(), what, &help)
    })
}

/// The text of a built-in name; `None` for an existing file.
///
/// # Errors
/// [`Error::Unsupported`] with the names when it is neither.
pub fn find(presets: &'static Presets, name_or_path: &Path, what: &str) -> Result<Option<&'static str>> {
    if let Some((_, text)) = presets.iter().find(|(name, _)| Path::new(name) == name_or_path) {
        return Ok(Some(text));
    }
    // a broken link too: reading it has the better message
    if std::fs::symlink_metadata(name_or_path).is_ok() {
        return Ok(None);
    }
    let name = name_or_path.display().to_string();
    let meant = did_you_mean(&name, presets.iter().map(|(name, _)| *name));
    Err(Error::unsupported(
        Subject::of_parameter("config").with(format!("{name:?}")),
        format!("no {what}: neither a file nor one of {}{meant}", listed(presets)),
    ))
}

/// Sets a key of a table, written as `KEY=VALUE`; dots go into tables, which are made, and a value that is no TOML is text.
///
/// # Errors
/// [`Error::Invalid`] for no `=`, an empty key, and a key below one that is no table; `example` says how it is written.
pub fn set_key(table: &mut Table, pair: &str, example: &str) -> Result<()> {
    let wrong = || Error::invalid_parameter("set", pair, format!("KEY=VALUE, such as {example}"));
    let (key, text) = pair.split_once('=').ok_or_else(wrong)?;
    // one key alone: a text with a line break could set others
    let value = format!("v = {text}").parse::<Table>().ok().filter(|table| table.len() == 1);
    let value = value.and_then(|mut table| table.remove("v")).unwrap_or_else(|| text.into());
    let mut steps: Vec<&str> = key.trim().split('.').collect();
    let last = steps.pop().filter(|key| !key.is_empty()).ok_or_else(wrong)?;
    let mut table = table;
    for step in steps {
        let below = table.entry(step).or_insert_with(|| Value::Table(Table::new()));
        table = below.as_table_mut().ok_or_else(wrong)?;
    }
    table.insert(last.into(), value);
    Ok(())
}

/// Settings with keys set over their own, each written as [`set_key`] takes it.
///
/// # Errors
/// Those of [`set_key`]; [`Error::Unsupported`] for an unknown key or a value of another type.
///
/// ```
/// # #[derive(serde::Serialize, serde::Deserialize)]
/// # #[serde(deny_unknown_fields)]
/// # struct Settings { steps: u64 }
/// use kinelm_store::presets::with_keys;
///
/// let settings = with_keys(&Settings { steps: 10 }, &["steps=20".into()], "steps=20")?;
/// assert_eq!(settings.steps, 20);
/// assert!(with_keys(&settings, &["stepz=30".into()], "steps=20").is_err());
/// # kinelm_store::Result::Ok(())
/// ```
pub fn with_keys<T: Serialize + DeserializeOwned>(settings: &T, set: &[String], example: &str) -> Result<T> {
    // names in backquotes would be taken for parameters
    let wrong =
        |what: &str| Error::unsupported(Subject::of_parameter("set").with(set.join(" ")), what.replace('`', ""));
    // through a table and back: keys are checked by the type itself, with its own messages
    let mut table = Table::try_from(settings).map_err(|e| wrong(&e.to_string()))?;
    set.iter().try_for_each(|pair| set_key(&mut table, pair, example))?;
    table.try_into().map_err(|e: toml::de::Error| wrong(e.message()))
}

/// Refuses to set any keys but `allowed`; `why` says why others stay.
///
/// # Errors
/// [`Error::Unsupported`] for the first other one.
pub fn check_keys(set: &[String], allowed: &[&str], why: &str) -> Result<()> {
    let key = |pair: &String| pair.split('=').next().unwrap_or_default().trim().to_owned();
    match set.iter().map(key).find(|key| !allowed.contains(&&**key)) {
        Some(key) => {
            let why = format!("{why}; what may change: {}", allowed.join(", "));
            Err(Error::unsupported(Subject::of_parameter("set").with(key), why))
        }
        None => Ok(()),
    }
}
