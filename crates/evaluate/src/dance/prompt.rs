//! How a dance follows its prompt: docs/measures.md, "The prompt".

use super::coded::Dance;
use super::coordination::{Coordination, coordination};
use crate::Result;
use kinelm_generate::prompt::{PromptClip, given_characters, read_back, share_changed};
use kinelm_generate::provenance::Provenance;
use kinelm_generate::score::coded_feet;
use kinelm_model::run::TOKENIZER;
use kinelm_motion::metric::{Skate, jitter_of};
use kinelm_motion::{Clip, joints};
use kinelm_tokenizer::{Tokenizer, UncodedPose};
use serde::Serialize;
use std::path::Path;

/// The metrics of a dance against the joints that it was given.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct PromptMetrics {
    /// The joints, as requested.
    pub joints: String,
    /// Share of the given characters that came out different; 0, unless the dance was written on another rig. `None` where
    /// they can't be compared: in another tokenizer's words, or where the rate of its file is no multiple of the
    /// tokenizer's, so that it lacks the sampled frames.
    pub mismatch: Option<f64>,
    /// Why not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub not_compared: Option<String>,
    /// Mean distance of the given joints' positions from the prompt's, both pelvises moved to 0, cm: free joints above
    /// them move them.
    pub given_mpjpe_cm: f64,
    /// Jitter of the free joints over that of the same joints of the prompt, coded and decoded.
    pub free_jitter: Option<f64>,
    /// Foot skate over the prompt's, where the feet are free.
    pub free_skate: Option<f64>,
    /// Whether the free joints respond.
    pub coordination: Option<Coordination>,
}

impl PromptMetrics {
    /// Compares a dance, which is in `file`, with the prompt that its provenance names; `None` where no joints were given.
    /// Characters are compared only if `tokenizer` is that of the dance's model, whatever labels either has.
    ///
    /// # Errors
    /// A prompt that can't be read, joints that the tokenizer doesn't code.
    pub fn measure(
        dance: &Dance,
        file: &Path,
        provenance: &Provenance,
        tokenizer: &Tokenizer,
    ) -> Result<Option<PromptMetrics>> {
        let Some(followed) = &provenance.request.prompt else { return Ok(None) };
        let Some(list) = &followed.joints else { return Ok(None) };
        let selection = joints::parse(list)?;
        let places = given_characters(tokenizer, &selection)?;
        let prompt = PromptClip::load(&followed.path, &followed.read, tokenizer)?;
        let seen = tokenizer.decode(&prompt.words, UncodedPose::Identity)?;
        let frames = dance.clip.frames().min(prompt.frames());
        let not_compared = other_words(provenance, tokenizer);
        let back = match not_compared {
            None => read_back(file, &provenance.request, &prompt, tokenizer)?,
            Some(_) => None,
        };
        let mismatch = back.and_then(|(_, words)| share_changed(prompt.words.codes(), words.codes(), &places, frames));
        let joints = tokenizer.channels().joints().iter().copied();
        let (given, free): (Vec<usize>, Vec<usize>) = joints.partition(|j| selection.joints.contains(j));
        let (seen, made) = (seen.slice(0..frames), dance.clip.slice(0..frames));
        let (a, b) = (seen.positions(), made.positions());
        let mut distances = Vec::new();
        for (a, b) in a.chunks(24).zip(b.chunks(24)) {
            distances.extend(given.iter().map(|&j| ((a[j] - a[0]) - (b[j] - b[0])).length()));
        }
        // beside a prompt at rest there is none
        let quotient = |dance: Option<f64>, prompt: Option<f64>| Some(dance? / prompt.filter(|x| *x > 0.0)?);
        let feet = coded_feet(tokenizer.channels().joints())?;
        // given feet are the prompt's own
        let is_free = feet.joints.iter().all(|(foot, _)| free.contains(foot));
        let skate = |clip: &Clip| Skate::of(&feet, clip).cm_s().filter(|_| is_free);
        Ok(Some(PromptMetrics {
            joints: list.clone(),
            mismatch,
            not_compared,
            given_mpjpe_cm: 100.0 * distances.iter().sum::<f64>() / distances.len().max(1) as f64,
            free_jitter: quotient(jitter_of(&made, &free), jitter_of(&seen, &free)),
            free_skate: quotient(skate(&made), skate(&seen)),
            coordination: coordination(&made, &given, &free),
        }))
    }
}

/// Why the characters of a dance aren't those of `tokenizer`; `None` where its model has the same words.
fn other_words(provenance: &Provenance, tokenizer: &Tokenizer) -> Option<String> {
    let (own, found) = (&provenance.tokenizer_sha256, tokenizer.hash());
    if *own == found {
        return None;
    }
    // tokenizers that differ in labels alone have the same words
    let run = &provenance.request.run;
    match Tokenizer::load(run.join(TOKENIZER)).ok().filter(|model| model.hash() == *own) {
        Some(model) if model.base_hash() == tokenizer.base_hash() => None,
        Some(_) => Some(format!(
            "the corpus has another tokenizer ({found:.8}) than the dance's model ({own:.8}); take one that kinelm tokenize \
             made with the model's"
        )),
        None => Some(format!(
            "the corpus has tokenizer {found:.8}, the dance's model had {own:.8}, and {} doesn't say whether they differ by \
             labels alone",
            run.display()
        )),
    }
}
