//! What a dance made of its prompt: docs/measures.md, "The prompt".

use super::coordination::{Coordination, coordination};
use super::report::Dance;
use crate::Result;
use crate::generate::prompt::{Prompt, given_places, share_changed};
use crate::generate::recipe::PromptRecipe;
use kinelm_motion::joints;
use kinelm_tokenizer::{Rest, Tokenizer};
use serde::Serialize;

/// What a dance made of the joints that it was given.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Prompted {
    /// The joints, as they were asked for.
    pub joints: String,
    /// Share of the given characters that came out otherwise; 0, unless the dance was written on another rig.
    pub mismatch: f64,
    /// Mean distance of the given joints' places from the prompt's, both pelvises moved to 0, cm: free joints above them
    /// move them.
    pub given_mpjpe_cm: f64,
    /// Whether the free joints answer.
    pub coordination: Option<Coordination>,
}

/// Holds a dance to the prompt that its recipe names; `None` where no joints were followed.
///
/// # Errors
/// A prompt that can't be read, joints that the tokenizer doesn't code.
pub fn prompted(dance: &Dance, recipe: &PromptRecipe, tokenizer: &Tokenizer) -> Result<Option<Prompted>> {
    let Some(list) = &recipe.joints else { return Ok(None) };
    let selection = joints::parse(list)?;
    let places = given_places(tokenizer, &selection)?;
    let prompt = Prompt::load(&recipe.path, &recipe.read, tokenizer)?;
    let seen = tokenizer.decode(&prompt.words, Rest::Identity)?;
    let frames = dance.clip.frames().min(prompt.frames());
    let mismatch = share_changed(prompt.words.codes(), dance.words.codes(), &places, frames).unwrap_or(0.0);
    let joints = tokenizer.channels().joints().iter().copied();
    let (given, free): (Vec<usize>, Vec<usize>) = joints.partition(|j| selection.joints.contains(j));
    let (a, b) = (seen.slice(0..frames).positions(), dance.clip.slice(0..frames).positions());
    let mut apart = Vec::new();
    for (a, b) in a.chunks(24).zip(b.chunks(24)) {
        apart.extend(given.iter().map(|&j| ((a[j] - a[0]) - (b[j] - b[0])).length()));
    }
    Ok(Some(Prompted {
        joints: list.clone(),
        mismatch,
        given_mpjpe_cm: 100.0 * apart.iter().sum::<f64>() / apart.len().max(1) as f64,
        coordination: coordination(&dance.clip.slice(0..frames), &given, &free),
    }))
}
