//! The deviation of a recording's tuning from 440 Hz.
//!
//! Limits: one number for the whole sound, in steps of 1/100 bin, modulo a third of a semitone.

/// Bins of the constant-Q transform in an octave: the unit of a tuning.
pub const BINS_PER_OCTAVE: usize = 36;

/// Steps of a bin.
const STEPS: usize = 100;
/// Magnitude levels per octave, their number, and the lowest as a power of 2.
const FINE: f64 = 64.0;
// 2^-60 to 2^30, beyond any magnitude of 2,048 samples
const LEVELS: usize = 90 * 64;
const LOWEST: f64 = -60.0;
/// Range of the peaks, hertz.
const RANGE: std::ops::Range<f64> = 150.0..4000.0;

/// A histogram of spectral peaks by deviation and magnitude, of constant size.
///
/// Source: librosa's `estimate_tuning` and `piptrack`, which store every peak; here the median of the magnitudes is known
/// to 1 %.
pub struct Tuning {
    hz_per_bin: f64,
    /// (STEPS, LEVELS)
    counts: Vec<u32>,
}

impl Tuning {
    /// For spectra of `size` samples at `rate` per second.
    pub fn new(size: usize, rate: u32) -> Tuning {
        Tuning { hz_per_bin: f64::from(rate) / size as f64, counts: vec![0; STEPS * LEVELS] }
    }

    /// Adds the peaks of a spectrum above 10 % of its largest magnitude.
    pub fn take(&mut self, magnitudes: &[f32]) {
        let s = magnitudes;
        let least = 0.1 * s.iter().copied().fold(0.0, f32::max);
        let first = (RANGE.start / self.hz_per_bin).ceil().max(1.0) as usize;
        let end = ((RANGE.end / self.hz_per_bin).ceil() as usize).min(s.len().saturating_sub(1));
        let loud = |i: usize| if s[i] > least { s[i] } else { 0.0 };
        for i in first..end {
            let (before, now, after) = (loud(i - 1), loud(i), loud(i + 1));
            if !(now > before && now >= after) {
                continue;
            }
            let (before, after) = (f64::from(s[i - 1]), f64::from(s[i + 1]));
            let (bend, slope) = (after + before - 2.0 * f64::from(now), 0.5 * (after - before));
            // no top between the neighbours: a flank, or the parabola is a line
            let shift = if slope.abs() >= bend.abs() { 0.0 } else { -slope / bend };
            self.count((i as f64 + shift) * self.hz_per_bin, f64::from(now) + 0.5 * slope * shift);
        }
    }

    fn count(&mut self, hz: f64, magnitude: f64) {
        // from A0, a whole number of bins below 440 Hz
        let bins = BINS_PER_OCTAVE as f64 * (hz / 27.5).log2();
        // -0.5 to 0.5
        let off = bins - (bins + 0.5).floor();
        let step = (((off + 0.5) * STEPS as f64) as usize).min(STEPS - 1);
        let level = ((magnitude.log2() - LOWEST) * FINE).clamp(0.0, (LEVELS - 1) as f64) as usize;
        let count = &mut self.counts[step * LEVELS + level];
        *count = count.saturating_add(1);
    }

    /// The most frequent deviation of the louder half of the peaks, in bins of [`BINS_PER_OCTAVE`], -0.5 to 0.5; 0 for silence.
    pub fn estimate(&self) -> f64 {
        let of_level = |level: usize| (0..STEPS).map(|s| u64::from(self.counts[s * LEVELS + level])).sum::<u64>();
        let all: u64 = self.counts.iter().map(|c| u64::from(*c)).sum();
        let (mut below, mut middle) = (0, 0);
        while middle < LEVELS && below + of_level(middle) <= all / 2 {
            below += of_level(middle);
            middle += 1;
        }
        if all == 0 {
            return 0.0;
        }
        let louder = |step: usize| -> u64 {
            self.counts[step * LEVELS + middle.min(LEVELS - 1)..(step + 1) * LEVELS].iter().map(|c| u64::from(*c)).sum()
        };
        // `max_by_key` gives the last of equals: reversed, the lowest, as NumPy's argmax
        let commonest = (0..STEPS).rev().max_by_key(|step| louder(*step)).unwrap_or(0);
        commonest as f64 / STEPS as f64 - 0.5
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The magnitudes of a spectrum with a peak as of a Hann window at each of these frequencies.
    fn spectrum(all: &[f64], hz_per_bin: f64) -> Vec<f32> {
        let mut out = vec![0.0f32; 1025];
        for hz in all {
            for (i, x) in out.iter_mut().enumerate() {
                let d = i as f64 - hz / hz_per_bin;
                // a parabola near its top
                *x += (1.0 - 0.25 * d * d).max(0.0) as f32;
            }
        }
        out
    }

    #[test]
    fn a_piece_played_sharp_is_found_out() {
        for off in [-0.31, 0.0, 0.2] {
            let mut t = Tuning::new(2048, 30_720);
            for note in [24, 27, 31, 36, 40] {
                let hz = 55.0 * 2f64.powf((f64::from(note) * 3.0 + off) / BINS_PER_OCTAVE as f64);
                t.take(&spectrum(&[hz], 15.0));
            }
            assert!((t.estimate() - off).abs() < 0.011, "{off}: {}", t.estimate());
        }
        assert_eq!(Tuning::new(2048, 30_720).estimate(), 0.0);
    }
}
