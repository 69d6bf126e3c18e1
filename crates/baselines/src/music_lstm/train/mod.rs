//! Training: from motion and music files to a run folder.

#[cfg(test)]
mod tests;

use super::SPECTRUM;
use super::config::Config;
use super::data::{MusicClip, MusicClips, MusicSources, scale, training_clips};
use super::effort::shares;
use super::loss::{Terms, loss};
use super::network::{Dropout, Network, initial, list, standardise};
use super::run::RunFile;
use crate::Result;
use crate::data::{Recording, Recordings};
use crate::run::{RunConfig, Settings};
use crate::train::{self, Parameters, Plan, Progress, Summary, note_clips};
use kinelm_corpus::Split;
use kinelm_engine::arena::Floats;
use kinelm_engine::lstm::TeacherForcing;
use kinelm_store::random;
use kinelm_train::folder::RunFolder;
use rand_chacha::rand_core::RngCore;
use rayon::prelude::*;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// A new run, or one to resume.
pub type Start = train::Start<Config, MusicSources>;

/// Trains a network, or resumes a run from its last whole checkpoint: to the same bits as if it had never stopped, on the
/// same kind of processor. It works on the rayon pool that it is called in, whose number of threads changes nothing.
///
/// # Errors
/// A run folder that exists or, to resume, doesn't; no clips, clips on several rigs, without music, too short or, to resume,
/// others than before; music that is silent or too short; a loss that is not finite; what the system refuses.
pub fn train(run: &Path, start: &Start, stop: &AtomicBool, progress: Progress) -> Result<Summary> {
    let take = |recordings: &Recordings, clips: MusicClips, config: &Config, progress: Progress| {
        let notes = clips.notes.clone();
        let (clips, short) = training_clips(clips, config)?;
        note_clips(recordings.notes.iter().chain(&notes), &short, progress);
        Ok::<_, crate::Error>(clips)
    };
    let (folder, file, clips) = match start {
        Start::New(config, sources) => {
            config.validate()?;
            let recordings = Recordings::load(&sources.motion, config.margin, None)?;
            let clips = MusicClips::load(&recordings, sources, config.audio, config.margin, is_training)?;
            let file = RunFile::new(config, sources, &recordings, &clips);
            let clips = take(&recordings, clips, config, progress)?;
            // what is refused must not leave an empty run
            let folder = RunFolder::create(run)?;
            file.write(run)?;
            (folder, file, clips)
        }
        Start::Resume(changes) => {
            let folder = RunFolder::open(run)?;
            let mut file = RunFile::read(run)?;
            let (recordings, clips) = file.clips(run, is_training)?;
            file.change(run, changes)?;
            let clips = take(&recordings, clips, &file.config, progress)?;
            (folder, file, clips)
        }
    };
    let config = file.config.clone();
    let shape = config.shape(file.rig.joints());
    let plan = Plan {
        kind: "music-lstm",
        steps: config.steps,
        rate: config.learning_rate,
        clip: (config.clip > 0.0).then_some(config.clip),
        batch: config.batch,
        seed: config.seed,
        checkpoint_every: config.checkpoint_every,
        keep: config.keep,
    };
    let weights = shares(&*file.body.skeleton(&file.rig)?);
    let network = |start| Training::new(config, start, &clips, weights);
    let first = || initial(&shape, scale(&clips.iter().collect::<Vec<_>>(), file.config.audio), plan.seed);
    train::train(&folder, &plan, &list(&shape), first, network, stop, progress)
}

fn is_training(one: &Recording) -> bool {
    one.split == Split::Train
}

/// The sequences of an update.
pub struct Batch {
    /// (T, B, N) spectra, not standardised.
    pub spectra: Vec<f32>,
    /// (T, B, 4J) true frames.
    pub truth: Vec<f32>,
    /// (T, B, 4J) the previous true frames.
    pub previous: Vec<f32>,
    /// (T) the teacher-forced steps.
    pub forced: Vec<bool>,
    /// (B) the clips.
    pub clips: Vec<usize>,
}

