//! A prompt prepared for sampling: read, converted and coded once.

use crate::edit::{PreparedEdit, lengthen};
use crate::prompt::{PromptClip, given_characters};
use crate::request::PromptRequest;
use crate::timeline::TimelineLayout;
use crate::{Error, Result};
use kinelm_motion::Source;
use kinelm_motion::format::Format;
use kinelm_motion::joints::{self, Selection};
use kinelm_motion::rig::Humanoid;
use kinelm_store::Subject;
use kinelm_store::input;
use kinelm_tokenizer::Tokenizer;
use std::sync::Arc;

/// A prompt, and which part of it is given.
pub struct PreparedPrompt {
    /// The clip.
    pub clip: PromptClip,
    /// The joints that are given throughout.
    pub selection: Option<Selection>,
    /// (C) which characters of a word these joints are; empty without such joints.
    pub given: Vec<bool>,
    /// Ids of the first words, which the dance begins with.
    pub beginning: Vec<u32>,
    /// Frames of which something is given: all if joints are, those of the first words if they are, else none.
    pub frames: usize,
    /// What stays and what is generated, if the clip is edited.
    pub edit: Option<PreparedEdit>,
}

impl PreparedPrompt {
    /// Whether nothing is given: the clip lends its rig and its rate.
    pub fn lends(&self) -> bool {
        self.given.is_empty() && self.beginning.is_empty() && self.edit.is_none()
    }

    /// Reads a prompt. Writes into the request what was decided on reading: joints in SMPL's names, the floor, the up axis.
    /// `layout`: of a timeline that is laid out already.
    pub(super) fn load(
        request: &mut PromptRequest,
        layout: Option<TimelineLayout>,
        frames: Option<usize>,
        tokenizer: &Tokenizer,
    ) -> Result<PreparedPrompt> {
        let text = bytes(request, layout)?;
        let mut clip = PromptClip::parse(&request.path, &text, &request.read, tokenizer)?;
        // map, floor and up axis are settled here, so that they aren't estimated again, least of all from the dance
        let found = clip.motion.humanoid().ok().map(Humanoid::found).filter(|found| found.is_of_clip());
        if let Some(map) = found.map(|found| found.map.to_toml()) {
            // what the sidecar says gives the same bits again
            clip = clip.with_map(&map, &request.read, tokenizer)?;
            request.read.map = Some(map);
        }
        request.read.floor = clip.floor_m.or(request.read.floor);
        if let Source::Bvh(_) | Source::Json(_) = clip.motion.source {
            request.read.up = clip.motion.source.axes().up;
        }
        let (rig, map) = (clip.motion.clip.skeleton(), clip.motion.map());
        let wrong = |list: &str, e: &dyn std::fmt::Display| {
            Error::unsupported(Subject::of_parameter("joints").with(list), e.to_string())
        };
        let to_smpl_names = |list: &String| joints::to_smpl_names(list, rig, map).map_err(|e| wrong(list, &e));
        request.joints = request.joints.as_ref().map(to_smpl_names).transpose()?;
        let selection = request.joints.as_deref().map(joints::parse).transpose()?;
        let given = match (&selection, &request.joints) {
            (Some(selection), Some(list)) => given_characters(tokenizer, selection).map_err(|e| wrong(list, &e))?,
            _ => Vec::new(),
        };
        let beginning = request.from_frame.map(|n| clip.beginning(tokenizer, n)).transpose()?.unwrap_or_default();
        let mut edit = request.edit.take();
        let mut seam = None;
        if let Some(looping) = edit.as_ref().and_then(|edit| edit.looping) {
            let (long, at) = lengthen(looping, clip, tokenizer)?;
            (clip, seam) = (long, Some(at));
        }
        let prepare = |edit| PreparedEdit::load(edit, frames, (request, &text), (&clip, seam), tokenizer);
        let prepared = edit.as_mut().map(prepare).transpose()?;
        request.edit = edit;
        let frames = match request.from_frame {
            Some(n) if given.is_empty() => n,
            _ if request.lends() => 0,
            _ => clip.frames(),
        };
        Ok(PreparedPrompt { clip, selection, given, beginning, frames, edit: prepared })
    }
}

/// The bytes of the prompt's file, or of the clip that a timeline is composed into.
fn bytes(request: &PromptRequest, layout: Option<TimelineLayout>) -> Result<Arc<[u8]>> {
    let bytes = match (&request.timeline, layout) {
        (Some(_), Some(layout)) => layout.compose()?,
        (Some(timeline), None) => timeline.lay_out()?.compose()?,
        (None, _) => {
            Format::of(&request.path)?; // refused by its name before it is read
            input::bytes(&request.path).map_err(Error::io(&request.path))?
        }
    };
    Ok(bytes.into())
}
