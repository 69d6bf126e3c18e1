//! The rank and measures of a dance chosen among several; `kinelm_evaluate::dance::judge` measures it.

use serde::{Deserialize, Serialize};
use std::fmt;

/// The rank of a dance among those that were sampled with it.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Best {
    /// Dances that were sampled.
    pub of: usize,
    /// The number of them that are better.
    pub better: usize,
    /// Its measures.
    pub verdict: Verdict,
}

/// Measures of the generated parts of a dance.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Verdict {
    /// The mean score of its windows: [`crate::score`].
    pub score: f64,
    /// Share of the steps of feet in contact that are faster than 10 cm/s, where feet are generated.
    pub skate_share: Option<f64>,
    /// Mean depth of the lowest foot in the floor beyond 2 cm, cm, where feet are generated.
    pub penetration_cm: Option<f64>,
    /// Jerk over speed, 1/s^2: jerk alone grows with speed.
    pub shake: Option<f64>,
    /// Mean distance of the centre of mass outside the support, cm, where feet are generated.
    pub outside_cm: Option<f64>,
    /// Seconds until the generated joints freeze for good; `None`: never.
    pub freezes_s: Option<f64>,
    /// Whether it is a copy of a training clip, where that was checked.
    pub copied: bool,
}

impl Verdict {
    /// Why a dance is bad whatever its score; `None` if nothing speaks against it.
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
        parts.extend(self.outside_cm.map(|x| format!("{x:.1} cm off balance")));
        parts.extend(self.doubt());
        if parts.is_empty() { Ok(()) } else { write!(f, ": {}", parts.join(", ")) }
    }
}
