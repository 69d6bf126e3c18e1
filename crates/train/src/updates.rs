//! The training loop of small networks beside the GPT: updates whose batches are functions of their number, whole
//! checkpoints, and going on to the same bits.

use super::folder::RunFolder;
use super::learner::listed;
use super::metrics::Metrics;
use super::parameters::{List, Parameters, numbers};
use crate::{Error, Result};
use kinelm_engine::arena::Floats;
use kinelm_model::checkpoint::{CheckpointChoice, Checkpoints, State};
use kinelm_model::run::{CONFIG, OPTIMIZER, WEIGHTS};
use kinelm_model::weights;
use kinelm_store::{files, input, memory};
use serde::de::DeserializeOwned;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// A network with its data.
pub trait Learner {
    /// The loss of update `step`, counted from 0, and the names of the clips that it saw; gradients stay in
    /// [`Learner::parameters`].
    fn gradients(&mut self, step: u64) -> (f64, Vec<String>);
    /// What moves.
    fn parameters(&mut self) -> &mut Parameters;
}

/// How a training goes.
#[derive(Debug, Clone, Copy)]
pub struct Plan {
    /// What lines of `metrics.jsonl` are called.
    pub kind: &'static str,
    /// Updates in all.
    pub steps: u64,
    /// Adam's rate.
    pub rate: f64,
    /// The longest that gradients may be; `None`: as they are.
    pub clip: Option<f64>,
    /// Sequences of an update.
    pub batch: usize,
    /// The run's.
    pub seed: u64,
    /// Updates between checkpoints; 0: only at the end.
    pub checkpoint_every: u64,
    /// Checkpoints that stay.
    pub keep: usize,
}

/// Figures of an update.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Figures {
    /// Updates done with it.
    pub step: u64,
    /// The batch's loss, in the network's own measure.
    pub loss: f64,
    /// What it took.
    pub seconds: f64,
}

/// How a training ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// Its last checkpoint.
    pub checkpoint: PathBuf,
    /// Updates done in all.
    pub step: u64,
    /// Whether it was stopped before its last.
    pub stopped: bool,
    /// Mean loss of the last hundred updates of this call; `None` if there were none.
    pub loss: Option<f64>,
    /// Seconds of this call's updates.
    pub seconds: f64,
}

/// What is heard while it goes.
pub enum Event<'a> {
    /// Something the user should know.
    Note(&'a str),
    /// An update of so many.
    Step(Figures, u64),
}

/// Where a run stands: its weights, and the optimizer's state if it has any.
struct Start {
    weights: Vec<Floats>,
    moments: Option<std::collections::BTreeMap<String, candle_core::Tensor>>,
    state: State,
}

/// Trains from the last whole checkpoint of the folder, or from `initial`: to the same bits as if it had never stopped, on
/// the same kind of processor. `learner` gets the weights, in the order of `list`.
///
/// # Errors
/// A checkpoint that is damaged or of another network, a loss that is no number, what the system refuses.
pub fn train<L: Learner>(
    folder: &RunFolder,
    plan: &Plan,
    list: &List,
    (initial, learner): (impl FnOnce() -> Vec<Floats>, impl FnOnce(Vec<Floats>) -> L),
    stop: &AtomicBool,
    hear: &mut dyn FnMut(Event),
) -> Result<Summary> {
    // weights, gradients and two moments
    let numbers: u128 = list.iter().map(|(_, [rows, columns])| (rows * columns) as u128).sum();
    memory::check(16 * numbers, "training this network", "lower its width or its layers, or give the program more")?;
    let checkpoints = Checkpoints::of(folder.path());
    let start = match found(folder.path(), &checkpoints, list, hear)? {
        Some(start) => start,
        None => Start { weights: initial(), moments: None, state: State::new(0, 0, 0, plan.seed, None) },
    };
    checkpoints.sweep()?;
    let metrics = Metrics::open(folder.path(), start.state.step)?;
    let mut learner = learner(start.weights);
    if let Some(moments) = &start.moments {
        learner.parameters().restore(moments, start.state.step)?;
    }
    Trainer { plan, learner, checkpoints, metrics, state: start.state }.train(stop, hear)
}

fn found(run: &Path, checkpoints: &Checkpoints, list: &List, hear: &mut dyn FnMut(Event)) -> Result<Option<Start>> {
    if checkpoints.steps()?.is_empty() {
        if let Some(step) = checkpoints.named("latest") {
            let found = format!("no checkpoint, though `latest` names that of step {step}");
            let help = "put it back, or begin a new run";
            return Err(Error::file(run, found, "the checkpoints that it wrote", help));
        }
        return Ok(None);
    }
    let mut note = |text: String| hear(Event::Note(&text));
    let found = checkpoints.find(CheckpointChoice::Latest, &[WEIGHTS, OPTIMIZER], &[], &mut note)?;
    let tensors = |name: &str| weights::from_bytes(&found.dir.join(name), &found.files[name]);
    let weights = numbers(list, &tensors(WEIGHTS)?, "")?;
    let moments = Some(tensors(OPTIMIZER)?);
    note(format!("going on after step {}", found.state.step));
    let mut state = found.state;
    state.files.clear();
    Ok(Some(Start { weights, moments, state }))
}

struct Trainer<'a, L> {
    plan: &'a Plan,
    learner: L,
    checkpoints: Checkpoints,
    metrics: Metrics,
    state: State,
}

