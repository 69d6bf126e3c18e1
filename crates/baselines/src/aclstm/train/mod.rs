//! Training: from motion files to a run folder.

mod batches;
#[cfg(test)]
mod tests;

pub use batches::{Batch, batch};

use super::run::RunFile;
use super::sequences::Sequences;
use super::{Config, network};
use crate::Result;
use crate::data::{Recordings, Sources};
use crate::form::Coder;
use crate::run::{RunConfig, Settings};
use crate::train::{self, Network, Parameters, Plan, Progress, Summary, note_clips};
use kinelm_train::folder::RunFolder;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// A new run, or one to resume.
pub type Start = train::Start<Config, Sources>;

/// Trains a network, or resumes a run from its last whole checkpoint: to the same bits as if it had never stopped, on the
/// same kind of processor. It works on the rayon pool that it is called in, whose number of threads changes nothing.
///
/// # Errors
/// A run folder that exists or, to resume, doesn't; no clips, clips on several rigs, too short or, to resume, others than
/// before; a loss that is not finite; what the system refuses.
pub fn train(run: &Path, start: &Start, stop: &AtomicBool, progress: Progress) -> Result<Summary> {
    let load = |recordings: &Recordings, file: &RunFile, progress: Progress| {
        let coder = file.coder()?;
        let sequences = Sequences::of(recordings, &coder, &file.config)?;
        note_clips(recordings.notes.iter(), &sequences.short, progress);
        Ok::<_, crate::Error>((sequences, coder))
    };
    let (folder, file, (sequences, coder)) = match start {
        Start::New(config, sources) => {
            config.validate()?;
            let recordings = Recordings::load(sources, config.margin, None)?;
            let file = RunFile::new(config, sources, &recordings);
            let data = load(&recordings, &file, progress)?;
            // what is refused must not leave an empty run
            let folder = RunFolder::create(run)?;
            file.write(run)?;
            (folder, file, data)
        }
        Start::Resume(changes) => {
            let folder = RunFolder::open(run)?;
            let mut file = RunFile::read(run)?;
            let recordings = file.recordings(run)?;
            file.change(run, changes)?;
            let data = load(&recordings, &file, progress)?;
            (folder, file, data)
        }
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
    let network = |weights| Training {
        network: network::Learner::new(config.form, shape, config.batch, config.length, weights),
        sequences,
        coder,
        config,
    };
    let initial = || network::initial(&shape, plan.seed);
    train::train(&folder, &plan, &network::list(&shape), initial, network, stop, progress)
}

/// A network with its data.
struct Training {
    network: network::Learner,
    sequences: Sequences,
    coder: Coder,
    config: Config,
}

impl Network for Training {
    fn gradients(&mut self, step: u64) -> (f64, Vec<String>) {
        let batch = batch(&self.sequences, &self.coder, &self.config, step);
        let loss = self.network.gradients(&batch.inputs, &batch.targets, &self.config.given());
        (loss, batch.clips.iter().map(|&clip| self.sequences.clips[clip].2.clone()).collect())
    }

    fn parameters(&mut self) -> &mut Parameters {
        &mut self.network.parameters
    }
}
