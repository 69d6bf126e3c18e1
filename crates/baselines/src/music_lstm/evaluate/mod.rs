//! Evaluation of dances to training, unseen and other music, and of a long dance.
//!
//! All dances, true ones too, are measured on the run's body with a fixed root, at 30 frames a second.

mod metrics;
mod report;

pub use metrics::{LongDance, Metrics};
pub use report::{Report, Row};

use super::data::{MusicClip, MusicClips};
use super::run::Trained;
use crate::data::Recording;
use crate::{Error, FPS, Result};
use kinelm_corpus::Split;
use kinelm_evaluate::dance::freeze;
use kinelm_motion::{Clip, Quat, Vec3};
use metrics::{One, energy};
use std::time::Instant;

/// What is measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// The split whose music isn't in training.
    pub split: Split,
    /// Frames of the long dance.
    pub frames: usize,
    /// Cutoff of the low-pass filter of the filtered jitter, Hz.
    pub cutoff_hz: f64,
}

/// A true dance with its music.
struct True<'a> {
    source: &'a MusicClip,
    clip: Clip,
    spectra: Vec<f32>,
}

/// Measures a network on the clips and the music of its own run, those of a second and more; `progress` receives the number
/// of frames done.
///
/// # Errors
/// What reading fails with; clips or music that have changed since the run was begun; no clip with music in a split; a
/// network that diverges.
pub fn evaluate(trained: &Trained, options: &Options, progress: &mut dyn FnMut(usize)) -> Result<Report> {
    if options.frames < FPS as usize {
        return Err(Error::invalid_parameter("frames", options.frames, format!("{FPS} or more")));
    }
    let splits = [Split::Train, options.split];
    let measured = |one: &Recording| splits.contains(&one.split) && one.frames() >= FPS as usize;
    let (_, clips) = trained.file.clips(&trained.run, measured)?;
    let [training, unseen] = splits.map(|split| truths(trained, &clips, split));
    let (training, unseen) = (training?, unseen?);
    let still: Vec<f64> = training.iter().flat_map(|one| energy(&one.clip)).collect();
    let threshold = freeze::threshold(still)
        .ok_or_else(|| Error::missing("training frames", "the threshold of standing still is theirs"))?;
    let mean = mean_pose(&training);
    let mut rows = Vec::new();
    let mut done = 0;
    for (split, all) in [(splits[0], &training), (splits[1], &unseen)] {
        let own: Vec<Clip> = all.iter().map(|one| trained.dance(&one.spectra)).collect::<Result<_>>()?;
        done += own.iter().map(Clip::frames).sum::<usize>();
        progress(done);
        let mut to_other = Vec::new();
        for (i, one) in all.iter().enumerate() {
            let Some(other) = other(all, i) else { continue };
            let clip = trained.dance(&other.spectra)?;
            done += clip.frames();
            to_other.push((one, clip, &own[i]));
        }
        progress(done);
        let of = |dance: &Clip, one: &True, own: Option<&Clip>| {
            One::of(&one.source.recording.take, dance, &one.clip, own, &mean, threshold, options.cutoff_hz)
        };
        let ones = all.iter().zip(&own).map(|(one, clip)| of(clip, one, None)).collect::<Result<Vec<_>>>()?;
        let others = to_other.iter().map(|(one, clip, own)| of(clip, one, Some(*own))).collect::<Result<Vec<_>>>()?;
        let real = all.iter().map(|one| of(&one.clip, one, None)).collect::<Result<Vec<_>>>()?;
        rows.push(Row { split: split.to_string(), music: "none: the true dances".into(), metrics: Metrics::of(&real) });
        rows.push(Row { split: split.to_string(), music: "the clips' own".into(), metrics: Metrics::of(&ones) });
        if !others.is_empty() {
            rows.push(Row { split: split.to_string(), music: "other clips'".into(), metrics: Metrics::of(&others) });
        }
    }
    let long = long(trained, &unseen, options.frames, threshold)?;
    Ok(Report::new(trained, options, threshold, rows, long))
}

fn truths<'a>(trained: &Trained, clips: &'a MusicClips, split: Split) -> Result<Vec<True<'a>>> {
    let all: Vec<True> = clips
        .split(split)
        .map(|source| {
            let clip = source.recording.at_rate()?;
            // generated dances have no root position, so the true ones get the same fixed one
            let root = vec![Vec3::from(trained.file.body.place); clip.frames()];
            let clip = Clip::new(trained.skeleton.clone(), FPS, root, clip.rotations().to_vec())?;
            Ok(True { source, clip, spectra: source.at_rate() })
        })
        .collect::<Result<_>>()?;
    match all.is_empty() {
        true => Err(Error::missing(format!("{split} clip with music"), "take another split")),
        false => Ok(all),
    }
}

/// A dance to other music than the `i`-th: of another genre, if there is one.
fn other<'a, 'b>(all: &'a [True<'b>], i: usize) -> Option<&'a True<'b>> {
    let genre = |one: &True| one.source.recording.item.labels.get("genre").cloned();
    let after = || (1..all.len()).map(|by| &all[(i + by) % all.len()]);
    let foreign = after().find(|one| genre(one) != genre(&all[i]) && one.source.music != all[i].source.music);
    foreign.or_else(|| after().find(|one| one.source.music != all[i].source.music))
}

/// (J) the mean rotations of some dances: the best constant output.
fn mean_pose(all: &[True]) -> Vec<Quat> {
    let joints = all.first().map_or(0, |one| one.clip.joints());
    let mut sums = vec![Quat::from_xyzw(0.0, 0.0, 0.0, 0.0); joints];
    for frame in all.iter().flat_map(|one| one.clip.rotations().chunks_exact(joints)) {
        // q and -q are one rotation: summed on one side
        sums.iter_mut().zip(frame).for_each(|(sum, q)| *sum += *q * if sum.dot(*q) < 0.0 { -1.0 } else { 1.0 });
    }
    // rotations that cancel have no mean
    sums.into_iter().map(|sum| if sum.length() > 1e-9 { sum.normalize() } else { Quat::IDENTITY }).collect()
}

/// A long dance to all unseen music, piece after piece, repeated.
fn long(trained: &Trained, unseen: &[True], frames: usize, threshold: f64) -> Result<LongDance> {
    let spectra: Vec<&[f32]> = unseen.iter().flat_map(|one| one.spectra.chunks_exact(super::SPECTRUM)).collect();
    let begun = Instant::now();
    let mut dancer = trained.dancer();
    spectra.iter().cycle().take(frames).for_each(|frame| dancer.push(frame));
    let clip = dancer.finish()?;
    Ok(LongDance::of(&clip, threshold, begun.elapsed().as_secs_f64()))
}
