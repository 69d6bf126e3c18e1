//! Edits: chosen joints of a clip are generated at chosen times, and all else stays as it is.
//!
//! The spans of an edit are resolved against the clip ([`mask`]), sampled like any dance with the given characters in their
//! slots, brought to what is given on both sides ([`gap`]), and put into the clip at its file's own rate (`splice`).
//! docs/editing.md.

pub mod feet;
pub mod gap;
pub(crate) mod loop_seam;
pub mod mask;
pub mod splice;

pub use gap::ClosingError;
pub(crate) use loop_seam::{LoopSeam, lengthen};
pub use mask::Mask;
pub(crate) use mask::{ResolvedSpan, ResolvedSpans};

use crate::prompt::PromptClip;
use crate::prompt::uncoded::mean_pose;
use crate::request::{Edit, PromptRequest};
use crate::{Error, Result};
use kinelm_motion::feet::FootLock;
use kinelm_motion::format::{self, Changed, ReadOptions, RestFrame};
use kinelm_motion::joints::Selection;
use kinelm_motion::moment::Timebase;
use kinelm_motion::resample::{Method, held_frames, resample, resample_held};
use kinelm_motion::{Clip, Motion};
use kinelm_store::Subject;
use kinelm_tokenizer::{Tokenizer, UncodedPose, WordLength, Words};
use splice::{RigJoints, extended, merge, splice};
use std::ops::Range;
use std::sync::Arc;

/// An edit resolved against its prompt.
pub struct PreparedEdit {
    /// The spans, and what is given of the clip.
    pub(crate) spans: ResolvedSpans,
    /// The whole file, the frames included that reading leaves out.
    whole: Motion,
    /// Its bytes.
    pub(crate) text: Arc<[u8]>,
    /// The frames that reading leaves out at the beginning.
    pub left_out: usize,
    /// Frames at the model's rate that reach to the end of the clip.
    pub frames: usize,
    /// Frames that are written, without those left out.
    written: usize,
    /// The given joints at the model's rate.
    mask: Mask,
    /// (C) the joint of each character.
    joints: Vec<usize>,
    blend_s: f64,
    /// The seam of a loop.
    pub(crate) seam: Option<LoopSeam>,
    known: usize,
}

/// A dance whose gaps are closed: on SMPL-24, at the model's rate.
pub(crate) struct ClosedGaps {
    /// The prompt where it is given, the dance where it is free.
    pub clip: Clip,
    /// The errors at the ends of gaps, before they were spread.
    pub errors: Vec<ClosingError>,
    /// The changes by foot locking, gap by gap.
    pub locked: Vec<FootLock>,
}

impl ClosedGaps {
    /// All errors as one number; see [`ClosingError::total`].
    pub(crate) fn total_error(&self) -> f64 {
        self.errors.iter().map(ClosingError::total).sum()
    }
}

impl PreparedEdit {
    /// Resolves an edit of a clip that `prompt` was read from; its spans get SMPL's names. `frames`: the requested length, at
    /// the model's rate. `seam`: of a prompt that was lengthened to loop.
    ///
    /// # Errors
    /// Those of [`Mask::resolve`]; words of several frames or lengths, merged tokens; nothing to generate; fewer frames than
    /// the prompt has; another length of a loop.
    pub(crate) fn load(
        edit: &mut Edit,
        frames: Option<usize>,
        request: &PromptRequest,
        text: &Arc<[u8]>,
        prompt: &PromptClip,
        seam: Option<LoopSeam>,
        tokenizer: &Tokenizer,
    ) -> Result<PreparedEdit> {
        let joints = joints_of_characters(tokenizer)?;
        let whole = whole(request, text, &prompt.motion, seam.is_some())?;
        let (clip, fps) = (&prompt.motion.clip, tokenizer.fps());
        let appended = seam.as_ref().map_or(0, |seam| seam.appended);
        let left_out = whole.clip.frames().saturating_sub(clip.frames() - appended);
        let scale = Timebase { frames: clip.frames(), fps: clip.fps(), left_out, model_fps: Some(fps) };
        let of_loop = seam.as_ref().map(|seam| seam.span(left_out));
        let (given, free) = match &of_loop {
            Some(gap) => (&[][..], std::slice::from_ref(gap)),
            None => (&edit.given[..], &edit.free[..]),
        };
        let spans = Mask::resolve(given, free, scale, tokenizer, &prompt.motion)?;
        // frames of the model within these of the file
        // 1e-9: a whole number may come out just below itself
        let within = |frames: usize| ((frames - 1) as f64 * fps / clip.fps() + 1e-9) as usize + 1;
        let known = seam.as_ref().map_or(prompt.frames(), |seam| within(seam.frames()));
        if let Some(frames) = frames.filter(|&frames| seam.is_some() && frames != known) {
            return Err(Error::invalid_parameter(
                "frames",
                frames,
                format!("{known}: a loop stays as long as its clip"),
            ));
        }
        if let Some(frames) = frames.filter(|&frames| frames < known) {
            let expected = format!("at least the {known} of the prompt, which is edited as a whole; cut it first");
            return Err(Error::invalid_parameter("frames", frames, expected));
        }
        let longer = frames.filter(|&frames| frames > known);
        if !spans.mask.has_free() && longer.is_none() {
            return Err(Error::missing("free joint", "all joints that the model knows are given throughout"));
        }
        if !edit.given.is_empty() && (0..clip.frames()).all(|frame| spans.mask.is_all_free(frame)) {
            let help = "what `free` names is subtracted from what `given` names, and nothing is left";
            return Err(Error::missing("given joint", help));
        }
        if seam.is_none() {
            for (spans, resolved) in [(&mut edit.given, &spans.given), (&mut edit.free, &spans.free)] {
                *spans = resolved.iter().map(|resolved| resolved.span.clone()).collect();
            }
        }
        // rounded up: the last frame of the file needs a frame of the model at or after it
        let reach = ((clip.frames() - 1) as f64 * fps / clip.fps() - 1e-9).ceil() as usize + 1;
        let frames = longer.unwrap_or(reach).max(reach);
        let own = seam.as_ref().map_or(clip.frames(), LoopSeam::frames);
        let written = longer.map_or(own, |n| held_frames(n, fps, clip.fps()));
        let mask = spans.mask.at_model_rate(frames, reach);
        let blend_s = edit.blend_s.ok_or_else(|| Error::missing("`blend_s`", "say over how many seconds ends fade"))?;
        let text = text.clone();
        Ok(PreparedEdit { spans, whole, text, left_out, frames, written, mask, joints, blend_s, seam, known })
    }

