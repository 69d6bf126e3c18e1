//! How well a network goes on: its next 20 frames, and for how long it moves; and the same of any dances that go on from
//! the same seeds, whatever made them.
//!
//! Every seed ends at the same places, whatever its length, so that all lengths foretell the same frames.

mod curves;
mod dances;
mod figures;
mod report;
mod seeds;

pub use curves::{Curves, charts};
pub use dances::evaluate_dances;
pub use figures::{Figures, Lasting, Mean};
pub use report::{Report, Row};
pub use seeds::{Seed, Test};

use super::FPS;
use super::run::Trained;
use crate::{Error, Result};
use figures::{Continued, Energy, of_real};
use kinelm_corpus::Split;

/// Frames that are compared with the true ones: two thirds of a second.
pub const COMPARED: usize = 20;
/// Frames over which it is seen whether dances last, besides all that are made.
pub const SHORT: usize = 400;

/// What is measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Whose clips the seeds are from.
    pub split: Split,
    /// Seeds of each length.
    pub seeds: usize,
    /// Frames of a seed.
    pub lengths: Vec<usize>,
    /// Frames that are made of each.
    pub frames: usize,
}

impl Options {
    fn check(&self) -> Result<()> {
        if self.lengths.contains(&0) || self.lengths.is_empty() || self.seeds == 0 || self.frames < SHORT {
            let what =
                format!("seeds, lengths and frames; expected 1 seed or more, of 1 frame or more, and {SHORT} frames");
            return Err(Error::call(what));
        }
        Ok(())
    }

    fn longest(&self) -> usize {
        self.lengths.iter().copied().max().unwrap_or(0)
    }
}

/// Measures a network on the clips of its own run's sources; `progress` is told the frames made, of all.
///
/// # Errors
/// What reading fails with; no clip of the split that is long enough; a network that runs away.
pub fn evaluate(trained: &Trained, options: &Options, progress: &mut dyn FnMut(usize)) -> Result<Report> {
    let test = Test::load(trained, options)?;
    let c = trained.coder.channels();
    let mut rows = Vec::new();
    for (i, &length) in options.lengths.iter().enumerate() {
        let of = |seed: &Seed| trained.coder.frames(&seed.clip.slice(seed.at - length..seed.at + COMPARED + 1));
        let frames: Vec<Vec<f64>> = test.seeds.iter().map(of).collect();
        let driven: Vec<&[f64]> = frames.iter().map(|frames| &frames[..(length + 1) * c]).collect();
        let made = trained.go_on(&driven, options.frames, &mut |done| progress(i * options.frames + done))?;
        let all = test.seeds.iter().zip(frames.iter().zip(&made));
        let each: Vec<(&str, Continued)> = all
            .map(|(seed, (frames, made))| {
                let last = &frames[(length - 1) * c..length * c];
                let found = Continued::of(trained, last, &frames[length * c..], made, &seed.clip, test.thresholds)?;
                Ok((&*seed.take, found))
            })
            .collect::<Result<_>>()?;
        rows.push(Row { seed_frames: length, figures: Figures::of(&each) });
    }
    let seeds: Vec<&Seed> = test.seeds.iter().collect();
    Ok(Report::new(trained, options, &test, &seeds, rows))
}
