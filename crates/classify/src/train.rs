//! Training of a classifier from a pre-trained run, or from nothing.

use super::batches::Batches;
use super::fields::{self, Field, Fields, LabelFilter};
use super::folder::{Manifest, SCHEMA, extended};
use super::fusion::Discriminants;
use super::learner::{Learner, first_heads, heads};
use super::scores::{ClassScores, Source, read_windows};
use super::unfinished::{Call, Saved, Unfinished};
use crate::{Error, Result};
use kinelm_corpus::{ClipRecord, Corpus, Split};
use kinelm_model::checkpoint::State;
use kinelm_model::class_windows::Layout;
use kinelm_model::fast::{Fast, Losses};
use kinelm_model::{Dropout, LoadedRun, layout};
use kinelm_store::{FileRecord, random};
use kinelm_tokenizer::Tokenizer;
use kinelm_train::optimizer::{Tensors, floats};
use kinelm_train::resize::{Inputs, resize};
use kinelm_train::schedule::rate;
use kinelm_train::trainer::{Cadence, Files};
use kinelm_train::{Schedule, Task, TrainConfig, Trainer};
use rand_chacha::rand_core::RngCore;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// What to learn, from what.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrainOptions {
    /// The label fields to classify by.
    pub fields: Vec<String>,
    /// Labels that clips must have.
    pub only: Vec<LabelFilter>,
    /// The run's shape with random weights instead of its own.
    pub scratch: bool,
    /// The share of the training clips that are used, above 0 up to 1: of each class at least one clip.
    pub share: f64,
    /// Class tokens attend to those before them.
    pub compat: bool,
    /// Classes are weighted by their shares of the windows, instead of equally.
    pub unbalanced: bool,
    /// Updates.
    pub steps: u64,
    /// Windows of a step.
    pub batch: usize,
    /// The learning rate of the pretrained weights.
    pub rate: f64,
    /// That of the heads and the class tokens, which are new.
    pub head_rate: f64,
    /// Updates between measurements on the validation clips.
    pub eval_every: u64,
    /// Largest number of validation windows of a measurement, evenly spread; 0: all.
    pub eval_windows: usize,
    /// Measurements without improvement after which training ends; 0: never.
    pub patience: u64,
    /// The seed of all random numbers.
    pub seed: u64,
}

impl Default for TrainOptions {
    /// The thesis's where it states them (docs/classification.md).
    fn default() -> Self {
        TrainOptions {
            fields: Vec::new(),
            only: Vec::new(),
            scratch: false,
            share: 1.0,
            compat: false,
            unbalanced: false,
            steps: 1000,
            batch: 16,
            rate: 2e-5,
            head_rate: 1e-3,
            eval_every: 100,
            eval_windows: 512,
            patience: 0,
            seed: 1,
        }
    }
}

impl TrainOptions {
    /// 5 % of warm-up, then a cosine.
    fn schedule(&self) -> TrainConfig {
        TrainConfig {
            batch: self.batch,
            steps: self.steps,
            learning_rate: self.rate,
            schedule: Schedule::Cosine,
            warmup: (self.steps / 20).max(1),
            seed: self.seed,
            ..TrainConfig::default()
        }
    }
}

/// Metrics of a measurement, as `metrics.jsonl` has them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct EvalMetrics {
    /// Updates done.
    pub step: u64,
    /// Mean -ln p of the motion's tokens over the updates since the last measurement.
    pub token_nats: f64,
    /// Mean weighted -ln p of the classes, summed over the fields.
    pub class_nats: f64,
    /// The same on the validation windows, unweighted.
    pub valid_nats: Option<f64>,
    /// Share of the validation windows that are classified right, averaged over the fields.
    pub valid_accuracy: Option<f64>,
}

/// How training ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// The fields and their classes.
    pub fields: Fields,
    /// Training clips.
    pub clips: usize,
    /// Windows of those.
    pub windows: usize,
    /// Updates done.
    pub step: u64,
    /// The step of the weights that are stored.
    pub best: u64,
    /// Their -ln p on the validation windows.
    pub valid_nats: Option<f64>,
    /// Whether it was stopped.
    pub stopped: bool,
}

/// The state of a training after an update.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct TrainState {
    /// Updates done.
    pub step: u64,
    /// Lines of `metrics.jsonl`.
    pub lines: usize,
    /// Whether the measurement after the last update was interrupted: it comes before the next.
    pub due: bool,
    /// The best measurement's step and -ln p.
    best: u64,
    valid_nats: Option<f64>,
    /// Measurements since.
    worse: u64,
    averages: Averages,
}

