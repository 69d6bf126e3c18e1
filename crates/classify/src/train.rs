//! Training of a classifier from a pre-trained run, or from nothing.

use super::batches::Batches;
use super::eval::{Named, Source, read_windows};
use super::fields::{self, Field, Fields, Only};
use super::folder::{About, SCHEMA, grown, heads};
use super::learner::{Learner, first_heads};
use super::work::{Asked, Saved, Work};
use crate::{Error, Result};
use candle_core::Tensor;
use kinelm_corpus::{ClipRecord, Corpus, Split};
use kinelm_model::class_windows::Layout;
use kinelm_model::fast::{Fast, Losses};
use kinelm_model::{Dropout, LoadedRun, layout};
use kinelm_store::{FileRecord, random};
use kinelm_tokenizer::Tokenizer;
use kinelm_train::grow::{Language, grow};
use kinelm_train::schedule::rate;
use kinelm_train::{Schedule, TrainConfig};
use rand_chacha::rand_core::RngCore;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};

/// What to learn, from what.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct TrainOptions {
    /// The label fields to tell.
    pub fields: Vec<String>,
    /// The clips that are looked at.
    pub only: Vec<Only>,
    /// The run's shape with weights that are drawn instead of its own.
    pub scratch: bool,
    /// The share of the training clips whose labels are seen, above 0 up to 1: of each class at least one clip. The others
    /// are left out.
    pub share: f64,
    /// Class tokens see those before them.
    pub compat: bool,
    /// A class counts by its share of the windows instead of all classes alike.
    pub unbalanced: bool,
    /// Updates.
    pub steps: u64,
    /// Windows of a step.
    pub batch: usize,
    /// The learning rate of what was trained before.
    pub rate: f64,
    /// That of the heads and the class tokens: they begin with nothing.
    pub head_rate: f64,
    /// Updates between measurements on the validation clips.
    pub eval_every: u64,
    /// Validation windows of a measurement at most, spread evenly; 0: all.
    pub eval_windows: usize,
    /// Measurements without a better one after which it ends; 0: never.
    pub patience: u64,
    /// Every random number comes from it.
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
    /// As the trainer's schedule has it: a twentieth of warm-up, then a cosine.
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

/// Figures of a measurement or a step, as `metrics.jsonl` has them.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Told {
    /// Updates done.
    pub step: u64,
    /// Mean -ln p of the motion's tokens over the updates since the line before.
    pub token_nats: f64,
    /// Mean weighted -ln p of the classes, summed over the fields.
    pub class_nats: f64,
    /// The same on the validation windows, unweighted.
    pub valid_nats: Option<f64>,
    /// Share of validation windows whose class is the likeliest, averaged over the fields.
    pub valid_accuracy: Option<f64>,
}

/// How it ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// What it tells.
    pub fields: Fields,
    /// Training clips, and windows of them.
    pub clips: usize,
    /// Windows of those.
    pub windows: usize,
    /// Updates done.
    pub step: u64,
    /// The step whose weights were kept.
    pub best: u64,
    /// Its validation figures.
    pub valid_nats: Option<f64>,
    /// Whether it was stopped.
    pub stopped: bool,
}

/// Where a training stands after an update.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
pub(super) struct Standing {
    /// Updates done.
    pub step: u64,
    /// Lines of `metrics.jsonl`.
    pub told: usize,
    /// Whether the measurement behind the last update was broken off: it comes before the next.
    due: bool,
    /// The best measurement's step and -ln p.
    best: u64,
    valid_nats: Option<f64>,
    /// Measurements since.
    worse: u64,
    averages: Averages,
}

