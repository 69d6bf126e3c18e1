//! A prompt clip as the model sees it, and the way back to the user's rig.

pub mod uncoded;

use crate::request::{PromptRequest, Resolved, Rig};
use crate::{Error, Result};
use kinelm_corpus::load::ModelClip;
use kinelm_motion::format::{self, ReadOptions};
use kinelm_motion::joints::Selection;
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::retarget::{self, Retarget};
use kinelm_motion::rig::Humanoid;
use kinelm_motion::{Clip, Motion, Source, Warning, smpl};
use kinelm_tokenizer::{Encoded, Tokenizer, WordLength, Words};
use std::path::Path;

/// A prompt clip, read.
#[derive(Debug, Clone)]
pub struct PromptClip {
    /// As read from the file, on the user's rig.
    pub motion: Motion,
    /// On SMPL-24 at the tokenizer's rate.
    pub clip: Clip,
    /// The floor of the file, metres; `None` where the tokenizer doesn't subtract it.
    pub floor_m: Option<f64>,
    /// The floor under `clip`, metres; 0 where the tokenizer doesn't subtract it.
    pub under_m: f64,
    /// The words of `clip`.
    pub words: Words,
    /// Values outside the tokenizer's ranges, heights above the floor not counted.
    pub clipped: u64,
    /// SHA-256 of the file.
    pub sha256: String,
}

impl PromptClip {
    /// Reads a prompt.
    ///
    /// # Errors
    /// Errors of reading; a rig that no skeleton map knows; a clip without frames, or that can't be coded.
    pub fn load(path: &Path, options: &ReadOptions, tokenizer: &Tokenizer) -> Result<PromptClip> {
        PromptClip::of(ModelClip::load(path, options, tokenizer.config().into())?, tokenizer)
    }

    /// Reads a prompt from the bytes of the file `path`.
    ///
    /// # Errors
    /// Those of [`PromptClip::load`].
    pub fn parse(path: &Path, bytes: &[u8], options: &ReadOptions, tokenizer: &Tokenizer) -> Result<PromptClip> {
        PromptClip::of(ModelClip::parse(path, bytes, options, tokenizer.config().into())?, tokenizer)
    }

    fn of(placed: ModelClip, tokenizer: &Tokenizer) -> Result<PromptClip> {
        // coded on y = 0, decoded and raised again: the words don't depend on the file's floor
        let lowered = placed.lowered();
        let ModelClip { mut motion, clip, floor_m, clip_floor_m: under_m, sha256, .. } = placed;
        if clip.frames() == 0 {
            return Err(Error::file(&motion.path, "no frames", "at least one", "give another prompt"));
        }
        let coded = tokenizer.encode(&lowered)?;
        motion.warnings.extend(height_warning(&coded, clip.frames()));
        // heights outside the range are clamped and reported above; they delay nothing
        let clipped = coded.clipped.saturating_sub(coded.off_range);
        Ok(PromptClip { motion, clip, floor_m, under_m, words: coded.words, clipped, sha256 })
    }

    /// The same prompt with this skeleton map of its rig.
    ///
    /// # Errors
    /// Those of [`PromptClip::load`].
    pub fn with_map(self, map: &str, options: &ReadOptions, tokenizer: &Tokenizer) -> Result<PromptClip> {
        let (warnings, motion) = (self.motion.warnings.clone(), self.motion.with_map(map)?);
        let mut again = PromptClip::of(ModelClip::of(motion, options, tokenizer.config().into())?, tokenizer)?;
        again.motion.warnings = warnings;
        Ok(PromptClip { sha256: self.sha256, ..again })
    }

    /// The same prompt with another motion of the same rig, rate and first frame.
    ///
    /// # Errors
    /// Errors of retargeting and coding.
    pub(crate) fn with_motion(self, motion: Motion, tokenizer: &Tokenizer) -> Result<PromptClip> {
        let clip = resample(&retarget::to_smpl(&motion)?, tokenizer.fps(), Method::Auto)?;
        let words = tokenizer.encode(&clip.clone().raised(-self.under_m))?.words;
        Ok(PromptClip { motion, clip, words, ..self })
    }

    /// P, its frames at the tokenizer's rate.
    pub fn frames(&self) -> usize {
        self.clip.frames()
    }