/// Trains a classifier and writes it to the new folder `out`. Of the weights at all measurements those with the lowest -ln p
/// on the validation clips are stored; without validation clips the last. It works on the rayon pool that it is called in,
/// whose number of threads changes nothing.
///
/// Until training is done, `out` with `.training` appended holds its state: with `resume` a training that was stopped or
/// killed continues from there to the same bytes.
///
/// # Errors
/// A folder that exists; nothing, or another training, to resume; fields, classes or clips that don't exist; a corpus of
/// another tokenizer; a loss that is not finite; what the system refuses.
pub fn train(
    run: &LoadedRun,
    corpus: &Corpus,
    options: &TrainOptions,
    (out, resume): (&Path, bool),
    stop: &AtomicBool,
    progress: &mut dyn FnMut(&EvalMetrics),
) -> Result<Summary> {
    check(options)?;
    let tokenizer = run_tokenizer(run, corpus)?;
    let clips = fields::clips(corpus, &options.only)?;
    let fields = Fields::of(corpus, &clips, &options.fields)?;
    let layout = Layout::new(&run.config, &run.tokens, fields.len())?;
    let training = training_clips(&clips, &fields, options.share, options.seed);
    let fields = fields.counted(&training);
    let valid: Vec<&ClipRecord> = clips.iter().copied().filter(|c| c.split == Split::Valid).collect();
    let discriminants = Discriminants::fit(corpus, &fields, &training, &valid)?;
    let batches = Batches::new(corpus, training, &fields, &layout, options);
    let (training_clips, windows) = (batches.clips(), batches.windows());
    let call = Call {
        weights: run.weights_sha256(),
        corpus: corpus.hash().into(),
        tokenizer: tokenizer.hash(),
        options: options.clone(),
    };
    let (folder, saved) = Unfinished::open(out, &tokenizer, &call, resume)?;
    let checkpoints = folder.checkpoints();
    let (learner, state) = match saved {
        Some(saved) => resumed(run, &fields, saved)?,
        None => (new_learner(run, &fields, options)?, TrainState::default()),
    };
    let manifest = Manifest { corpus: absolute(corpus.dir())?, ..manifest(run, &tokenizer, &fields, options) };
    let (step, due, every) = (state.step, state.due, options.eval_every.max(1));
    let cadence = Cadence { steps: options.steps, eval_every: every, checkpoint_every: every, keep: 1 };
    let train = options.schedule();
    let (pad, dropout) = (run.tokens.pad, run.config.dropout);
    let (layout, fields) = (&layout, &fields);
    let task = Training {
        corpus,
        options,
        layout,
        fields,
        valid,
        discriminants,
        stop,
        progress,
        learner,
        batches,
        folder,
        manifest,
        state,
        train,
        pad,
        dropout,
    };
    let before = State::new(step, 0, 0, options.seed, None);
    let mut trainer = Trainer::new(task, cadence, Some(checkpoints), before).measuring(due);
    let mut is_stopped = false;
    while !is_stopped && let Some(step) = trainer.next() {
        step?;
        is_stopped = stop.load(Ordering::Relaxed);
    }
    let stopped = !trainer.is_done();
    match stopped {
        true => trainer.finish()?,
        false => trainer.task.folder.finish()?,
    }
    let TrainState { step, best, valid_nats, .. } = trainer.task.state;
    Ok(Summary { fields: fields.clone(), clips: training_clips, windows, step, best, valid_nats, stopped })
}

/// A classifier as the training loop trains it.
struct Training<'a> {
    corpus: &'a Corpus,
    options: &'a TrainOptions,
    layout: &'a Layout,
    fields: &'a Fields,
    /// The validation clips.
    valid: Vec<&'a ClipRecord>,
    discriminants: Discriminants,
    stop: &'a AtomicBool,
    progress: &'a mut dyn FnMut(&EvalMetrics),
    learner: Learner,
    batches: Batches<'a>,
    folder: Unfinished,
    manifest: Manifest,
    state: TrainState,
    train: TrainConfig,
    pad: u32,
    dropout: f64,
}

