//! Where dances begin, and what they are measured by: seeds of the clips, how real ones move.

use super::figures::Moves;
use super::{COMPARED, Energy, Options, of_real};
use crate::aclstm::FPS;
use crate::aclstm::data::{Recording, Recordings};
use crate::aclstm::run::Trained;
use crate::{Error, Result};
use kinelm_corpus::Split;
use kinelm_evaluate::dance::freeze;
use kinelm_motion::{Clip, Motion, Source};
use std::path::Path;

/// A place of a clip where seeds of every length end.
pub struct Seed {
    /// `seed-01` and so on.
    pub name: String,
    /// The recording it is of.
    pub take: String,
    /// The whole clip at the network's rate.
    pub clip: Clip,
    /// Its first frame that is foretold.
    pub at: usize,
}

impl Seed {
    /// Its frames: those before the first that is foretold.
    pub fn motion(&self, frames: usize, path: &Path) -> Motion {
        let clip = self.clip.slice(self.at - frames..self.at);
        Motion { path: path.into(), clip, source: Source::Plain, warnings: vec![] }
    }
}

/// What a network is put to.
pub struct Test {
    /// Spread evenly over the clips that are long enough, and in each of them.
    pub seeds: Vec<Seed>,
    /// Below it a dance stands still, cm/s: in the world, and with the hip held at 0.
    pub(super) thresholds: [f64; 2],
    /// The split's clips: how they move, and their steps with a flip.
    pub(super) real: Vec<(Moves, [usize; 2])>,
}

impl Test {
    /// Of the clips of a run's own sources.
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
            freeze::threshold(all).ok_or_else(|| Error::call("no training frames to tell standing from moving"))
        };
        let thresholds = [threshold(|e| &e.world)?, threshold(|e| &e.pose)?];
        let real =
            recordings.split(options.split).map(|one| of_real(&one.at_rate()?, thresholds)).collect::<Result<_>>()?;
        Ok(Test { seeds, thresholds, real })
    }
}

fn seeds(recordings: &Recordings, options: &Options) -> Result<Vec<Seed>> {
    let longest = options.longest();
    let needed = longest + COMPARED + 1;
    let long: Vec<&Recording> = recordings.split(options.split).filter(|one| one.frames() >= needed).collect();
    if long.is_empty() {
        let what = format!("no {} clip of {needed} frames at {FPS} a second", options.split);
        return Err(Error::call(format!("{what}: take shorter seeds, or another split")));
    }
    let digits = options.seeds.to_string().len().max(2);
    let mut seeds = Vec::new();
    for (i, one) in long.iter().enumerate() {
        let clip = one.at_rate()?;
        let count = (options.seeds + long.len() - 1 - i) / long.len();
        let room = clip.frames() - needed;
        for k in 0..count {
            let at = longest + room * (2 * k + 1) / (2 * count);
            let name = format!("seed-{:0digits$}", seeds.len() + 1);
            seeds.push(Seed { name, take: one.take.clone(), clip: clip.clone(), at });
        }
    }
    Ok(seeds)
}
