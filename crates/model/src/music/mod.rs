//! Music conditioning of a frame: the phase of the beats ([`beats`]), the sound ([`features`]), or both, one after the
//! other. Where one isn't known, all its numbers are 0.
//!
//! Training, measuring and generation all call `conditioning`.

pub mod beats;
pub mod features;

use features::Scale;
use kinelm_corpus::music::clip_music::ClipMusic;
use serde::{Deserialize, Serialize};

/// The music that conditions a model.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Music {
    /// Nothing.
    #[default]
    None,
    /// Its beats.
    Beats,
    /// Its sound features.
    Features,
    /// Its beats and its sound features.
    Both,
}

/// Times after the frame's own whose music conditions it, seconds.
pub(crate) const AHEAD_S: [f64; 4] = [0.0, 0.1, 0.25, 0.5];

impl Music {
    /// Whether it is nothing.
    pub fn is_none(&self) -> bool {
        *self == Music::None
    }

    /// Whether it includes the beats.
    pub fn has_beats(self) -> bool {
        matches!(self, Music::Beats | Music::Both)
    }

    /// Whether it includes the sound.
    pub fn has_features(self) -> bool {
        matches!(self, Music::Features | Music::Both)
    }

    /// M: conditioning numbers of a frame.
    pub fn numbers(self) -> usize {
        let of = |is_used: bool, numbers: usize| if is_used { numbers } else { 0 };
        of(self.has_beats(), beats::NUMBERS) + of(self.has_features(), features::NUMBERS)
    }
}

/// Music conditioning (N, M) of frames at these times of a clip, the sound by the scale of the training clips; `pace`
/// seconds of the clip pass in one second of the frames.
pub(super) fn conditioning(
    music: Music,
    scale: Option<&Scale>,
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
            beats::write(sound.beats_s, times, of_beats);
        }
        if let Some(scale) = scale.filter(|_| music.has_features()) {
            features::write(&sound.rows, scale, times, of_sound);
        }
    }
    all
}
