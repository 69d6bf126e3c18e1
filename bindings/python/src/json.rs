//! Records of the library as dictionaries.

use pyo3::prelude::*;
use serde::Serialize;

/// The keys that the program prints with `--json`.
pub fn python<'py>(py: Python<'py>, record: &impl Serialize) -> PyResult<Bound<'py, PyAny>> {
    let text = serde_json::to_string(record).map_err(|e| crate::error::wrong(e.to_string()))?;
    py.import("json")?.call_method1("loads", (text,))
}
