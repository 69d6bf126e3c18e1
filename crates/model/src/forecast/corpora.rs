//! The forecast of the training clips of some corpora.

use super::{Fit, Forecast};
use crate::Result;
use crate::config::TokenLayout;
use kinelm_corpus::{ClipRecord, Corpus, Split};
use kinelm_engine::bins::Bins;
use kinelm_motion::mirror;
use kinelm_tokenizer::{UncodedPose, Words};

/// The most frames that are fitted on; of more, each clip gives its first ones.
const MOST: f64 = 200_000.0;

impl Forecast {
    /// The forecast fitted on the training clips of `corpora`, each weighted, and on their mirror images.
    ///
    /// # Errors
    /// A corpus that can no longer be read.
    ///
    /// # Panics
    /// If a corpus's words are no frames of bins.
    pub fn of_corpora(corpora: &[(&Corpus, f64)]) -> Result<Forecast> {
        let clips = |corpus: &'_ Corpus| corpus.split(Split::Train).map(|clip| clip.frames as f64).sum::<f64>();
        let share = (MOST / corpora.iter().map(|(corpus, _)| clips(corpus)).sum::<f64>()).min(1.0);
        let places = corpora.first().map_or(Vec::new(), |(corpus, _)| TokenLayout::of(corpus.tokenizer()).bins());
        let mut fit = Fit::new(places.clone());
        for (corpus, weight) in corpora {
            for clip in corpus.split(Split::Train) {
                let frames = (clip.frames as f64 * share).ceil() as usize;
                let ids = corpus.ids(clip, 0..frames * (places.len() + 1))?;
                fit.add(&bins(&places, &ids), *weight);
                // motion that can't be coded when it is mirrored is fitted on as it is
                if let Some(ids) = mirrored(corpus, clip, frames) {
                    fit.add(&bins(&places, &ids), *weight);
                }
            }
        }
        Ok(fit.forecast())
    }
}

/// The bins (F, C) of whole words.
fn bins(places: &[Bins], ids: &[u32]) -> Vec<Option<usize>> {
    let words = ids.chunks_exact(places.len() + 1);
    words.flat_map(|word| places.iter().zip(word).map(|(place, &id)| place.bin(id))).collect()
}

/// The ids of the first frames of a clip in the mirror.
fn mirrored(corpus: &Corpus, clip: &ClipRecord, frames: usize) -> Option<Vec<u32>> {
    let tokenizer = corpus.tokenizer();
    let ids = corpus.word_ids(clip, 0..frames).ok()?;
    let motion = tokenizer.decode(&tokenizer.words_of_ids(&ids).words, UncodedPose::Identity).ok()?;
    let words: Words = tokenizer.encode(&mirror::mirror(&motion).ok()?).ok()?.words;
    tokenizer.ids_of_words(&words).ok()
}
