//! A dance that goes on from a clip, on that clip's own rig, and the file beside it that tells where it is from.

use super::FPS;
use super::data::{inner, read, stride};
use super::form::frames_of_steps;
use super::run::Trained;
use crate::{Error, Result, sidecar as told};
use kinelm_corpus::sidecar::as_written;
use kinelm_generate::check_frames;
use kinelm_generate::output::lock_feet;
use kinelm_generate::provenance::Provenance;
use kinelm_generate::request::FootMode;
use kinelm_motion::Motion;
use kinelm_motion::feet::{FixedParts, FootLock};
use kinelm_motion::format::{Format, ReadOptions};
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::rig::{floor, map_for};
use kinelm_store::{hash, sidecar};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Everything that decides a dance, but the bytes of the network and of the clip.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// The run folder.
    pub run: PathBuf,
    /// The clip.
    pub clip: PathBuf,
    /// How it is read.
    pub read: ReadOptions,
    /// Where the seed begins: frames at the network's rate, behind the run's margin.
    pub from: usize,
    /// Frames of the seed.
    pub seed_frames: usize,
    /// Frames that are made.
    pub frames: usize,
    /// Whether the seed stands in front of them.
    pub with_seed: bool,
    /// What is done to the feet.
    pub feet: FootMode,
}

impl told::Recipe for Recipe {
    const KEY: &'static str = "aclstm";
    const GIVEN: [&'static str; 2] = ["the clip", "clip_sha256"];
    const COMMAND: &'static str = "kinelm aclstm generate";

    fn run(&self) -> &Path {
        &self.run
    }

    fn read_back(&self, dance: &Path) -> ReadOptions {
        // an .npz is on SMPL's rig
        let on_rig = Format::of_name(dance) != Some(Format::Npz);
        as_written(dance, on_rig.then_some((&*self.clip, &self.read)))
    }
}

/// What stands beside a dance.
pub type Told = told::Told<Recipe>;

/// A dance.
pub struct Made {
    /// On the clip's rig.
    pub motion: Motion,
    /// SHA-256 of the clip's file.
    pub clip_sha256: String,
    /// What was done to its feet.
    pub locked: Option<FootLock>,
}

impl Recipe {
    /// Carries it out; `progress` is told the frames done.
    ///
    /// # Errors
    /// What reading the clip fails with; another rig than the run's, with the joints; a rate that is no multiple of the
    /// network's; a clip that is shorter than the seed; a network that runs away; a rig whose feet no skeleton map knows,
    /// where they are to be held.
    pub fn make(&self, trained: &Trained, progress: &mut dyn FnMut(usize)) -> Result<Made> {
        [self.frames, self.from, self.seed_frames].into_iter().try_for_each(check_frames)?;
        let (mut motion, clip_sha256) = read(&self.clip, &self.read)?;
        trained.file.rig.check(&self.clip, motion.clip.skeleton())?;
        stride(&self.clip, motion.clip.fps())?;
        // a rest pose in front lies within the margin
        motion.warnings.retain(|warning| warning.kind != "rest_frame" || trained.file.config.margin == 0);
        let clip = resample(&inner(&motion.clip, trained.file.config.margin), FPS, Method::Stride)?;
        // one more: the last step of the hip leads to it
        let (n, needed) = (self.seed_frames, self.from + self.seed_frames + 1);
        if n == 0 || clip.frames() < needed {
            let margin = trained.file.config.margin;
            let found =
                format!("{} frames at {FPS} a second, {margin} at both ends of the file left out", clip.frames());
            let expected =
                format!("{needed}: {} before the seed, its {n}, at least 1, and the one behind it", self.from);
            return Err(Error::file(&self.clip, found, expected, "take a shorter seed, or a longer clip"));
        }
        let coder = &trained.coder;
        let c = coder.channels();
        let seed = coder.frames(&clip.slice(self.from..needed));
        let made = trained.go_on(&[&seed], self.frames, progress)?.remove(0);
        let at = &seed[n * c..];
        let made = frames_of_steps(&made, c, [at[0], at[2]]);
        let skeleton = motion.clip.skeleton().clone();
        let (frames, kept) = match self.with_seed {
            true => ([&seed[..n * c], &made[..]].concat(), n),
            false => (made, 0),
        };
        let floor_m = match self.feet {
            FootMode::Off => None,
            FootMode::Lock => {
                let map = map_for(&skeleton, self.read.map.as_deref())?;
                Some(self.read.floor.map_or_else(|| floor(&clip, &map).map(|f| f.height_m), Ok)?)
            }
        };
        motion.clip = coder.clip(&frames, &skeleton, FPS)?;
        let Some(floor_m) = floor_m else { return Ok(Made { motion, clip_sha256, locked: None }) };
        let fixed = FixedParts { root: false, path: false, legs: [false; 2], frames: kept };
        let (motion, locked) = lock_feet(motion, self.read.map.as_deref(), Some(floor_m), fixed)?;
        Ok(Made { motion, clip_sha256, locked: Some(locked) })
    }
}

/// The hashes of the clips that a dance comes from: its timeline's clips, its prompt, the seed of an LSTM, or itself.
///
/// # Errors
/// A file that can't be read.
pub fn source_hashes(dance: &Path, provenance: Option<&Provenance>) -> Result<Vec<String>> {
    let prompt = provenance.and_then(|provenance| provenance.request.prompt.as_ref());
    if let Some(timeline) = prompt.and_then(|prompt| prompt.timeline.as_ref()) {
        let clips = timeline.segments.iter().filter_map(|segment| timeline.clips.get(segment.clip.as_ref()?));
        return Ok(clips.map(|clip| hash::of_file(&clip.file)).collect::<kinelm_store::Result<_>>()?);
    }
    if let Some(prompt) = provenance.and_then(|provenance| provenance.prompt_sha256.clone()) {
        return Ok(vec![prompt]);
    }
    match Told::load(&sidecar::path_of(dance)) {
        Ok(lstm) => Ok(vec![lstm.given_sha256]),
        Err(_) => Ok(vec![hash::of_file(dance)?]),
    }
}
