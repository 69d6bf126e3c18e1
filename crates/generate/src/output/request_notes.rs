//! Notes for the user on an open request: joints that are taken from the prompt or free, and the music.

use super::distance::{free_ancestors, free_ancestors_of_span};
use crate::Result;
use crate::edit::PreparedEdit;
use crate::edit::mask::ResolvedSpan;
use crate::open::{OpenRequest, PreparedPrompt};
use crate::request::{PromptRequest, Span};
use kinelm_corpus::music::tempo;
use kinelm_motion::joints::{self, ambiguity_note};
use kinelm_motion::smpl;
use kinelm_tokenizer::Tokenizer;
use std::collections::BTreeSet;

impl OpenRequest {
    /// Lines to print before sampling.
    ///
    /// # Errors
    /// A list of joints that can't be parsed.
    pub fn notes(&self) -> Result<Vec<String>> {
        let mut notes = self.run.notes.clone();
        if let Some((prompt, request)) = self.prompt.as_ref().zip(self.resolved.prompt.as_ref()) {
            self.note_prompt(prompt, request, &mut notes)?;
        }
        if let Some(way) = self.way.as_ref().filter(|way| way.clipped > 0) {
            let (n, fastest) = (way.clipped, way.fastest());
            notes.push(format!(
                "{n} steps or turns of the path, up to {fastest:.1} m/s, are longer than the model codes: the dance falls behind; \
                 make the path slower, or its bends wider"
            ));
        }
        if let Some((music, request)) = self.music.as_ref().zip(self.resolved.music.as_ref()) {
            let seconds = self.frames as f64 / self.tokenizer.fps();
            let (path, bpm) = (request.path.display(), music.bpm(seconds).unwrap_or_default());
            let label = self.resolved.labels.get(tempo::FIELD).map(|tempo| format!(", conditioned on tempo={tempo}"));
            notes.push(format!("{path}: {bpm:.1} beats per minute{}", label.unwrap_or_default()));
        }
        Ok(notes)
    }

    fn note_prompt(&self, prompt: &PreparedPrompt, request: &PromptRequest, notes: &mut Vec<String>) -> Result<()> {
        if let Some(list) = &request.joints {
            notes.extend(uncoded_parts(&self.tokenizer, list)?);
            let free = free_ancestors(&self.tokenizer, prompt);
            notes.extend(note_free(&free, list, |list| format!("`joints` {list}")));
        }
        if prompt.clip.clipped > 0 && !prompt.lends() {
            let (n, path) = (prompt.clip.clipped, request.path.display());
            notes.push(format!(
                "{path}: {n} numbers are out of the range that the model codes; the dance catches up later"
            ));
        }
        if let Some(edit) = &prompt.edit {
            note_edit(prompt, edit, notes);
            note_free_of_spans(edit, request.timeline.is_some(), notes);
        }
        let known = prompt.clip.frames();
        if !prompt.given.is_empty() && known < self.frames {
            let free = self.frames - known;
            notes.push(format!("the prompt ends after {known} frames; the {free} that follow are generated free"));
        }
        Ok(())
    }
}

/// Parts of a list of joints that name none the model codes.
fn uncoded_parts(tokenizer: &Tokenizer, list: &str) -> Result<Vec<String>> {
    let mut notes = Vec::new();
    for part in list.split(',').filter(|_| list.contains(',')) {
        let joints = joints::parse(part)?.joints;
        if !joints.iter().any(|j| tokenizer.channels().joints().contains(j)) {
            notes.push(format!("{} is not taken from the prompt: the model doesn't code it", part.trim()));
        }
    }
    Ok(notes)
}

/// The joints and frames of an edit that are given and free.
fn note_edit(prompt: &PreparedPrompt, edit: &PreparedEdit, notes: &mut Vec<String>) {
    let fps = prompt.clip.motion.clip.fps();
    let names = |joints: &[usize]| joints.iter().map(|&j| smpl::NAMES[j]).collect::<Vec<_>>().join(" ");
    let mut note = |word: &str, resolved: &ResolvedSpan| {
        let ResolvedSpan { span, joints, uncoded, frames, ambiguous } = resolved;
        let (from, last) = (frames.start + edit.left_out, frames.end + edit.left_out - 1);
        let (from_s, to_s) = (frames.start as f64 / fps, frames.end as f64 / fps);
        notes.push(format!(
            "{word} {span}: {}; frames {from} to {last} of the file, {from_s:.2} to {to_s:.2} s",
            names(joints)
        ));
        notes.extend(ambiguous.iter().map(|(part, own)| format!("  {}", ambiguity_note(part, own))));
        if !uncoded.is_empty() {
            let what = "the model doesn't code them; they are the prompt's, and where all coded joints are free, they go from \
                        their pose before the gap to that after it";
            notes.push(format!("  {}: {what}", names(uncoded)));
        }
    };
    edit.spans.given.iter().for_each(|span| note("given", span));
    edit.spans.free.iter().for_each(|span| note("free", span));
    let rest = match edit.spans.given.is_empty() {
        _ if edit.seam.is_some() => "all else is given; after it the beginning comes again",
        true => "all else is given",
        false => "all else is free",
    };
    notes.push(rest.into());
}

/// Free ancestors of the given joints of each span of an edit.
fn note_free_of_spans(edit: &PreparedEdit, is_timeline: bool, notes: &mut Vec<String>) {
    let mut seen = BTreeSet::new();
    for resolved in &edit.spans.given {
        let Span { joints, from, to } = &resolved.span;
        let free = free_ancestors_of_span(edit, resolved);
        if seen.insert((joints.clone(), free.clone())) {
            notes.extend(note_free(&free, joints, |list| match is_timeline {
                true => format!("joints = \"{list}\""),
                false => format!("`given` {}", Span { joints: list.into(), from: *from, to: *to }),
            }));
        }
    }
}

/// That free joints move the given ones of a list, and the option that gives them too.
fn note_free(free: &[usize], list: &str, option: impl FnOnce(&str) -> String) -> Option<String> {
    if free.is_empty() {
        return None;
    }
    let torso = joints::parse("torso").map(|s| s.joints).unwrap_or_default();
    let (torso, others): (Vec<usize>, Vec<usize>) = free.iter().partition(|j| torso.contains(j));
    let names = |joints: &[usize]| joints.iter().map(|&j| smpl::NAMES[j]).collect::<Vec<_>>();
    let mut all = vec!["root"];
    all.extend((!torso.is_empty()).then_some("torso"));
    all.extend(names(&others));
    all.extend(list.split(',').map(str::trim).filter(|part| !["root", "torso", "pelvis"].contains(part)));
    let (free, option) = (names(free).join(", "), option(&all.join(",")));
    Some(format!("{free}: free, and they move the given joints below them; to give them too: {option}"))
}
