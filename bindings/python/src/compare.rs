//! Two dancers compared.

use crate::clip::Clip;
use crate::error::library;
use crate::json::python;
use crate::pool::detach;
use kinelm::spectral::compare as two;
use pyo3::prelude::*;

/// Compares a student's clip with a teacher's: what `kinelm compare --json` prints of them. `band` is in seconds.
#[pyfunction]
#[pyo3(signature = (teacher, student, *, joints="24", band=1.0))]
pub fn compare<'py>(
    py: Python<'py>,
    teacher: &Clip,
    student: &Clip,
    joints: &str,
    band: f64,
) -> PyResult<Bound<'py, PyAny>> {
    let options = two::CompareOptions { joints: joints.into(), band_s: band };
    let compared = detach(py, || two::compare(&teacher.0, &student.0, &options).map_err(library))?;
    python(py, &compared.report)
}