    /// The floor under `clip`, metres: the file's, or detected from the feet where the tokenizer doesn't subtract it.
    ///
    /// # Errors
    /// None for a clip that was read.
    pub fn ground_m(&self) -> Result<f64> {
        match self.floor_m {
            Some(_) => Ok(self.under_m),
            None => Ok(Humanoid::neutral().floor(&self.clip)?.height_m),
        }
    }

    /// How far a decoded dance that follows the clip's path is raised to y = 0, metres; `first_m` is the height of its
    /// first frame, which is the clip's, above the floor or not as the tokenizer codes heights.
    ///
    /// # Errors
    /// Those of [`PromptClip::ground_m`].
    pub(crate) fn rise_m(&self, first_m: f64) -> Result<f64> {
        match self.floor_m {
            Some(_) => Ok(0.0),
            None => Ok(self.clip.root()[0].y - self.ground_m()? - first_m),
        }
    }

    /// On the user's rig at the tokenizer's rate.
    ///
    /// # Errors
    /// None for a clip that was read.
    pub(crate) fn at_rate(&self) -> Result<Clip> {
        Ok(resample(&self.motion.clip, self.clip.fps(), Method::Auto)?)
    }

    /// Ids of the words of the first `frames` frames, for a dance to begin with; no word that the clip's end would change.
    ///
    /// # Errors
    /// More frames than the prompt has, or too few for a word.
    pub(crate) fn beginning(&self, tokenizer: &Tokenizer, frames: usize) -> Result<Vec<u32>> {
        if frames > self.frames() {
            let expected = format!("a frame of the prompt, which has {}", self.frames());
            return Err(Error::invalid_parameter("from_frame", frames, expected));
        }
        let whole = frames / tokenizer.frames_per_word();
        let unsettled = tokenizer.scheme().unsettled_words();
        if whole <= unsettled {
            let (least, has) = ((unsettled + 1) * tokenizer.frames_per_word(), self.frames());
            let expected = format!("at least {least} frames, a word of this tokenizer; the prompt has {has}");
            return Err(Error::invalid_parameter("from_frame", frames, expected));
        }
        let clip = self.clip.slice(0..whole * tokenizer.frames_per_word()).raised(-self.under_m);
        Ok(tokenizer.ids_of_words(&tokenizer.encode(&clip)?.words.slice(0..whole - unsettled))?)
    }

    /// A dance on SMPL-24 with its floor at y = 0, retargeted to the prompt's rig as it will be written, about the
    /// height `about_m` of that rig, metres. Joints without an SMPL joint move as in `base`, a clip on that rig, or
    /// hold the rest pose.
    ///
    /// # Errors
    /// A rig that no skeleton map knows.
    pub(crate) fn on_own_rig(&self, dance: &Clip, about_m: f64, base: Option<&Clip>) -> Result<Motion> {
        let clip = self.retarget()?.with_floor(about_m).to_rig_over(dance, base)?;
        Ok(self.motion.clone().with_clip(clip))
    }

    /// The height about which the path of a dance on y = 0 is scaled to the prompt's own rig, metres: a path that it follows
    /// comes back as far above y = 0 as it is above the prompt's floor, whatever floor was stated.
    ///
    /// # Errors
    /// A rig that no skeleton map knows.
    pub(crate) fn about_m(&self, follows_path: bool) -> Result<f64> {
        if !follows_path {
            return Ok(0.0);
        }
        Ok(format::floor_height(&self.motion)? - self.ground_m()?)
    }

    /// The retargeting between the prompt's own rig, on its own floor, and SMPL-24.
    ///
    /// # Errors
    /// A rig that no skeleton map knows.
    pub(crate) fn retarget(&self) -> Result<Retarget> {
        let floor_m = format::floor_height(&self.motion)?;
        Ok(Retarget::new(self.motion.humanoid()?, smpl::neutral())?.with_floor(floor_m))
    }
}

/// The share of frames with heights off the range above which a warning is printed.
const OFF_RANGE: f64 = 0.01;

