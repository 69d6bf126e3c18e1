//! Classifiers.

use crate::corpus::Corpus;
use crate::error::library;
use crate::interrupt::Interrupt;
use crate::json::python;
use crate::options::{Reading, choice};
use crate::pool::detach;
use kinelm::classify::TrainOptions;
use kinelm::model::exchange;
use kinelm::motion::format::RestFrame;
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use std::sync::{Mutex, PoisonError};

/// Class tokens of a model: dancer, genre or whatever a corpus labels.
#[pyclass(frozen, module = "kinelm")]
// a mutex: reading changes the model's working memory
pub struct Classifier(Mutex<kinelm::classify::Classifier>);

#[pymethods]
impl Classifier {
    /// Opens a classifier's folder.
    #[staticmethod]
    fn open(py: Python<'_>, path: PathBuf) -> PyResult<Classifier> {
        let open = || kinelm::classify::Classifier::load(&path).map_err(library);
        detach(py, || open().map(|c| Classifier(Mutex::new(c))))
    }

    /// Trains class tokens for label fields on a run (`checkpoint` as in `Model.open`), together with its language model, into
    /// the folder `out`. `callback` gets a dictionary at every validation, and may return False to stop; the training is then
    /// taken up again with `resume`.
    #[staticmethod]
    #[pyo3(signature = (run, corpus, fields, out, *, steps=1000, batch=16, seed=1, resume=false, callback=None, checkpoint=None))]
    #[allow(clippy::too_many_arguments)]
    fn train(
        py: Python<'_>,
        run: PathBuf,
        corpus: &Corpus,
        fields: Vec<String>,
        out: PathBuf,
        steps: u64,
        batch: usize,
        seed: u64,
        resume: bool,
        callback: Option<Py<PyAny>>,
        checkpoint: Option<Bound<'_, PyAny>>,
    ) -> PyResult<Option<Classifier>> {
        let checkpoint = choice(checkpoint)?;
        // the program's own patience
        let options = TrainOptions { fields, steps, batch, seed, patience: 5, ..TrainOptions::default() };
        detach(py, || {
            let run = exchange::load(&run, checkpoint).map_err(library)?;
            let (stop, mut interrupt) = (AtomicBool::new(false), Interrupt::default());
            let done = kinelm::classify::train(&run, &corpus.0, &options, &out, resume, &stop, &mut |metrics| {
                interrupt.tell(callback.as_ref(), &stop, |py| python(py, metrics));
            });
            let done = interrupt.result(done)?;
            if done.stopped {
                return Ok(None);
            }
            let classifier = kinelm::classify::Classifier::load(&out).map_err(library)?;
            Ok(Some(Classifier(Mutex::new(classifier))))
        })
    }

    /// The classes of a motion file: a dictionary with, for each field, the likeliest class, all probabilities, and the class
    /// second by second.
    #[pyo3(signature = (path, **reading))]
    fn predict<'py>(
        &self,
        py: Python<'py>,
        path: PathBuf,
        reading: Option<&Bound<'py, PyDict>>,
    ) -> PyResult<Bound<'py, PyAny>> {
        let read = Reading::of(reading, RestFrame::Drop)?;
        let predict = || self.0.lock().unwrap_or_else(PoisonError::into_inner).predict(&path, &read);
        python(py, &detach(py, || predict().map_err(library))?.1)
    }
}
