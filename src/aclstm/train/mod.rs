//! Training: from motion files to a run folder.

mod batches;
#[cfg(test)]
mod tests;

pub use batches::{Batch, batch};

use super::Config;
use super::data::{Learned, Recordings, Sources};
use super::form::Coder;
use super::network::{self, Learner};
use super::run::RunFile;
use crate::model::checkpoint::{Checkpoints, State, Which};
use crate::model::run::{OPTIMIZER, WEIGHTS};
use crate::model::weights;
use crate::train::folder::RunFolder;
use crate::train::learner::listed;
use crate::train::metrics::Metrics;
use crate::{Error, Result};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Instant;

/// What to train.
#[derive(Debug, Clone)]
#[allow(clippy::large_enum_variant)] // a call has one
pub enum Asked {
    /// A new run.
    New(Config, Sources),
    /// One that is there, to so many steps if they are said.
    Resumed(Option<u64>),
}

/// Figures of an update.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Figures {
    /// Updates done with it.
    pub step: u64,
    /// The batch's loss, in the form's own measure.
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

/// Trains a network, or goes on with one where its last whole checkpoint stands: to the same bits as if it had never
/// stopped, on the same kind of processor. It works on the rayon pool that it is called in; the number of threads changes
/// nothing.
///
/// # Errors
/// A run folder that is there, or, to go on, isn't; clips that are none, on several rigs, too short or, to go on, others
/// than they were; a loss that is no number; what the system refuses.
pub fn train(run: &Path, asked: &Asked, stop: &AtomicBool, hear: &mut dyn FnMut(Event)) -> Result<Summary> {
    let (folder, file, learned, coder) = match asked {
        Asked::New(config, sources) => begin(run, config, sources, hear)?,
        Asked::Resumed(steps) => found(run, *steps, hear)?,
    };
    Trainer::new(&folder, file, learned, coder, hear)?.train(stop, hear)
}

type Ready = (RunFolder, RunFile, Learned, Coder);

fn begin(run: &Path, config: &Config, sources: &Sources, hear: &mut dyn FnMut(Event)) -> Result<Ready> {
    config.validate()?;
    let recordings = Recordings::load(sources, config.margin, None)?;
    let file = RunFile::new(config, sources, &recordings);
    let coder = file.coder()?;
    let learned = told(&recordings, &coder, config, hear)?;
    // whatever is refused must not leave an empty run behind
    let folder = RunFolder::create(run)?;
    file.write(run)?;
    Ok((folder, file, learned, coder))
}

fn found(run: &Path, steps: Option<u64>, hear: &mut dyn FnMut(Event)) -> Result<Ready> {
    let folder = RunFolder::open(run)?;
    let mut file = RunFile::read(run)?;
    let coder = file.coder()?;
    let recordings = Recordings::load(&file.sources, file.config.margin, Some(&file.rig))?;
    if recordings.sha256() != file.clips_sha256 {
        let found = format!("clips with hash {}", recordings.sha256());
        let help = "put back the files and labels that the run was begun with, or begin a new one";
        return Err(Error::file(run, found, format!("the run's, {}", file.clips_sha256), help));
    }
    if let Some(steps) = steps.filter(|steps| *steps != file.config.steps) {
        if let Some(done) = Checkpoints::of(run).named("latest").filter(|done| steps < *done) {
            return Err(Error::Call(format!("steps {steps}; the run has done {done}: ask for that or more")));
        }
        file.config.steps = steps;
        file.config.validate()?;
        file.write(run)?;
    }
    let learned = told(&recordings, &coder, &file.config, hear)?;
    Ok((folder, file, learned, coder))
}

fn told(recordings: &Recordings, coder: &Coder, config: &Config, hear: &mut dyn FnMut(Event)) -> Result<Learned> {
    recordings.said.iter().for_each(|line| hear(Event::Note(line)));
    let learned = Learned::of(recordings, coder, config)?;
    if !learned.short.is_empty() {
        let (n, which) = (learned.short.len(), listed(learned.short.iter()));
        hear(Event::Note(&format!("{n} training clips are too short for a sequence: {which}")));
    }
    Ok(learned)
}

