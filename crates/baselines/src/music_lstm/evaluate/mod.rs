//! What dances to heard, unheard and other music are like, and for how long one moves.
//!
//! All dances, true ones too, are measured on the run's body with its root in one place, at 30 frames a second.

mod figures;
mod report;

pub use figures::{Figures, Lasting};
pub use report::{Report, Row};

use super::FPS;
use super::data::{Danced, Dances};
use super::run::Trained;
use crate::aclstm::data::Recording;
use crate::{Error, Result};
use figures::{One, energy};
use kinelm_corpus::Split;
use kinelm_evaluate::dance::freeze;
use kinelm_motion::{Clip, Quat, Vec3};
use std::time::Instant;

/// What is measured.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// The split whose music wasn't heard in training.
    pub unheard: Split,
    /// Frames of the long dance.
    pub frames: usize,
    /// Frequency of the filter that dances are measured behind too, Hz.
    pub cutoff_hz: f64,
}

/// A true dance with its music.
struct True<'a> {
    danced: &'a Danced,
    clip: Clip,
    heard: Vec<f32>,
}

/// Measures a network on the clips and the music of its own run, those of a second and more; `progress` is told the frames
/// made.
///
/// # Errors
/// What reading and hearing fail with; clips or music that have changed since the run was begun; no clip with music in a split; a network that runs away.
pub fn evaluate(trained: &Trained, options: &Options, progress: &mut dyn FnMut(usize)) -> Result<Report> {
    if options.frames < FPS as usize {
        return Err(Error::call(format!("{} frames of the long dance; expected {FPS} or more", options.frames)));
    }
    let splits = [Split::Train, options.unheard];
    let measured = |one: &Recording| splits.contains(&one.split) && one.frames() >= FPS as usize;
    let (_, dances) = trained.file.dances(&trained.run, measured)?;
    let [heard, unheard] = splits.map(|split| truths(trained, &dances, split));
    let (heard, unheard) = (heard?, unheard?);
    let still: Vec<f64> = heard.iter().flat_map(|one| energy(&one.clip)).collect();
    let threshold =
        freeze::threshold(still).ok_or_else(|| Error::call("no training frames to tell rest from movement"))?;
    let mean = mean_pose(&heard);
    let mut rows = Vec::new();
    let mut done = 0;
    for (split, all) in [(splits[0], &heard), (splits[1], &unheard)] {
        let own: Vec<Clip> = all.iter().map(|one| trained.dance(&one.heard)).collect::<Result<_>>()?;
        done += own.iter().map(Clip::frames).sum::<usize>();
        progress(done);
        let mut made = Vec::new();
        for (i, one) in all.iter().enumerate() {
            let Some(other) = other(all, i) else { continue };
            let clip = trained.dance(&other.heard)?;
            done += clip.frames();
            made.push((one, clip, &own[i]));
        }
        progress(done);
        let of = |made: &Clip, one: &True, own: Option<&Clip>| {
            One::of((&one.danced.recording.take, made), &one.clip, own, &mean, (threshold, options.cutoff_hz))
        };
        let ones = all.iter().zip(&own).map(|(one, clip)| of(clip, one, None)).collect::<Result<Vec<_>>>()?;
        let others = made.iter().map(|(one, clip, own)| of(clip, one, Some(*own))).collect::<Result<Vec<_>>>()?;
        let real = all.iter().map(|one| of(&one.clip, one, None)).collect::<Result<Vec<_>>>()?;
        rows.push(Row { split: split.to_string(), music: "none: the true dances".into(), figures: Figures::of(&real) });
        rows.push(Row { split: split.to_string(), music: "the clips' own".into(), figures: Figures::of(&ones) });
        if !others.is_empty() {
            rows.push(Row { split: split.to_string(), music: "other clips'".into(), figures: Figures::of(&others) });
        }
    }
    let lasting = long(trained, &unheard, options.frames, threshold)?;
    Ok(Report::new(trained, options, threshold, rows, lasting))
}

fn truths<'a>(trained: &Trained, dances: &'a Dances, split: Split) -> Result<Vec<True<'a>>> {
    let all: Vec<True> = dances
        .split(split)
        .map(|danced| {
            let clip = danced.recording.at_rate()?;
            let root = vec![Vec3::from(trained.file.body.place); clip.frames()];
            let clip = Clip::new(trained.skeleton.clone(), FPS, root, clip.rotations().to_vec())?;
            Ok(True { danced, clip, heard: danced.at_rate() })
        })
        .collect::<Result<_>>()?;
    match all.is_empty() {
        true => Err(Error::call(format!("no {split} clip with music; take another split"))),
        false => Ok(all),
    }
}

/// A dance of other music than the `i`-th: of another genre, where that is known and there is one.
fn other<'a, 'b>(all: &'a [True<'b>], i: usize) -> Option<&'a True<'b>> {
    let genre = |one: &True| one.danced.recording.item.labels.get("genre").cloned();
    let after = || (1..all.len()).map(|by| &all[(i + by) % all.len()]);
    let foreign = after().find(|one| genre(one) != genre(&all[i]) && one.danced.music != all[i].danced.music);
    foreign.or_else(|| after().find(|one| one.danced.music != all[i].danced.music))
}

/// (J) the mean rotations of some dances: what a network that hears nothing would do best to show.
fn mean_pose(all: &[True]) -> Vec<Quat> {
    let joints = all.first().map_or(0, |one| one.clip.joints());
    let mut sums = vec![Quat::from_xyzw(0.0, 0.0, 0.0, 0.0); joints];
    for frame in all.iter().flat_map(|one| one.clip.rotations().chunks_exact(joints)) {
        sums.iter_mut().zip(frame).for_each(|(sum, q)| *sum += *q * if sum.dot(*q) < 0.0 { -1.0 } else { 1.0 });
    }
    sums.into_iter().map(|sum| if sum.length() > 1e-9 { sum.normalize() } else { Quat::IDENTITY }).collect()
}

/// A long dance to all unheard music, piece after piece, round and round.
fn long(trained: &Trained, unheard: &[True], frames: usize, threshold: f64) -> Result<Lasting> {
    let heard: Vec<&[f32]> = unheard.iter().flat_map(|one| one.heard.chunks_exact(super::HEARD)).collect();
    let begun = Instant::now();
    let mut dancer = trained.dancer();
    heard.iter().cycle().take(frames).for_each(|frame| dancer.hear(frame));
    let clip = dancer.finish()?;
    Ok(Lasting::of(&clip, threshold, begun.elapsed().as_secs_f64()))
}
