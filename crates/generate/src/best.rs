//! What is said of a dance that is the best of several; `evaluate::dance::judge` finds it.

use serde::{Deserialize, Serialize};
use std::fmt;

/// A dance among those that were drawn with it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Best {
    /// How many were drawn.
    pub of: usize,
    /// How many of them are better.
    pub better: usize,
    /// What was found.
    pub verdict: Verdict,
}

/// What was found of one dance, of what was invented in it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Verdict {
    /// How far it is beyond what is usual, in spreads of real windows, summed over the three below; 0: nowhere.
    pub score: f64,
    /// Share of the steps of standing feet that are faster than 10 cm/s, where feet were invented.
    pub skate_share: Option<f64>,
    /// Mean depth of the lowest foot in the floor beyond 2 cm, cm, where feet were invented.
    pub penetration_cm: Option<f64>,
    /// Jerk over speed, 1/s^2: jerk alone is larger the faster one dances.
    pub shake: Option<f64>,
    /// Seconds until what was invented up to the end stands still for good; `None`: never.
    pub freezes_s: Option<f64>,
    /// Whether it is a copy of what was trained on, where that was looked for.
    pub copied: bool,
}

impl Verdict {
    /// Why a dance is no good whatever its score; `None` if nothing is known against it.
    pub fn doubt(&self) -> Option<String> {
        match self.freezes_s {
            Some(s) => Some(format!("it stands still from {s:.1} s on")),
            None => self.copied.then(|| "it is a copy of a training clip".into()),
        }
    }
}

impl fmt::Display for Verdict {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "score {:.2}", self.score)?;
        let mut parts = Vec::new();
        parts.extend(self.skate_share.map(|x| format!("{:.0} % of steps slide", 100.0 * x)));
        parts.extend(self.penetration_cm.map(|x| format!("{x:.2} cm in the floor")));
        parts.extend(self.shake.map(|x| format!("jerk {x:.0} times its speed")));
        parts.extend(self.doubt());
        if parts.is_empty() { Ok(()) } else { write!(f, ": {}", parts.join(", ")) }
    }
}
