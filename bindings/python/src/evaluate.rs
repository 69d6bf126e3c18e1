//! The referee of dances.

use crate::corpus::Corpus;
use crate::error::library;
use crate::json::python;
use crate::options::{Paths, Reading};
use crate::pool::detach;
use kinelm::evaluate::dance::{Dance, Reference};
use kinelm::generate::provenance;
use kinelm::motion::format::RestFrame;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// Measures dances, motion files of any rig, against the real ones of a corpus: what `kinelm evaluate dance --json` prints.
#[pyfunction]
#[pyo3(signature = (dances, real, *, copying=false, **reading))]
pub fn evaluate<'py>(
    py: Python<'py>,
    dances: Paths,
    real: &Corpus,
    copying: bool,
    reading: Option<&Bound<'py, PyDict>>,
) -> PyResult<Bound<'py, PyAny>> {
    let read = Reading::of(reading, RestFrame::Drop)?;
    let files: Vec<PathBuf> = dances.into();
    let measure = || {
        let reference = Reference::load(&real.0)?;
        let load = |path: &PathBuf| Dance::load(&real.0, path, provenance::find(path)?.as_ref(), &read);
        let dances = files.iter().map(load).collect::<kinelm::Result<Vec<_>>>()?;
        let mut report = reference.report(&dances)?;
        if copying {
            report.copied = Some(reference.copied(&dances, &[])?);
        }
        Ok::<_, kinelm::Error>(report)
    };
    python(py, &detach(py, || measure().map_err(library))?)
}
