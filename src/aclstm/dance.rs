//! A dance that goes on from a clip, on that clip's own rig, and the file beside it that tells where it is from.

use super::FPS;
use super::data::{inner, read, stride};
use super::form::frames_of_steps;
use super::run::Trained;
use crate::corpus::FileRecord;
use crate::generate::feet::{self, Care};
use crate::generate::provenance::{self, FileHash};
use crate::output::Outputs;
use crate::{Error, Result, files};
use kinelm_motion::feet::{Fixed, Locked};
use kinelm_motion::format::{ReadOptions, input};
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::retarget::map_for;
use kinelm_motion::{Motion, metric};
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
    pub feet: Care,
}

/// What stands beside a dance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Told {
    /// The layout's version: 1.
    pub schema: u32,
    /// The program's version.
    pub kinelm: String,
    /// The dance.
    pub output: FileHash,
    /// SHA-256 of the dance that this one takes the place of.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub replaces: Option<String>,
    /// What decides it.
    pub aclstm: Recipe,
    /// Updates that the network had.
    pub step: u64,
    /// SHA-256 of its weights' file.
    pub weights_sha256: String,
    /// SHA-256 of the clip's file.
    pub clip_sha256: String,
    /// Instructions of the processor that the engine used.
    pub kernels: String,
}

impl Told {
    /// Of a dance that is to be written, by its bytes.
    pub fn of(recipe: &Recipe, trained: &Trained, clip_sha256: &str, dance: &Path, bytes: &[u8]) -> Told {
        Told {
            schema: 1,
            kinelm: env!("CARGO_PKG_VERSION").into(),
            output: FileHash { file: provenance::name_of(dance), sha256: FileRecord::of(bytes).sha256 },
            replaces: None,
            aclstm: recipe.clone(),
            step: trained.step,
            weights_sha256: trained.sha256.clone(),
            clip_sha256: clip_sha256.into(),
            kernels: kinelm_engine::dispatch::name().into(),
        }
    }

    /// Reads such a file.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::File`] for text that is no such file, of a GPT's dance, or of another version.
    pub fn load(path: &Path) -> Result<Told> {
        let text = input::text(path).map_err(Error::io(path))?;
        let expected = "what kinelm aclstm generate wrote beside a dance";
        let wrong = |e: serde_json::Error| Error::file(path, e.to_string(), expected, "");
        let value: serde_json::Value = serde_json::from_str(&text).map_err(wrong)?;
        if value["schema"] != 1 {
            let found = format!("schema {}", value["schema"]);
            return Err(Error::file(path, found, format!("schema 1: {expected}"), "make it again with this version"));
        }
        let told: Told = serde_json::from_value(value).map_err(wrong)?;
        match files::is_plain(&told.output.file) {
            true => Ok(told),
            false => {
                let (found, expected) = (format!("`{}`", told.output.file), "the name of a dance beside this file");
                Err(Error::file(path, found, expected, "it isn't as it was written"))
            }
        }
    }

    /// Refuses a network or a clip that is not the one that made the dance, and bytes that came out different.
    ///
    /// # Errors
    /// [`Error::Call`] that names what has changed, with both hashes.
    pub fn check(&self, now: &Told) -> Result<()> {
        let recipe = &now.aclstm;
        let all = [
            (
                format!("{}: the weights at step {}", recipe.run.display(), self.step),
                &self.weights_sha256,
                &now.weights_sha256,
            ),
            (format!("{}: the clip", recipe.clip.display()), &self.clip_sha256, &now.clip_sha256),
            (format!("{}: the dance", self.output.file), &self.output.sha256, &now.output.sha256),
        ];
        for (what, then, now_is) in all {
            if then != now_is {
                let (kernels, by) = (&self.kernels, &self.kinelm);
                let what =
                    format!("{what} has SHA-256 {now_is}, then {then}, made by kinelm {by} with the kernels {kernels}");
                return Err(Error::Call(format!(
                    "{what}; this is {} with {}. Nothing was written",
                    now.kinelm, now.kernels
                )));
            }
        }
        Ok(())
    }

    /// Writes it beside the dance, and then the dance.
    ///
    /// # Errors
    /// What [`Outputs::write`] refuses; paths that aren't UTF-8, which JSON can't hold.
    pub fn write(mut self, dance: &Path, bytes: &[u8], outputs: &Outputs) -> Result<()> {
        let sha256 = self.output.sha256.clone();
        provenance::write_beside(dance, bytes, &sha256, outputs, |before| {
            self.replaces = before;
            serde_json::to_string_pretty(&self)
        })
    }
}

/// A dance.
pub struct Made {
    /// On the clip's rig.
    pub motion: Motion,
    /// SHA-256 of the clip's file.
    pub clip_sha256: String,
    /// What was done to its feet.
    pub locked: Option<Locked>,
}

impl Recipe {
    /// Carries it out; `progress` is told the frames done.
    ///
    /// # Errors
    /// What reading the clip fails with; another rig than the run's, with the joints; a rate that is no multiple of the
    /// network's; a clip that is shorter than the seed; a network that runs away; a rig whose feet no skeleton map knows,
    /// where they are to be held.
    pub fn make(&self, trained: &Trained, progress: &mut dyn FnMut(usize)) -> Result<Made> {
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
            Care::Off => None,
            Care::Lock => {
                let map = map_for(&skeleton, self.read.map.as_deref())?;
                Some(self.read.floor.map_or_else(|| metric::floor(&clip, &map).map(|f| f.height_m), Ok)?)
            }
        };
        motion.clip = coder.clip(&frames, &skeleton, FPS)?;
        let Some(floor_m) = floor_m else { return Ok(Made { motion, clip_sha256, locked: None }) };
        let fixed = Fixed { root: false, path: false, legs: [false; 2], frames: kept };
        let (motion, locked) = feet::held(motion, self.read.map.as_deref(), Some(floor_m), fixed)?;
        Ok(Made { motion, clip_sha256, locked: Some(locked) })
    }
}
