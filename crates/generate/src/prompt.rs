//! A prompt: a clip in the user's own rig, as the model sees it, and the way back.

use super::request::{Resolved, Rig};
use super::rest::{self, RestJoints};
use crate::{Error, Result};
use kinelm_corpus::load::{Placed, load_placed, parse_placed};
use kinelm_motion::format::{self, ReadOptions};
use kinelm_motion::joints::Selection;
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::retarget::{self, Retarget};
use kinelm_motion::rig::map_for;
use kinelm_motion::{Clip, Motion, Source, Warning, smpl};
use kinelm_tokenizer::{Encoded, Tokenizer, UncodedPose, WordLength, Words};
use std::path::Path;

/// A prompt clip, read.
#[derive(Debug, Clone)]
pub struct Prompt {
    /// As it came from the file, on the user's rig.
    pub motion: Motion,
    /// On SMPL-24 at the tokenizer's rate.
    pub clip: Clip,
    /// Where the file's floor is, metres, and where under `clip`; what the tokenizer doesn't take off is 0.
    pub floor_m: Option<f64>,
    under_m: f64,
    /// Its words.
    pub words: Words,
    /// How many of its values lie outside what the tokenizer codes, heights above the floor not counted.
    pub clipped: u64,
    /// SHA-256 of the file.
    pub sha256: String,
}

impl Prompt {
    /// Reads a prompt.
    ///
    /// # Errors
    /// What reading fails with, and a rig that no skeleton map knows; a clip without frames, and one that can't be coded.
    pub fn load(path: &Path, options: &ReadOptions, tokenizer: &Tokenizer) -> Result<Prompt> {
        Prompt::of(load_placed(path, options, tokenizer.config().into())?, tokenizer)
    }

    /// The same of bytes that are read as the file `path` would be.
    ///
    /// # Errors
    /// Those of [`Prompt::load`].
    pub fn parse(path: &Path, bytes: &[u8], options: &ReadOptions, tokenizer: &Tokenizer) -> Result<Prompt> {
        Prompt::of(parse_placed(path, bytes, options, tokenizer.config().into())?, tokenizer)
    }

    fn of(placed: Placed, tokenizer: &Tokenizer) -> Result<Prompt> {
        let lowered = placed.lowered();
        let Placed { mut motion, clip, floor_m, under_m, sha256 } = placed;
        if clip.frames() == 0 {
            return Err(Error::file(&motion.path, "no frames", "at least one", "give another prompt"));
        }
        let coded = tokenizer.encode(&lowered)?;
        motion.warnings.extend(off_range(&coded, clip.frames()));
        // heights off the range are clamped and told above; they delay nothing
        let clipped = coded.clipped.saturating_sub(coded.off_range);
        Ok(Prompt { motion, clip, floor_m, under_m, words: coded.words, clipped, sha256 })
    }

    /// The same prompt with another motion of the same rig, rate and first frame.
    ///
    /// # Errors
    /// What retargeting and coding fail with.
    pub fn with_motion(self, motion: Motion, map: Option<&str>, tokenizer: &Tokenizer) -> Result<Prompt> {
        let clip = resample(&retarget::to_smpl(&motion, map)?, tokenizer.fps(), Method::Auto)?;
        let words = tokenizer.encode(&clip.clone().raised(-self.under_m))?.words;
        Ok(Prompt { motion, clip, words, ..self })
    }

    /// P, its frames at the tokenizer's rate.
    pub fn frames(&self) -> usize {
        self.clip.frames()
    }

    /// Where the floor is under `clip`, metres; `None` where the tokenizer doesn't take it off.
    pub fn under_m(&self) -> Option<f64> {
        self.floor_m.map(|_| self.under_m)
    }

    /// On the user's rig at the tokenizer's rate.
    ///
    /// # Errors
    /// None that a clip brings about which was read.
    pub fn at_rate(&self) -> Result<Clip> {
        Ok(resample(&self.motion.clip, self.clip.fps(), Method::Auto)?)
    }

    /// Ids of the words of the first `frames` frames, for a dance to begin with: no word that the clip's end would be in.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Call`] when that leaves none.
    pub fn beginning(&self, tokenizer: &Tokenizer, frames: usize) -> Result<Vec<u32>> {
        if frames > self.frames() {
            return Err(Error::call(format!(
                "frame {frames} of a prompt of {}; expected one that it has",
                self.frames()
            )));
        }
        let whole = frames / tokenizer.frames_per_word();
        let unsettled = tokenizer.scheme().unsettled_words();
        if whole <= unsettled {
            let (least, has) = ((unsettled + 1) * tokenizer.frames_per_word(), self.frames());
            return Err(Error::call(format!(
                "{frames} frames of a prompt of {has}; words of this tokenizer need at least {least} to begin with"
            )));
        }
        let words =
            tokenizer.encode(&self.clip.slice(0..whole * tokenizer.frames_per_word()).raised(-self.under_m))?.words;
        Ok(tokenizer.ids_of_words(&words.slice(0..whole - unsettled))?)
    }

