//! A database to measure searches with.

use super::database::Database;
use super::embedding::Models;
use super::extract::FeatureExtractor;
use super::options::{FeatureKind, IndexOptions};
use super::part::Part;
use super::record::ClipEntry;
use crate::{Error, Result};
use kinelm_motion::{Clip, Quat, synth};
use kinelm_store::random;
use rayon::prelude::*;

/// How much the numbers of copied windows are scattered, as a share of each.
const SCATTER: f64 = 0.2;
/// How far repeated clips are turned about the vertical, and each of their joints about each axis, radians.
const TURNS: [f64; 2] = [0.2, 0.05];
/// Seconds of a made-up dance, and how many there are.
const DANCES: (f64, usize) = (60.0, 24);

/// `windows` windows of made-up dances, by a feature that needs no fitting, as an index holds them, in memory: those of
/// 24 dances again and again, each number scattered by 20 % of itself.
///
/// # Errors
/// [`kinelm_store::Error::Invalid`] for a kind that must be fitted or trained.
pub fn synthetic(kind: &FeatureKind, windows: usize) -> Result<Database> {
    let (options, extractor) = extractor(kind)?;
    let numbers = extractor.numbers();
    let mut first = Vec::new();
    for dance in synth::corpus(1, DANCES.1, DANCES.0, options.windows.fps)? {
        let starts: Vec<usize> = options.windows.starts(dance.clip.frames(), 0).collect();
        first.extend(extractor.embed(extractor.extract(&dance.clip, &starts)?)?);
    }
    let mut features = vec![0.0f32; windows * numbers];
    // scattered, since equal windows would tie
    features.par_chunks_mut(numbers).enumerate().for_each(|(window, feature)| {
        // a stream per window, so that threads share none
        let mut rng = random::stream(1, "made-up windows", 0, window as u64);
        let from = &first[window * numbers % first.len()..][..numbers];
        for (to, &x) in feature.iter_mut().zip(from) {
            *to = (f64::from(x) * (1.0 + SCATTER * (2.0 * random::unit(&mut rng) - 1.0))) as f32;
        }
    });
    Ok(of_features(&options, numbers, features))
}

/// `windows` windows of these clips, which are on the 24 SMPL joints at the windows' rate, again and again: each time turned by
/// up to 0.2 radians about the vertical, its joints by up to 0.05, and cut into windows from another frame on.
///
/// # Errors
/// As [`synthetic`]; clips of which none has a window.
pub fn repeated(kind: &FeatureKind, clips: &[Clip], windows: usize) -> Result<Database> {
    let (options, extractor) = extractor(kind)?;
    let (numbers, hop) = (extractor.numbers(), options.windows.hop);
    let mut features = Vec::new();
    for round in 0.. {
        let of = |(i, clip): (usize, &Clip)| {
            let mut rng = random::stream(1, "repeated clips", round, i as u64);
            let phase = (random::unit(&mut rng) * hop as f64) as usize;
            let mut about = |most: f64| most * (2.0 * random::unit(&mut rng) - 1.0);
            let turn = Quat::from_rotation_y(about(TURNS[0]));
            let bends: Vec<Quat> = (0..clip.joints())
                .map(|_| Quat::from_rotation_x(about(TURNS[1])) * Quat::from_rotation_z(about(TURNS[1])))
                .collect();
            let turned = clip.rotations().iter().zip(bends.iter().cycle()).map(|(&q, &bend)| q * bend);
            let mut turned: Vec<Quat> = turned.collect();
            turned.iter_mut().step_by(clip.joints()).for_each(|root| *root = turn * *root);
            let clip = Clip::new(clip.skeleton().clone(), clip.fps(), clip.root().to_vec(), turned)?;
            let starts: Vec<usize> = options.windows.starts(clip.frames(), phase).collect();
            extractor.embed(extractor.extract(&clip, &starts)?)
        };
        let had = features.len();
        let all: Vec<Vec<f32>> = clips.par_iter().enumerate().map(of).collect::<Result<_>>()?;
        features.extend(all.into_iter().flatten());
        if features.len() == had {
            return Err(Error::missing("clip", "as long as a window"));
        }
        if features.len() >= windows * numbers {
            break;
        }
    }
    features.truncate(windows * numbers);
    Ok(of_features(&options, numbers, features))
}

/// How windows are cut, and what makes features of them that need no fitting.
fn extractor(kind: &FeatureKind) -> Result<(IndexOptions, FeatureExtractor)> {
    let options = IndexOptions::new(kind.clone());
    if matches!(kind, FeatureKind::Pca { .. } | FeatureKind::Model { .. }) {
        return Err(Error::invalid_parameter("transform", kind.name(), "stft or dct, which need no fitting"));
    }
    let extractor = FeatureExtractor::new(&options, None, Models::default())?;
    Ok((options, extractor))
}

/// Features (N, D) as an index holds them, all of one clip.
fn of_features(options: &IndexOptions, numbers: usize, features: Vec<f32>) -> Database {
    let windows = features.len() / numbers.max(1);
    let entry = ClipEntry::in_memory("made-up", (windows + 1) * options.windows.hop, &options.windows);
    Database::new(numbers, vec![(Part::held(features, numbers), vec![entry])])
}
