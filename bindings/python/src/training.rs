//! Training.

use crate::error::{library, wrong};
use crate::interrupt::Interrupt;
use crate::json::python;
use crate::model::Model;
use crate::options::{Paths, parsed};
use crate::pool::detach;
use kinelm::model::CheckpointChoice;
use kinelm::model::scored_windows::Likelihood;
use kinelm::train::metrics::StepMetrics;
use kinelm::train::{self, CorpusPart, Precision, PretrainOptions, Progress, Summary, TrainFile};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use serde::Deserialize;
use serde_json::json;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Duration;

/// Reports a training to a callback, which may stop it.
struct Watch<'a> {
    callback: Option<&'a Py<PyAny>>,
    stop: &'a AtomicBool,
    interrupt: Interrupt,
}

impl Watch<'_> {
    fn tell(&mut self, said: impl for<'py> FnOnce(Python<'py>) -> PyResult<Bound<'py, PyAny>>) {
        self.interrupt.tell(self.callback, self.stop, said);
    }
}

impl Progress for Watch<'_> {
    fn step(&mut self, metrics: &StepMetrics, steps: u64, left: Duration) {
        self.tell(|py| {
            let said = python(py, metrics)?;
            said.set_item("steps", steps)?;
            said.set_item("seconds_left", left.as_secs_f64())?;
            Ok(said)
        });
    }

    fn valid(&mut self, step: u64, found: &Likelihood, best: bool) {
        let said = json!({ "step": step, "valid_bits_per_frame": found.bits_per_frame, "best": best });
        self.tell(|py| python(py, &said));
    }

    fn note(&mut self, text: &str) {
        self.tell(|py| python(py, &json!({ "note": text })));
    }
}

/// Runs a training under a callback.
fn watched(
    py: Python<'_>,
    callback: Option<Py<PyAny>>,
    train: impl FnOnce(&AtomicBool, &mut dyn Progress) -> kinelm::Result<Summary> + Send,
) -> PyResult<Model> {
    detach(py, || {
        let stop = AtomicBool::new(false);
        let mut watch = Watch { callback: callback.as_ref(), stop: &stop, interrupt: Interrupt::default() };
        let summary = train(&stop, &mut watch);
        Ok(Model::of(watch.interrupt.result(summary)?.run))
    })
}

/// Options of a training.
#[derive(Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct TrainingOptions {
    steps: Option<u64>,
    seed: Option<u64>,
    conditions: Option<Vec<String>>,
    precision: Option<String>,
}

/// The library's options.
fn options(
    corpus: Paths,
    run: PathBuf,
    config: &Path,
    kwargs: Option<&Bound<'_, PyDict>>,
) -> PyResult<PretrainOptions> {
    let TrainingOptions { steps, seed, conditions, precision } = parsed(kwargs)?;
    let precision = precision.map(|name| name.parse::<Precision>().map_err(|e| wrong(e.to_string())));
    let corpora: Vec<PathBuf> = corpus.into();
    Ok(PretrainOptions {
        file: Some(TrainFile::find(config).map_err(library)?),
        corpora: corpora.into_iter().map(CorpusPart::once).collect(),
        run: Some(run),
        steps,
        seed,
        conditions,
        precision: precision.transpose()?,
        ..PretrainOptions::default()
    })
}

/// Trains a model on corpora into a run folder: `config` is a name (two-level, tiny, ..) or a TOML file; `steps`, `seed`,
/// `conditions` and `precision` overrule it. `callback` gets a dictionary at every step and validation, and may return False
/// to stop; `resume` goes on.
#[pyfunction]
#[pyo3(signature = (corpus, run, *, config=PathBuf::from("two-level"), callback=None, **options))]
pub fn pretrain(
    py: Python<'_>,
    corpus: Paths,
    run: PathBuf,
    config: PathBuf,
    callback: Option<Py<PyAny>>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<Model> {
    let options = self::options(corpus, run, &config, options)?;
    watched(py, callback, |stop, progress| train::pretrain(&options, stop, progress))
}

/// As `pretrain`, from the weights of a model or run folder; its corpora have the model's tokenizer.
#[pyfunction]
#[pyo3(signature = (source, corpus, run, *, config=PathBuf::from("tune"), callback=None, **options))]
pub fn finetune(
    py: Python<'_>,
    source: &Bound<'_, PyAny>,
    corpus: Paths,
    run: PathBuf,
    config: PathBuf,
    callback: Option<Py<PyAny>>,
    options: Option<&Bound<'_, PyDict>>,
) -> PyResult<Model> {
    let (from, checkpoint) = match source.cast::<Model>() {
        Ok(model) => (model.get().run(), model.get().checkpoint()),
        Err(_) => (source.extract()?, CheckpointChoice::Auto),
    };
    let options = PretrainOptions { from: Some(from), checkpoint, ..self::options(corpus, run, &config, options)? };
    watched(py, callback, |stop, progress| train::finetune(&options, stop, progress))
}

/// Goes on with a training that was stopped.
#[pyfunction]
#[pyo3(signature = (run, *, steps=None, callback=None))]
pub fn resume(py: Python<'_>, run: PathBuf, steps: Option<u64>, callback: Option<Py<PyAny>>) -> PyResult<Model> {
    let options = PretrainOptions { run: Some(run), steps, resume: true, ..PretrainOptions::default() };
    watched(py, callback, |stop, progress| train::pretrain(&options, stop, progress))
}
