//! A database to measure searches with.

use super::database::Database;
use super::embedding::Models;
use super::extract::FeatureExtractor;
use super::options::{FeatureKind, IndexOptions};
use super::part::Part;
use super::record::ClipEntry;
use crate::{Error, Result};
use kinelm_motion::synth;
use kinelm_store::random;
use rayon::prelude::*;

/// How much the numbers of copied windows are scattered, as a share of each.
const SCATTER: f64 = 0.2;
/// Seconds of a made-up dance, and how many there are.
const DANCES: (f64, usize) = (60.0, 24);

/// `windows` windows of made-up dances, by a feature that needs no fitting, as an index holds them, in memory: those of
/// 24 dances again and again, each number scattered by 20 % of itself.
///
/// # Errors
/// [`kinelm_store::Error::Invalid`] for a kind that must be fitted or trained.
pub fn synthetic(kind: &FeatureKind, windows: usize) -> Result<Database> {
    let options = IndexOptions::new(kind.clone());
    if matches!(kind, FeatureKind::Pca { .. } | FeatureKind::Model { .. }) {
        return Err(Error::invalid_parameter("transform", kind.name(), "stft or dct, which need no fitting"));
    }
    let extractor = FeatureExtractor::new(&options, None, Models::default())?;
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
    let entry = ClipEntry::in_memory("made-up", (windows + 1) * options.windows.hop, &options.windows);
    Database::new(numbers, vec![(Part::held(features, numbers), vec![entry])]).with_bytes()
}
