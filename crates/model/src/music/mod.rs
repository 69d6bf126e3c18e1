//! What a frame is told of the music that is danced to: where its beats are ([`beats`]), what it sounds like
//! ([`features`]), or both, one behind the other. Where something isn't known, all its numbers are 0.
//!
//! Training, measuring and generation all ask [`told`].

pub mod beats;
pub mod features;

use features::Scale;
use kinelm_corpus::music::clip_music::ClipMusic;
use serde::{Deserialize, Serialize};

/// What of the music a model is told.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Music {
    /// Nothing.
    #[default]
    None,
    /// Where its beats are.
    Beats,
    /// What it sounds like.
    Features,
    /// Where its beats are, and what it sounds like.
    Both,
}

/// Times of which a frame is told, behind its own, seconds.
pub const AHEAD_S: [f64; 4] = [0.0, 0.1, 0.25, 0.5];

impl Music {
    /// Whether it is nothing.
    pub fn is_none(&self) -> bool {
        *self == Music::None
    }

    /// Whether it is told where beats are.
    pub fn has_beats(self) -> bool {
        matches!(self, Music::Beats | Music::Both)
    }

    /// Whether it is told what music sounds like.
    pub fn has_features(self) -> bool {
        matches!(self, Music::Features | Music::Both)
    }

    /// M: numbers that a frame is told.
    pub fn numbers(self) -> usize {
        let of = |is_told: bool, numbers: usize| if is_told { numbers } else { 0 };
        of(self.has_beats(), beats::NUMBERS) + of(self.has_features(), features::NUMBERS)
    }
}

/// What frames at these times of a clip are told of its music, (N, M), sounds by the scale of the training clips; `pace`
/// seconds of the clip pass in a second of the frames.
pub fn conditioning(
    (music, scale): (Music, Option<&Scale>),
    sound: &ClipMusic<'_>,
    times_s: impl Iterator<Item = f64>,
    pace: f64,
) -> Vec<f32> {
    let mut all = Vec::new();
    for time in times_s {
        let first = all.len();
        all.resize(first + music.numbers(), 0.0);
        let (of_beats, of_sound) = all[first..].split_at_mut(if music.has_beats() { beats::NUMBERS } else { 0 });
        let times = AHEAD_S.map(|ahead| time + ahead * pace);
        if music.has_beats() {
            beats::tell(sound.beats_s, times, of_beats);
        }
        if let Some(scale) = scale.filter(|_| music.has_features()) {
            features::tell(&sound.rows, scale, times, of_sound);
        }
    }
    all
}
