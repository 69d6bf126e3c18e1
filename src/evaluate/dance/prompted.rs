//! What a dance made of its prompt: docs/measures.md, "The prompt".

use super::coordination::{Coordination, coordination};
use super::report::Dance;
use crate::Result;
use crate::generate::prompt::{Prompt, given_places, read_back, share_changed};
use crate::generate::recipe::Recipe;
use kinelm_motion::joints;
use kinelm_tokenizer::{Rest, Tokenizer};
use serde::Serialize;
use std::path::Path;

/// What a dance made of the joints that it was given.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Prompted {
    /// The joints, as they were asked for.
    pub joints: String,
    /// Share of the given characters that came out different; 0, unless the dance was written on another rig.
    pub mismatch: f64,
    /// Mean distance of the given joints' places from the prompt's, both pelvises moved to 0, cm: free joints above them
    /// move them.
    pub given_mpjpe_cm: f64,
    /// Whether the free joints answer.
    pub coordination: Option<Coordination>,
}

/// Holds a dance, which stands in `file`, to the prompt that its recipe names; `None` where no joints were followed.
///
/// # Errors
/// A prompt that can't be read, joints that the tokenizer doesn't code.
pub fn prompted(dance: &Dance, file: &Path, recipe: &Recipe, tokenizer: &Tokenizer) -> Result<Option<Prompted>> {
    let Some(followed) = &recipe.prompt else { return Ok(None) };
    let Some(list) = &followed.joints else { return Ok(None) };
    let selection = joints::parse(list)?;
    let places = given_places(tokenizer, &selection)?;
    let prompt = Prompt::load(&followed.path, &followed.read, tokenizer)?;
    let seen = tokenizer.decode(&prompt.words, Rest::Identity)?;
    let frames = dance.clip.frames().min(prompt.frames());
    // on the prompt's rig the floor is the one of the way there, not what the dance's own feet say
    let back = read_back(file, recipe, &prompt, tokenizer)?.map(|(_, words)| words);
    let codes = back.as_ref().unwrap_or(&dance.words).codes();
    let mismatch = share_changed(prompt.words.codes(), codes, &places, frames).unwrap_or(0.0);
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
