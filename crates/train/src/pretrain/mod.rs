//! Training from the first weights on: what is asked for becomes a run folder, or a run folder is found and gone on with.

pub mod from;
mod saved;
#[cfg(test)]
mod tests;
mod trainer;

use super::config::TrainFile;
use super::data::{CorpusPart, Data};
use super::folder::RunFolder;
use super::precision::Precision;
use super::progress::Progress;
use super::run::RunFile;
use super::stages::Stages;
use super::{lead_ins, room, updates};
use crate::{Error, Result};
use candle_core::Tensor;
use from::Source;
use kinelm_corpus::Opening;
use kinelm_model::Compute;
use kinelm_model::checkpoint::{Best, Checkpoints};
use kinelm_model::likelihood::Likelihood;
use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;
use trainer::Trainer;

/// What to train, on what, and where to.
#[derive(Debug, Clone, Default)]
pub struct PretrainOptions {
    /// The training file. A run that is resumed has its own; one given then must say the same.
    pub file: Option<TrainFile>,
    /// The corpora, over those in the file (or the run's).
    pub corpora: Vec<CorpusPart>,
    /// The run folder, over the one in the file.
    pub run: Option<PathBuf>,
    /// Steps in all, over the file's (or the run's).
    pub steps: Option<u64>,
    /// The seed, over the file's.
    pub seed: Option<u64>,
    /// Label fields that the model is conditioned on, over the file's.
    pub conditions: Option<Vec<String>>,
    /// A run, or a folder that was exported, whose weights a new run begins with.
    pub from: Option<PathBuf>,
    /// Go on with the run where its last whole checkpoint stands.
    pub resume: bool,
    /// In which numbers products are computed, over the file's (or the run's).
    pub precision: Option<Precision>,
    /// Where and how to compute. A run can go on elsewhere than where it was begun.
    pub compute: Compute,
    /// How the corpora are opened.
    pub opening: Opening,
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
    /// Whether it ended before its last step because its patience was out.
    pub early: bool,
    /// The last step's loss, nats a token; `None` if no step was left to do.
    pub loss: Option<f64>,
    /// The measurement at the end, if there are validation clips and it wasn't stopped.
    pub valid: Option<Likelihood>,
    /// The best measurement of the run.
    pub best: Option<Best>,
    /// Tokens trained on in all, padding left out.
    pub tokens: u64,
    /// Seconds of this call.
    pub seconds: f64,
}

/// Trains a model from scratch or from the weights of another run, or goes on with a run.
///
/// A checkpoint is written as often as the file says, where validation is best, at the last step, and when `stop`
/// becomes true. A resumed run has the same bits as one that was never stopped, on the same kind of CPU and in the same
/// form. It works on the rayon pool that it is called in; the number of threads changes nothing.
///
/// # Errors
/// Options that don't hold together; a run folder that exists (without `resume`), or that another process writes; a
/// corpus without training clips or another than the run's; a loss or gradient that is not finite (step and clips are
/// named); what the system refuses.
pub fn pretrain(options: &PretrainOptions, stop: &AtomicBool, progress: &mut dyn Progress) -> Result<Summary> {
    let of_file = |pick: fn(&TrainFile) -> &Option<PathBuf>| options.file.as_ref().and_then(|f| pick(f).clone());
    let run = options.run.clone().or_else(|| of_file(|f| &f.run));
    let run = run.ok_or_else(|| Error::call("no run folder; give one by --run or in the training file"))?;
    // a device that isn't there must not leave an empty run behind
    options.compute.device.open()?;
    let (folder, file, data) = match options.resume {
        true => {
            let folder = RunFolder::open(&run)?;
            let (file, data) = found(options, &folder)?;
            (folder, file, data)
        }
        false => {
            let (file, data, weights) = asked(options, progress)?;
            (begin(&run, &file, &data, weights)?, file, data)
        }
    };
    go_on(&folder, file, &data, options.compute, stop, progress)
}

/// Tensors by name.
type Weights = BTreeMap<String, Tensor>;

