//! What is usual of a run's train clips, and what none of them does.

use super::data::Data;
use crate::Result;
use kinelm_corpus::{ClipRecord, Corpus, Split};
use kinelm_generate::score::{Limits, Measures, Scorer};
use kinelm_model::run::LIMITS;
use kinelm_store::files;
use kinelm_tokenizer::Tokenizer;
use rayon::prelude::*;
use std::path::Path;

/// Of longer corpora so many hours are measured: what is usual changes little then, and training waits for it.
const MOST_HOURS: f64 = 10.0;

/// Writes the limits of a run, unless it has some.
///
/// # Errors
/// A corpus that can no longer be read; what the system refuses.
pub fn write(run: &Path, data: &Data) -> Result<()> {
    let path = run.join(LIMITS);
    if path.exists() {
        return Ok(());
    }
    Ok(files::write_whole(&path, of_train_clips(data)?.to_json().as_bytes())?)
}

/// Of the train clips as they are coded, by the weights of their corpora; of many clips every n-th.
fn of_train_clips(data: &Data) -> Result<Limits> {
    let scorer = Scorer::new(data.tokenizer().channels().joints())?;
    let frames = data.parts().iter().flat_map(|part| part.corpus.split(Split::Train)).map(|clip| clip.frames);
    let step = every(frames.sum(), data.tokenizer().fps());
    let mut windows = Vec::new();
    for part in data.parts() {
        let records: Vec<&ClipRecord> = part.corpus.split(Split::Train).step_by(step).collect();
        let of = |record: &&ClipRecord| measured(&scorer, data.tokenizer(), &part.corpus, record);
        let all: Vec<Vec<Measures>> = records.par_iter().map(of).collect::<Result<_>>()?;
        windows.extend(all.into_iter().flatten().map(|found| (found, part.weight)));
    }
    Ok(Limits::of(&windows))
}

/// Every how many clips are measured, of so many frames.
fn every(frames: usize, fps: f64) -> usize {
    ((frames as f64 / (3600.0 * fps * MOST_HOURS)).ceil() as usize).max(1)
}

fn measured(scorer: &Scorer, tokenizer: &Tokenizer, corpus: &Corpus, record: &ClipRecord) -> Result<Vec<Measures>> {
    let clip = tokenizer.decode(&corpus.clip_words(record)?, tokenizer.uncoded_pose())?;
    // a last tile is padded with frames that the clip doesn't have
    Ok(scorer.windows(&clip.slice(0..record.frames.min(clip.frames()))))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn all_clips_of_ten_hours_are_measured_and_every_tenth_of_a_hundred() {
        let hour = 3600 * 20;
        let found = [0, 1, 10 * hour, 10 * hour + 1, 100 * hour, 1000 * hour].map(|frames| every(frames, 20.0));
        assert_eq!(found, [1, 1, 1, 2, 10, 100]);
    }
}
