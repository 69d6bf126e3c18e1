//! Training: from motion and music files to a run folder.

#[cfg(test)]
mod tests;

use super::SPECTRUM;
use super::config::{Config, Effort};
use super::data::{MusicClip, MusicClips, MusicSources, scale, sequence_clips};
use super::effort::shares;
use super::loss::{Terms, loss};
use super::network::{Dropout, Network, initial, list, standardise};
use super::run::{RunFile, Trained};
use crate::data::{Recording, Recordings};
use crate::form::{Coder, Form};
use crate::run::{RunConfig, Settings};
use crate::train::{self, Parameters, Plan, Progress, Summary, note_clips, note_unmeasured, spread};
use crate::{Error, FPS, Loss, Result};
use kinelm_corpus::Split;
use kinelm_engine::arena::Floats;
use kinelm_engine::lstm::TeacherForcing;
use kinelm_motion::Clip;
use kinelm_store::random;
use kinelm_train::folder::RunFolder;
use kinelm_train::sample::SECONDS;
use rand_chacha::rand_core::RngCore;
use rayon::prelude::*;
use std::path::{Path, PathBuf};
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
    let mut take = |recordings: &Recordings, clips: MusicClips, config: &Config| {
        let notes = clips.notes.clone();
        let (clips, short) = sequence_clips(clips, config)?;
        note_clips(recordings.notes.iter().chain(&notes), &short, progress);
        note_unmeasured(config.eval_every > 0 && clips[1].is_empty(), progress);
        Ok::<_, crate::Error>(clips)
    };
    let (folder, file, [clips, valid]) = match start {
        Start::New(config, sources) => {
            config.validate()?;
            let recordings = Recordings::load(&sources.motion, config.margin, None)?;
            let clips = MusicClips::load(&recordings, sources, config.audio, config.margin, is_used(config))?;
            let file = RunFile::new(config, sources, &recordings, &clips);
            let clips = take(&recordings, clips, config)?;
            // what is refused must not leave an empty run
            let folder = RunFolder::create(run)?;
            file.write(run)?;
            (folder, file, clips)
        }
        Start::Resume(changes) => RunFile::resume(run, changes, |file| {
            let (recordings, clips) = file.clips(run, is_used(&file.config))?;
            take(&recordings, clips, &file.config)
        })?,
    };
    let config = &file.config;
    let shape = config.shape(file.rig.joints());
    let plan = Plan {
        kind: "music-lstm",
        steps: config.steps,
        rate: config.learning_rate,
        clip: (config.clip > 0.0).then_some(config.clip),
        batch: config.batch,
        seed: config.seed,
        eval_every: config.eval_every,
        sample_every: config.sample_every,
        checkpoint_every: config.checkpoint_every,
        keep: config.keep,
    };
    let weights = shares(&*file.body.skeleton(&file.rig)?);
    let network = |start| Training::new(&file, start, [&clips, &valid], weights);
    let first = || initial(&shape, scale(&clips.iter().collect::<Vec<_>>(), file.config.audio), plan.seed);
    train::train(&folder, &plan, &list(&shape), first, network, stop, progress)
}

/// The clips that training reads.
fn is_used(config: &Config) -> impl Fn(&Recording) -> bool {
    let with_valid = config.eval_every > 0 || config.sample_every > 0;
    move |one| one.split == Split::Train || (with_valid && one.split == Split::Valid)
}

/// Sequences of one pass.
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
    let sampled: Vec<(usize, usize)> = (0..config.batch)
        .map(|index| {
            let mut rng = random::stream(config.seed, "music lstm batch", step, index as u64);
            let clip = (rng.next_u64() % clips.len() as u64) as usize;
            (clip, (rng.next_u64() % room(&clips[clip], config) as u64) as usize)
        })
        .collect();
    // one choice for all sequences: the engine forces whole steps
    let mut rng = random::stream(config.seed, "music lstm told", step, 0);
    let forced = (0..config.length).map(|_| random::unit(&mut rng) < config.teacher).collect();
    Batch { forced, ..assembled(clips, channels, config, &sampled) }
}

/// Frames at which a sequence can begin, at least 1: clips have `length` + 1 frames at the network's rate.
fn room(clip: &MusicClip, config: &Config) -> usize {
    clip.recording.clip.frames() - config.length * clip.recording.stride
}