impl<L: Learner> Trainer<'_, L> {
    fn train(mut self, stop: &AtomicBool, hear: &mut dyn FnMut(Event)) -> Result<Summary> {
        let (steps, every) = (self.plan.steps, self.plan.checkpoint_every);
        let (mut losses, mut seconds, mut saved) = (Vec::new(), 0.0, None);
        while self.state.step < steps && !stop.load(Ordering::Relaxed) {
            let figures = self.step()?;
            losses.push(figures.loss);
            seconds += figures.seconds;
            hear(Event::Step(figures, steps));
            let step = self.state.step;
            if step == steps || (every > 0 && step.is_multiple_of(every)) {
                saved = Some((step, self.save()?));
            }
        }
        let step = self.state.step;
        let checkpoint = match saved {
            Some((at, path)) if at == step => path,
            _ => self.save()?,
        };
        let last = &losses[losses.len().saturating_sub(100)..];
        let loss = (!last.is_empty()).then(|| last.iter().sum::<f64>() / last.len() as f64);
        Ok(Summary { checkpoint, step, stopped: step < steps, loss, seconds })
    }

    fn step(&mut self) -> Result<Figures> {
        let begun = Instant::now();
        let (loss, clips) = self.learner.gradients(self.state.step);
        let step = self.state.step + 1;
        if !loss.is_finite() {
            let whole = match self.checkpoints.named("latest") {
                Some(step) => format!("the checkpoint of step {step} is whole; "),
                None => String::new(),
            };
            let on = listed(clips.iter());
            let what = format!("step {step}: the loss is {loss} on {on}; {whole}try a lower learning rate");
            return Err(Error::NotFinite(what));
        }
        self.learner.parameters().update(self.plan.rate, self.plan.clip);
        self.state.step = step;
        self.state.windows += self.plan.batch as u64;
        let figures = Figures { step, loss, seconds: begun.elapsed().as_secs_f64() };
        let values = [("train/loss", loss), ("train/steps_per_second", 1.0 / figures.seconds)];
        self.metrics.other(self.plan.kind, step, &figures, &values)?;
        Ok(figures)
    }

    fn save(&mut self) -> Result<PathBuf> {
        self.metrics.sync()?;
        let parameters = self.learner.parameters();
        let contents = [
            (WEIGHTS, weights::finite_bytes(WEIGHTS, &parameters.weights()?)?),
            (OPTIMIZER, weights::finite_bytes(OPTIMIZER, &parameters.moments()?)?),
        ];
        let path = self.checkpoints.write(self.state.clone(), &contents)?;
        self.checkpoints.prune(self.plan.keep)?;
        Ok(path)
    }
}

/// Refuses to end a run before where it stands: `steps` are asked for in all.
///
/// # Errors
/// [`kinelm_store::Error::Call`] with both numbers.
pub fn check_steps(run: &Path, steps: u64) -> Result<()> {
    // what is there, not what `latest` says
    let checkpoints = Checkpoints::of(run);
    let done = checkpoints.steps()?.into_iter().rev().find(|&step| checkpoints.state(step).is_ok());
    match done.filter(|done| steps < *done) {
        Some(done) => Err(Error::call(format!(
            "steps {steps}; the run has done {done}: ask for that or more, or begin a new run"
        ))),
        None => Ok(()),
    }
}

/// What a kind of run is called: in `config.toml`, to people, and the command that makes one.
#[derive(Debug, Clone, Copy)]
pub struct Kind {
    /// `kind` in `config.toml`.
    pub name: &'static str,
    /// With its article, as in "one of an auto-conditioned LSTM".
    pub one_of: &'static str,
    /// The command.
    pub command: &'static str,
    /// The layout of `config.toml` that this program writes and reads.
    pub version: u32,
}

impl Kind {
    /// Writes `config.toml`.
    ///
    /// # Errors
    /// What the system refuses.
    pub fn write(&self, run: &Path, settings: &impl Serialize) -> Result<()> {
        let text = toml::to_string(settings).map_err(|e| Error::call(format!("{CONFIG} can't be written: {e}")))?;
        Ok(files::write_whole(&run.join(CONFIG), text.as_bytes())?)
    }

    /// Reads that of a run.
    ///
    /// # Errors
    /// A folder without one, a run of another kind, another version, keys that are wrong.
    pub fn read<T: DeserializeOwned>(&self, run: &Path) -> Result<T> {
        #[derive(Deserialize)]
        struct Head {
            kind: Option<String>,
            version: u32,
        }
        let path = run.join(CONFIG);
        let help = format!("a run of this kind is a folder that `{} --run RUN` wrote", self.command);
        let text = input::text(&path).map_err(|e| match e.kind() {
            std::io::ErrorKind::NotFound => Error::file(run, format!("no {CONFIG}"), "a run folder", help.clone()),
            _ => Error::io(&path)(e),
        })?;
        let wrong =
            |e: toml::de::Error| Error::in_text((&path, &text), e.span(), e.message(), "the settings of a run", "");
        let head: Head = toml::from_str(&text).map_err(wrong)?;
        if head.kind.as_deref() != Some(self.name) {
            let found = head.kind.map_or("a run of a GPT".into(), |kind| format!("a run of kind {kind:?}"));
            return Err(Error::file(&path, found, self.one_of, help));
        }
        if head.version != self.version {
            let found = format!("version {}", head.version);
            let expected = format!("version {}", self.version);
            return Err(Error::file(&path, found, expected, "take the kinelm that wrote it"));
        }
        toml::from_str(&text).map_err(wrong)
    }
}
