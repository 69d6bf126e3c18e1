//! How well a network goes on: its next 20 frames, and for how long it moves.
//!
//! Every seed ends at the same places, whatever its length, so that all lengths foretell the same frames.

mod figures;
mod report;

pub use figures::{Figures, Lasting, Mean};
pub use report::{Report, Row};

use super::FPS;
use super::data::{Recording, Recordings};
use super::run::Trained;
use crate::corpus::Split;
use crate::evaluate::dance::freeze;
use crate::{Error, Result};
use figures::{Continued, Energy, of_real};

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

/// Where seeds end: a recording and a frame of it at the network's rate, the first that is foretold.
struct Place<'a> {
    take: &'a str,
    clip: kinelm_motion::Clip,
    at: usize,
}

/// Measures a network on the clips of its own run's sources; `progress` is told the frames made, of all.
///
/// # Errors
/// What reading fails with; no clip of the split that is long enough; a network that runs away.
pub fn evaluate(trained: &Trained, options: &Options, progress: &mut dyn FnMut(usize)) -> Result<Report> {
    let longest = options.lengths.iter().copied().max().unwrap_or(0);
    if options.lengths.contains(&0) || longest == 0 || options.seeds == 0 || options.frames < SHORT {
        let what =
            format!("seeds, lengths and frames; expected 1 seed or more, of 1 frame or more, and {SHORT} frames");
        return Err(Error::Call(what));
    }
    let recordings = Recordings::load(&trained.file.sources, trained.file.config.margin, Some(&trained.file.rig))?;
    let places = places(&recordings, options, longest)?;
    let real =
        recordings.split(Split::Train).map(|one| Energy::of_clip(&one.at_rate()?)).collect::<Result<Vec<_>>>()?;
    let threshold = |pick: fn(&Energy) -> &Vec<f64>| {
        let all = real.iter().flat_map(|energy| pick(energy).iter().copied()).collect();
        freeze::threshold(all).ok_or_else(|| Error::Call("no training frames to tell standing from moving".into()))
    };
    let thresholds = [threshold(|e| &e.world)?, threshold(|e| &e.pose)?];
    let truth =
        recordings.split(options.split).map(|one| of_real(&one.at_rate()?, thresholds)).collect::<Result<_>>()?;
    let mut rows = Vec::new();
    for (i, &length) in options.lengths.iter().enumerate() {
        let of = |place: &Place| trained.coder.frames(&place.clip.slice(place.at - length..place.at + COMPARED + 1));
        let frames: Vec<Vec<f64>> = places.iter().map(of).collect();
        let c = trained.coder.channels();
        let seeds: Vec<&[f64]> = frames.iter().map(|frames| &frames[..(length + 1) * c]).collect();
        let made = trained.go_on(&seeds, options.frames, &mut |done| progress(i * options.frames + done))?;
        let all = places.iter().zip(frames.iter().zip(&made));
        let each: Vec<(&str, Continued)> = all
            .map(|(place, (frames, made))| {
                let truth = &frames[length * c..];
                Ok((
                    place.take,
                    Continued::of(
                        trained,
                        &frames[(length - 1) * c..length * c],
                        truth,
                        made,
                        &place.clip,
                        thresholds,
                    )?,
                ))
            })
            .collect::<Result<_>>()?;
        rows.push(Row { seed_frames: length, figures: Figures::of(&each) });
    }
    let mut takes: Vec<&str> = places.iter().map(|place| place.take).collect();
    takes.sort_unstable();
    takes.dedup();
    Ok(Report::new(trained, options, (places.len(), takes.len()), thresholds, truth, rows))
}

/// Places spread evenly over the clips that are long enough, and in each of them.
fn places<'a>(recordings: &'a Recordings, options: &Options, longest: usize) -> Result<Vec<Place<'a>>> {
    let needed = longest + COMPARED + 1;
    let long: Vec<&Recording> = recordings.split(options.split).filter(|one| one.frames() >= needed).collect();
    if long.is_empty() {
        let what = format!("no {} clip of {needed} frames at {FPS} a second", options.split);
        return Err(Error::Call(format!("{what}: take shorter seeds, or another split")));
    }
    let mut places = Vec::new();
    for (i, one) in long.iter().enumerate() {
        let clip = one.at_rate()?;
        let count = (options.seeds + long.len() - 1 - i) / long.len();
        let room = clip.frames() - needed;
        for k in 0..count {
            let at = longest + room * (2 * k + 1) / (2 * count);
            places.push(Place { take: &one.take, clip: clip.clone(), at });
        }
    }
    Ok(places)
}
