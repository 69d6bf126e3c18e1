//! A clip edited: chosen joints at chosen times are invented anew, all else stays as it is.
//!
//! What is asked for is read ([`mask`]), drawn as any dance is, with the given characters in their places, brought to
//! what is given on both sides ([`close`]), and put into the clip at its file's own rate ([`splice`]). docs/editing.md.

pub mod close;
pub mod feet;
pub mod mask;
pub mod round;
pub mod splice;

use super::prompt::Prompt;
use super::request::{Edit, PromptRequest};
use super::rest::{RestJoints, mean_pose};
use crate::{Error, Result};
use close::LeftOver;
use kinelm_motion::feet::FootLock;
use kinelm_motion::format::{self, ReadOptions, RestFrame, bvh::Changed};
use kinelm_motion::joints::Selection;
use kinelm_motion::moment::Timebase;
use kinelm_motion::resample::{Method, held_frames, resample, resample_held};
use kinelm_motion::rig::{SkeletonMap, floor};
use kinelm_motion::{Clip, Motion};
use kinelm_tokenizer::{Tokenizer, WordLength, Words};
use mask::Mask;
use round::Seam;
use splice::{RigJoints, lengthened, on_both, spliced};
use std::ops::Range;
use std::sync::Arc;

/// An edit of a prompt, understood.
pub struct Edited {
    /// What was understood, and what is given of the clip.
    pub read: mask::Read,
    /// The whole file, with frames that are left out on reading.
    whole: Motion,
    /// Its bytes.
    pub(super) text: Arc<[u8]>,
    /// Those frames, in front.
    pub left_out: usize,
    /// Frames at the model's rate, such that they reach to the end of the clip.
    pub frames: usize,
    /// Frames that are written, without those left out.
    written: usize,
    /// What is given at the model's rate.
    model: Mask,
    /// A place of a word is this joint's.
    places: Vec<usize>,
    blend_s: f64,
    /// Of a clip that goes round.
    pub seam: Option<Seam>,
    known: usize,
}

/// What came out of words: on SMPL-24, at the model's rate.
pub struct Closed {
    /// What is given as the prompt has it, what is free invented.
    pub clip: Clip,
    /// What was left over at the ends of gaps.
    pub left: Vec<LeftOver>,
    /// What was done to feet, gap by gap.
    pub locked: Vec<FootLock>,
}

impl Closed {
    /// All that was left over, as one number; see [`LeftOver::total`].
    pub fn left_over(&self) -> f64 {
        self.left.iter().map(LeftOver::total).sum()
    }
}

impl Edited {
    /// Understands an edit of the bytes of a clip; spans get SMPL's names. `frames`: as many as are asked for, at the model's rate, if any are.
    /// `seam`: of a prompt that was laid to go round.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Call`]: see [`Mask::read`]; words of several frames or of several lengths, merged tokens; nothing to
    /// invent; fewer frames than the prompt has; others, of one that goes round.
    pub fn load(
        edit: &mut Edit,
        frames: Option<usize>,
        (recipe, text): (&PromptRequest, &Arc<[u8]>),
        (prompt, seam): (&Prompt, Option<Seam>),
        tokenizer: &Tokenizer,
    ) -> Result<Edited> {
        let places = places(tokenizer).map_err(|e| Error::call(format!("--given, --free: {e}")))?;
        let options = ReadOptions { skip: 0, rest: RestFrame::Keep, ..recipe.read.clone() };
        let whole = format::parse(&recipe.path, text, &options)?;
        let (clip, fps) = (&prompt.motion.clip, tokenizer.fps());
        let again = seam.as_ref().map_or(0, |seam| seam.again);
        let left_out = whole.clip.frames().saturating_sub(clip.frames() - again);
        let scale = Timebase { frames: clip.frames(), fps: clip.fps(), left_out, model_fps: Some(fps) };
        let rig = (&**clip.skeleton(), recipe.read.map.as_deref());
        let looped = seam.as_ref().map(|seam| seam.span(left_out));
        let (given, free) = match &looped {
            Some(gap) => (&[][..], std::slice::from_ref(gap)),
            None => (&edit.given[..], &edit.free[..]),
        };
        let read = Mask::read((given, free), scale, tokenizer, rig).map_err(Error::call)?;
        // the last frame of the model that lies within so many of the file
        let within = |frames: usize| ((frames - 1) as f64 * fps / clip.fps() + 1e-9) as usize + 1;
        let known = seam.as_ref().map_or(prompt.frames(), |seam| within(seam.frames()));
        if let Some(frames) = frames.filter(|&frames| seam.is_some() && frames != known) {
            let what = format!("--loop: {frames} frames; a clip that goes round stays as long as it is, {known}");
            return Err(Error::call(what));
        }
        if let Some(frames) = frames.filter(|&frames| frames < known) {
            let what = format!(
                "{frames} frames of a prompt of {known}; an edited clip is as long at least: cut it first (kinelm convert --to)"
            );
            return Err(Error::call(what));
        }
        let longer = frames.filter(|&frames| frames > known);
        if !read.mask.frees_anything() && longer.is_none() {
            return Err(Error::call("nothing is free: all joints that the model knows are given throughout"));
        }
        if !edit.given.is_empty() && (0..clip.frames()).all(|frame| read.mask.is_all_free(frame)) {
            let what = "nothing is given in the end: what is free is taken off what is given, wherever both are named";
            return Err(Error::call(what));
        }
        for (spans, read) in [(&mut edit.given, &read.given), (&mut edit.free, &read.free)] {
            if seam.is_some() {
                break;
            }
            *spans = read.iter().map(|understood| understood.span.clone()).collect();
        }
        let reach = ((clip.frames() - 1) as f64 * fps / clip.fps() - 1e-9).ceil() as usize + 1;
        let frames = longer.unwrap_or(reach).max(reach);
        let own = seam.as_ref().map_or(clip.frames(), Seam::frames);
        let written = longer.map_or(own, |n| held_frames(n, fps, clip.fps()));
        let model = read.mask.at_model_rate(frames, reach);
        Ok(Edited {
            read,
            whole,
            text: text.clone(),
            left_out,
            frames,
            written,
            model,
            places,
            blend_s: edit.blend_s,
            seam,
            known,
        })
    }

