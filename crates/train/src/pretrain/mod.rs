//! Training of a GPT: a new run, from random weights or another model's, or a run that is resumed.

mod finetune;
mod resume;
mod saved;
mod task;
#[cfg(test)]
mod tests;

use super::branch::Branch;
use super::data::{CorpusPart, Data};
use super::folder::RunFolder;
use super::precision::Precision;
use super::progress::Progress;
use super::resize::{Inputs, resize};
use super::run::{RunFile, origin};
use super::stages::Stages;
use super::train_file::TrainFile;
use super::trainer::Trainer;
use super::{lead_ins, limits, memory};
use crate::{Error, Result};
use kinelm_corpus::CorpusOptions;
use kinelm_model::checkpoint::{Best, CheckpointChoice, Checkpoints};
use kinelm_model::forecast::Forecast;
use kinelm_model::scored_windows::Likelihood;
use kinelm_model::weights::{self, Weights};
use kinelm_model::{Compute, LoadedRun, ModelConfig, exchange};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Instant;

pub use finetune::finetune;
pub use resume::RESUMABLE;
pub use task::Pretraining;

/// The network to train, its data, and the folder to write to.
#[derive(Debug, Clone, Default)]
pub struct PretrainOptions {
    /// The training file. A resumed run has its own; a file given then must agree with it.
    pub file: Option<TrainFile>,
    /// Keys over those of the file, or of a resumed run ([`RESUMABLE`]), each as `train.batch=4`. The fields below win.
    pub set: Vec<String>,
    /// The corpora, in place of those in the file (or the run's).
    pub corpora: Vec<CorpusPart>,
    /// The run folder, in place of the file's.
    pub run: Option<PathBuf>,
    /// Steps in all, in place of the file's (or the run's).
    pub steps: Option<u64>,
    /// The seed, in place of the file's.
    pub seed: Option<u64>,
    /// Label fields that the model is conditioned on, in place of the file's. A fine-tuned model has its source's too.
    pub conditions: Option<Vec<String>>,
    /// The weights that a new run begins with: a run, or a folder that `kinelm export` or `transformers` wrote.
    pub from: Option<PathBuf>,
    /// Which checkpoint of that run.
    pub checkpoint: CheckpointChoice,
    /// Continues the run from its last whole checkpoint.
    pub resume: bool,
    /// Continues it from an earlier one instead, as a new run.
    pub branch: Option<Branch>,
    /// Numbers that products are computed in, in place of the file's (or the run's).
    pub precision: Option<Precision>,
    /// Where and how to compute. A run may be resumed elsewhere than where it began.
    pub compute: Compute,
    /// How the corpora are opened.
    pub opening: CorpusOptions,
}

/// How a run ended.
#[derive(Debug, Clone)]
pub struct Summary {
    /// The run folder.
    pub run: PathBuf,
    /// The last checkpoint's folder.
    pub checkpoint: PathBuf,
    /// Updates done in all.
    pub step: u64,
    /// Whether it was stopped before its last step.
    pub stopped: bool,
    /// Whether its patience ended it before its last step.
    pub early: bool,
    /// The last step's loss, nats a token; `None` without a step.
    pub loss: Option<f64>,
    /// The measurement at the end, if there are validation clips and the run wasn't stopped.
    pub valid: Option<Likelihood>,
    /// The best measurement of the run.
    pub best: Option<Best>,
    /// Tokens trained on in all, without padding.
    pub tokens: u64,
    /// Seconds of this call.
    pub seconds: f64,
}

/// Trains a model from random weights or those of another run, or resumes a run.
///
/// Checkpoints are written every `train.checkpoint_every` steps, where validation is best, at the last step, and when `stop`
/// becomes true. A resumed run has the bits of one that was never stopped, on the same kind of CPU and in the same form. It
/// works on the rayon pool that it is called in, whose number of threads changes nothing.
///
/// # Errors
/// Options that don't agree; a run folder that exists (without `resume`), or that another process writes; a corpus without
/// training clips or another than the run's; a loss or gradient that is not finite, with step and clips; what the system
/// refuses.
pub fn pretrain(options: &PretrainOptions, stop: &AtomicBool, progress: &mut dyn Progress) -> Result<Summary> {
    run_of(options, false, stop, progress)
}