impl Task for Training<'_> {
    type Step = ();

    fn update(&mut self, state: &mut State) -> Result<()> {
        let (step, rate) = (state.step, rate(&self.train, state.step));
        let numbers = self.batches.batch(step)?;
        let dropout = Dropout { share: self.dropout, seed: self.options.seed, step, first: 0 };
        let dropout = (self.dropout > 0.0).then_some(&dropout);
        let rates = [rate, rate / self.options.rate * self.options.head_rate];
        let counted = numbers.targets.iter().filter(|&&t| t != self.pad).count();
        let found = self.learner.step(numbers.as_batch(self.layout), dropout, &self.train, rates)?;
        self.state.averages.add(found, counted);
        state.step = step + 1;
        self.state.step = state.step;
        Ok(())
    }

    fn measure(&mut self, _: &mut State) -> Result<Option<bool>> {
        let source =
            Source { most: self.options.eval_windows, stop: Some(self.stop), ..Source::of(self.corpus, &self.valid) };
        let compat = self.options.compat;
        let Learner { model, heads, .. } = &mut self.learner;
        let scores = match read_windows(model, heads, self.layout, compat, &source) {
            Err(Error::Store(kinelm_store::Error::Stopped(_))) => return Ok(None),
            scores => scores?,
        };
        let metrics = self.state.measured(measure(&scores, &self.valid, self.fields));
        self.folder.log(&metrics)?;
        (self.progress)(&metrics);
        let best = self.state.best == metrics.step;
        if best {
            let manifest = Manifest { step: metrics.step, valid_nats: metrics.valid_nats, ..self.manifest.clone() };
            let mut tensors = self.learner.tensors()?;
            tensors.extend(self.discriminants.tensors(&scores, &self.valid, self.fields)?);
            self.folder.save_best(manifest, &tensors)?;
        }
        Ok(Some(best))
    }

    fn is_over(&self, _: &State) -> bool {
        self.options.patience > 0 && self.state.worse >= self.options.patience
    }

    fn files(&mut self, due: bool) -> Result<Files> {
        self.state.due = due;
        Unfinished::files(&self.state, &self.learner.tensors()?, &self.learner.moments()?)
    }
}

/// What learns, before the first update.
fn new_learner(run: &LoadedRun, fields: &Fields, options: &TrainOptions) -> Result<Learner> {
    let (config, tokens) = extended(&run.config, &run.tokens, fields);
    let model = Fast::from_tensors(&config, &tokens, first_weights(run, fields, options)?)?;
    let heads = first_heads(fields, run.config.width, options.seed);
    Ok(Learner::new(model, fields, heads, run.tokens.vocabulary as u32))
}

/// What learns, and its state, from a checkpoint.
fn resumed(run: &LoadedRun, fields: &Fields, saved: Saved) -> Result<(Learner, TrainState)> {
    let Saved { state, mut tensors, moments } = saved;
    let parameters = heads(fields, run.config.width);
    let heads = floats("checkpoint", &parameters, &tensors, |p| p.name.clone())?;
    tensors.retain(|name, _| parameters.iter().all(|p| p.name != *name));
    let (config, tokens) = extended(&run.config, &run.tokens, fields);
    let model = Fast::from_tensors(&config, &tokens, tensors)?;
    let mut learner = Learner::new(model, fields, heads, run.tokens.vocabulary as u32);
    learner.restore(&moments, state.step)?;
    Ok((learner, state))
}

/// `classifier.json` before the first update.
fn manifest(run: &LoadedRun, tokenizer: &Tokenizer, fields: &Fields, options: &TrainOptions) -> Manifest {
    Manifest {
        schema: SCHEMA,
        kinelm: env!("CARGO_PKG_VERSION").into(),
        model: run.config.clone(),
        tokens: run.tokens.clone(),
        fields: fields.clone(),
        compat: options.compat,
        only: options.only.clone(),
        corpus: PathBuf::new(),
        from: (!options.scratch).then(|| run.checkpoint.clone()),
        share: options.share,
        seed: options.seed,
        step: 0,
        valid_nats: None,
        tokenizer: tokenizer.base_hash(),
        weights: (String::new(), FileRecord::of(&[])),
    }
}

fn absolute(dir: &Path) -> Result<PathBuf> {
    std::path::absolute(dir).map_err(Error::io(dir))
}

/// Sums of the losses since the last measurement.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
struct Averages {
    updates: u32,
    tokens: f64,
    classes: f64,
}

impl Averages {
    /// Adds an update's losses, the motion's over `counted` tokens.
    fn add(&mut self, found: Losses, counted: usize) {
        self.updates += 1;
        self.tokens += found.tokens / counted.max(1) as f64;
        self.classes += found.classes;
    }
}

impl TrainState {
    /// The metrics of a measurement. It is the best if it is better than those before; without validation clips every one
    /// is.
    fn measured(&mut self, measured: Option<(f64, f64)>) -> EvalMetrics {
        let Averages { updates, tokens, classes } = std::mem::take(&mut self.averages);
        let updates = f64::from(updates.max(1));
        let (valid_nats, valid_accuracy) = measured.unzip();
        self.lines += 1;
        let better = match (valid_nats, self.valid_nats) {
            (Some(now), Some(before)) => now < before,
            _ => true,
        };
        match better {
            true => (self.best, self.valid_nats, self.worse) = (self.step, valid_nats, 0),
            false => self.worse += 1,
        }
        let (token_nats, class_nats) = (tokens / updates, classes / updates);
        EvalMetrics { step: self.step, token_nats, class_nats, valid_nats, valid_accuracy }
    }
}