    /// Frames of what is written, at the model's rate, where no more are asked for.
    pub fn known(&self) -> usize {
        self.known
    }

    /// What is given at the model's rate.
    pub fn model(&self) -> &Mask {
        &self.model
    }

    /// (P, C) which characters of the prompt's words are given, and which of these are foretold: those behind a gap.
    pub fn given(&self, words: usize) -> (Vec<bool>, Vec<bool>) {
        let is_given = |frame: usize, joint: usize| self.model.is_given(frame, joint);
        let places = (0..words).flat_map(|frame| self.places.iter().map(move |&joint| (frame, joint)));
        let foretold = |(frame, joint)| is_given(frame, joint) && frame > 0 && !is_given(frame - 1, joint);
        (places.clone().map(|(f, j)| is_given(f, j)).collect(), places.map(foretold).collect())
    }

    /// Whether a gap ends where the clip goes on, so that one way through it may be better than another.
    pub fn has_ends(&self) -> bool {
        let joints = (0..24).filter(|&joint| self.model.is_coded(joint));
        joints.flat_map(|joint| self.model.free_runs(joint)).any(|gap| gap.start > 0 && gap.end < self.frames)
    }

    /// Whether nothing is given in the first frame.
    pub fn begins_from_nothing(&self) -> bool {
        self.model.is_all_free(0)
    }

    /// What words make behind so many frames that led in: drawn ones, and behind every gap those that were foretold.
    ///
    /// # Errors
    /// Words that are not this tokenizer's.
    pub fn closed(
        &self,
        words: &Words,
        (prompt, lead_in): (&Prompt, usize),
        tokenizer: &Tokenizer,
        hold_feet: bool,
    ) -> Result<Closed> {
        let uncoded: Vec<usize> = (0..24).filter(|&joint| !self.model.is_coded(joint)).collect();
        let truth = lengthened(&prompt.clip, self.frames)?;
        let truth = close::bridged(&truth, &uncoded, &self.gaps(), &mean_pose(&prompt.clip))?;
        let drawn = prompt.decode(tokenizer, words, RestJoints::Prompt, 0)?;
        let drawn = drawn.slice(lead_in.min(drawn.frames())..drawn.frames());
        let drawn = lengthened(&drawn, self.frames)?;
        let drawn = on_both(&truth, &drawn, |_, joint| self.model.is_coded(joint))?;
        let mut dance = close::aligned(&drawn, &truth, &self.model)?;
        let mut locked = Vec::new();
        if hold_feet {
            let floor_m = match prompt.under_m() {
                Some(floor_m) => floor_m,
                None => floor(&prompt.clip, &SkeletonMap::by_name_or_file("smpl")?)?.height_m,
            };
            (dance, locked) = feet::held(&dance, &truth, &self.model, floor_m)?;
        }
        let (clip, left) = close::closed(&dance, &truth, &self.model)?;
        Ok(Closed { clip, left, locked })
    }

