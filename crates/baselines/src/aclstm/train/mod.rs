//! Training: from motion files to a run folder.

mod batches;
#[cfg(test)]
mod tests;

pub use batches::{Batch, batch, held_out};

use super::rollout::roll_out;
use super::run::RunFile;
use super::sequences::Sequences;
use super::{Config, network};
use crate::data::{Recordings, Sources};
use crate::form::{Coder, frames_of_steps};
use crate::run::{RunConfig, Settings};
use crate::train::{self, Event, Network, Parameters, Plan, Progress, Summary, note_clips, note_unmeasured};
use crate::{Error, FPS, Loss, Result};
use kinelm_corpus::Split;
use kinelm_engine::lstm::Shape;
use kinelm_motion::{Clip, Skeleton};
use kinelm_train::folder::RunFolder;
use kinelm_train::sample::SECONDS;
use std::path::Path;
use std::sync::Arc;
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
    let mut load = |recordings: &Recordings, file: &RunFile| Data::of(recordings, file, progress);
    let (folder, file, data) = match start {
        Start::New(config, sources) => {
            config.validate()?;
            let recordings = Recordings::load(sources, config.margin, None)?;
            let file = RunFile::new(config, sources, &recordings);
            let data = load(&recordings, &file)?;
            // what is refused must not leave an empty run
            let folder = RunFolder::create(run)?;
            file.write(run)?;
            (folder, file, data)
        }
        Start::Resume(changes) => RunFile::resume(run, changes, |file| load(&file.recordings(run)?, file))?,
    };
    let config = file.config;
    let shape = config.shape(data.coder.channels());
    let plan = Plan {
        kind: "aclstm",
        steps: config.steps,
        rate: config.learning_rate,
        clip: None,
        batch: config.batch,
        seed: config.seed,
        eval_every: config.eval_every,
        sample_every: config.sample_every,
        checkpoint_every: config.checkpoint_every,
        keep: config.keep,
    };
    let network = |weights| Training {
        network: network::Learner::new(config.form, config.parts(), shape, config.batch, config.length, weights),
        shape,
        data,
        config,
    };
    let initial = || network::initial(&shape, plan.seed);
    train::train(&folder, &plan, &network::list(&shape), initial, network, stop, progress)
}

/// The sequences that a network learns from, is measured on and continues.
struct Data {
    coder: Coder,
    training: Sequences,
    /// (T, B, C) of the validation clips, where the run is measured and has some.
    held_out: Option<Batch>,
    /// (T + 1, C) first frames of a held-out clip, or else of a training clip, and its skeleton.
    seed: Option<(Vec<f64>, Arc<Skeleton>, String)>,
}

impl Data {
    /// Of the clips of a run. Notes what reading reported, clips that are too short, and a run that can't be measured.
    fn of(recordings: &Recordings, file: &RunFile, progress: &mut dyn FnMut(Event)) -> Result<Data> {
        let (coder, config) = (file.coder()?, &file.config);
        let training = Sequences::of(recordings, &coder, config)?;
        note_clips(recordings.notes.iter(), &training.short, progress);
        let mut held_out = None;
        if config.eval_every > 0 {
            let valid = Sequences::of_split(recordings, Split::Valid, &coder, config);
            held_out = (!valid.clips.is_empty()).then(|| batches::held_out(&valid, &coder, config));
        }
        note_unmeasured(config.eval_every > 0 && held_out.is_none(), progress);
        let mut seed = None;
        if config.sample_every > 0 {
            let mut all = [Split::Valid, Split::Train].into_iter().flat_map(|split| recordings.split(split));
            if let Some(one) = all.find(|one| one.frames() > config.length) {
                let clip = one.at_rate()?.slice(0..config.length + 1);
                seed = Some((coder.frames(&clip), clip.skeleton().clone(), one.name.clone()));
            }
        }
        Ok(Data { coder, training, held_out, seed })
    }
}

/// A network with its data.
struct Training {
    network: network::Learner,
    shape: Shape,
    data: Data,
    config: Config,
}

impl Network for Training {
    fn gradients(&mut self, step: u64) -> (Loss, Vec<String>) {
        let batch = batch(&self.data.training, &self.data.coder, &self.config, step);
        let loss = self.network.gradients(&batch.inputs, &batch.targets, &self.config.given());
        (loss, batch.clips.iter().map(|&clip| self.data.training.clips[clip].2.clone()).collect())
    }

    fn measure(&mut self) -> Option<Loss> {
        let batch = self.data.held_out.as_ref()?;
        Some(self.network.loss(&batch.inputs, &batch.targets, &self.config.given()))
    }

    fn sample(&self) -> Result<(Clip, String)> {
        let Some((seed, skeleton, clip)) = &self.data.seed else {
            return Err(Error::missing("clip to continue", "none is long enough"));
        };
        let (c, n) = (self.data.coder.channels(), self.config.length);
        let frames = (SECONDS * FPS).round() as usize;
        let steps = roll_out(self.shape, &self.network.parameters.weights, &[seed], frames, &mut |_| ())?.remove(0);
        // the hip's place at the first new frame: steps say only how it moves from there
        let at = &seed[n * c..];
        let dance = frames_of_steps(&steps, c, [at[0], at[2]]);
        let dance = self.data.coder.clip(&dance, skeleton, FPS)?;
        Ok((dance, format!("after the first {n} frames of {clip}")))
    }

    fn parameters(&mut self) -> &mut Parameters {
        &mut self.network.parameters
    }
}
