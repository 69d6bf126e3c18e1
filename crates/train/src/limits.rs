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

/// Of the train clips as they are coded, by the weights of their corpora.
fn of_train_clips(data: &Data) -> Result<Limits> {
    let scorer = Scorer::new(data.tokenizer().channels().joints())?;
    let mut windows = Vec::new();
    for part in data.parts() {
        let records: Vec<&ClipRecord> = part.corpus.split(Split::Train).collect();
        let of = |record: &&ClipRecord| measured(&scorer, data.tokenizer(), &part.corpus, record);
        let all: Vec<Vec<Measures>> = records.par_iter().map(of).collect::<Result<_>>()?;
        windows.extend(all.into_iter().flatten().map(|found| (found, part.weight)));
    }
    Ok(Limits::of(&windows))
}

fn measured(scorer: &Scorer, tokenizer: &Tokenizer, corpus: &Corpus, record: &ClipRecord) -> Result<Vec<Measures>> {
    let clip = tokenizer.decode(&corpus.clip_words(record)?, tokenizer.uncoded_pose())?;
    // a last tile is padded with frames that the clip doesn't have
    Ok(scorer.windows(&clip.slice(0..record.frames.min(clip.frames()))))
}
