//! Asking people: a page of dances without names, and what its votes say (docs/measures.md).
//!
//! [`Study::make`] draws trials from folders of clips and writes a page that has no trace of where a dance is from,
//! beside a [`Key`] that stays with its maker. [`Count::of`] counts the votes by the key. The motion-language thesis
//! asked six experts (section 3.7); the dissertation on music to dance asked for quality (chapter 7).

mod count;
mod key;
mod make;
#[cfg(test)]
mod tests;
mod votes;

pub use count::{Count, Share, fleiss_kappa};
pub use key::{Key, Source, Trial};
pub use make::{Study, StudyOptions};
pub use votes::Votes;

use serde::{Deserialize, Serialize};

/// The question of a study; every trial has a clip of the folder A and one of B, the one on the left by chance.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Ask {
    /// Which of a pair was recorded from a real dancer: A has the real ones
    Real,
    /// Which of two dances X is more like: X is a clip of C, one of A and one of B stand beside it
    Alike,
    /// Which of two dances a blend X is more like, or as much like both: C has the blends of the clips of A and B
    Blend,
    /// Which of a pair is the better dance
    Better,
}

impl Ask {
    /// As it stands on the page.
    pub fn question(self) -> &'static str {
        match self {
            Ask::Real => "One of the two was recorded from a real dancer. Which one?",
            Ask::Alike => "Which of the two is more like X?",
            Ask::Blend => "Which of the two is X more like?",
            Ask::Better => "Which of the two is the better dance?",
        }
    }

    /// Whether a clip X stands in the middle; only clips of one name belong together then.
    pub fn has_x(self) -> bool {
        matches!(self, Ask::Alike | Ask::Blend)
    }

    /// The answers, from left to right.
    pub fn choices(self) -> &'static [&'static str] {
        if self == Ask::Blend { &["1", "As much like both", "2"] } else { &["1", "2"] }
    }
}
