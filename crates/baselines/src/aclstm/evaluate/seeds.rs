//! The seeds of rollouts, and the thresholds and real clips that they are compared to.

use super::metrics::Movement;
use super::{COMPARED, Energy, Options, of_real};
use crate::aclstm::run::Trained;
use crate::data::{Recording, Recordings};
use crate::{Error, FPS, Result};
use kinelm_corpus::Split;
use kinelm_evaluate::dance::freeze;
use kinelm_motion::{Clip, Motion};
use std::path::Path;

/// A frame of a clip at which seeds of every length end.
pub struct Seed {
    /// `seed-01` and so on.
    pub name: String,
    /// Its recording.
    pub take: String,
    /// The whole clip at the network's rate.
    pub clip: Clip,
    /// The first predicted frame.
    pub at: usize,
}

impl Seed {
    /// The last `frames` frames before the first predicted one.
    pub fn motion(&self, frames: usize, path: &Path) -> Motion {
        let clip = self.clip.slice(self.at - frames..self.at);
        Motion::new(path, clip)
    }
}

/// The test of a network.
pub struct Test {
    /// Evenly spread over the clips that are long enough, and in each of them.
    pub seeds: Vec<Seed>,
    /// Energy below which a dance is still, cm/s: in the world, and with the hip fixed at 0.
    pub(super) thresholds: [f64; 2],
    /// The split's clips: their movement, and their steps with a flip.
    pub(super) real: Vec<(Movement, [usize; 2])>,
}

impl Test {
    /// The test on the clips of a run's own sources.
    ///
    /// # Errors
    /// What reading fails with; clips that have changed since the run was begun; no clip of the split that is long enough.
    pub fn load(trained: &Trained, options: &Options) -> Result<Test> {
        options.check()?;
        let recordings = trained.file.recordings(&trained.run)?;
        let seeds = seeds(&recordings, options)?;
        let train =
            recordings.split(Split::Train).map(|one| Energy::of_clip(&one.at_rate()?)).collect::<Result<Vec<_>>>()?;
        let threshold = |pick: fn(&Energy) -> &Vec<f64>| {
            let all = train.iter().flat_map(|energy| pick(energy).iter().copied()).collect();
            freeze::threshold(all)
                .ok_or_else(|| Error::missing("training frames", "the threshold of standing still is theirs"))
        };
        let thresholds = [threshold(|e| &e.world)?, threshold(|e| &e.pose)?];
        let real =
            recordings.split(options.split).map(|one| of_real(&one.at_rate()?, thresholds)).collect::<Result<_>>()?;
        Ok(Test { seeds, thresholds, real })
    }
}

fn seeds(recordings: &Recordings, options: &Options) -> Result<Vec<Seed>> {
    let longest = options.longest();
    // one more frame: the last compared step leads to it
    let needed = longest + COMPARED + 1;
    let long: Vec<&Recording> = recordings.split(options.split).filter(|one| one.frames() >= needed).collect();
    if long.is_empty() {
        let what = format!("{} clip of {needed} frames at {FPS} a second", options.split);
        return Err(Error::missing(what, "take shorter seeds, or another split"));
    }
    let digits = options.seeds.to_string().len().max(2);
    let mut seeds = Vec::new();
    for (i, one) in long.iter().enumerate() {
        let clip = one.at_rate()?;
        // seeds that don't divide evenly go to the first clips
        let count = (options.seeds + long.len() - 1 - i) / long.len();
        let room = clip.frames() - needed;
        for k in 0..count {
            // the middle of the k-th of `count` equal parts of the room
            let at = longest + room * (2 * k + 1) / (2 * count);
            let name = format!("seed-{:0digits$}", seeds.len() + 1);
            seeds.push(Seed { name, take: one.take.clone(), clip: clip.clone(), at });
        }
    }
    Ok(seeds)
}
