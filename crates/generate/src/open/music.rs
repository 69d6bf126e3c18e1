//! The music of a requested dance.

use crate::request::MusicRequest;
use crate::{Error, Result};
use kinelm_corpus::Conditions;
use kinelm_corpus::music::clip_music::FeatureRows;
use kinelm_corpus::music::library::beats_in_dance;
use kinelm_corpus::music::tempo;
use kinelm_corpus::music::track::Track;
use kinelm_model::LoadedRun;
use kinelm_store::Subject;
use kinelm_store::hash;

/// A piece of music with its beats and features.
pub struct OpenMusic {
    request: MusicRequest,
    /// SHA-256 of its file.
    pub sha256: String,
    piece: Track,
}

impl OpenMusic {
    /// Reads the requested music for a model at `fps` frames per second.
    ///
    /// # Errors
    /// A model that is conditioned neither on music nor on its tempo; music that can't be read, is silent, or ends before the
    /// dance begins.
    pub fn open(request: &MusicRequest, run: &LoadedRun, fps: f64) -> Result<OpenMusic> {
        if run.config.music.is_none() && !run.conditions.iter().any(|field| field == tempo::FIELD) {
            let why = "this model is not conditioned on music (model.music) or on its tempo (train.conditions); train one on \
                       a corpus with music, or add it with kinelm finetune";
            return Err(Error::unsupported(Subject::of_parameter("music").with(request.path.display()), why));
        }
        let sha256 = hash::of_file(&request.path)?;
        let piece = match run.config.music.has_features() {
            true => Track::analyse(&request.path, fps)?,
            false => Track::beats_only(&request.path)?,
        };
        let music = OpenMusic { request: request.clone(), sha256, piece };
        music.check(0.0)?;
        Ok(music)
    }

    /// Seconds from the dance's beginning to the music's end.
    pub fn seconds(&self) -> f64 {
        self.piece.beats.seconds - self.request.from_s
    }

    /// Refuses a dance of `seconds` that the music doesn't cover.
    ///
    /// # Errors
    /// Music that ends before the dance, or has no beat in it.
    pub fn check(&self, seconds: f64) -> Result<()> {
        Ok(beats_in_dance(&self.request.path, &self.piece.beats, (self.request.from_s, seconds)).map(|_| ())?)
    }

    /// The beats in seconds from the dance's beginning; earlier ones are negative.
    pub(crate) fn beats_s(&self) -> Vec<f64> {
        self.piece.beats.times_s.iter().map(|beat| beat - self.request.from_s).collect()
    }

    /// The sound features, by the dance's time.
    pub(crate) fn rows(&self) -> FeatureRows<'_> {
        self.piece.rows(self.request.from_s)
    }

    /// The tempo label of a dance of `seconds`: the nearest that the model knows; `None` if it knows none.
    pub(crate) fn tempo(&self, conditions: &Conditions, seconds: f64) -> Option<String> {
        tempo::nearest(&conditions.values(tempo::FIELD), self.bpm(seconds)?)
    }

    /// Beats per minute during a dance of `seconds`; with fewer than two beats there, of the whole piece.
    pub(crate) fn bpm(&self, seconds: f64) -> Option<f64> {
        tempo::bpm(&self.beats_s(), seconds).or(self.piece.beats.bpm())
    }
}
