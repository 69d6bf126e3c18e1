//! Search.

use crate::error::library;
use crate::interrupt::Interrupt;
use crate::json::python;
use crate::options::{Paths, Reading, named, size};
use crate::pool::detach;
use kinelm::classify::embedding::MODELS;
use kinelm::corpus::{BuildOptions, Dataset};
use kinelm::motion::format::RestFrame;
use kinelm::spectral::query::{Distance, Exclude, IndexRequest, Query};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// Windows that a search returns.
const MOST_FOUND: usize = 1 << 20;

/// An index of windows of clips, by their spectra.
#[pyclass(frozen, module = "kinelm")]
pub struct Index(kinelm::spectral::query::Index);

#[pymethods]
impl Index {
    /// Opens an index folder.
    #[staticmethod]
    fn open(py: Python<'_>, path: PathBuf) -> PyResult<Index> {
        detach(py, || kinelm::spectral::query::Index::open(&path).map(Index).map_err(library))
    }

    /// Indexes files and folders at `out`, or adds them to the index there: windows of `window` frames at `fps`, `hop` frames
    /// apart, by the DCT of their joints.
    #[staticmethod]
    #[pyo3(signature = (data, out, *, labels=None, window=None, hop=None, fps=None, **reading))]
    #[allow(clippy::too_many_arguments)]
    fn build(
        py: Python<'_>,
        data: Paths,
        out: PathBuf,
        labels: Option<Vec<String>>,
        window: Option<usize>,
        hop: Option<usize>,
        fps: Option<f64>,
        reading: Option<&Bound<'_, PyDict>>,
    ) -> PyResult<Index> {
        let read = Reading::of(reading, RestFrame::Drop)?;
        let options = BuildOptions { read, ..BuildOptions::default() };
        let request = IndexRequest { frames: window, hop, fps, models: MODELS, ..IndexRequest::default() };
        let data: Vec<PathBuf> = data.into();
        detach(py, || {
            let dataset = Dataset::find(&data, &labels.unwrap_or_default()).map_err(library)?;
            let mut interrupt = Interrupt::default();
            let built =
                kinelm::spectral::query::Index::build(&dataset, &request, &options, &out, &mut |_| interrupt.check());
            interrupt.result(built)?;
            kinelm::spectral::query::Index::open(&out).map(Index).map_err(library)
        })
    }

    /// The `k` windows that move most like the clip does `at` seconds from its beginning (or in its middle), nearest first, as
    /// dictionaries. `exclude` is none, self, overlap, clip, take or choreography; `distance` cosine or euclid.
    #[pyo3(signature = (clip, *, at=None, k=10, distance="cosine", exclude="take", one_per_clip=false, **reading))]
    #[allow(clippy::too_many_arguments)]
    fn find<'py>(
        &self,
        py: Python<'py>,
        clip: PathBuf,
        at: Option<f64>,
        k: usize,
        distance: &str,
        exclude: &str,
        one_per_clip: bool,
        reading: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let k = size("k", k, 0..=MOST_FOUND)?;
        let distance: Distance = named(distance, "distance", &["cosine", "euclid"])?;
        let exclusions = ["none", "self", "overlap", "clip", "take", "choreography"];
        let exclude: Exclude = named(exclude, "exclude", &exclusions)?;
        // without reading options, a clip of the index is read as it was for the index
        let as_indexed = reading.is_none_or(|reading| reading.is_empty());
        let read = Reading::of(reading, RestFrame::Drop)?;
        let query =
            Query { clip, read, as_indexed, at_s: at, k, lowest: 0, distance, exclude, one_per_clip, models: MODELS };
        let found = detach(py, || self.0.find(&query).map_err(library))?;
        python(py, &found.matches)
    }

    fn __len__(&self) -> usize {
        self.0.database().windows()
    }

    fn __repr__(&self) -> String {
        let database = self.0.database();
        format!("<kinelm.Index: {} windows of {} clips>", database.windows(), database.clips().len())
    }
}