/// The sequences from some frames of clips on, without a teacher-forced step.
fn assembled(clips: &[MusicClip], channels: usize, config: &Config, sampled: &[(usize, usize)]) -> Batch {
    let (t, b, c) = (config.length, config.batch, channels);
    let mut batch = Batch {
        spectra: vec![0.0; t * b * SPECTRUM],
        truth: vec![0.0; t * b * c],
        previous: vec![0.0; t * b * c],
        forced: vec![false; t],
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
    batch
}

/// A network with its data.
struct Training<'a> {
    file: &'a RunFile,
    network: Network,
    parameters: Parameters,
    clips: &'a [MusicClip],
    valid: &'a [MusicClip],
    /// Of joints in the effort.
    weights: Vec<f64>,
    /// (T, B, 4J) gradients of the outputs.
    d_out: Floats,
}

impl Training<'_> {
    fn new<'a>(
        file: &'a RunFile,
        start: Vec<Floats>,
        [clips, valid]: [&'a [MusicClip]; 2],
        weights: Vec<f64>,
    ) -> Training<'a> {
        let config = &file.config;
        let shape = config.shape(weights.len());
        let rows = config.batch * config.length;
        Training {
            network: Network::new(&shape, config.batch, config.length, true),
            parameters: Parameters::new(list(&shape), start),
            d_out: Floats::new(rows * shape.channels()),
            file,
            clips,
            valid,
            weights,
        }
    }

    /// The loss of a batch, whose spectra become standardised; its gradient stays in `d_out`.
    fn pass(&mut self, batch: &mut Batch, dropout: Dropout, effort: Effort) -> Loss {
        let (config, weights) = (&self.file.config, &self.parameters.weights);
        standardise(weights, &mut batch.spectra);
        self.network.pack(weights);
        self.network.rest();
        let forced = TeacherForcing { steps: &batch.forced, rows: &batch.previous };
        let outputs = self.network.forward(weights, &batch.spectra, forced, dropout);
        let terms = Terms { pose: config.pose, effort, parts: config.parts(), weights: &self.weights };
        loss(terms, config.batch, outputs, &batch.truth, &mut self.d_out)
    }
}

impl train::Network for Training<'_> {
    fn gradients(&mut self, step: u64) -> (Loss, Vec<String>) {
        let config = &self.file.config;
        let mut batch = batch(self.clips, 4 * self.weights.len(), config, step);
        let keys: Vec<u64> = (0..config.layers as u64)
            .map(|layer| random::stream(config.seed, "music lstm dropout", step, layer).next_u64())
            .collect();
        let dropout = Dropout { share: config.dropout, keys: &keys };
        let loss = self.pass(&mut batch, dropout, config.effort_of(step));
        let Parameters { weights, optimizer, .. } = &mut self.parameters;
        self.network.backward(weights, &self.d_out, &batch.spectra, dropout, &mut optimizer.gradients);
        (loss, batch.clips.iter().map(|&clip| self.clips[clip].recording.name.clone()).collect())
    }

    /// As dances are generated: without dropout and teacher forcing. With the effort, where the run has one.
    fn measure(&mut self) -> Option<Loss> {
        let config = &self.file.config;
        if self.valid.is_empty() {
            return None;
        }
        let rooms: Vec<usize> = self.valid.iter().map(|clip| room(clip, config)).collect();
        let sampled = spread(config.batch, &rooms);
        let mut batch = assembled(self.valid, 4 * self.weights.len(), config, &sampled);
        Some(self.pass(&mut batch, Dropout { share: 0.0, keys: &[] }, config.effort))
    }

    fn sample(&self) -> Result<(Clip, String)> {
        let Some(clip) = self.valid.iter().chain(self.clips).next() else {
            return Err(Error::missing("clip with music", "a dance is to the music of one"));
        };
        let coder = Coder::new(Form::Quaternion, &self.file.rig)?;
        let trained = Trained {
            run: PathBuf::new(),
            skeleton: self.file.body.skeleton(&self.file.rig)?,
            shape: self.file.config.shape(coder.joints()),
            weights: self.parameters.weights.iter().map(|tensor| Floats::of(tensor)).collect(),
            coder,
            step: 0,
            sha256: String::new(),
            notes: Vec::new(),
            file: self.file.clone(),
        };
        let frames = (SECONDS * FPS).round() as usize;
        let spectra: Vec<f32> = clip.at_rate().into_iter().take(frames * SPECTRUM).collect();
        Ok((trained.dance(&spectra)?, format!("to the music of {}", clip.recording.name)))
    }

    fn parameters(&mut self) -> &mut Parameters {
        &mut self.parameters
    }
}
