//! What the user of `generate` should know of the joints that are followed.

use crate::cli::{Say, warn};
use crate::corpus::music::tempo;
use crate::generate::edit::PreparedEdit;
use crate::generate::open::OpenRequest;
use crate::generate::open::PreparedPrompt;
use crate::generate::output::distance::{free_ancestors, free_ancestors_of_span, given_distance};
use crate::generate::prompt;
use crate::generate::request::{PromptRequest, Span};
use anyhow::Result;
use kinelm_motion::{joints, smpl};
use kinelm_tokenizer::{Tokenizer, Words};
use std::collections::BTreeSet;
use std::path::Path;

/// What the user should know of a request that is open.
pub fn opened(ready: &OpenRequest, say: Say) -> Result<()> {
    ready.run.notes.iter().for_each(|note| say.line(note));
    if let Some((prompt, recipe)) = ready.prompt.as_ref().zip(ready.resolved.prompt.as_ref()) {
        of_prompt(ready, prompt, recipe, say)?;
    }
    let Some((music, recipe)) = ready.music.as_ref().zip(ready.resolved.music.as_ref()) else { return Ok(()) };
    let seconds = ready.frames as f64 / ready.tokenizer.fps();
    let (path, bpm) = (recipe.path.display(), music.bpm(seconds).unwrap_or_default());
    let told = ready.resolved.labels.get(tempo::FIELD).map(|tempo| format!(", told as tempo={tempo}"));
    say.line(format_args!("{path}: {bpm:.1} beats a minute{}", told.unwrap_or_default()));
    Ok(())
}

fn of_prompt(ready: &OpenRequest, prompt: &PreparedPrompt, recipe: &PromptRequest, say: Say) -> Result<()> {
    warn(&prompt.clip.motion, say);
    if let Some(list) = &recipe.joints {
        not_followed(&ready.tokenizer, list, say)?;
        of_free_between(&ready.tokenizer, prompt, list, say);
    }
    if prompt.clip.clipped > 0 {
        let (n, path) = (prompt.clip.clipped, recipe.path.display());
        say.line(format_args!("{path}: {n} numbers lie outside what the model codes; what follows them is late"));
    }
    if let Some(edited) = &prompt.edit {
        super::edit::say_understood(prompt, edited, say);
        of_free_between_spans(edited, recipe.timeline.is_some(), say);
    }
    let known = prompt.clip.frames();
    if !prompt.given.is_empty() && known < ready.frames {
        let free = ready.frames - known;
        say.line(format_args!("the prompt ends after {known} frames; the {free} that follow are generated free"));
    }
    Ok(())
}

/// Parts of the list that name nothing the model knows. (A group is followed as far as it is known.)
fn not_followed(tokenizer: &Tokenizer, list: &str, say: Say) -> Result<()> {
    for part in list.split(',').filter(|_| list.contains(',')) {
        let joints = joints::parse(part)?.joints;
        if !joints.iter().any(|j| tokenizer.channels().joints().contains(j)) {
            say.line(format_args!("{} is not followed: the model doesn't know it", part.trim()));
        }
    }
    Ok(())
}

/// Free joints that move given ones, and the call that gives them too.
fn of_free_between(tokenizer: &Tokenizer, prompt: &PreparedPrompt, list: &str, say: Say) {
    offer(&free_ancestors(tokenizer, prompt), list, say, |offer| format!("--joints {offer}"));
}

/// The same of an edit, or of a plan.
fn of_free_between_spans(edited: &PreparedEdit, is_plan: bool, say: Say) {
    let mut said = BTreeSet::new();
    for understood in &edited.spans.given {
        let Span { joints, from, to } = &understood.span;
        let between = free_ancestors_of_span(edited, understood);
        if said.insert((joints.clone(), between.clone())) {
            offer(&between, joints, say, |offer| match is_plan {
                true => format!("joints = \"{offer}\""),
                false => format!("--given {}", Span { joints: offer.into(), from: *from, to: *to }),
            });
        }
    }
}

/// Says which free joints move the given ones of a list, and by what they are given too.
fn offer(between: &[usize], list: &str, say: Say, call: impl FnOnce(&str) -> String) {
    if between.is_empty() {
        return;
    }
    let torso = joints::parse("torso").map(|s| s.joints).unwrap_or_default();
    let (torso, others): (Vec<usize>, Vec<usize>) = between.iter().partition(|j| torso.contains(j));
    let names = |joints: &[usize]| joints.iter().map(|&j| smpl::NAMES[j]).collect::<Vec<_>>();
    let mut offer = vec!["root"];
    offer.extend((!torso.is_empty()).then_some("torso"));
    offer.extend(names(&others));
    offer.extend(list.split(',').map(str::trim).filter(|part| !["root", "torso", "pelvis"].contains(part)));
    let (free, call) = (names(between).join(", "), call(&offer.join(",")));
    say.line(format_args!("{free}: free, and they move the given joints that hang on them; to give them too: {call}"));
}

/// Reads a dance on the prompt's rig back and says which share of the given characters it codes otherwise, and how far the
/// given joints are from the prompt's.
pub fn read_back(ready: &OpenRequest, words: &Words, out: &Path, say: Say) -> Result<()> {
    let followed = ready.on_own_rig().filter(|(prompt, _)| !prompt.given.is_empty());
    let (Some((prompt, recipe)), tokenizer) = (followed, &ready.tokenizer) else { return Ok(()) };
    let back = prompt::read_back(out, &ready.resolved, &prompt.clip, tokenizer)?;
    let Some((motion, again)) = back else { return Ok(()) };
    if let Some(share) = prompt::share_changed(words.codes(), again.codes(), &prompt.given, prompt.clip.words.len()) {
        let apart = given_distance(tokenizer, prompt, recipe.read.map.as_deref(), &motion.clip)?;
        let apart = apart
            .map(|a| format!("; the given joints are {:.2} cm apart in the mean, {:.2} at most", a.mean_cm, a.max_cm));
        say.line(format_args!(
            "read back from the prompt's rig, {:.4} % of the given characters differ{}",
            100.0 * share,
            apart.unwrap_or_default()
        ));
    }
    Ok(())
}
