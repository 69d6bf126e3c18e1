//! Training.

use crate::interrupt::Interrupt;
use crate::json::python;
use crate::model::Model;
use crate::options::Paths;
use kinelm::model::likelihood::Likelihood;
use kinelm::train::metrics::StepMetrics;
use kinelm::train::{
    CorpusPart, Precision, PretrainOptions, Progress, Summary, TrainFile, finetune as finetune_run,
    pretrain as pretrain_run,
};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

/// Tells a callback of a training, and stops it.
struct Watch<'a> {
    callback: Option<&'a Py<PyAny>>,
    stop: &'a AtomicBool,
    interrupt: Interrupt,
}

impl Watch<'_> {
    /// Calls back with a dictionary of `what`.
    fn tell(&mut self, what: impl FnOnce(Python<'_>) -> PyResult<Py<PyDict>>) {
        let (callback, stop) = (self.callback, self.stop);
        let goes_on = self.interrupt.during(|py| {
            py.check_signals()?;
            if let Some(callback) = callback {
                let said = callback.call1(py, (what(py)?,))?;
                stop.fetch_or(said.extract::<bool>(py).is_ok_and(|more| !more), Ordering::SeqCst);
            }
            Ok(())
        });
        stop.fetch_or(goes_on.is_break(), Ordering::SeqCst);
    }
}

impl Progress for Watch<'_> {
    fn step(&mut self, metrics: &StepMetrics, steps: u64, left: Duration) {
        self.tell(|py| {
            let said = python(py, metrics)?.cast_into::<PyDict>()?;
            said.set_item("steps", steps)?;
            said.set_item("seconds_left", left.as_secs_f64())?;
            Ok(said.unbind())
        });
    }

    fn valid(&mut self, step: u64, found: &Likelihood, best: bool) {
        self.tell(|py| {
            let said = PyDict::new(py);
            said.set_item("step", step)?;
            said.set_item("valid_bits_per_frame", found.bits_per_frame)?;
            said.set_item("best", best)?;
            Ok(said.unbind())
        });
    }

    fn note(&mut self, text: &str) {
        self.tell(|py| {
            let said = PyDict::new(py);
            said.set_item("note", text)?;
            Ok(said.unbind())
        });
    }
}

/// Runs a training under a callback.
fn watched(
    py: Python<'_>,
    callback: Option<Py<PyAny>>,
    train: impl FnOnce(&AtomicBool, &mut dyn Progress) -> kinelm::Result<Summary> + Send,
) -> PyResult<Model> {
    py.detach(|| {
        let stop = AtomicBool::new(false);
        let mut watch = Watch { callback: callback.as_ref(), stop: &stop, interrupt: Interrupt::default() };
        let summary = train(&stop, &mut watch);
        Ok(Model::of(watch.interrupt.result(summary)?.run))
    })
}

/// What a training is asked for.
fn options(
    (corpus, run, config): (Paths, PathBuf, PathBuf),
    (steps, seed): (Option<u64>, Option<u64>),
    conditions: Option<Vec<String>>,
    precision: Option<&str>,
) -> PyResult<PretrainOptions> {
    let precision = precision.map(|name| name.parse::<Precision>().map_err(|e| crate::error::wrong(e.to_string())));
    let corpora: Vec<PathBuf> = corpus.into();
    Ok(PretrainOptions {
        file: Some(TrainFile::find(&config).map_err(crate::error::library)?),
        corpora: corpora.into_iter().map(CorpusPart::once).collect(),
        run: Some(run),
        steps,
        seed,
        conditions,
        precision: precision.transpose()?,
        ..PretrainOptions::default()
    })
}

/// Trains a model on corpora into a run folder: `config` is a name (two-level, tiny, ..) or a TOML file. `callback` gets a
/// dictionary at every step and validation, and may return False to stop; `resume` goes on.
#[pyfunction]
#[pyo3(signature = (corpus, run, *, config=PathBuf::from("two-level"), steps=None, seed=None, conditions=None, precision=None, callback=None))]
#[allow(clippy::too_many_arguments)]
pub fn pretrain(
    py: Python<'_>,
    corpus: Paths,
    run: PathBuf,
    config: PathBuf,
    steps: Option<u64>,
    seed: Option<u64>,
    conditions: Option<Vec<String>>,
    precision: Option<&str>,
    callback: Option<Py<PyAny>>,
) -> PyResult<Model> {
    let options = options((corpus, run, config), (steps, seed), conditions, precision)?;
    watched(py, callback, |stop, progress| pretrain_run(&options, stop, progress))
}

/// As `pretrain`, from the weights of a model or run folder; its corpora have the model's tokenizer.
#[pyfunction]
#[pyo3(signature = (source, corpus, run, *, config=PathBuf::from("tune"), steps=None, seed=None, conditions=None, precision=None, callback=None))]
#[allow(clippy::too_many_arguments)]
pub fn finetune(
    py: Python<'_>,
    source: &Bound<'_, PyAny>,
    corpus: Paths,
    run: PathBuf,
    config: PathBuf,
    steps: Option<u64>,
    seed: Option<u64>,
    conditions: Option<Vec<String>>,
    precision: Option<&str>,
    callback: Option<Py<PyAny>>,
) -> PyResult<Model> {
    let from = match source.cast::<Model>() {
        Ok(model) => model.get().run(),
        Err(_) => source.extract()?,
    };
    let options = options((corpus, run, config), (steps, seed), conditions, precision)?;
    let options = PretrainOptions { from: Some(from), ..options };
    watched(py, callback, |stop, progress| finetune_run(&options, stop, progress))
}

/// Goes on with a training that was stopped.
#[pyfunction]
#[pyo3(signature = (run, *, steps=None, callback=None))]
pub fn resume(py: Python<'_>, run: PathBuf, steps: Option<u64>, callback: Option<Py<PyAny>>) -> PyResult<Model> {
    let options = PretrainOptions { run: Some(run), steps, resume: true, ..PretrainOptions::default() };
    watched(py, callback, |stop, progress| pretrain_run(&options, stop, progress))
}