    /// Frames that are written, at the model's rate, where no more are requested.
    pub(crate) fn known(&self) -> usize {
        self.known
    }

    /// The given joints at the model's rate.
    pub(crate) fn mask(&self) -> &Mask {
        &self.mask
    }

    /// (P, C) which characters of the prompt's P words are given, and which of these are sampled ahead: those right after a
    /// gap.
    pub(crate) fn given(&self, words: usize) -> (Vec<bool>, Vec<bool>) {
        let is_given = |frame: usize, joint: usize| self.mask.is_given(frame, joint);
        let characters = (0..words).flat_map(|frame| self.joints.iter().map(move |&joint| (frame, joint)));
        let ends_gap = |(frame, joint)| is_given(frame, joint) && frame > 0 && !is_given(frame - 1, joint);
        (characters.clone().map(|(f, j)| is_given(f, j)).collect(), characters.map(ends_gap).collect())
    }

    /// Whether a gap ends where the clip continues, so that one way through it may be better than another.
    pub(crate) fn has_ends(&self) -> bool {
        let joints = (0..24).filter(|&joint| self.mask.is_coded(joint));
        joints.flat_map(|joint| self.mask.free_runs(joint)).any(|gap| gap.start > 0 && gap.end < self.frames)
    }

    /// Decodes words after `lead_in` frames, sampled ones in gaps and look-ahead ones after them, and closes the gaps.
    ///
    /// # Errors
    /// Words that are not this tokenizer's.
    pub(crate) fn close(
        &self,
        words: &Words,
        prompt: &PromptClip,
        lead_in: usize,
        tokenizer: &Tokenizer,
        lock_feet: bool,
    ) -> Result<ClosedGaps> {
        let uncoded: Vec<usize> = (0..24).filter(|&joint| !self.mask.is_coded(joint)).collect();
        let truth = extended(&prompt.clip, self.frames)?;
        // before the dance is merged in, which has no motion of its own for uncoded joints
        let truth = gap::bridge(&truth, &uncoded, &self.gaps(), &mean_pose(&prompt.clip))?;
        let dance = tokenizer.decode(words, UncodedPose::Clip(&prompt.clip))?.raised(prompt.under_m);
        let dance = dance.slice(lead_in.min(dance.frames())..dance.frames());
        let dance = extended(&dance, self.frames)?;
        let dance = merge(&truth, &dance, |_, joint| self.mask.is_coded(joint))?;
        let mut dance = gap::aligned(&dance, &truth, &self.mask)?;
        let mut locked = Vec::new();
        if lock_feet {
            // before the gaps are closed, so that what locking moves is part of the error that is spread
            (dance, locked) = feet::lock_gaps(&dance, &truth, &self.mask, prompt.ground_m()?)?;
        }
        let (clip, errors) = gap::close(&dance, &truth, &self.mask)?;
        Ok(ClosedGaps { clip, errors, locked })
    }

    /// Frames of the file in which something is generated, those left out in front not counted.
    pub(crate) fn generated(&self) -> Vec<Range<usize>> {
        let mask = &self.spans.mask;
        let is_free = |frame: usize| (0..24).any(|joint| mask.is_coded(joint) && !mask.is_given(frame, joint));
        Mask::runs(self.written, |frame| frame >= mask.frames() || is_free(frame))
    }

