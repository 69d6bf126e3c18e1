//! Dances from their files and sidecars.

use super::Dance;
use crate::Result;
use kinelm_corpus::Corpus;
use kinelm_generate::provenance::Provenance;
use kinelm_motion::format::{Format, ReadOptions};
use kinelm_store::hash;
use std::path::Path;

impl Dance {
    /// A dance from its file. One without a sidecar that is a clip of the corpus is read as the corpus has read it.
    ///
    /// # Errors
    /// A name of no motion format; those of [`Dance::of_file`] and [`Dance::of_corpus`].
    pub fn load(corpus: &Corpus, path: &Path, provenance: Option<&Provenance>, options: &ReadOptions) -> Result<Dance> {
        Format::of(path)?; // refused by its name before it is read
        if provenance.is_none() {
            let sha256 = hash::of_file(path)?;
            let mut same = corpus.clips().iter().filter(|record| record.sha256 == sha256);
            // an exclusion makes several clips of a file, none of which is the whole dance
            if let (Some(record), None) = (same.next(), same.next()) {
                return Ok(Dance { name: path.display().to_string(), ..Dance::of_corpus(corpus, record)? });
            }
        }
        Dance::of_file(path, options, corpus.tokenizer())
    }
}

/// The label that a dance was requested with, or else that of its prompt's clip or, without a sidecar, of the clip itself.
/// `None` where the label changes in the dance, and for edited clips, most of which isn't generated.
///
/// # Errors
/// A file that can't be read.
pub fn requested_label(
    corpus: &Corpus,
    field: &str,
    path: &Path,
    provenance: Option<&Provenance>,
) -> Result<Option<String>> {
    let of_clip = |sha256: &str| {
        let record = corpus.clips().iter().find(|record| record.sha256 == sha256)?;
        record.labels.get(field).cloned()
    };
    let Some(provenance) = provenance else { return Ok(of_clip(&hash::of_file(path)?)) };
    let request = &provenance.request;
    if request.prompt.as_ref().is_some_and(|prompt| prompt.edit.is_some()) {
        return Ok(None);
    }
    let mut timed = request.timed_labels.iter().filter(|label| label.field == field).peekable();
    if let Some(first) = timed.peek().map(|label| label.value.clone()) {
        return Ok(timed.all(|label| label.value == first).then_some(first));
    }
    let of_prompt = || of_clip(provenance.prompt_sha256.as_ref()?);
    Ok(request.labels.get(field).cloned().or_else(of_prompt))
}
