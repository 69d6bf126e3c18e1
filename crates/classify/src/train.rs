//! Training of a classifier from a pre-trained run, or from nothing.

use super::batches::Batches;
use super::class_scores::ClassScores;
use super::fields::{self, Field, Fields};
use super::folder::{Manifest, SCHEMA, extended, same_tokenizer};
use super::fusion::Discriminants;
use super::learner::{Learner, first_heads, heads};
use super::options::{TrainOptions, check};
use super::scores::{Source, read_windows};
use super::state::{EvalMetrics, TrainState};
use super::unfinished::{Call, Saved, Unfinished};
use crate::{Error, Result};
use kinelm_corpus::{ClipRecord, Corpus, Split};
use kinelm_model::checkpoint::{Keep, State};
use kinelm_model::class_windows::Layout;
use kinelm_model::fast::Fast;
use kinelm_model::weights::{Weights, floats};
use kinelm_model::{Dropout, LoadedRun, weights};
use kinelm_store::{FileRecord, random};
use kinelm_tokenizer::Tokenizer;
use kinelm_train::resize::{Inputs, resize};
use kinelm_train::schedule::rate;
use kinelm_train::trainer::{Cadence, Files};
use kinelm_train::{Task, TrainConfig, Trainer};
use rand_chacha::rand_core::RngCore;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

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
    out: &Path,
    resume: bool,
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
    // the first thing on disk: what is refused above leaves no folder
    let (folder, saved) = Unfinished::open(out, &tokenizer, &call, resume)?;
    let checkpoints = folder.checkpoints();
    let (learner, state) = match saved {
        Some(saved) => resumed(run, &fields, saved)?,
        None => (new_learner(run, &fields, options)?, TrainState::default()),
    };
    let manifest = Manifest { corpus: absolute(corpus.dir())?, ..manifest(run, &tokenizer, &fields, options) };
    let (step, due, every) = (state.step, state.due, options.eval_every.max(1));
    let cadence = Cadence { steps: options.steps, eval_every: every, checkpoint_every: every, keep: Keep::Last(1) };
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
        // heads follow the same schedule from their own rate
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
            // a stop in between: the measurement is due when training is resumed
            Err(Error::Store(kinelm_store::Error::Stopped(_))) => return Ok(None),
            scores => scores?,
        };
        let metrics = self.state.measured(measure(&scores, &self.valid, self.fields));
        self.folder.log(&metrics)?;
        (self.progress)(&metrics);
        let best = self.state.best == metrics.step;
        if best {
            let manifest = Manifest { step: metrics.step, valid_nats: metrics.valid_nats, ..self.manifest.clone() };
            let mut weights = self.learner.weights();
            weights.extend(self.discriminants.arrays(&scores, &self.valid, self.fields));
            self.folder.save_best(manifest, &weights)?;
        }
        Ok(Some(best))
    }

    fn is_over(&self, _: &State) -> bool {
        self.options.patience > 0 && self.state.worse >= self.options.patience
    }

    fn files(&mut self, due: bool) -> Result<Files> {
        self.state.due = due;
        Unfinished::files(&self.state, &self.learner.weights(), &self.learner.moments())
    }
}

/// What learns, before the first update.
fn new_learner(run: &LoadedRun, fields: &Fields, options: &TrainOptions) -> Result<Learner> {
    let (config, tokens) = extended(&run.config, &run.tokens, fields);
    let model = Fast::from_weights(&config, &tokens, &first_weights(run, fields, options)?)?;
    let heads = first_heads(fields, run.config.width, options.seed);
    Ok(Learner::new(model, fields, heads, run.tokens.vocabulary as u32))
}

/// What learns, and its state, from a checkpoint.
fn resumed(run: &LoadedRun, fields: &Fields, saved: Saved) -> Result<(Learner, TrainState)> {
    let Saved { state, mut weights, moments } = saved;
    let parameters = heads(fields, run.config.width);
    let heads = floats("checkpoint", &parameters, &weights, |p| p.name.clone())?;
    weights.retain(|name, _| parameters.iter().all(|p| p.name != *name));
    let (config, tokens) = extended(&run.config, &run.tokens, fields);
    let model = Fast::from_weights(&config, &tokens, &weights)?;
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

/// The run's tokenizer, which must be the corpus's except for labels.
pub(super) fn run_tokenizer(run: &LoadedRun, corpus: &Corpus) -> Result<Tokenizer> {
    let tokenizer = run.load_tokenizer()?;
    same_tokenizer(&tokenizer.base_hash(), corpus)?;
    Ok(tokenizer)
}

/// The run's weights, or random ones, with rows for the class tokens.
fn first_weights(run: &LoadedRun, fields: &Fields, options: &TrainOptions) -> Result<Weights> {
    let (config, tokens) = extended(&run.config, &run.tokens, fields);
    if options.scratch {
        return Ok(weights::initial(&config, &tokens, options.seed));
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

/// Of each class of the first field, the first clips by a random number of their own: a larger share contains a smaller
/// one.
fn labelled<'a>(clips: &[&'a ClipRecord], field: &Field, share: f64, seed: u64) -> Vec<&'a ClipRecord> {
    let mut chosen = Vec::new();
    for class in 0..field.classes.len() {
        let mut of_class: Vec<(u64, &ClipRecord)> = clips
            .iter()
            .filter(|c| field.class_of(c) == Some(class))
            .map(|c| (random::stream(seed, "labelled", 0, c.key as u64).next_u64(), *c))
            .collect();
        of_class.sort_by_key(|(hash, c)| (*hash, c.key));
        let count = ((of_class.len() as f64 * share).round() as usize).max(1);
        chosen.extend(of_class.into_iter().take(count).map(|(_, c)| c));
    }
    chosen.sort_by_key(|c| c.key);
    chosen
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