struct Trainer {
    file: RunFile,
    learned: Learned,
    coder: Coder,
    learner: Learner,
    checkpoints: Checkpoints,
    metrics: Metrics,
    state: State,
}

impl Trainer {
    fn new(
        run: &RunFolder,
        file: RunFile,
        learned: Learned,
        coder: Coder,
        hear: &mut dyn FnMut(Event),
    ) -> Result<Trainer> {
        let config = &file.config;
        let shape = config.shape(coder.channels());
        let checkpoints = Checkpoints::of(run.path());
        let size = (config.batch, config.length);
        let (learner, state) = if checkpoints.steps()?.is_empty() {
            if let Some(step) = checkpoints.named("latest") {
                let found = format!("no checkpoint, though `latest` names that of step {step}");
                let help = "put it back, or begin a new run";
                return Err(Error::file(run.path(), found, "the checkpoints that it wrote", help));
            }
            let weights = network::initial(&shape, config.seed);
            (Learner::new(config.form, shape, size, weights), State::new(0, 0, 0, config.seed, None))
        } else {
            let mut note = |text: String| hear(Event::Note(&text));
            let found = checkpoints.find(Which::Latest, &[WEIGHTS, OPTIMIZER], &[], &mut note)?;
            let tensors = |name: &str| weights::from_bytes(&found.dir.join(name), &found.files[name]);
            let weights = network::numbers(&shape, &tensors(WEIGHTS)?, "")?;
            let mut learner = Learner::new(config.form, shape, size, weights);
            learner.restore(&tensors(OPTIMIZER)?, found.state.step)?;
            note(format!("going on after step {}", found.state.step));
            let mut state = found.state;
            state.files.clear();
            (learner, state)
        };
        checkpoints.sweep()?;
        let metrics = Metrics::open(run.path(), state.step)?;
        Ok(Trainer { file, learned, coder, learner, checkpoints, metrics, state })
    }

    fn train(mut self, stop: &AtomicBool, hear: &mut dyn FnMut(Event)) -> Result<Summary> {
        let (steps, every) = (self.file.config.steps, self.file.config.checkpoint_every);
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
        let config = &self.file.config;
        let batch = batch(&self.learned, &self.coder, config, self.state.step);
        let loss = self.learner.gradients(&batch.inputs, &batch.targets, &config.given());
        let step = self.state.step + 1;
        if !loss.is_finite() {
            let clips: Vec<String> = batch.clips.iter().map(|&clip| self.learned.clips[clip].2.clone()).collect();
            let whole = match self.checkpoints.named("latest") {
                Some(step) => format!("the checkpoint of step {step} is whole; "),
                None => String::new(),
            };
            let on = listed(clips.iter());
            let what = format!("step {step}: the loss is {loss} on {on}; {whole}try a lower learning rate");
            return Err(Error::NotFinite(what));
        }
        self.learner.update(config.learning_rate);
        self.state.step = step;
        self.state.windows += config.batch as u64;
        let figures = Figures { step, loss, seconds: begun.elapsed().as_secs_f64() };
        let values = [("train/loss", loss), ("train/steps_per_second", 1.0 / figures.seconds)];
        self.metrics.other("aclstm", step, &figures, &values)?;
        Ok(figures)
    }

    fn save(&mut self) -> Result<PathBuf> {
        self.metrics.sync()?;
        let contents = [
            (WEIGHTS, weights::finite_bytes(WEIGHTS, &self.learner.weights()?)?),
            (OPTIMIZER, weights::finite_bytes(OPTIMIZER, &self.learner.moments()?)?),
        ];
        let path = self.checkpoints.write(self.state.clone(), &contents)?;
        self.checkpoints.prune(self.file.config.keep)?;
        Ok(path)
    }
}
