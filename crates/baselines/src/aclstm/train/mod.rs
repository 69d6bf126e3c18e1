//! Training: from motion files to a run folder.

mod batches;
#[cfg(test)]
mod tests;

pub use batches::{Batch, batch};

pub use kinelm_train::updates::{Event, Figures, Summary};

use super::data::{Learned, Recordings, Sources};
use super::form::Coder;
use super::run::RunFile;
use super::{Config, network};
use crate::Result;
use kinelm_train::folder::RunFolder;
use kinelm_train::learner::listed;
use kinelm_train::parameters::Parameters;
use kinelm_train::updates;
use kinelm_train::updates::Plan;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// What to train.
#[derive(Debug, Clone)]
#[allow(clippy::large_enum_variant)] // a call has one
pub enum Asked {
    /// A new run.
    New(Config, Sources),
    /// One that is there, to so many steps if they are said.
    Resumed(Option<u64>),
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
    let config = file.config.clone();
    let shape = config.shape(coder.channels());
    let plan = Plan {
        kind: "aclstm",
        steps: config.steps,
        rate: config.learning_rate,
        clip: None,
        batch: config.batch,
        seed: config.seed,
        checkpoint_every: config.checkpoint_every,
        keep: config.keep,
    };
    let size = (config.batch, config.length);
    let learner = |weights| Learning {
        network: network::Learner::new(config.form, shape, size, weights),
        learned,
        coder,
        config,
    };
    let initial = || network::initial(&shape, plan.seed);
    updates::train(&folder, &plan, &network::list(&shape), (initial, learner), stop, hear)
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
    let recordings = file.recordings(run)?;
    if let Some(steps) = steps.filter(|steps| *steps != file.config.steps) {
        updates::check_steps(run, steps)?;
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

/// A network that learns, with what it learns from.
struct Learning {
    network: network::Learner,
    learned: Learned,
    coder: Coder,
    config: Config,
}

impl updates::Learner for Learning {
    fn gradients(&mut self, step: u64) -> (f64, Vec<String>) {
        let batch = batch(&self.learned, &self.coder, &self.config, step);
        let loss = self.network.gradients(&batch.inputs, &batch.targets, &self.config.given());
        (loss, batch.clips.iter().map(|&clip| self.learned.clips[clip].2.clone()).collect())
    }

    fn parameters(&mut self) -> &mut Parameters {
        &mut self.network.parameters
    }
}