    /// The clip of a new dance's words, the other joints as asked; `followed` frames of the prompt count for
    /// [`RestJoints::Follow`].
    ///
    /// # Errors
    /// Words that are not this tokenizer's.
    pub fn decode(&self, tokenizer: &Tokenizer, words: &Words, rest: RestJoints, followed: usize) -> Result<Clip> {
        let (mean, settling);
        let rest = match rest {
            RestJoints::Identity => UncodedPose::Identity,
            RestJoints::Training => tokenizer.uncoded_pose(),
            RestJoints::Prompt => UncodedPose::Clip(&self.clip),
            RestJoints::Mean => {
                let pose = rest::mean_pose(&self.clip);
                mean = std::array::from_fn(|j| pose[j]);
                UncodedPose::Pose(&mean)
            }
            RestJoints::Follow => {
                settling = rest::settling(&self.clip, followed)?;
                UncodedPose::Clip(&settling)
            }
        };
        Ok(tokenizer.decode(words, rest)?.raised(self.under_m))
    }

    /// A dance on SMPL-24 put on the prompt's own rig, as it will be written. Joints that no SMPL joint stands for move as
    /// in `base`, a clip on that rig, or stand at rest.
    ///
    /// # Errors
    /// A rig that no skeleton map knows.
    pub fn on_own_rig(&self, dance: &Clip, map: Option<&str>, base: Option<&Clip>) -> Result<Motion> {
        let clip = self.way(map)?.to_rig_over(dance, base)?;
        Ok(Motion { clip, source: self.motion.source.clone(), ..self.motion.clone() })
    }

    /// The way between the prompt's own rig and SMPL-24.
    ///
    /// # Errors
    /// A rig that no skeleton map knows.
    pub fn way(&self, map: Option<&str>) -> Result<Retarget> {
        let rig = self.motion.clip.skeleton();
        let floor_m = format::floor_height(&self.motion, map)?;
        Ok(Retarget::new(rig, &map_for(rig, map)?, smpl::neutral())?.with_floor(floor_m))
    }
}

/// What there is to say of heights that the tokenizer was not made for.
fn off_range(coded: &Encoded, frames: usize) -> Option<Warning> {
    let share = coded.off_range as f64 / frames.max(1) as f64;
    let what = format!(
        "in {:.1} % of frames the pelvis is higher or lower above the floor than in the clips that the tokenizer was fitted on: \
         its height ends there; --floor METRES says where the floor is",
        100.0 * share
    );
    (share > OFF_RANGE).then_some(Warning { kind: "height_off_range", what })
}

/// The share of frames off the range of heights that is said.
const OFF_RANGE: f64 = 0.01;

/// A dance on its prompt's own rig as it is read from its file, and its words, with the floor where its way there had it:
/// the prompt's. `None` where the file has none of the frames that were drawn, at another rate, or is on the model's rig.
///
/// # Errors
/// What reading, retargeting and coding fail with.
pub fn read_back(
    dance: &Path,
    recipe: &Resolved,
    prompt: &Prompt,
    tokenizer: &Tokenizer,
) -> Result<Option<(Motion, Words)>> {
    if recipe.rig != Rig::Prompt {
        return Ok(None);
    }
    let options = recipe.read_back(dance);
    let mut motion = format::read(dance, &options)?;
    // of a dance at a higher rate the frames that were drawn; at others there are none of them
    match resample(&motion.clip, tokenizer.fps(), Method::Stride) {
        Ok(drawn) => motion.clip = drawn,
        Err(_) => return Ok(None),
    }
    let floor = prompt.floor_m.unwrap_or(0.0);
    // the way there went about the prompt's floor
    let floor_m = format::floor_height(&prompt.motion, options.map.as_deref())? - floor;
    let clip = motion.clip.clone().raised(-floor);
    let lowered = Motion { clip, source: Source::Retargeted { floor_m }, ..motion.clone() };
    let words = tokenizer.encode(&retarget::to_smpl(&lowered, options.map.as_deref())?)?.words;
    Ok(Some((motion, words)))
}

/// The share of given characters that another reading of the dance codes otherwise: `codes` and `again` are (F, C), of
/// `prompt` frames only the first count. `None` when nothing was given.
pub fn share_changed(codes: &[u16], again: &[u16], given: &[bool], prompt: usize) -> Option<f64> {
    let c = given.len();
    let (mut all, mut changed) = (0u64, 0u64);
    for (i, code) in codes.iter().enumerate().take(prompt * c) {
        if given[i % c] {
            all += 1;
            changed += u64::from(again.get(i) != Some(code));
        }
    }
    (all > 0).then(|| changed as f64 / all as f64)
}

/// (C) which places of a word a selection gives.
///
/// # Errors
/// [`Error::Tokenizer`] with the reason, where characters belong to no one joint; [`kinelm_store::Error::Call`] when the tokenizer codes
/// none of the joints.
pub fn given_places(tokenizer: &Tokenizer, selection: &Selection) -> Result<Vec<bool>> {
    let places = tokenizer.slots_of(selection)?;
    let WordLength::Fixed(characters) = tokenizer.word_length() else {
        return Err(Error::call("words differ in length: no place is always the same joint's"));
    };
    let mut given = vec![false; characters];
    places.into_iter().for_each(|place| given[place] = true);
    if !given.contains(&true) {
        let joints: Vec<_> = tokenizer.channels().joints().iter().map(|&j| smpl::NAMES[j]).collect();
        return Err(Error::call(format!("none of these joints is coded; this tokenizer codes {}", joints.join(" "))));
    }
    Ok(given)
}

/// The motion of a dance on the model's own rig.
pub fn on_model_rig(path: &Path, clip: Clip) -> Motion {
    Motion { path: path.to_owned(), clip, source: Source::Plain, warnings: Vec::new() }
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
