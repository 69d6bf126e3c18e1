//! Keyframes of one property (glTF 2.0, section 3.11 and appendix C).

use crate::rotation::{nearest_sign, slerp};
use crate::{Quat, Vec3};

/// How values between keys are found.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Between {
    Linear,
    Step,
    /// Hermite, with a tangent before and after each value.
    Cubic,
}

impl Between {
    /// As a sampler states it.
    pub fn name(self) -> &'static str {
        match self {
            Between::Linear => "LINEAR",
            Between::Step => "STEP",
            Between::Cubic => "CUBICSPLINE",
        }
    }
}

/// Keys of a property: seconds (K) and values (K, width), or (K, 3, width) with tangents.
pub struct Track {
    pub times: Vec<f64>,
    pub values: Vec<f64>,
    pub width: usize,
    pub between: Between,
}

impl Track {
    /// The key before `time`, the one after it, and how far between them it is.
    pub fn place(&self, time: f64) -> (usize, usize, f64) {
        let after = self.times.partition_point(|t| *t <= time);
        let (a, b) = (after.saturating_sub(1), after.min(self.times.len() - 1));
        let span = self.times[b] - self.times[a];
        (a, b, if span > 0.0 { ((time - self.times[a]) / span).clamp(0.0, 1.0) } else { 0.0 })
    }

    pub fn value(&self, key: usize) -> &[f64] {
        let cubic = self.between == Between::Cubic;
        // in-tangent, value, out-tangent for each key
        let at = if cubic { (3 * key + 1) * self.width } else { key * self.width };
        &self.values[at..at + self.width]
    }

    /// Whether all keys have the same value.
    pub fn is_still(&self) -> bool {
        (1..self.times.len()).all(|key| self.value(key) == self.value(0))
    }

    /// The components at `time`, but for linear rotations.
    pub fn components(&self, time: f64) -> Vec<f64> {
        let (a, b, u) = self.place(time);
        let (from, to) = (self.value(a), self.value(b));
        match self.between {
            Between::Step => from.to_vec(),
            Between::Linear => from.iter().zip(to).map(|(p, q)| p + (q - p) * u).collect(),
            Between::Cubic => {
                let span = self.times[b] - self.times[a];
                // stored tangents are per second, Hermite's are per segment (appendix C)
                let tangent = |key: usize, side: usize, c: usize| span * self.values[(3 * key + side) * self.width + c];
                let (u2, u3) = (u * u, u * u * u);
                let hermite = |c: usize| {
                    (2.0 * u3 - 3.0 * u2 + 1.0) * from[c]
                        + (u3 - 2.0 * u2 + u) * tangent(a, 2, c)
                        + (3.0 * u2 - 2.0 * u3) * to[c]
                        + (u3 - u2) * tangent(b, 0, c)
                };
                (0..self.width).map(hermite).collect()
            }
        }
    }

    /// How fast the components change at `time`, of a cubic track; 0 before its first key and after its last.
    pub fn slopes(&self, time: f64) -> Vec<f64> {
        let (a, b, u) = self.place(time);
        let span = self.times[b] - self.times[a];
        if span <= 0.0 {
            return vec![0.0; self.width];
        }
        let tangent = |key: usize, side: usize, c: usize| self.values[(3 * key + side) * self.width + c];
        let (from, to) = (self.value(a), self.value(b));
        // the derivative of the polynomials in `components`
        let slope = |c: usize| {
            (6.0 * u * u - 6.0 * u) * (from[c] - to[c]) / span
                + (3.0 * u * u - 4.0 * u + 1.0) * tangent(a, 2, c)
                + (3.0 * u * u - 2.0 * u) * tangent(b, 0, c)
        };
        (0..self.width).map(slope).collect()
    }

    /// A place or a scale at `time`.
    pub fn vector(&self, time: f64) -> Vec3 {
        let c = self.components(time);
        Vec3::new(c[0], c[1], c[2])
    }

    /// A rotation at `time`.
    pub fn rotation(&self, time: f64) -> Quat {
        if self.between == Between::Linear {
            let (a, b, u) = self.place(time);
            let [from, to] = [a, b].map(|key| quat(self.value(key)));
            return slerp(from, nearest_sign(to, from), u);
        }
        quat(&self.components(time))
    }
}

/// x, y, z, w; identity if it is none.
pub fn quat(c: &[f64]) -> Quat {
    let q = Quat::from_xyzw(c[0], c[1], c[2], c[3]);
    if q.length() > 1e-9 { q.normalize() } else { Quat::IDENTITY }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn between_keys() {
        let values = vec![0.0, 0.0, 0.0, 2.0, 4.0, 6.0];
        let track = |between, values| Track { times: vec![1.0, 2.0], values, width: 3, between };
        let linear = track(Between::Linear, values.clone());
        assert_eq!(linear.vector(1.5), Vec3::new(1.0, 2.0, 3.0));
        assert_eq!((linear.vector(0.0), linear.vector(9.0)), (Vec3::ZERO, Vec3::new(2.0, 4.0, 6.0)));
        assert_eq!(track(Between::Step, values).vector(1.999), Vec3::ZERO);
        // tangents of 0: a smooth step
        let cubic = [[0.0; 3], [0.0; 3], [0.0; 3], [0.0; 3], [2.0, 4.0, 6.0], [0.0; 3]].concat();
        assert!((track(Between::Cubic, cubic).vector(1.25).x - 2.0 * 0.15625).abs() < 1e-12);
        let turns = Track {
            times: vec![0.0, 1.0],
            values: [Quat::IDENTITY, -Quat::from_rotation_y(1.0)].iter().flat_map(|q| q.to_array()).collect(),
            width: 4,
            between: Between::Linear,
        };
        assert!(crate::rotation::angle_between(turns.rotation(0.5), Quat::from_rotation_y(0.5)) < 1e-12);
    }
}