    /// Frames in which nothing is given, at the model's rate.
    fn gaps(&self) -> Vec<Range<usize>> {
        Mask::runs(self.frames, |frame| self.mask.is_all_free(frame))
    }

    /// The prompt's file with the dance spliced in, at another rate if one is requested, and which numbers are new, at its
    /// own.
    ///
    /// # Errors
    /// A rig that no skeleton map knows, a rate that is none.
    pub(crate) fn on_own_rig(
        &self,
        closed: &Clip,
        prompt: &PromptClip,
        fps: Option<f64>,
    ) -> Result<(Motion, Option<Changed>)> {
        let retarget = prompt.retarget()?;
        let rig = RigJoints::of(&retarget);
        let own = prompt.at_rate()?;
        let base = gap::bridge(&extended(&own, self.frames)?, &rig.others(), &self.gaps(), &mean_pose(&own))?;
        let dance = retarget.to_rig_over(closed, Some(&base))?;
        // the appended beginning is met at the end, and not written
        let appended = self.seam.as_ref().map_or(0, |seam| seam.appended);
        let frames = self.written + appended;
        let (clip, mut changed) = splice(&prompt.motion.clip, &dance, &self.spans.mask, &rig, frames, self.blend_s)?;
        if let (Some(fps), Some(_)) = (fps, &self.seam) {
            let clip = self.at_rate(&clip, self.written, fps)?;
            return Ok((self.whole.clone().with_clip(clip), None));
        }
        let clip = clip.slice(0..self.written);
        // the appended beginning was only there to be met
        changed.root.truncate(self.written);
        changed.joints.truncate(self.written * clip.joints());
        let (clip, changed) = match self.seam {
            // a rest pose in front would return with every round
            Some(_) => (clip, Changed { before: self.left_out, ..changed }),
            None => self.after_left_out(&clip, changed)?,
        };
        let clip = fps.map_or(Ok(clip.clone()), |fps| resample_held(&clip, fps, Method::Smooth))?;
        Ok((self.whole.clone().with_clip(clip), Some(changed).filter(|_| fps.is_none())))
    }

    /// The first `frames` of a dance at another rate. The last one is held; of a loop it leads into the beginning, which is
    /// appended.
    ///
    /// # Errors
    /// A rate that is none.
    pub(crate) fn at_rate(&self, clip: &Clip, frames: usize, fps: f64) -> Result<Clip> {
        if self.seam.is_none() {
            return Ok(resample_held(&clip.slice(0..frames), fps, Method::Smooth)?);
        }
        let resampled = resample(clip, fps, Method::Smooth)?;
        Ok(resampled.slice(0..held_frames(frames, clip.fps(), fps).min(resampled.frames())))
    }

    /// The clip after the frames of the file that reading leaves out.
    fn after_left_out(&self, clip: &Clip, changed: Changed) -> Result<(Clip, Changed)> {
        let front = self.whole.clip.slice(0..self.left_out);
        let root = [front.root(), clip.root()].concat();
        let rotations = [front.rotations(), clip.rotations()].concat();
        let after = |flags: Vec<bool>, n: usize| [vec![false; n], flags].concat();
        let joints = after(changed.joints, self.left_out * clip.joints());
        let changed = Changed { before: 0, root: after(changed.root, self.left_out), joints };
        Ok((Clip::new(clip.skeleton().clone(), clip.fps(), root, rotations)?, changed))
    }
}

/// The motion of the whole file. It is read again only where reading has left out frames, or the clip was lengthened.
fn whole(request: &PromptRequest, text: &[u8], read: &Motion, is_lengthened: bool) -> Result<Motion> {
    let is_whole = request.read.skip == 0 && !read.warnings.iter().any(|warning| warning.kind == "rest_frame");
    if is_whole && !is_lengthened {
        return Ok(read.clone());
    }
    let options = ReadOptions { skip: 0, rest: RestFrame::Keep, ..request.read.clone() };
    let motion = format::parse(&request.path, text, &options)?;
    Ok(request.written_as_requested(motion)?)
}

/// (C) the joint of each character.
fn joints_of_characters(tokenizer: &Tokenizer) -> Result<Vec<usize>> {
    let unsupported = |why: String| {
        let needs = "an edit needs a tokenizer of uniform or quantile bins, whose words are frames";
        Error::unsupported(Subject::about("`given`, `free`", "given"), format!("{why}; {needs}"))
    };
    let (WordLength::Fixed(characters), 1) = (tokenizer.word_length(), tokenizer.frames_per_word()) else {
        return Err(unsupported("words of this tokenizer are no single frames".into()));
    };
    let mut joints = vec![0; characters];
    for &joint in tokenizer.channels().joints() {
        let selection = Selection::of(vec![joint]);
        let own = tokenizer.slots_of(&selection).map_err(|e| unsupported(e.to_string()))?;
        own.into_iter().for_each(|character| joints[character] = joint);
    }
    Ok(joints)
}