/// The most windows of an update.
const MOST_BATCH: usize = 1 << 16;

fn check(options: &TrainOptions) -> Result<()> {
    let TrainOptions { share, steps, batch, rate, head_rate, .. } = *options;
    let positive = |x: f64| x > 0.0 && x.is_finite();
    match () {
        () if !(share > 0.0 && share <= 1.0) => Err(Error::invalid("`share`", share, "above 0, at most 1")),
        () if steps == 0 => Err(Error::invalid("`steps`", steps, "1 or more")),
        () if !(1..=MOST_BATCH).contains(&batch) => {
            Err(Error::invalid("`batch`", batch, format!("1 to {MOST_BATCH} windows")))
        }
        () if !positive(rate) => Err(Error::invalid("`rate`", rate, "a number above 0")),
        () if !positive(head_rate) => Err(Error::invalid("`head_rate`", head_rate, "a number above 0")),
        () => Ok(()),
    }
}

/// The run's tokenizer, which must be the corpus's except for labels.
pub(super) fn run_tokenizer(run: &LoadedRun, corpus: &Corpus) -> Result<Tokenizer> {
    let tokenizer = run.load_tokenizer()?;
    same_tokenizer(&tokenizer.base_hash(), corpus)?;
    Ok(tokenizer)
}

/// Refuses a corpus of another tokenizer.
pub(super) fn same_tokenizer(expected: &str, corpus: &Corpus) -> Result<()> {
    let found = corpus.tokenizer().base_hash();
    if found == expected {
        return Ok(());
    }
    let help = "make the corpus with the model's tokenizer.json: kinelm tokenize DATA --tokenizer FILE";
    let (found, expected) = (format!("a corpus of tokenizer {found}"), format!("that of the model, {expected}"));
    Err(Error::file(corpus.dir(), found, expected, help))
}

/// The run's weights, or random ones, with rows for the class tokens.
fn first_weights(run: &LoadedRun, fields: &Fields, options: &TrainOptions) -> Result<Tensors> {
    let (config, tokens) = extended(&run.config, &run.tokens, fields);
    if options.scratch {
        return layout::initial(&config, &tokens, options.seed);
    }
    let inputs = |tokens| Inputs { tokens, conditions: &run.conditions };
    resize(&run.weights, &config, inputs(&run.tokens), inputs(&tokens), options.seed)
}

/// The clips that a classifier is trained on.
pub(super) fn training_clips<'a>(
    clips: &[&'a ClipRecord],
    fields: &Fields,
    share: f64,
    seed: u64,
) -> Vec<&'a ClipRecord> {
    let has_class = |c: &&&ClipRecord| c.split == Split::Train && fields.0.iter().any(|f| f.class_of(c).is_some());
    let train: Vec<&ClipRecord> = clips.iter().filter(has_class).copied().collect();
    if share < 1.0 { labelled(&train, &fields.0[0], share, seed) } else { train }
}

/// Of each class of the first field, the first clips by a hash of their take: a larger share contains a smaller one.
fn labelled<'a>(clips: &[&'a ClipRecord], field: &Field, share: f64, seed: u64) -> Vec<&'a ClipRecord> {
    let mut kept = Vec::new();
    for class in 0..field.classes.len() {
        let mut of_class: Vec<(u64, &ClipRecord)> = clips
            .iter()
            .filter(|c| field.class_of(c) == Some(class))
            .map(|c| (random::stream(seed, "labelled", 0, c.key as u64).next_u64(), *c))
            .collect();
        of_class.sort_by_key(|(hash, c)| (*hash, c.key));
        let keep = ((of_class.len() as f64 * share).round() as usize).max(1);
        kept.extend(of_class.into_iter().take(keep).map(|(_, c)| c));
    }
    kept.sort_by_key(|c| c.key);
    kept
}

/// Mean -ln p of the classes of the validation windows, summed over the fields, and the mean accuracy.
fn measure(scores: &[ClassScores], valid: &[&ClipRecord], fields: &Fields) -> Option<(f64, f64)> {
    let (mut nats, mut right, mut some) = (0.0, 0.0, 0);
    for (table, field) in fields.0.iter().enumerate() {
        let labelled: Vec<(usize, &ClassScores)> =
            scores.iter().filter_map(|n| Some((field.class_of(valid[n.clip])?, n))).collect();
        if labelled.is_empty() {
            continue;
        }
        let count = labelled.len() as f64;
        nats -= labelled.iter().map(|(class, n)| n.log_p[table][*class]).sum::<f64>() / count;
        right += labelled.iter().filter(|(class, n)| n.likeliest(table) == *class).count() as f64 / count;
        some += 1;
    }
    (some > 0).then(|| (nats, right / f64::from(some)))
}