/// The sequences of update `step`, counted from 0: a random clip, from a random frame on. A function of the seed and the
/// step.
pub fn batch(clips: &[MusicClip], channels: usize, config: &Config, step: u64) -> Batch {
    let (t, b, c) = (config.length, config.batch, channels);
    let sampled: Vec<(usize, usize)> = (0..b)
        .map(|index| {
            let mut rng = random::stream(config.seed, "music lstm batch", step, index as u64);
            let clip = (rng.next_u64() % clips.len() as u64) as usize;
            let recording = &clips[clip].recording;
            // at least 1: clips have `length` + 1 frames at the network's rate
            let room = recording.clip.frames() - t * recording.stride;
            (clip, (rng.next_u64() % room as u64) as usize)
        })
        .collect();
    let mut batch = Batch {
        spectra: vec![0.0; t * b * SPECTRUM],
        truth: vec![0.0; t * b * c],
        previous: vec![0.0; t * b * c],
        forced: Vec::new(),
        clips: sampled.iter().map(|(clip, _)| *clip).collect(),
    };
    let frame = |i: usize, late: usize| {
        let (clip, first) = sampled[i % b];
        (&clips[clip], first + (i / b + late) * clips[clip].recording.stride)
    };
    let rows = batch.spectra.par_chunks_mut(SPECTRUM).enumerate();
    rows.for_each(|(i, row)| {
        // the music of the frame that is predicted, not of the previous one
        let (clip, at) = frame(i, 1);
        row.copy_from_slice(clip.at(at));
    });
    for (late, to) in [&mut batch.previous, &mut batch.truth].into_iter().enumerate() {
        for (i, row) in to.chunks_exact_mut(c).enumerate() {
            let (clip, at) = frame(i, late);
            row.copy_from_slice(&clip.poses[at * c..][..c]);
        }
    }
    // one choice for all sequences: the engine forces whole steps
    let mut rng = random::stream(config.seed, "music lstm told", step, 0);
    batch.forced = (0..t).map(|_| random::unit(&mut rng) < config.teacher).collect();
    batch
}

/// A network with its data.
struct Training<'a> {
    config: Config,
    network: Network,
    parameters: Parameters,
    clips: &'a [MusicClip],
    /// Of joints in the effort.
    weights: Vec<f64>,
    /// (T, B, 4J) gradients of the outputs.
    d_out: Floats,
}

impl Training<'_> {
    fn new<'a>(config: Config, start: Vec<Floats>, clips: &'a [MusicClip], weights: Vec<f64>) -> Training<'a> {
        let shape = config.shape(weights.len());
        let rows = config.batch * config.length;
        Training {
            network: Network::new(&shape, config.batch, config.length, true),
            parameters: Parameters::new(list(&shape), start),
            d_out: Floats::new(rows * shape.channels()),
            clips,
            weights,
            config,
        }
    }
}

impl train::Network for Training<'_> {
    fn gradients(&mut self, step: u64) -> (f64, Vec<String>) {
        let config = &self.config;
        let mut batch = batch(self.clips, 4 * self.weights.len(), config, step);
        let keys: Vec<u64> = (0..config.layers as u64)
            .map(|layer| random::stream(config.seed, "music lstm dropout", step, layer).next_u64())
            .collect();
        let dropout = Dropout { share: config.dropout, keys: &keys };
        let weights = &self.parameters.weights;
        standardise(weights, &mut batch.spectra);
        self.network.pack(weights);
        self.network.rest();
        let forced = TeacherForcing { steps: &batch.forced, rows: &batch.previous };
        let outputs = self.network.forward(weights, &batch.spectra, forced, dropout);
        let terms = Terms { pose: config.pose, effort: config.effort_of(step), weights: &self.weights };
        let loss = loss(terms, config.batch, outputs, &batch.truth, &mut self.d_out);
        let gradients = &mut self.parameters.optimizer.gradients;
        self.network.backward(weights, &self.d_out, &batch.spectra, dropout, gradients);
        (loss, batch.clips.iter().map(|&clip| self.clips[clip].recording.name.clone()).collect())
    }

    fn parameters(&mut self) -> &mut Parameters {
        &mut self.parameters
    }
}
