//! A dance that continues a clip, on that clip's own rig, and its sidecar.

use super::run::Trained;
use crate::data::{inner, read, stride};
use crate::form::frames_of_steps;
use crate::{Error, FPS, Result, sidecar};
use kinelm_corpus::sidecar::output_read_options;
use kinelm_generate::check_frames;
use kinelm_generate::feet::lock_feet;
use kinelm_generate::provenance::Provenance;
use kinelm_generate::request::FootMode;
use kinelm_motion::feet::{FixedParts, FootLock};
use kinelm_motion::format::{Format, ReadOptions};
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::{Motion, Source};
use kinelm_store::hash;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// A dance to generate. With the bytes of the network and of the clip it decides the dance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Request {
    /// The run folder.
    pub run: PathBuf,
    /// The clip.
    pub clip: PathBuf,
    /// How it is read.
    pub read: ReadOptions,
    /// The seed's first frame at the network's rate, after the run's margin.
    pub from: usize,
    /// Frames of the seed.
    pub seed_frames: usize,
    /// Frames to generate.
    pub frames: usize,
    /// Whether the seed precedes them in the file.
    pub with_seed: bool,
    /// What is done to the feet.
    pub feet: FootMode,
}

impl sidecar::Request for Request {
    const KEY: &'static str = "aclstm";
    const INPUT: [&'static str; 2] = ["the clip", "clip_sha256"];
    const COMMAND: &'static str = "kinelm aclstm generate";

    fn run(&self) -> &Path {
        &self.run
    }

    fn read_back(&self, dance: &Path) -> ReadOptions {
        // an .npz is on SMPL's rig
        let on_rig = Format::of_name(dance) != Some(Format::Npz);
        output_read_options(dance, on_rig.then_some((&*self.clip, &self.read)))
    }
}

/// The sidecar of a dance.
pub type Sidecar = sidecar::Sidecar<Request>;

/// A generated dance.
pub struct Generated {
    /// On the clip's rig.
    pub motion: Motion,
    /// SHA-256 of the clip's file.
    pub clip_sha256: String,
    /// How its feet were locked.
    pub locked: Option<FootLock>,
}

impl Request {
    /// Generates the dance; `progress` receives the number of frames done.
    ///
    /// # Errors
    /// What reading the clip fails with; another rig than the run's, with the joints; a rate that is no multiple of the
    /// network's; a clip that is shorter than the seed; a network that diverges; feet to lock on a rig without a skeleton
    /// map.
    pub fn generate(&self, trained: &Trained, progress: &mut dyn FnMut(usize)) -> Result<Generated> {
        [self.frames, self.from, self.seed_frames].into_iter().try_for_each(check_frames)?;
        let (mut motion, clip_sha256) = read(&self.clip, &self.read)?;
        trained.file.rig.check(&self.clip, motion.clip.skeleton())?;
        stride(&self.clip, motion.clip.fps())?;
        // a rest pose at the start is within the margin
        motion.warnings.retain(|warning| warning.kind != "rest_frame" || trained.file.config.margin == 0);
        let clip = resample(&inner(&motion.clip, trained.file.config.margin), FPS, Method::Stride)?;
        // one more frame: the last step of the hip leads to it
        let (n, needed) = (self.seed_frames, self.from + self.seed_frames + 1);
        if n == 0 || clip.frames() < needed {
            let margin = trained.file.config.margin;
            let found =
                format!("{} frames at {FPS} a second, {margin} at both ends of the file left out", clip.frames());
            let expected =
                format!("{needed}: {} before the seed, its {n}, at least 1, and the one after it", self.from);
            return Err(Error::file(&self.clip, found, expected, "take a shorter seed, or a longer clip"));
        }
        let coder = &trained.coder;
        let c = coder.channels();
        let seed = coder.frames(&clip.slice(self.from..needed));
        let steps = trained.roll_out(&[&seed], self.frames, progress)?.remove(0);
        // the hip's place at the first new frame: steps say only how it moves from there
        let at = &seed[n * c..];
        let dance = frames_of_steps(&steps, c, [at[0], at[2]]);
        let skeleton = motion.clip.skeleton().clone();
        let (frames, given) = match self.with_seed {
            true => ([&seed[..n * c], &dance[..]].concat(), n),
            false => (dance, 0),
        };
        let floor_m = match self.feet {
            FootMode::Off => None,
            FootMode::Lock => {
                let humanoid = motion.humanoid()?;
                // of the clip: the feet of a generated dance may float or sink
                Some(self.read.floor.map_or_else(|| humanoid.floor(&clip).map(|floor| floor.height_m), Ok)?)
            }
        };
        let mut motion = motion.with_clip(coder.clip(&frames, &skeleton, FPS)?);
        if motion.has_character() {
            // a new file, as it is read back: not an animation of the clip's own
            motion = motion.with_source(Source::Plain);
        }
        let Some(floor_m) = floor_m else { return Ok(Generated { motion, clip_sha256, locked: None }) };
        let fixed = FixedParts { root: false, path: false, legs: [false; 2], frames: given };
        let (motion, locked) = lock_feet(motion, Some(floor_m), fixed)?;
        Ok(Generated { motion, clip_sha256, locked: Some(locked) })
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
    match Sidecar::load(&kinelm_store::sidecar::path_of(dance)) {
        Ok(lstm) => Ok(vec![lstm.input_sha256]),
        // no dance of an LSTM: a recording is its own source
        Err(_) => Ok(vec![hash::of_file(dance)?]),
    }
}
