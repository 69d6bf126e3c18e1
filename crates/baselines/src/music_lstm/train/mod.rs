//! Training: from motion and music files to a run folder.

#[cfg(test)]
mod tests;

pub use kinelm_train::updates::{Event, Figures, Summary};

use super::HEARD;
use super::config::Config;
use super::data::{Danced, Dances, Places, learned, standard};
use super::effort::shares;
use super::loss::{Asked as Wanted, loss};
use super::network::{Dropped, Network, initial, list, standardise};
use super::run::RunFile;
use crate::Result;
use crate::aclstm::data::{Recording, Recordings};
use kinelm_corpus::Split;
use kinelm_engine::arena::Floats;
use kinelm_engine::lstm::TeacherForcing;
use kinelm_store::random;
use kinelm_train::folder::RunFolder;
use kinelm_train::learner::listed;
use kinelm_train::parameters::Parameters;
use kinelm_train::updates;
use kinelm_train::updates::Plan;
use rand_chacha::rand_core::RngCore;
use rayon::prelude::*;
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// What to train.
#[derive(Debug, Clone)]
#[allow(clippy::large_enum_variant)] // a call has one
pub enum Asked {
    /// A new run.
    New(Config, Places),
    /// One that is there, to so many steps if they are said.
    Resumed(Option<u64>),
}

/// Trains a network, or goes on with one where its last whole checkpoint stands: to the same bits as if it had never
/// stopped, on the same kind of processor. It works on the rayon pool that it is called in; the number of threads changes
/// nothing.
///
/// # Errors
/// A run folder that is there or, to go on, isn't; clips that are none, on several rigs, without music, too short or, to go
/// on, others than they were; music that is silent or too short; a loss that is no number; what the system refuses.
pub fn train(run: &Path, asked: &Asked, stop: &AtomicBool, hear: &mut dyn FnMut(Event)) -> Result<Summary> {
    let (folder, file, dances) = match asked {
        Asked::New(config, places) => begin(run, config, places, hear)?,
        Asked::Resumed(steps) => found(run, *steps, hear)?,
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
    let learner = |start| Learning::new(config, start, &dances, weights);
    let first = || initial(&shape, standard(&dances.iter().collect::<Vec<_>>(), file.config.audio), plan.seed);
    updates::train(&folder, &plan, &list(&shape), (first, learner), stop, hear)
}

type Ready = (RunFolder, RunFile, Vec<Danced>);

fn is_learned(one: &Recording) -> bool {
    one.split == Split::Train
}

fn begin(run: &Path, config: &Config, places: &Places, hear: &mut dyn FnMut(Event)) -> Result<Ready> {
    config.validate()?;
    let recordings = Recordings::load(&places.motion, config.margin, None)?;
    let dances = Dances::hear(&recordings, places, config.audio, config.margin, is_learned)?;
    let file = RunFile::new(config, places, &recordings, &dances);
    let all = told(&recordings, dances, config, hear)?;
    // whatever is refused must not leave an empty run behind
    let folder = RunFolder::create(run)?;
    file.write(run)?;
    Ok((folder, file, all))
}

fn found(run: &Path, steps: Option<u64>, hear: &mut dyn FnMut(Event)) -> Result<Ready> {
    let folder = RunFolder::open(run)?;
    let mut file = RunFile::read(run)?;
    let (recordings, dances) = file.dances(run, is_learned)?;
    if let Some(steps) = steps.filter(|steps| *steps != file.config.steps) {
        updates::check_steps(run, steps)?;
        file.config.steps = steps;
        file.config.validate()?;
        file.write(run)?;
    }
    let all = told(&recordings, dances, &file.config, hear)?;
    Ok((folder, file, all))
}

fn told(recordings: &Recordings, dances: Dances, config: &Config, hear: &mut dyn FnMut(Event)) -> Result<Vec<Danced>> {
    recordings.said.iter().chain(&dances.said).for_each(|line| hear(Event::Note(line)));
    let (all, short) = learned(dances, config)?;
    if !short.is_empty() {
        let (n, which) = (short.len(), listed(short.iter()));
        hear(Event::Note(&format!("{n} training clips are too short for a sequence: {which}")));
    }
    Ok(all)
}

/// What an update sees.
pub struct Batch {
    /// (T, B, N) spectra, as they were heard.
    pub heard: Vec<f32>,
    /// (T, B, 4J) true frames, and those before them.
    pub truth: Vec<f32>,
    /// The same, a step earlier.
    pub before: Vec<f32>,
    /// (T) at which steps the last layer sees the frame before.
    pub told: Vec<bool>,
    /// (B) the clips.
    pub clips: Vec<usize>,
}

/// The sequences of update `step`, counted from 0: any clip with equal chance, any place in it. A function of the seed and
/// of the update.
pub fn batch(dances: &[Danced], channels: usize, config: &Config, step: u64) -> Batch {
    let (t, b, c) = (config.length, config.batch, channels);
    let drawn: Vec<(usize, usize)> = (0..b)
        .map(|index| {
            let mut rng = random::stream(config.seed, "music lstm batch", step, index as u64);
            let clip = (rng.next_u64() % dances.len() as u64) as usize;
            let recording = &dances[clip].recording;
            let room = recording.clip.frames() - t * recording.stride;
            (clip, (rng.next_u64() % room as u64) as usize)
        })
        .collect();
    let mut batch = Batch {
        heard: vec![0.0; t * b * HEARD],
        truth: vec![0.0; t * b * c],
        before: vec![0.0; t * b * c],
        told: Vec::new(),
        clips: drawn.iter().map(|(clip, _)| *clip).collect(),
    };
    let frame = |i: usize, late: usize| {
        let (clip, first) = drawn[i % b];
        (&dances[clip], first + (i / b + late) * dances[clip].recording.stride)
    };
    let rows = batch.heard.par_chunks_mut(HEARD).enumerate();
    rows.for_each(|(i, row)| {
        let (dance, at) = frame(i, 1);
        row.copy_from_slice(dance.at(at));
    });
    for (late, to) in [&mut batch.before, &mut batch.truth].into_iter().enumerate() {
        for (i, row) in to.chunks_exact_mut(c).enumerate() {
            let (dance, at) = frame(i, late);
            row.copy_from_slice(&dance.poses[at * c..][..c]);
        }
    }
    let mut rng = random::stream(config.seed, "music lstm told", step, 0);
    batch.told = (0..t).map(|_| random::unit(&mut rng) < config.teacher).collect();
    batch
}

/// A network that learns, with what it learns from.
struct Learning<'a> {
    config: Config,
    network: Network,
    parameters: Parameters,
    dances: &'a [Danced],
    weights: Vec<f64>,
    pull: Floats,
}

