//! Training of LSTMs: Adam at one rate, on batches that are functions of their number.

use crate::run::Changes;
use crate::{Error, Loss, Parts, Result};
use kinelm_engine::arena::Floats;
use kinelm_model::checkpoint::{Checkpoints, Keep, Measured, State};
use kinelm_model::layout::{Init, Parameter, Role};
use kinelm_model::run::{OPTIMIZER, WEIGHTS};
use kinelm_model::weights;
use kinelm_motion::Clip;
use kinelm_store::{memory, random};
use kinelm_train::folder::RunFolder;
use kinelm_train::learner::{listed, not_finite};
use kinelm_train::metrics::Metrics;
use kinelm_train::optimizer::{Adam, Optimizer, Rates};
use kinelm_train::sample::write_sample;
use kinelm_train::trainer::{Cadence, Files, last_checkpoint};
use kinelm_train::{Task, Trainer};
use rayon::prelude::*;
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::time::Instant;

/// What to train.
#[derive(Debug, Clone)]
#[allow(clippy::large_enum_variant)] // a call has one
pub enum Start<C, S> {
    /// A new run of these settings on these sources.
    New(C, S),
    /// A run that exists, with these changes, in its folder or as a new run.
    Resume(Changes),
}

/// A network with its data.
pub trait Network {
    /// The loss of update `step`, counted from 0, and the names of its clips. Gradients stay in [`Network::parameters`].
    fn gradients(&mut self, step: u64) -> (Loss, Vec<String>);
    /// The loss of sequences that are spread evenly over the validation clips; `None` without such clips.
    fn measure(&mut self) -> Option<Loss>;
    /// A dance of the network as it is, and how it was made. It changes nothing in the training.
    ///
    /// # Errors
    /// A network that diverges.
    fn sample(&self) -> Result<(Clip, String)>;
    /// What learns.
    fn parameters(&mut self) -> &mut Parameters;
}

/// Weights, and their gradients and moments.
pub struct Parameters {
    list: Vec<Parameter>,
    /// In the order of the list.
    pub weights: Vec<Floats>,
    /// Gradients and moments.
    pub optimizer: Optimizer,
}

impl Parameters {
    /// Before the first update.
    pub(crate) fn new(list: Vec<Parameter>, weights: Vec<Floats>) -> Parameters {
        Parameters { optimizer: Optimizer::new(list.clone()), list, weights }
    }

    /// Moves the weights by their gradients, by Adam. Gradients whose norm is above `clip` are scaled to it.
    pub fn update(&mut self, rate: f64, clip: Option<f64>) {
        let share = clip.map_or(1.0, |most| {
            let norm = self.optimizer.norm();
            if norm > most { most / norm } else { 1.0 }
        });
        let rates = |_, _: &Parameter| Rates { rate, decay: 0.0, tail: None };
        self.optimizer.update(self.weights.par_iter_mut(), Adam::default(), share, rates);
    }
}

/// A tensor of a network. On disk, biases have one dimension.
pub fn parameter(name: String, [rows, columns]: [usize; 2]) -> Parameter {
    let shape = if name.ends_with("bias") { vec![columns] } else { vec![rows, columns] };
    Parameter { name, shape, init: Init::Zeros, role: Role::Matrix }
}

/// Numbers uniform over +-`most`, of the random stream of a purpose and an index.
pub fn uniform(purpose: &str, index: usize, len: usize, most: f64, seed: u64) -> Floats {
    let mut rng = random::stream(seed, purpose, 0, index as u64);
    let numbers: Vec<f32> = (0..len).map(|_| ((2.0 * random::unit(&mut rng) - 1.0) * most) as f32).collect();
    Floats::of(&numbers)
}

/// `n` sequences spread evenly over clips with these numbers of possible first frames: clip and first frame of each sequence.
pub(crate) fn spread(n: usize, rooms: &[usize]) -> Vec<(usize, usize)> {
    let clips = rooms.len();
    let one = |i: usize| {
        // every clip in turn, or of more clips than sequences some
        let clip = if clips < n { i % clips } else { i * clips / n };
        // sequences that don't divide evenly go to the first clips
        let (k, count) = (i / clips, ((n + clips - 1 - clip) / clips).max(1));
        // the middle of the k-th of `count` equal parts of the room
        (clip, rooms[clip] * (2 * k + 1) / (2 * count))
    };
    (0..n).map(one).collect()
}

