//! A dance to music, on the run's body.

use super::data::check;
use super::run::Trained;
use super::{FPS, HEARD};
use crate::{Error, Result, sidecar as told};
use kinelm_corpus::sidecar::as_written;
use kinelm_generate::check_frames;
use kinelm_generate::prompt::on_model_rig;
use kinelm_generate::provenance::{DanceMusic, Provenance};
use kinelm_motion::Motion;
use kinelm_motion::format::ReadOptions;
use kinelm_music::stft::stft;
use kinelm_store::{hash, sidecar};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// Everything that decides a dance, but the bytes of the network and of the music.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Recipe {
    /// The run folder.
    pub run: PathBuf,
    /// The music.
    pub music: PathBuf,
    /// The music's time at the dance's first frame, seconds.
    pub from_s: f64,
    /// Frames; `None`: as long as the music.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frames: Option<usize>,
}

impl told::Recipe for Recipe {
    const KEY: &'static str = "music_lstm";
    const GIVEN: [&'static str; 2] = ["the music", "music_sha256"];
    const COMMAND: &'static str = "kinelm music-lstm generate";

    fn run(&self) -> &Path {
        &self.run
    }

    fn read_back(&self, dance: &Path) -> ReadOptions {
        as_written(dance, None)
    }
}

/// What stands beside a dance.
pub type Told = told::Told<Recipe>;

/// The music that `dance` was made to: by the GPT whose sidecar is `told`, or, where that is none, by a music LSTM, as the
/// file beside it says.
///
/// # Errors
/// The sidecar of a music LSTM that isn't as it was written.
pub fn music_of(told: Option<&Provenance>, dance: &Path) -> Result<Option<DanceMusic>> {
    if let Some(told) = told {
        return Ok(told.music());
    }
    let path = sidecar::path_of(dance);
    if !sidecar::is_of_kind(&path, &[<Recipe as told::Recipe>::KEY]) {
        return Ok(None);
    }
    let told = Told::load(&path)?;
    let from_s = told.recipe.begins_s();
    let made_to = DanceMusic { path: told.recipe.music, from_s, sha256: Some(told.given_sha256) };
    Ok((told.output.file == sidecar::name_of(dance)).then_some(made_to))
}

/// A dance.
pub struct Made {
    /// On the run's body, its root in one place.
    pub motion: Motion,
    /// SHA-256 of the music's file.
    pub music_sha256: String,
}

impl Recipe {
    /// The music's time at the first frame: [`Recipe::from_s`] to a frame.
    pub fn begins_s(&self) -> f64 {
        (self.from_s * FPS).round() / FPS
    }

    /// Carries it out; `progress` is told the frames done.
    ///
    /// # Errors
    /// Music that can't be read, is silent where it is danced to, or ends before the dance; a network that runs away.
    pub fn make(&self, trained: &Trained, progress: &mut dyn FnMut(usize)) -> Result<Made> {
        check_frames(self.frames.unwrap_or(0))?;
        let music_sha256 = hash::of_file(&self.music)?;
        let first = (self.begins_s() * FPS).round();
        if !(0.0..1e9).contains(&first) {
            let found = format!("a beginning at {} s", self.from_s);
            return Err(Error::file(&self.music, found, "0 s or more", "the dance begins at this time of the music"));
        }
        let (first, mut at) = (first as usize, 0);
        let end = self.frames.map(|frames| first + frames);
        let mut dancer = trained.dancer();
        // enough of it to tell music from silence
        let mut loudest = [0.0f32];
        let mut last = vec![0.0; HEARD];
        let frames = stft(&self.music, trained.file.config.audio.form(), FPS, &mut |frame| {
            if at >= first && end.is_none_or(|end| at < end) {
                loudest[0] = frame.iter().fold(loudest[0], |most, x| most.max(x.abs()));
                last.copy_from_slice(frame);
                dancer.hear(frame);
                progress(dancer.frames());
            }
            at += 1;
            Ok(())
        })?;
        let heard: &[f32] = if dancer.frames() > 0 { &loudest } else { &[] };
        check(&self.music, frames, &(first..end.unwrap_or(frames.max(first))), heard)?;
        while end.is_some_and(|end| first + dancer.frames() < end) {
            dancer.hear(&last);
        }
        let clip = dancer.finish()?;
        Ok(Made { motion: on_model_rig(&self.music, clip), music_sha256 })
    }
}
