//! The music of a dance that is to be made.

use super::request::MusicRequest;
use crate::{Error, Result};
use kinelm_corpus::Conditions;
use kinelm_corpus::music::find::in_dance;
use kinelm_corpus::music::piece::Piece;
use kinelm_corpus::music::sound::Rows;
use kinelm_corpus::music::tempo;
use kinelm_model::LoadedRun;
use kinelm_store::hash;

/// How far music is followed where nobody says and its beats are told: as they are learned, they are followed little
/// (docs/results/music.md).
pub const GUIDANCE: f64 = 3.0;
/// The same where it is told what music sounds like: followed further, some dances fly apart.
const GUIDANCE_OF_FEATURES: f64 = 2.0;

/// How far music is followed by a model that is told so much of it, where nobody says; 1, as learned, of its tempo alone.
pub fn guidance(told: kinelm_model::music::Music) -> f64 {
    match told {
        told if told.has_features() => GUIDANCE_OF_FEATURES,
        told if told.has_beats() => GUIDANCE,
        _ => 1.0,
    }
}

/// A piece, heard.
pub struct Music {
    recipe: MusicRequest,
    /// SHA-256 of its file.
    pub sha256: String,
    piece: Piece,
}

impl Music {
    /// Hears what a recipe names, for a model of so many frames a second.
    ///
    /// # Errors
    /// A model that is told neither music nor its tempo; music that can't be read, is silent, or ends before the dance begins.
    pub fn hear(recipe: &MusicRequest, run: &LoadedRun, fps: f64) -> Result<Music> {
        if run.config.music.is_none() && !run.conditions.iter().any(|field| field == tempo::FIELD) {
            return Err(Error::call(format!(
                "--music {}: this model hears no music (model.music) and knows no tempo (train.conditions); train one on a \
                 corpus of kinelm tokenize --music, or have kinelm finetune add it",
                recipe.path.display()
            )));
        }
        let sha256 = hash::of_file(&recipe.path)?;
        let piece = match run.config.music.has_features() {
            true => Piece::hear(&recipe.path, fps)?,
            false => Piece::beats_of(&recipe.path)?,
        };
        let music = Music { recipe: recipe.clone(), sha256, piece };
        music.check(0.0)?;
        Ok(music)
    }

    /// Seconds of it from the dance's beginning on.
    pub fn seconds(&self) -> f64 {
        self.piece.beats.seconds - self.recipe.from_s
    }

    /// Refuses a dance of so many seconds that it can't be danced to.
    ///
    /// # Errors
    /// Those of [`in_dance`].
    pub fn check(&self, seconds: f64) -> Result<()> {
        Ok(in_dance(&self.recipe.path, &self.piece.beats, (self.recipe.from_s, seconds)).map(|_| ())?)
    }

    /// Its beats, seconds from the dance's beginning, those before it among them.
    pub fn beats_s(&self) -> Vec<f64> {
        self.piece.beats.times_s.iter().map(|beat| beat - self.recipe.from_s).collect()
    }

    /// What it sounds like, by the dance's time.
    pub fn rows(&self) -> Rows<'_> {
        self.piece.rows(self.recipe.from_s)
    }

    /// The tempo of a dance of so many seconds to it, as a label for a model that is told of it: the nearest that it knows.
    pub fn tempo(&self, conditions: &Conditions, seconds: f64) -> Option<String> {
        tempo::nearest(&conditions.values(tempo::FIELD), self.bpm(seconds)?)
    }

    /// Its beats a minute in a dance of so many seconds; where fewer than two lie there, in the whole piece.
    pub fn bpm(&self, seconds: f64) -> Option<f64> {
        tempo::bpm(&self.beats_s(), seconds).or(self.piece.beats.bpm())
    }
}