/// A training of either kind.
pub(super) fn run_of(
    options: &PretrainOptions,
    is_finetuning: bool,
    stop: &AtomicBool,
    progress: &mut dyn Progress,
) -> Result<Summary> {
    let run = options.run.clone().or_else(|| options.file.as_ref()?.run.clone());
    let run = run.ok_or_else(|| Error::missing("run folder", "give `run`, or `run` in the training file"))?;
    // a missing device must not leave an empty run
    options.compute.device.open()?;
    let (folder, file, data) = if let Some(branch) = &options.branch {
        let (mut file, data, _) = resume::resumed(options, &run)?;
        let (folder, origin) = branch.begin(&run)?;
        file.from = Some(origin);
        file.put_beside(folder.path(), &data)?;
        // last: a folder with it is a run
        file.write(folder.path())?;
        (folder, file, data)
    } else if options.resume {
        let folder = RunFolder::open(&run)?;
        let (file, data, differs) = resume::resumed(options, &run)?;
        if differs {
            file.write(&run)?;
        }
        (folder, file, data)
    } else {
        let (file, data, weights) = new(options, is_finetuning, progress)?;
        (begin(&run, &file, &data, weights)?, file, data)
    };
    continue_run(&folder, file, &data, options.compute, stop, progress)
}

/// The configuration of a new run, its data, and its first weights unless they are random.
fn new(
    options: &PretrainOptions,
    is_finetuning: bool,
    progress: &mut dyn Progress,
) -> Result<(RunFile, Data, Option<Weights>)> {
    let file = options.file.as_ref();
    let file = file.ok_or_else(|| Error::missing("training file", "give `config`"))?;
    let file = &file.with_keys(&options.set)?;
    let corpora = if options.corpora.is_empty() { file.corpora()? } else { options.corpora.clone() };
    let source = options
        .from
        .as_deref()
        .map(|from| Ok::<_, Error>((from, exchange::load(from, options.checkpoint)?)))
        .transpose()?;
    source.iter().flat_map(|(_, source)| &source.notes).for_each(|note| progress.note(note));
    let mut train = file.train.clone();
    train.conditions = options.conditions.clone().unwrap_or(train.conditions);
    train.steps = options.steps.unwrap_or(train.steps);
    train.seed = options.seed.unwrap_or(train.seed);
    train.precision = options.precision.unwrap_or(train.precision);
    let model = match source.as_ref().filter(|_| is_finetuning) {
        Some((_, source)) => {
            train.conditions = finetune::conditions(source, &train.conditions);
            finetune::shape(file, source)?
        }
        None => file.model.clone(),
    };
    let (precision, note) = train.precision.decide(options.compute, model.width)?;
    train.precision = precision;
    note.iter().for_each(|note| progress.note(note));
    let tokenizer = source.as_ref().map(|(_, source)| source.load_tokenizer()).transpose()?;
    let data = Data::open(&corpora, tokenizer.as_ref(), &train.conditions, options.opening)
        .map_err(|e| if options.conditions.is_some() { e } else { file.located(e) })?;
    let run = RunFile::new(&model, &train, &data).map_err(|e| file.located(e))?;
    let mut run = RunFile { augment: file.augment, ..run };
    let Some((from, source)) = source else {
        // what is forecast belongs to the data, so such a run begins with a checkpoint of its own
        let weights = run.model.forecast().then(|| first_weights(&run, &data)).transpose()?;
        return Ok((run, data, weights));
    };
    if !is_finetuning {
        check_same_model(from, &run.model, &source)?;
    }
    run.from = Some(origin(from, &source)?);
    let old = Inputs { tokens: &source.tokens, conditions: &source.conditions };
    let inputs = Inputs { tokens: &run.tokens, conditions: &run.train.conditions };
    let weights = resize(&source.weights, &run.model, old, inputs, run.train.seed)?;
    if is_finetuning {
        progress.note(&finetune::new_inputs(&source.tokens, &run.tokens));
    }
    Ok((run, data, Some(weights)))
}

