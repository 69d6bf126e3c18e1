//! Controls: the targets of a dance at one moment, as numbers that can be mixed, mirrored and smoothed.

use crate::Vec3;

/// The number of channels of a [`Control`].
pub const CHANNELS: usize = 22;

/// The targets at one moment. Rotations are small rotation vectors: x bows forward, y turns left, z leans right.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Control {
    /// Left and right wrist relative to the shoulder, in the chest's frame, in arm lengths: (outward, up, forward).
    pub wrists: [Vec3; 2],
    /// Position of the dance: x to the left, z forward, metres; y is the height of the hips relative to standing.
    pub travel: Vec3,
    /// Heading, radians to the left, including whole turns.
    pub turn: f64,
    /// Displacement of the hips from between the feet, metres: (left, unused, forward).
    pub shift: Vec3,
    /// Rotation of the pelvis.
    pub hips: Vec3,
    /// Rotation of the chest relative to the pelvis, distributed over the spine.
    pub spine: Vec3,
    /// Rotation of the head relative to the chest.
    pub head: Vec3,
}

impl Control {
    /// Relaxed standing.
    pub const REST: Control = Control {
        wrists: [Vec3::new(0.22, -0.88, 0.16); 2],
        travel: Vec3::ZERO,
        turn: 0.0,
        shift: Vec3::ZERO,
        hips: Vec3::ZERO,
        spine: Vec3::ZERO,
        head: Vec3::ZERO,
    };

    /// All channels in a fixed order.
    pub fn channels(&self) -> [f64; CHANNELS] {
        let mut c = [0.0; CHANNELS];
        let vectors = [self.wrists[0], self.wrists[1], self.travel, self.shift, self.hips, self.spine, self.head];
        for (to, v) in c.chunks_exact_mut(3).zip(vectors) {
            to.copy_from_slice(&v.to_array());
        }
        c[21] = self.turn;
        c
    }

    /// The inverse of [`Control::channels`].
    pub fn from_channels(c: [f64; CHANNELS]) -> Self {
        let v = |i: usize| Vec3::new(c[3 * i], c[3 * i + 1], c[3 * i + 2]);
        Control { wrists: [v(0), v(1)], travel: v(2), shift: v(3), hips: v(4), spine: v(5), head: v(6), turn: c[21] }
    }

    /// Linear interpolation from `self` to `other`.
    pub fn mix(&self, other: &Control, t: f64) -> Self {
        let (a, b) = (self.channels(), other.channels());
        Self::from_channels(std::array::from_fn(|i| a[i] + (b[i] - a[i]) * t))
    }

    /// Exchanges left and right.
    pub fn mirrored(&self) -> Self {
        let aside = Vec3::new(-1.0, 1.0, 1.0);
        // rotation vectors are pseudovectors: mirrored in x, they change the other two signs
        let turned = Vec3::new(1.0, -1.0, -1.0);
        Control {
            wrists: [self.wrists[1], self.wrists[0]],
            travel: self.travel * aside,
            turn: -self.turn,
            shift: self.shift * aside,
            hips: self.hips * turned,
            spine: self.spine * turned,
            head: self.head * turned,
        }
    }

    /// The same with another heading.
    pub fn with_turn(self, turn: f64) -> Self {
        Control { turn, ..self }
    }

    /// Scales everything but the heading, relative to [`Control::REST`].
    pub fn amplified(&self, amplitude: f64) -> Self {
        Control { turn: self.turn, ..Control::REST.mix(self, amplitude) }
    }
}

/// A Gaussian low pass over time, `sigma` in frames; the ends are held. It is symmetric, so movements are anticipated: the
/// body leans before the foot leaves.
pub fn smooth(values: &[f64], sigma: f64) -> Vec<f64> {
    let radius = (3.0 * sigma).ceil().max(0.0) as usize;
    if radius == 0 || values.is_empty() {
        return values.to_vec();
    }
    let kernel: Vec<f64> =
        (0..=2 * radius).map(|i| (-0.5 * ((i as f64 - radius as f64) / sigma).powi(2)).exp()).collect();
    let total: f64 = kernel.iter().sum();
    let last = values.len() - 1;
    let at = |f: usize| -> f64 {
        kernel.iter().enumerate().map(|(i, k)| k * values[(f + i).saturating_sub(radius).min(last)]).sum::<f64>()
            / total
    };
    (0..values.len()).map(at).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn channels_hold_everything() {
        let c: [f64; CHANNELS] = std::array::from_fn(|i| i as f64);
        assert_eq!(Control::from_channels(c).channels(), c);
        let c = Control::from_channels(c);
        assert_eq!(c.mirrored().mirrored(), c);
        let same = c.amplified(1.0).channels();
        assert!(same.iter().zip(c.channels()).all(|(a, b)| (a - b).abs() < 1e-12));
    }

    #[test]
    fn smoothing_keeps_what_is_still_and_spreads_a_step() {
        assert!(smooth(&[3.0; 40], 4.0).iter().all(|v| (v - 3.0).abs() < 1e-12));
        let step: Vec<f64> = (0..80).map(|f| if f < 40 { 0.0 } else { 1.0 }).collect();
        let s = smooth(&step, 4.0);
        assert!(s.windows(2).all(|w| w[1] >= w[0] && w[1] - w[0] < 0.11), "{s:?}");
        assert!((s[39] + s[40] - 1.0).abs() < 1e-12);
        assert_eq!(smooth(&[], 4.0), Vec::<f64>::new());
    }
}