/// How a network is trained.
#[derive(Debug, Clone, Copy)]
pub struct Plan {
    /// The kind of lines in `metrics.jsonl`.
    pub kind: &'static str,
    /// Updates in all.
    pub steps: u64,
    /// Adam's learning rate.
    pub rate: f64,
    /// The largest norm of gradients; `None`: no limit.
    pub clip: Option<f64>,
    /// Sequences of an update.
    pub batch: usize,
    /// The run's seed.
    pub seed: u64,
    /// Updates between measurements; 0: none.
    pub eval_every: u64,
    /// Updates between dances; 0: none.
    pub sample_every: u64,
    /// Updates between checkpoints; 0: only at the end.
    pub checkpoint_every: u64,
    /// Checkpoints that stay beside the best.
    pub keep: Keep,
}

/// Metrics of an update.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct StepMetrics {
    /// Updates done with it.
    pub step: u64,
    /// The batch's loss, in the network's own measure.
    pub loss: f64,
    /// Its parts.
    #[serde(flatten)]
    pub parts: Parts,
    /// Its duration.
    pub seconds: f64,
}

/// How training ended.
#[derive(Debug, Clone, PartialEq)]
pub struct Summary {
    /// Its last checkpoint.
    pub checkpoint: PathBuf,
    /// Updates done in all.
    pub step: u64,
    /// Whether it was stopped before its last update.
    pub stopped: bool,
    /// Mean loss of the last hundred updates of this call; `None` without an update.
    pub loss: Option<f64>,
    /// Seconds of this call's updates.
    pub seconds: f64,
}

/// Progress of a training.
pub enum Event<'a> {
    /// Something that the user should know.
    Note(&'a str),
    /// An update, and the number of updates in all.
    Step(StepMetrics, u64),
    /// A measurement after some updates, and whether it is the best so far.
    Valid(u64, Loss, bool),
}

/// Receives the progress of a training.
pub type Progress<'a> = &'a mut dyn FnMut(Event);

/// Notes what reading the clips reported, and the clips that are too short for a sequence.
pub(crate) fn note_clips<'a>(notes: impl Iterator<Item = &'a String>, short: &[String], progress: Progress) {
    notes.for_each(|note| progress(Event::Note(note)));
    if !short.is_empty() {
        let (n, which) = (short.len(), listed(short.iter()));
        progress(Event::Note(&format!("{n} training clips are too short for a sequence: {which}")));
    }
}

/// Notes a run that is to be measured and has no validation clip.
pub(crate) fn note_unmeasured(is_unmeasured: bool, progress: Progress) {
    if is_unmeasured {
        let what =
            "no validation clip is long enough for a sequence: the run is not measured, its latest checkpoint counts";
        progress(Event::Note(what));
    }
}

/// Trains from the last whole checkpoint of the folder, or from `initial` weights: to the same bits as if it had never
/// stopped, on the same kind of processor. `network` makes the network of weights in the order of `list`.
///
/// # Errors
/// A checkpoint that is damaged or of another network, a loss that is not finite, what the system refuses.
pub fn train<N: Network>(
    folder: &RunFolder,
    plan: &Plan,
    list: &[Parameter],
    initial: impl FnOnce() -> Vec<Floats>,
    network: impl FnOnce(Vec<Floats>) -> N,
    stop: &AtomicBool,
    progress: Progress,
) -> Result<Summary> {
    // weights, gradients and two moments
    let numbers: u128 = list.iter().map(|p| p.len() as u128).sum();
    memory::check(16 * numbers, "training this network", "lower its width or its layers, or give the program more")?;
    let checkpoints = Checkpoints::of(folder.path());
    let note = &mut |text: String| progress(Event::Note(&text));
    let found = last_checkpoint(&checkpoints, &[WEIGHTS, OPTIMIZER], note)?;
    let (network, state) = match found {
        Some(found) => {
            let tensors = |name: &str| weights::from_bytes(&found.dir.join(name), &found.files[name]);
            let weights = weights::floats("checkpoint", list, &tensors(WEIGHTS)?, |p| p.name.clone())?;
            note(format!("resuming after step {}", found.state.step));
            let mut network = network(weights);
            network.parameters().optimizer.restore(&tensors(OPTIMIZER)?, found.state.step)?;
            (network, found.state)
        }
        None => (network(initial()), State::new(0, 0, 0, plan.seed, None)),
    };
    checkpoints.sweep()?;
    let metrics = Metrics::open(folder.path(), state.step)?;
    let Plan { steps, eval_every, checkpoint_every, keep, .. } = *plan;
    let cadence = Cadence { steps, eval_every, checkpoint_every, keep };
    let task = Training { plan, run: folder.path(), network, metrics, progress, losses: Vec::new(), seconds: 0.0 };
    let mut trainer = Trainer::new(task, cadence, Some(checkpoints), state);
    trainer.train(stop)?;
    let Training { losses, seconds, .. } = &trainer.task;
    let last = &losses[losses.len().saturating_sub(100)..];
    let step = trainer.state().step;
    Ok(Summary {
        checkpoint: trainer.checkpoint().unwrap_or(folder.path()).to_owned(),
        step,
        stopped: step < steps,
        loss: (!last.is_empty()).then(|| last.iter().sum::<f64>() / last.len() as f64),
        seconds: *seconds,
    })
}