/// The configuration of a new run, and the weights it begins with if they aren't drawn.
fn asked(options: &PretrainOptions, progress: &mut dyn Progress) -> Result<(RunFile, Data, Option<Weights>)> {
    let file = options.file.as_ref();
    let file = file.ok_or_else(|| Error::call("no training file; give one by --config"))?;
    let corpora = if options.corpora.is_empty() { file.corpora()? } else { options.corpora.clone() };
    let source = options.from.as_deref().map(Source::load).transpose()?;
    source.iter().flat_map(Source::notes).for_each(|note| progress.note(note));
    let mut train = file.train.clone();
    train.conditions = options.conditions.clone().unwrap_or(train.conditions);
    let data = Data::open(&corpora, source.as_ref().map(|s| &s.tokenizer), &train.conditions, options.opening)
        .map_err(|e| if options.conditions.is_some() { e } else { file.named(e) })?;
    train.steps = options.steps.unwrap_or(train.steps);
    train.seed = options.seed.unwrap_or(train.seed);
    train.precision = options.precision.unwrap_or(train.precision);
    train.precision.choose(None, options.compute)?;
    let mut run =
        RunFile { augment: file.augment, ..RunFile::new(&file.model, &train, &data).map_err(|e| file.named(e))? };
    let weights = source.map(|source| source.weights(&mut run)).transpose()?;
    Ok((run, data, weights))
}

/// The configuration of a run folder that is there.
fn found(options: &PretrainOptions, run: &RunFolder) -> Result<(RunFile, Data)> {
    let mut file = RunFile::read(run.path())?;
    let corpora = match (&options.file, options.corpora.is_empty()) {
        (Some(given), true) => given.corpora()?,
        _ => options.corpora.clone(),
    };
    let data = file.data(run.path(), &corpora, options.opening)?;
    if file.found_at(&data)? {
        file.write(run.path())?;
    }
    if let Some(given) = &options.file {
        let mut train = given.train.clone();
        (train.steps, train.seed) = (file.train.steps, options.seed.unwrap_or(train.seed));
        train.precision = options.precision.map_or(train.precision, |_| file.train.precision);
        let (asked, own) = (given.model.resolved(&file.tokens), file.model.resolved(&file.tokens));
        if asked != own || train != file.train || given.augment != file.augment {
            let what = "was begun with another configuration; leave --config out to go on with the run's own";
            return Err(Error::call(format!("{} {what}", run.path().display())));
        }
    }
    if let Some(seed) = options.seed.filter(|s| *s != file.train.seed) {
        return Err(Error::call(format!("seed {seed}; the run was begun with {}", file.train.seed)));
    }
    if let Some(steps) = options.steps.filter(|s| *s != file.train.steps) {
        updates::check_steps(run.path(), steps)?;
        file.train.steps = steps;
        file.write(run.path())?;
    }
    if let Some(precision) = options.precision.filter(|p| *p != file.train.precision) {
        precision.choose(None, options.compute)?;
        file.train.precision = precision;
        file.write(run.path())?;
    }
    Ok((file, data))
}

/// Makes the folder of a new run. Without `weights` it begins with those that its seed draws; with them, with these: they
/// are its first checkpoint, so that the run doesn't need again what they were taken from.
///
/// # Errors
/// A folder that is there and not empty; a corpus without training clips; a model that this machine can't hold; weights
/// of another model; what the system refuses.
pub fn begin(
    run: &std::path::Path,
    file: &RunFile,
    data: &Data,
    weights: Option<BTreeMap<String, Tensor>>,
) -> Result<RunFolder> {
    // whatever is refused must not leave an empty run behind
    Stages::of_run(file, data)?;
    room::check(&file.model, &file.tokens, &file.train)?;
    let first = weights.map(|weights| saved::first(file, weights)).transpose()?;
    let folder = RunFolder::create(run)?;
    file.put_beside(run, data)?;
    if let Some(contents) = first {
        Checkpoints::of(run).write(saved::before(file), &contents)?;
    }
    // last: a folder with it is a run
    file.write(run)?;
    Ok(folder)
}

/// Trains the run in a folder that [`begin`] made, from where it stands to its last step.
///
/// # Errors
/// As [`pretrain`].
pub fn go_on(
    run: &RunFolder,
    file: RunFile,
    data: &Data,
    compute: Compute,
    stop: &AtomicBool,
    progress: &mut dyn Progress,
) -> Result<Summary> {
    lead_ins::write(run.path(), file.train.seed, data)?;
    Trainer::new(run, file, data, compute, progress)?.train(stop)
}
