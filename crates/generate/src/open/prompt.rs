//! A prompt prepared for sampling: read, converted and coded once.

use crate::edit::{PreparedEdit, lengthen};
use crate::prompt::{PromptClip, given_characters};
use crate::request::PromptRequest;
use crate::sampler::has_given_after_free;
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
    /// The given and the generated parts, if the clip is edited.
    pub edit: Option<PreparedEdit>,
}

impl PreparedPrompt {
    /// Whether nothing is given: the clip lends its rig and its rate.
    pub fn lends(&self) -> bool {
        self.given.is_empty() && self.beginning.is_empty() && self.edit.is_none()
    }

    /// Whether nothing of the first frame is given: the clip only lends, or its edit frees all of it.
    pub(crate) fn begins_free(&self) -> bool {
        self.lends() || self.edit.as_ref().is_some_and(|edit| edit.mask().is_all_free(0))
    }

    /// Whether some joints are given in the first frame after free ones, and it doesn't continue from frames before it.
    pub(crate) fn begins_in_part(&self) -> bool {
        self.beginning.is_empty() && has_given_after_free(&self.first_given())
    }

    /// Whether a gap ends where the clip continues, so that one way through it may be better than another.
    pub(crate) fn has_ends(&self) -> bool {
        self.edit.as_ref().is_some_and(PreparedEdit::has_ends)
    }

    /// Whether every frame of a dance of `frames` that isn't given whole has joints given after free ones.
    pub(crate) fn is_given_throughout(&self, frames: usize) -> bool {
        let (known, first) = (self.clip.frames(), self.first_given());
        let given = self.edit.as_ref().map_or_else(|| first.clone(), |edit| edit.given(known).0);
        let is_whole = |frame: &[bool]| frame.iter().all(|is_given| *is_given);
        let mut sampled = given.chunks(first.len().max(1)).filter(|frame| !is_whole(frame)).peekable();
        frames <= known && sampled.peek().is_some() && sampled.all(has_given_after_free)
    }

    /// (C) which characters of the first word are given; empty: none.
    fn first_given(&self) -> Vec<bool> {
        self.edit.as_ref().map_or_else(|| self.given.clone(), |edit| edit.given(1).0)
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
        request.is_character = clip.motion.has_character();
        clip.motion = request.written_as_requested(clip.motion)?;
        if let Source::Bvh(_) | Source::Json(_) | Source::Glb(_) = clip.motion.source {
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
        // taken out, as preparing it borrows the rest of the request
        let mut edit = request.edit.take();
        let mut seam = None;
        if let Some(looping) = edit.as_ref().and_then(|edit| edit.looping) {
            let (long, at) = lengthen(looping, clip, tokenizer)?;
            (clip, seam) = (long, Some(at));
        }
        let prepare = |edit| PreparedEdit::load(edit, frames, request, &text, &clip, seam, tokenizer);
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
    let bytes = match (&request.timeline, layout, &request.bytes) {
        (Some(_), Some(layout), _) => layout.compose()?,
        (Some(timeline), None, _) => timeline.lay_out()?.compose()?,
        (None, _, Some(bytes)) => return Ok(bytes.clone()),
        (None, _, None) => {
            Format::of(&request.path)?; // refused by its name before it is read
            input::bytes(&request.path).map_err(Error::io(&request.path))?
        }
    };
    Ok(bytes.into())
}