/// A network as the training loop trains it.
struct Training<'a, N> {
    plan: &'a Plan,
    run: &'a Path,
    network: N,
    metrics: Metrics,
    progress: Progress<'a>,
    losses: Vec<f64>,
    seconds: f64,
}

impl<N: Network> Training<'_, N> {
    /// Writes a dance into `samples/`, where one is due; notes if it can't be made, which must not end the run.
    fn sample(&mut self, step: u64) {
        let every = self.plan.sample_every;
        if every == 0 || !step.is_multiple_of(every) {
            return;
        }
        let sampled = self.network.sample();
        let note = match sampled.and_then(|(clip, how)| write_sample(self.run, step, clip, &how)) {
            Ok(page) => format!("{}: a dance of the network after update {step}", page.display()),
            Err(e) => format!("no dance after update {step}: {e}"),
        };
        (self.progress)(Event::Note(&note));
    }
}

impl<N: Network> Task for Training<'_, N> {
    type Step = StepMetrics;

    fn update(&mut self, state: &mut State) -> Result<StepMetrics> {
        let begun = Instant::now();
        let (Loss { loss, parts }, clips) = self.network.gradients(state.step);
        if !loss.is_finite() {
            return Err(not_finite(loss, &clips));
        }
        // not before: a loss that isn't finite must leave the weights as they are
        self.network.parameters().update(self.plan.rate, self.plan.clip);
        state.step += 1;
        state.windows += self.plan.batch as u64;
        let metrics = StepMetrics { step: state.step, loss, parts, seconds: begun.elapsed().as_secs_f64() };
        let [root, rotations] = [("train/root", parts.root), ("train/rotations", parts.rotations)];
        let values = [("train/loss", loss), root, rotations, ("train/steps_per_second", 1.0 / metrics.seconds)];
        self.metrics.other(self.plan.kind, state.step, &metrics, &values)?;
        self.losses.push(loss);
        self.seconds += metrics.seconds;
        (self.progress)(Event::Step(metrics, self.plan.steps));
        self.sample(state.step);
        Ok(metrics)
    }

    fn measure(&mut self, state: &mut State) -> Result<Option<bool>> {
        // without measurements too, the last update is due for one
        let Some(found) = (self.plan.eval_every > 0).then(|| self.network.measure()).flatten() else {
            return Ok(Some(false));
        };
        if !found.loss.is_finite() {
            return Err(Error::NotFinite(format!("the loss is {} on the validation clips", found.loss)));
        }
        let is_best = state.measured(Measured::Loss(found.loss));
        // under a name of its own: the last line with a `loss` is the last update's
        #[derive(Serialize)]
        struct Line {
            step: u64,
            valid: Loss,
        }
        let Parts { root, rotations, .. } = found.parts;
        let values = [("valid/loss", found.loss), ("valid/root", root), ("valid/rotations", rotations)];
        self.metrics.other("valid", state.step, &Line { step: state.step, valid: found }, &values)?;
        (self.progress)(Event::Valid(state.step, found, is_best));
        Ok(Some(is_best))
    }

    fn files(&mut self, _due: bool) -> Result<Files> {
        // the checkpoint names a step up to which the lines must be on disk
        self.metrics.sync()?;
        let parameters = self.network.parameters();
        let weights = weights::named(&parameters.list, &parameters.weights);
        let moments = parameters.optimizer.moments();
        Ok(vec![
            (WEIGHTS, weights::finite_bytes(WEIGHTS, &weights)?),
            (OPTIMIZER, weights::finite_bytes(OPTIMIZER, &moments)?),
        ])
    }
}

#[cfg(test)]
mod tests {
    use super::spread;

    #[test]
    fn sequences_are_spread_evenly() {
        assert_eq!(spread(4, &[100]), [(0, 12), (0, 37), (0, 62), (0, 87)]);
        assert_eq!(spread(3, &[10, 1]), [(0, 2), (1, 0), (0, 7)]);
        assert_eq!(spread(2, &[9, 9, 9, 9]), [(0, 4), (2, 4)]);
        for n in 1..9 {
            for clips in 1..9 {
                assert!(spread(n, &vec![7; clips]).iter().all(|(clip, first)| *clip < clips && *first < 7));
            }
        }
    }
}