impl Learning<'_> {
    fn new<'a>(config: Config, start: Vec<Floats>, dances: &'a [Danced], weights: Vec<f64>) -> Learning<'a> {
        let shape = config.shape(weights.len());
        let size = (config.batch, config.length);
        Learning {
            network: Network::new(&shape, size, true),
            parameters: Parameters::new(list(&shape), start),
            pull: Floats::new(size.0 * size.1 * shape.channels()),
            dances,
            weights,
            config,
        }
    }
}

impl updates::Learner for Learning<'_> {
    fn gradients(&mut self, step: u64) -> (f64, Vec<String>) {
        let config = &self.config;
        let mut seen = batch(self.dances, 4 * self.weights.len(), config, step);
        let keys: Vec<u64> = (0..config.layers as u64)
            .map(|layer| random::stream(config.seed, "music lstm dropout", step, layer).next_u64())
            .collect();
        let dropped = Dropped { share: config.dropout, keys: &keys };
        let weights = &self.parameters.weights;
        standardise(weights, &mut seen.heard);
        self.network.pack(weights);
        self.network.rest();
        let told = TeacherForcing { steps: &seen.told, rows: &seen.before };
        let outputs = self.network.forward(weights, &seen.heard, told, dropped);
        let effort = config.effort_of(step);
        let asked = Wanted { pose: config.pose, effort, weights: &self.weights };
        let loss = loss(asked, config.batch, outputs, &seen.truth, &mut self.pull);
        self.network.backward(weights, &self.pull, &seen.heard, dropped, &mut self.parameters.gradients);
        (loss, seen.clips.iter().map(|&clip| self.dances[clip].recording.name.clone()).collect())
    }

    fn parameters(&mut self) -> &mut Parameters {
        &mut self.parameters
    }
}
