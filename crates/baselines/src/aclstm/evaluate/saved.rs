//! Reports that were saved.

use crate::{Error, Result};
use kinelm_store::input;
use serde::de::DeserializeOwned;
use std::path::Path;

/// What such a file is expected to be.
const REPORT: &str = "a JSON report of kinelm aclstm evaluate";

/// The requested fields of a JSON report of `kinelm aclstm evaluate`.
///
/// # Errors
/// [`kinelm_store::Error::Io`]; [`kinelm_store::Error::File`] for what is no such report.
pub fn saved<T: DeserializeOwned>(path: &Path) -> Result<T> {
    let text = input::text(path).map_err(Error::io(path))?;
    serde_json::from_str(&text).map_err(|e| no_report(path, e.to_string()))
}

/// The error of a file that is no such report.
pub fn no_report(path: &Path, found: impl Into<String>) -> Error {
    Error::file(path, found, REPORT, "measure the network again")
}
