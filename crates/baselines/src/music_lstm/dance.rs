//! A dance to music, on the run's body.

use super::SPECTRUM;
use super::data::check;
use super::run::Trained;
use crate::sidecar as envelope;
use crate::{Error, FPS, Result};
use kinelm_corpus::sidecar::output_read_options;
use kinelm_generate::check_frames;
use kinelm_generate::provenance::{DanceMusic, Provenance};
use kinelm_motion::Motion;
use kinelm_motion::format::ReadOptions;
use kinelm_music::stft::stft;
use kinelm_store::{hash, sidecar};
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};

/// A dance to generate. With the bytes of the network and of the music it decides the dance.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Request {
    /// The run folder.
    pub run: PathBuf,
    /// The music.
    pub music: PathBuf,
    /// The music's time at the dance's first frame, seconds.
    pub from_s: f64,
    /// Frames; `None`: the length of the music.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub frames: Option<usize>,
}

impl envelope::Request for Request {
    const KEY: &'static str = "music_lstm";
    const INPUT: [&'static str; 2] = ["the music", "music_sha256"];
    const COMMAND: &'static str = "kinelm music-lstm generate";

    fn run(&self) -> &Path {
        &self.run
    }

    fn read_back(&self, dance: &Path) -> ReadOptions {
        output_read_options(dance, None)
    }
}

/// The sidecar of a dance.
pub type Sidecar = envelope::Sidecar<Request>;

/// The music of `dance`, by the sidecar `provenance` of a GPT, or else by that of a music LSTM beside it.
///
/// # Errors
/// A damaged sidecar of a music LSTM.
pub fn music_of(provenance: Option<&Provenance>, dance: &Path) -> Result<Option<DanceMusic>> {
    if let Some(provenance) = provenance {
        return Ok(provenance.music());
    }
    let path = sidecar::path_of(dance);
    if !sidecar::is_of_kind(&path, &[<Request as envelope::Request>::KEY]) {
        return Ok(None);
    }
    let found = Sidecar::load(&path)?;
    let from_s = found.request.begins_s();
    let music = DanceMusic { path: found.request.music, from_s, sha256: Some(found.input_sha256) };
    Ok((found.output.file == sidecar::name_of(dance)).then_some(music))
}

/// A generated dance.
pub struct Generated {
    /// On the run's body, its root fixed.
    pub motion: Motion,
    /// SHA-256 of the music's file.
    pub music_sha256: String,
}

impl Request {
    /// The music's time at the first frame: [`Request::from_s`], rounded to a frame.
    pub(crate) fn begins_s(&self) -> f64 {
        (self.from_s * FPS).round() / FPS
    }

    /// Generates the dance; `progress` receives the number of frames done.
    ///
    /// # Errors
    /// Music that can't be read, is silent, or ends before the dance; a network that diverges.
    pub fn generate(&self, trained: &Trained, progress: &mut dyn FnMut(usize)) -> Result<Generated> {
        check_frames(self.frames.unwrap_or(0))?;
        let music_sha256 = hash::of_file(&self.music)?;
        // a whole number that the division has blurred
        let first = (self.begins_s() * FPS).round();
        // NaN is in no range
        if !(0.0..1e9).contains(&first) {
            let found = format!("a beginning at {} s", self.from_s);
            return Err(Error::file(&self.music, found, "0 s or more", "it is the music's time at the first frame"));
        }
        let (first, mut at) = (first as usize, 0);
        let end = self.frames.map(|frames| first + frames);
        let mut dancer = trained.dancer();
        // the loudest number is enough to detect silence
        let mut loudest = [0.0f32];
        let mut last = vec![0.0; SPECTRUM];
        let frames = stft(&self.music, trained.file.config.audio.form(), FPS, &mut |frame| {
            if at >= first && end.is_none_or(|end| at < end) {
                loudest[0] = frame.iter().fold(loudest[0], |most, x| most.max(x.abs()));
                last.copy_from_slice(frame);
                dancer.push(frame);
                progress(dancer.frames());
            }
            at += 1;
            Ok(())
        })?;
        let spectra: &[f32] = if dancer.frames() > 0 { &loudest } else { &[] };
        check(&self.music, frames, &(first..end.unwrap_or(frames.max(first))), spectra)?;
        // `check` lets music end a little early: its last spectrum is repeated
        while end.is_some_and(|end| first + dancer.frames() < end) {
            dancer.push(&last);
        }
        let clip = dancer.finish()?;
        Ok(Generated { motion: Motion::new(&self.music, clip), music_sha256 })
    }
}
