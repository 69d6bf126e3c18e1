//! A prompt: a clip in the user's own rig, as the model sees it, and the way back.

use crate::corpus::load::load_clip;
use crate::{Error, Result};
use kinelm_motion::format::ReadOptions;
use kinelm_motion::joints::Selection;
use kinelm_motion::retarget::{self, Retarget};
use kinelm_motion::{Clip, Motion, Quat, Source, smpl};
use kinelm_tokenizer::{Rest, Tokenizer, WordLength, Words};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// A prompt clip, read.
#[derive(Debug, Clone)]
pub struct Prompt {
    /// As it came from the file, on the user's rig.
    pub motion: Motion,
    /// On SMPL-24 at the tokenizer's rate.
    pub clip: Clip,
    /// Its words.
    pub words: Words,
}

/// What the joints that the model doesn't know do in a new dance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum RestJoints {
    /// They stand at rest.
    #[default]
    Identity,
    /// They move as in the prompt; where it has ended, they hold its last frame.
    Prompt,
    /// They hold their mean over the prompt.
    Mean,
}

impl Prompt {
    /// Reads a prompt.
    ///
    /// # Errors
    /// What reading fails with, and a rig that no skeleton map knows; a clip without frames, and one that can't be coded.
    pub fn load(path: &Path, options: &ReadOptions, tokenizer: &Tokenizer) -> Result<Prompt> {
        let (motion, clip) = load_clip(path, options, tokenizer.fps())?;
        if clip.frames() == 0 {
            return Err(Error::file(path, "no frames", "at least one", "give another prompt"));
        }
        let words = tokenizer.encode(&clip)?.words;
        Ok(Prompt { motion, clip, words })
    }

    /// P, its frames at the tokenizer's rate.
    pub fn frames(&self) -> usize {
        self.clip.frames()
    }

    /// Ids of the words of the first `frames` frames, for a dance to begin with: no word that the clip's end would be in.
    ///
    /// # Errors
    /// [`Error::Call`] when that leaves none.
    pub fn beginning(&self, tokenizer: &Tokenizer, frames: usize) -> Result<Vec<u32>> {
        if frames > self.frames() {
            return Err(Error::Call(format!(
                "frame {frames} of a prompt of {}; expected one that it has",
                self.frames()
            )));
        }
        let whole = frames / tokenizer.frames_per_word();
        let unsettled = tokenizer.scheme().unsettled_words();
        if whole <= unsettled {
            let (least, has) = ((unsettled + 1) * tokenizer.frames_per_word(), self.frames());
            return Err(Error::Call(format!(
                "{frames} frames of a prompt of {has}; words of this tokenizer need at least {least} to begin with"
            )));
        }
        let words = tokenizer.encode(&self.clip.slice(0..whole * tokenizer.frames_per_word()))?.words;
        Ok(tokenizer.ids_of_words(&words.slice(0..whole - unsettled))?)
    }

    /// The clip of a new dance's words, the other joints as asked.
    ///
    /// # Errors
    /// Words that are not this tokenizer's.
    pub fn decode(&self, tokenizer: &Tokenizer, words: &Words, rest: RestJoints) -> Result<Clip> {
        let mean;
        let rest = match rest {
            RestJoints::Identity => Rest::Identity,
            RestJoints::Prompt => Rest::Clip(&self.clip),
            RestJoints::Mean => {
                mean = mean_pose(&self.clip);
                Rest::Pose(&mean)
            }
        };
        Ok(tokenizer.decode(words, rest)?)
    }

    /// A dance on SMPL-24 put on the prompt's own rig, as it will be written.
    ///
    /// # Errors
    /// A rig that no skeleton map knows.
    pub fn on_own_rig(&self, dance: &Clip, map: Option<&str>) -> Result<Motion> {
        let rig = self.motion.clip.skeleton();
        let way = Retarget::new(rig, &retarget::map_for(rig, map)?, smpl::neutral())?;
        let clip = way.to_rig(dance)?;
        Ok(Motion { clip, source: self.motion.source.clone(), ..self.motion.clone() })
    }
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
/// [`Error::Tokenizer`] with the reason, where characters belong to no one joint; [`Error::Call`] when the tokenizer codes
/// none of the joints.
pub fn given_places(tokenizer: &Tokenizer, selection: &Selection) -> Result<Vec<bool>> {
    let places = tokenizer.places_of(selection)?;
    let WordLength::Fixed(characters) = tokenizer.word_length() else {
        return Err(Error::Call("words differ in length: no place is always the same joint's".into()));
    };
    let mut given = vec![false; characters];
    places.into_iter().for_each(|place| given[place] = true);
    if !given.contains(&true) {
        let joints: Vec<_> = tokenizer.channels().joints().iter().map(|&j| smpl::NAMES[j]).collect();
        return Err(Error::Call(format!("none of these joints is coded; this tokenizer codes {}", joints.join(" "))));
    }
    Ok(given)
}

/// The mean of every joint's rotation, the signs made one.
fn mean_pose(clip: &Clip) -> [Quat; 24] {
    std::array::from_fn(|j| {
        let first = clip.pose(0)[j];
        let zero = Quat::from_xyzw(0.0, 0.0, 0.0, 0.0);
        let near = |f: usize| kinelm_motion::rotation::nearest_sign(clip.pose(f)[j], first);
        let sum = (0..clip.frames()).fold(zero, |sum, f| sum + near(f));
        if sum.length_squared() > 1e-12 { sum.normalize() } else { first }
    })
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

    #[test]
    fn the_mean_of_two_turns_is_between_them() {
        let turn = |a: f64| Quat::from_rotation_y(a);
        let pose = |q: Quat| vec![q; 24];
        let rotations = [pose(turn(0.2)), pose(-turn(0.6))].concat();
        let clip = Clip::new(smpl::neutral(), 20.0, vec![Default::default(); 2], rotations).unwrap();
        assert!(kinelm_motion::rotation::angle_between(mean_pose(&clip)[5], turn(0.4)) < 1e-9);
    }
}
