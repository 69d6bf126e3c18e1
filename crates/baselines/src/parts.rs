//! The parts of a loss: what it says of the root, and what of the other numbers.

use serde::{Deserialize, Serialize};

/// Weights of the parts in a loss.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct PartWeights {
    /// Of [`Parts::root`].
    pub root: f64,
    /// Of [`Parts::rotations`].
    pub rotations: f64,
}

impl PartWeights {
    /// The loss is the sum of its parts.
    pub const EVEN: PartWeights = PartWeights { root: 1.0, rotations: 1.0 };
}

/// The parts of a loss, not weighted.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Parts {
    /// Of the root: of an auto-conditioned LSTM its position, of a music LSTM, whose root is fixed, its rotation.
    pub root: f64,
    /// Of the rotations (in the positional form, the positions) of the joints; of a music LSTM without the root's.
    pub rotations: f64,
    /// Of Laban's weight effort, of a music LSTM in the updates that have it; its weight is 1.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub effort: Option<f64>,
}

/// A loss with its parts.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct Loss {
    /// The weighted sum of the parts.
    pub loss: f64,
    /// The parts.
    #[serde(flatten)]
    pub parts: Parts,
}

impl Loss {
    /// Adds another one.
    pub(crate) fn plus(self, other: Loss) -> Loss {
        let effort = [self.parts.effort, other.parts.effort].into_iter().flatten().reduce(|a, b| a + b);
        let (root, rotations) = (self.parts.root + other.parts.root, self.parts.rotations + other.parts.rotations);
        Loss { loss: self.loss + other.loss, parts: Parts { root, rotations, effort } }
    }

    /// Divides it by a number.
    pub(crate) fn over(self, n: f64) -> Loss {
        let Parts { root, rotations, effort } = self.parts;
        let parts = Parts { root: root / n, rotations: rotations / n, effort: effort.map(|effort| effort / n) };
        Loss { loss: self.loss / n, parts }
    }
}
