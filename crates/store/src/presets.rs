//! Built-in settings, by the names of their files.
//!
//! A built-in name takes precedence; `./NAME` is a file of that name.

use crate::suggest::did_you_mean;
use crate::{Error, Result, Subject, input};
use serde::de::DeserializeOwned;
use std::path::Path;

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
    (folder, what): (&str, &str),
) -> Result<T> {
    let text = match find(presets, name_or_path, "settings")? {
        Some(text) => text.to_owned(),
        None => input::text(name_or_path).map_err(Error::io(name_or_path))?,
    };
    toml::from_str(&text).map_err(|e| {
        let help = format!("configs/{folder}/ has examples with every key");
        Error::in_text((name_or_path, &text), e.span(), e.message(), what, &help)
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