    /// Frames of what is written, those that are left out in front not counted, in which something is invented.
    pub fn anew(&self) -> Vec<Range<usize>> {
        let mask = &self.read.mask;
        let is_free = |frame: usize| (0..24).any(|joint| mask.is_coded(joint) && !mask.is_given(frame, joint));
        Mask::runs(self.written, |frame| frame >= mask.frames() || is_free(frame))
    }

    /// Frames in which nothing is given, at the model's rate.
    fn gaps(&self) -> Vec<Range<usize>> {
        Mask::runs(self.frames, |frame| self.model.is_all_free(frame))
    }

    /// The prompt's file with what was invented put in, at another rate if one is asked for, and what of it is new, at its own.
    ///
    /// # Errors
    /// A rig that no skeleton map knows, a rate that is none.
    pub fn on_own_rig(
        &self,
        closed: &Clip,
        (prompt, map): (&Prompt, Option<&str>),
        fps: Option<f64>,
    ) -> Result<(Motion, Option<Changed>)> {
        let way = prompt.way(map)?;
        let rig = RigJoints::of(&way);
        let own = prompt.at_rate()?;
        let base = close::bridged(&lengthened(&own, self.frames)?, &rig.others(), &self.gaps(), &mean_pose(&own))?;
        let dance = way.to_rig_over(closed, Some(&base))?;
        let (clips, how) = ((&prompt.motion.clip, &dance), (&self.read.mask, &rig));
        // what was laid behind the end is met there, and not written
        let again = self.seam.as_ref().map_or(0, |seam| seam.again);
        let (clip, mut changed) = spliced(clips, how, self.written + again, self.blend_s)?;
        if let (Some(fps), Some(_)) = (fps, &self.seam) {
            let clip = self.turn(&clip, self.written, fps)?;
            return Ok((Motion { clip, ..self.whole.clone() }, None));
        }
        let clip = clip.slice(0..self.written);
        changed.root.truncate(self.written);
        changed.joints.truncate(self.written * clip.joints());
        let (clip, changed) = match self.seam {
            // a rest pose in front would come round with every turn
            Some(_) => (clip, Changed { before: self.left_out, ..changed }),
            None => self.behind_left_out(&clip, changed)?,
        };
        let clip = fps.map_or(Ok(clip.clone()), |fps| resample_held(&clip, fps, Method::Smooth))?;
        Ok((Motion { clip, ..self.whole.clone() }, Some(changed).filter(|_| fps.is_none())))
    }

    /// The first `frames` of a dance at another rate. The last one is held, but where the clip goes round: there it goes on into
    /// the beginning, which stands behind.
    ///
    /// # Errors
    /// A rate that is none.
    pub fn turn(&self, clip: &Clip, frames: usize, fps: f64) -> Result<Clip> {
        if self.seam.is_none() {
            return Ok(resample_held(&clip.slice(0..frames), fps, Method::Smooth)?);
        }
        let turned = resample(clip, fps, Method::Smooth)?;
        Ok(turned.slice(0..held_frames(frames, clip.fps(), fps).min(turned.frames())))
    }

    /// Behind the frames of the file that were left out on reading.
    fn behind_left_out(&self, clip: &Clip, changed: Changed) -> Result<(Clip, Changed)> {
        let front = self.whole.clip.slice(0..self.left_out);
        let root = [front.root(), clip.root()].concat();
        let rotations = [front.rotations(), clip.rotations()].concat();
        let before = |flags: Vec<bool>, n: usize| [vec![false; n], flags].concat();
        let joints = before(changed.joints, self.left_out * clip.joints());
        let changed = Changed { before: 0, root: before(changed.root, self.left_out), joints };
        Ok((Clip::new(clip.skeleton().clone(), clip.fps(), root, rotations)?, changed))
    }
}

/// (C) the joint of each place of a word.
fn places(tokenizer: &Tokenizer) -> std::result::Result<Vec<usize>, String> {
    let expected = "an edit needs a tokenizer of uniform or quantile bins, whose words are frames";
    let (WordLength::Fixed(characters), 1) = (tokenizer.word_length(), tokenizer.frames_per_word()) else {
        return Err(format!("words of this tokenizer are no single frames; {expected}"));
    };
    let mut places = vec![0; characters];
    for &joint in tokenizer.channels().joints() {
        let selection = Selection { joints: vec![joint], translation: joint == 0 };
        let own = tokenizer.slots_of(&selection).map_err(|e| format!("{e}; {expected}"))?;
        own.into_iter().for_each(|place| places[place] = joint);
    }
    Ok(places)
}