/// Trains a classifier and writes it to the new folder `out`. It works on the rayon pool that it is called in; the number of
/// threads changes nothing. Where there are validation clips the weights with the lowest -ln p of their classes are kept,
/// else the last.
///
/// Until it is done, `out` with `.training` behind it holds all that is needed to go on: with `resume` a training that was
/// stopped or killed does, and has the bytes of one that was not.
///
/// # Errors
/// A folder that is there; nothing, or something else, to go on with; fields, classes or clips that aren't; a corpus of
/// another tokenizer; a loss that is not finite; what the system refuses.
pub fn train(
    run: &LoadedRun,
    corpus: &Corpus,
    options: &TrainOptions,
    (out, resume): (&Path, bool),
    stop: &AtomicBool,
    tell: &mut dyn FnMut(&Told),
) -> Result<Summary> {
    check(options)?;
    let tokenizer = run_tokenizer(run, corpus)?;
    let clips = fields::clips(corpus, &options.only)?;
    let fields = Fields::of(corpus, &clips, &options.fields)?;
    let layout = Layout::new(&run.config, &run.tokens, fields.len())?;
    let learned = learned_from(&clips, &fields, options.share, options.seed);
    let fields = fields.counted(&learned);
    let mut batches = Batches::new(corpus, learned, &fields, &layout, options);
    let valid: Vec<&ClipRecord> = clips.iter().copied().filter(|c| c.split == Split::Valid).collect();
    let asked = Asked {
        weights: run.weights_sha256(),
        corpus: corpus.hash().into(),
        tokenizer: tokenizer.hash(),
        options: options.clone(),
    };
    let (mut work, saved) = Work::open(out, &tokenizer, &asked, resume)?;
    let (mut learner, mut standing) = match saved {
        Some(saved) => go_on(run, &fields, saved, out)?,
        None => (begin(run, &fields, options)?, Standing::default()),
    };
    let about = About { corpus: absolute(corpus.dir())?, ..about(run, &tokenizer, &fields, options) };
    let train = options.schedule();
    let is_over = |s: &Standing| s.step >= options.steps || (options.patience > 0 && s.worse >= options.patience);
    let mut stopped = false;
    while (standing.due || !is_over(&standing)) && !stopped {
        if !standing.due {
            let (step, now) = (standing.step, rate(&train, standing.step));
            let numbers = batches.batch(step)?;
            let (share, seed) = (run.config.dropout, options.seed);
            let dropout = (share > 0.0).then_some(Dropout { share, seed, step, first: 0 });
            let rates = [now, now / options.rate * options.head_rate];
            let counted = numbers.targets.iter().filter(|&&t| t != run.tokens.pad).count();
            let found = learner.step(numbers.as_batch(&layout), dropout.as_ref(), &train, rates);
            standing.averages.add(found.map_err(|e| failed(e, step, out))?, counted);
            standing.step = step + 1;
            standing.due = standing.step == options.steps || standing.step.is_multiple_of(options.eval_every.max(1));
        }
        let was_due = standing.due;
        if standing.due {
            let source = Source { most: options.eval_windows, stop: Some(stop), ..Source::of(corpus, &valid) };
            match measure(&mut learner, &layout, options.compat, &source, &valid, &fields) {
                Err(Error::Store(kinelm_store::Error::Stopped(_))) => {}
                measured => {
                    let told = standing.measured(measured?);
                    work.tell(&told)?;
                    tell(&told);
                    if standing.best == told.step {
                        let about = About { step: told.step, valid_nats: told.valid_nats, ..about.clone() };
                        work.better(about, &learner.tensors(&fields)?)?;
                    }
                }
            }
        }
        stopped = stop.load(Ordering::Relaxed) && (standing.due || !is_over(&standing));
        if was_due || stopped {
            work.save(&standing, &learner.tensors(&fields)?, &learner.moments(&fields)?)?;
        }
    }
    if !stopped {
        work.finish()?;
    }
    let Standing { step, best, valid_nats, .. } = standing;
    let (clips, windows) = (batches.clips(), batches.windows());
    Ok(Summary { fields: fields.clone(), clips, windows, step, best, valid_nats, stopped })
}

/// What learns, before the first update.
fn begin(run: &LoadedRun, fields: &Fields, options: &TrainOptions) -> Result<Learner> {
    let (config, tokens) = grown(&run.config, &run.tokens, fields);
    let model = Fast::from_tensors(&config, &tokens, first_weights(run, fields, options)?)?;
    let heads = first_heads(fields, run.config.width, options.seed);
    Ok(Learner::new(model, heads, run.tokens.vocabulary as u32))
}

/// What learns, where it stood.
fn go_on(run: &LoadedRun, fields: &Fields, saved: Saved, out: &Path) -> Result<(Learner, Standing)> {
    let Saved { standing, mut tensors, moments } = saved;
    let heads = heads(out, fields, run.config.width, &mut tensors)?;
    let (config, tokens) = grown(&run.config, &run.tokens, fields);
    let model = Fast::from_tensors(&config, &tokens, tensors)?;
    let mut learner = Learner::new(model, heads, run.tokens.vocabulary as u32);
    learner.restore(fields, &moments, standing.step)?;
    Ok((learner, standing))
}