/// Random weights of a run's seed, with the forecast of its data.
///
/// # Errors
/// A corpus that can no longer be read.
pub fn first_weights(run: &RunFile, data: &Data) -> Result<Weights> {
    let mut weights = weights::initial(&run.model, &run.tokens, run.train.seed);
    if run.model.forecast() {
        let corpora: Vec<_> = data.parts().iter().map(|part| (&part.corpus, part.weight)).collect();
        weights.extend(weights::of_forecast(&Forecast::of_corpora(&corpora)?));
    }
    Ok(weights)
}

/// Refuses weights of another model than the run's. Only dropout may differ.
fn check_same_model(from: &Path, model: &ModelConfig, source: &LoadedRun) -> Result<()> {
    let (model, own) = (finetune::keys(model), finetune::keys(&source.config.resolved(&source.tokens)));
    let text = |value: Option<&toml::Value>| value.map_or("left out".into(), toml::Value::to_string);
    let keys: BTreeSet<&String> = model.keys().chain(own.keys()).collect();
    match keys.into_iter().find(|key| model.get(*key) != own.get(*key)) {
        Some(key) => {
            let help = "give the [model] of their run";
            let expected = format!("{}, as in the weights of {}; {help}", text(own.get(key)), from.display());
            Err(Error::invalid(format!("model.{key}"), text(model.get(key)), expected))
        }
        None => Ok(()),
    }
}

/// Makes the folder of a new run. Without `weights` it begins with random ones of its seed. With `weights`, these are its
/// first checkpoint, so that the run needs their source no more.
///
/// # Errors
/// A folder that exists and isn't empty; a corpus without training clips; a model that this machine can't hold; weights of
/// another model; what the system refuses.
pub fn begin(run: &Path, file: &RunFile, data: &Data, weights: Option<Weights>) -> Result<RunFolder> {
    // what is refused must not leave an empty run
    Stages::of_run(file, data)?;
    memory::check(&file.model, &file.tokens, &file.train)?;
    let first = weights.map(|weights| saved::first(file, weights)).transpose()?;
    let folder = RunFolder::create(run)?;
    file.put_beside(run, data)?;
    if let Some(files) = first {
        Checkpoints::of(run).write(saved::before(file), &files)?;
    }
    // last: a folder with it is a run
    file.write(run)?;
    Ok(folder)
}

/// Trains the run in a folder that [`begin`] made, from its last checkpoint to its last step.
///
/// # Errors
/// As [`pretrain`].
pub(crate) fn continue_run(
    run: &RunFolder,
    file: RunFile,
    data: &Data,
    compute: Compute,
    stop: &AtomicBool,
    progress: &mut dyn Progress,
) -> Result<Summary> {
    lead_ins::write(run.path(), file.train.seed, data)?;
    limits::write(run.path(), data)?;
    let started = Instant::now();
    let mut trainer = trainer(run, file, data, compute, progress)?;
    trainer.train(stop)?;
    Ok(trainer.task.summary(&trainer, started))
}

/// The training of a run, from its last checkpoint on.
///
/// # Errors
/// A corpus without training clips, no checkpoint that is whole though there are some, what the system refuses.
pub fn trainer<'a>(
    run: &RunFolder,
    file: RunFile,
    data: &'a Data,
    compute: Compute,
    progress: &'a mut dyn Progress,
) -> Result<Trainer<Pretraining<'a>>> {
    let cadence = file.train.cadence();
    let checkpoints = Checkpoints::of(run.path());
    let (task, state) = Pretraining::open(run, file, data, compute, &checkpoints, progress)?;
    Ok(Trainer::new(task, cadence, Some(checkpoints), state))
}