/// The warning of heights that the tokenizer was not made for.
fn height_warning(coded: &Encoded, frames: usize) -> Option<Warning> {
    let share = coded.off_range as f64 / frames.max(1) as f64;
    let what = format!(
        "in {:.1} % of frames the pelvis is higher or lower above the floor than in the clips that the tokenizer was fitted on: \
         its height is clamped; state the height of the floor (`floor`)",
        100.0 * share
    );
    (share > OFF_RANGE).then_some(Warning { kind: "height_off_range", what })
}

/// A dance that follows a prompt read from its file, and its words. `None` where the file doesn't have the frames that were
/// sampled: its rate is no multiple of the tokenizer's.
///
/// # Errors
/// Errors of reading, retargeting and coding.
pub fn read_back(
    dance: &Path,
    request: &Resolved,
    prompt: &PromptClip,
    tokenizer: &Tokenizer,
) -> Result<Option<(Motion, Words)>> {
    let options = request.read_back(dance);
    let mut motion = format::read(dance, &options)?;
    match resample(&motion.clip, tokenizer.fps(), Method::Stride) {
        Ok(sampled) => motion = motion.with_clip(sampled),
        Err(_) => return Ok(None),
    }
    let follows_path = request.prompt.as_ref().is_some_and(PromptRequest::gives_path);
    // the way back has the floor of the way there, not one that the dance's own feet show
    let floor_m = if request.rig == Rig::Prompt { prompt.about_m(follows_path)? } else { 0.0 };
    let known = motion.clone().with_source(Source::Retargeted { floor_m });
    let mut clip = retarget::to_smpl(&known)?;
    if let Some(first) = clip.root().first().filter(|_| follows_path && prompt.floor_m.is_none()) {
        let rise = prompt.clip.root()[0].y - first.y;
        clip = clip.raised(rise);
    }
    Ok(Some((motion, tokenizer.encode(&clip)?.words)))
}

/// The share of given characters that differ between two codings: `codes` and `again` are (F, C), of which the first `frames`
/// frames count. `given`: (C). `None` when nothing is given.
pub fn share_changed(codes: &[u16], again: &[u16], given: &[bool], frames: usize) -> Option<f64> {
    let c = given.len();
    let (mut all, mut changed) = (0u64, 0u64);
    for (i, code) in codes.iter().enumerate().take(frames * c) {
        if given[i % c] {
            all += 1;
            changed += u64::from(again.get(i) != Some(code));
        }
    }
    (all > 0).then(|| changed as f64 / all as f64)
}

/// (C) which characters of a word belong to the joints of a selection.
///
/// # Errors
/// A tokenizer whose characters belong to no one joint, or that codes none of the joints.
pub fn given_characters(tokenizer: &Tokenizer, selection: &Selection) -> Result<Vec<bool>> {
    let has_turn = tokenizer.channels().has_turn();
    if (selection.path || selection.tilt) && !selection.joints.contains(&0) && !has_turn {
        let why = "this tokenizer has no slot for the turn about the vertical: it codes the pelvis's rotation as a whole \
                   (`root_rotation` absolute); give `pelvis`, or a model with heading_delta";
        return Err(Error::unsupported("a given path or tilt", why));
    }
    let places = tokenizer.slots_of(selection)?;
    let WordLength::Fixed(characters) = tokenizer.word_length() else {
        let why = "words of this tokenizer differ in length: no character is always the same joint's";
        return Err(Error::unsupported("given joints", why));
    };
    let mut given = vec![false; characters];
    places.into_iter().for_each(|place| given[place] = true);
    if !given.contains(&true) {
        let joints: Vec<_> = tokenizer.channels().joints().iter().map(|&j| smpl::NAMES[j]).collect();
        let why = format!("none of these joints is coded; this tokenizer codes {}", joints.join(" "));
        return Err(Error::unsupported("given joints", why));
    }
    Ok(given)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_given_characters_of_prompted_frames_count() {
        let given = [true, false];
        assert_eq!(share_changed(&[1, 2, 3, 4, 5, 6], &[1, 9, 3, 9, 9, 9], &given, 2), Some(0.0));
        assert_eq!(share_changed(&[1, 2, 3, 4], &[1, 2, 9, 4], &given, 2), Some(0.5));
        assert_eq!(share_changed(&[1, 2, 3, 4], &[1, 2], &given, 2), Some(0.5));
        assert_eq!(share_changed(&[1, 2], &[1, 2], &[false, false], 1), None);
    }
}