/// What the folder says of itself, before the first update.
fn about(run: &LoadedRun, tokenizer: &Tokenizer, fields: &Fields, options: &TrainOptions) -> About {
    About {
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

/// A step's error with what can be done about it.
fn failed(e: Error, step: u64, out: &Path) -> Error {
    if !matches!(e, Error::NotFinite(_)) {
        return e; // no rate is to blame
    }
    let help = "take lower rates by --rate and --head-rate";
    Error::file(out, format!("at step {}: {e}", step + 1), "a loss that is a number", help)
}

/// Losses since they were last told.
#[derive(Debug, Clone, PartialEq, Default, Serialize, Deserialize)]
struct Averages {
    updates: u32,
    tokens: f64,
    classes: f64,
}

impl Averages {
    /// An update's losses, the motion's over `counted` tokens.
    fn add(&mut self, found: Losses, counted: usize) {
        self.updates += 1;
        self.tokens += found.tokens / counted.max(1) as f64;
        self.classes += found.classes;
    }

    /// Their means, beside what was measured; they begin anew.
    fn told(&mut self, step: u64, measured: Option<(f64, f64)>) -> Told {
        let Averages { updates, tokens, classes } = std::mem::take(self);
        let many = f64::from(updates.max(1));
        let (valid_nats, valid_accuracy) = measured.unzip();
        Told { step, token_nats: tokens / many, class_nats: classes / many, valid_nats, valid_accuracy }
    }
}

impl Standing {
    /// A measurement's line. It stands for the best if it is better than those before; without validation clips every one is.
    fn measured(&mut self, measured: Option<(f64, f64)>) -> Told {
        let told = self.averages.told(self.step, measured);
        (self.due, self.told) = (false, self.told + 1);
        let better = match (told.valid_nats, self.valid_nats) {
            (Some(now), Some(before)) => now < before,
            _ => true,
        };
        match better {
            true => (self.best, self.valid_nats, self.worse) = (told.step, told.valid_nats, 0),
            false => self.worse += 1,
        }
        told
    }
}

fn check(options: &TrainOptions) -> Result<()> {
    let fault = match options {
        o if !(o.share > 0.0 && o.share <= 1.0) => format!("a share of {}; expected above 0, at most 1", o.share),
        o if o.steps == 0 || o.batch == 0 => "0 steps or windows; expected 1 or more".into(),
        o if [o.rate, o.head_rate].iter().any(|r| !(*r > 0.0 && r.is_finite())) => {
            format!("rates {} and {}; expected numbers above 0", o.rate, o.head_rate)
        }
        _ => return Ok(()),
    };
    Err(Error::call(fault))
}

/// The run's tokenizer, which must be the corpus's but for labels.
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

/// The run's weights, or drawn ones, with rows for what answers.
fn first_weights(run: &LoadedRun, fields: &Fields, options: &TrainOptions) -> Result<BTreeMap<String, Tensor>> {
    let (config, tokens) = grown(&run.config, &run.tokens, fields);
    if options.scratch {
        return layout::initial(&config, &tokens, options.seed);
    }
    let language = |tokens| Language { tokens, conditions: &run.conditions };
    grow(&run.weights, &config, language(&run.tokens), language(&tokens), options.seed)
}

/// The clips that a classifier learns from.
pub(super) fn learned_from<'a>(
    clips: &[&'a ClipRecord],
    fields: &Fields,
    share: f64,
    seed: u64,
) -> Vec<&'a ClipRecord> {
    let told = |c: &&&ClipRecord| c.split == Split::Train && fields.0.iter().any(|f| f.class_of(c).is_some());
    let train: Vec<&ClipRecord> = clips.iter().filter(told).copied().collect();
    if share < 1.0 { labelled(&train, &fields.0[0], share, seed) } else { train }
}

/// Of each class of the first field, the first clips by a hash of their take: a share that grows keeps its clips.
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

/// Mean -ln p of the classes of validation windows, summed over the fields, and the mean share that is right.
fn measure(
    learner: &mut Learner,
    layout: &Layout,
    compat: bool,
    source: &Source,
    valid: &[&ClipRecord],
    fields: &Fields,
) -> Result<Option<(f64, f64)>> {
    let named = read_windows(&mut learner.model, &learner.heads, layout, compat, source)?;
    let (mut nats, mut right, mut some) = (0.0, 0.0, 0);
    for (table, field) in fields.0.iter().enumerate() {
        let asked: Vec<(usize, &Named)> =
            named.iter().filter_map(|n| Some((field.class_of(valid[n.clip])?, n))).collect();
        if asked.is_empty() {
            continue;
        }
        let count = asked.len() as f64;
        nats -= asked.iter().map(|(class, n)| n.log_p[table][*class]).sum::<f64>() / count;
        right += asked.iter().filter(|(class, n)| n.likeliest(table) == *class).count() as f64 / count;
        some += 1;
    }
    Ok((some > 0).then(|| (nats, right / f64::from(some))))
}
