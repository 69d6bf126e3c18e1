//! Evaluation of a network's rollouts: the error of the next 20 frames, and for how long they move. Dances of another
//! program that continue the same seeds are measured likewise.
//!
//! Seeds of all lengths end at the same frames, so that all lengths predict the same ones.

mod curves;
mod dances;
mod metrics;
mod report;
mod saved;
mod seed_lengths;
mod seeds;

pub use curves::{Curves, charts};
pub use dances::evaluate_dances;
pub use metrics::{Duration, Metrics};
pub use report::{Report, Row};
pub use seed_lengths::{SeedLengths, seed_charts};
pub use seeds::{Seed, Test};

use super::run::Trained;
use crate::{Error, Result};
use kinelm_corpus::Split;
use metrics::{Energy, Rollout, of_real};

/// Frames that are compared with the true ones: two thirds of a second.
pub(crate) const COMPARED: usize = 20;
/// Frames over which duration is measured, besides all.
pub const SHORT: usize = 400;

/// What is measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// The split of the seeds.
    pub split: Split,
    /// Seeds of each length.
    pub seeds: usize,
    /// Lengths of seeds, frames.
    pub lengths: Vec<usize>,
    /// Frames to generate from each.
    pub frames: usize,
}

impl Options {
    fn check(&self) -> Result<()> {
        match () {
            () if self.seeds == 0 => Err(Error::invalid_parameter("seeds", 0, "1 or more")),
            () if self.longest() == 0 || self.lengths.contains(&0) => {
                Err(Error::invalid_parameter("seed_frames", format!("{:?}", self.lengths), "lengths of 1 or more"))
            }
            () if self.frames < SHORT => {
                Err(Error::invalid_parameter("frames", self.frames, format!("{SHORT} or more")))
            }
            () => Ok(()),
        }
    }

    fn longest(&self) -> usize {
        self.lengths.iter().copied().max().unwrap_or(0)
    }
}

/// Measures a network on the clips of its own run's sources; `progress` receives the number of frames done.
///
/// # Errors
/// What reading fails with; no clip of the split that is long enough; a network that diverges.
pub fn evaluate(trained: &Trained, options: &Options, progress: &mut dyn FnMut(usize)) -> Result<Report> {
    let test = Test::load(trained, options)?;
    let c = trained.coder.channels();
    let mut rows = Vec::new();
    for (i, &length) in options.lengths.iter().enumerate() {
        let of = |seed: &Seed| trained.coder.frames(&seed.clip.slice(seed.at - length..seed.at + COMPARED + 1));
        let frames: Vec<Vec<f64>> = test.seeds.iter().map(of).collect();
        let inputs: Vec<&[f64]> = frames.iter().map(|frames| &frames[..(length + 1) * c]).collect();
        let rollouts = trained.roll_out(&inputs, options.frames, &mut |done| progress(i * options.frames + done))?;
        let all = test.seeds.iter().zip(frames.iter().zip(&rollouts));
        let each: Vec<(&str, Rollout)> = all
            .map(|(seed, (frames, steps))| {
                let last = &frames[(length - 1) * c..length * c];
                let found = Rollout::of(trained, last, &frames[length * c..], steps, &seed.clip, test.thresholds)?;
                Ok((&*seed.take, found))
            })
            .collect::<Result<_>>()?;
        rows.push(Row { seed_frames: length, metrics: Metrics::of(&each) });
    }
    let seeds: Vec<&Seed> = test.seeds.iter().collect();
    Ok(Report::new(trained, options, &test, &seeds, rows))
}
