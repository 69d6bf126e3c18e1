//! Styles and their patterns.

use super::voice::Noise;

/// A style of music.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Style {
    /// Kick on one and three, snare on two and four, hats on eighths, a bass that follows the kick.
    Pop,
    /// Kick on every beat, chords between, a bass of roots and fifths.
    March,
    /// Soft: a chord a bar, a walking bass, swung hats.
    Lounge,
    /// Kick on every beat, open hats between, a bass in octaves.
    Disco,
}

/// An instrument, or a note of the chord for the bass.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    Kick,
    Snare,
    Hat,
    /// The chord's root.
    Bass,
    /// Its fifth.
    Fifth,
    Chord,
}

/// A note of a bar.
#[derive(Debug, Clone, Copy)]
pub struct Hit {
    pub who: Part,
    /// Of the bar, from 0.
    pub beat: usize,
    /// Of the beat.
    pub part: f64,
    /// Length of a chord or bass note, in beats.
    pub length: f64,
    pub loud: f32,
}

const fn hit(who: Part, beat: usize, part: f64, length: f64, loud: f32) -> Hit {
    Hit { who, beat, part, length, loud }
}

use Part::{Bass, Chord, Fifth, Hat, Kick, Snare};

/// Position of a swung eighth, in beats.
const SWUNG: f64 = 2.0 / 3.0;

const POP: &[Hit] = &[
    hit(Kick, 0, 0.0, 0.0, 1.0),
    hit(Kick, 2, 0.0, 0.0, 1.0),
    hit(Kick, 2, 0.5, 0.0, 0.6),
    hit(Snare, 1, 0.0, 0.0, 0.7),
    hit(Snare, 3, 0.0, 0.0, 0.7),
    hit(Hat, 0, 0.0, 0.0, 0.22),
    hit(Hat, 0, 0.5, 0.0, 0.14),
    hit(Hat, 1, 0.0, 0.0, 0.22),
    hit(Hat, 1, 0.5, 0.0, 0.14),
    hit(Hat, 2, 0.0, 0.0, 0.22),
    hit(Hat, 2, 0.5, 0.0, 0.14),
    hit(Hat, 3, 0.0, 0.0, 0.22),
    hit(Hat, 3, 0.5, 0.0, 0.14),
    hit(Bass, 0, 0.0, 1.4, 0.5),
    hit(Bass, 2, 0.0, 0.5, 0.5),
    hit(Bass, 2, 0.5, 1.2, 0.4),
    hit(Chord, 0, 0.0, 2.0, 0.3),
    hit(Chord, 2, 0.0, 2.0, 0.22),
];

const MARCH: &[Hit] = &[
    hit(Kick, 0, 0.0, 0.0, 1.0),
    hit(Kick, 1, 0.0, 0.0, 0.7),
    hit(Kick, 2, 0.0, 0.0, 0.9),
    hit(Kick, 3, 0.0, 0.0, 0.7),
    hit(Snare, 1, 0.0, 0.0, 0.5),
    hit(Snare, 3, 0.0, 0.0, 0.5),
    hit(Snare, 3, 0.5, 0.0, 0.3),
    hit(Bass, 0, 0.0, 0.8, 0.6),
    hit(Fifth, 1, 0.0, 0.6, 0.4),
    hit(Bass, 2, 0.0, 0.8, 0.55),
    hit(Fifth, 3, 0.0, 0.6, 0.4),
    hit(Chord, 0, 0.5, 0.3, 0.14),
    hit(Chord, 1, 0.5, 0.3, 0.14),
    hit(Chord, 2, 0.5, 0.3, 0.14),
    hit(Chord, 3, 0.5, 0.3, 0.14),
];

const LOUNGE: &[Hit] = &[
    hit(Kick, 0, 0.0, 0.0, 0.6),
    hit(Kick, 2, 0.0, 0.0, 0.45),
    hit(Snare, 1, 0.0, 0.0, 0.25),
    hit(Snare, 3, 0.0, 0.0, 0.25),
    hit(Hat, 0, 0.0, 0.0, 0.2),
    hit(Hat, 1, 0.0, 0.0, 0.26),
    hit(Hat, 1, SWUNG, 0.0, 0.12),
    hit(Hat, 2, 0.0, 0.0, 0.2),
    hit(Hat, 3, 0.0, 0.0, 0.26),
    hit(Hat, 3, SWUNG, 0.0, 0.12),
    hit(Bass, 0, 0.0, 0.9, 0.6),
    hit(Bass, 1, 0.0, 0.9, 0.5),
    hit(Fifth, 2, 0.0, 0.9, 0.55),
    hit(Fifth, 3, 0.0, 0.9, 0.5),
    hit(Chord, 0, 0.0, 4.0, 0.4),
];

const DISCO: &[Hit] = &[
    hit(Kick, 0, 0.0, 0.0, 1.0),
    hit(Kick, 1, 0.0, 0.0, 1.0),
    hit(Kick, 2, 0.0, 0.0, 1.0),
    hit(Kick, 3, 0.0, 0.0, 1.0),
    hit(Snare, 1, 0.0, 0.0, 0.6),
    hit(Snare, 3, 0.0, 0.0, 0.6),
    hit(Hat, 0, 0.5, 0.0, 0.25),
    hit(Hat, 1, 0.5, 0.0, 0.25),
    hit(Hat, 2, 0.5, 0.0, 0.25),
    hit(Hat, 3, 0.5, 0.0, 0.25),
    hit(Hat, 3, 0.75, 0.0, 0.12),
    hit(Bass, 0, 0.0, 0.4, 0.55),
    hit(Bass, 1, 0.0, 0.4, 0.5),
    hit(Bass, 2, 0.0, 0.4, 0.5),
    hit(Fifth, 3, 0.0, 0.4, 0.5),
    hit(Chord, 0, 0.0, 1.0, 0.3),
    hit(Chord, 1, 0.5, 1.0, 0.2),
];

impl Style {
    /// All of them.
    pub const ALL: [Style; 4] = [Style::Pop, Style::March, Style::Lounge, Style::Disco];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Style::Pop => "pop",
            Style::March => "march",
            Style::Lounge => "lounge",
            Style::Disco => "disco",
        }
    }

    /// The notes of a bar.
    pub(super) fn pattern(self) -> &'static [Hit] {
        match self {
            Style::Pop => POP,
            Style::March => MARCH,
            Style::Lounge => LOUNGE,
            Style::Disco => DISCO,
        }
    }

    /// Four chords, a bar each, in semitones above the key.
    pub(super) fn chords(self, noise: &mut Noise) -> [[i32; 3]; 4] {
        let [first, fourth, fifth, sixth] = [[0, 4, 7], [5, 9, 12], [7, 11, 14], [9, 12, 16]];
        let all = match self {
            Style::Pop | Style::Disco => [[first, fifth, sixth, fourth], [sixth, fourth, first, fifth]],
            Style::March => [[first, first, fifth, first], [first, fourth, fifth, first]],
            Style::Lounge => [[first, sixth, [2, 5, 9], fifth], [fourth, fifth, first, sixth]],
        };
        all[noise.below(all.len())]
    }
}
