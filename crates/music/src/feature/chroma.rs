//! Energies of the twelve pitch classes, as CENS (chroma energy normalised statistics).

use super::cqt::ConstantQ;
use super::tuning::BINS_PER_OCTAVE;

/// Pitch classes, C first.
pub const CLASSES: usize = 12;
/// Frames of the smoothing window.
const SMOOTHED: usize = 41;

/// The pitch classes of a stream of samples.
///
/// The energies of a frame are divided by their sum, quantised to five levels (0, 1/4, 1/2, 3/4, 1; thresholds 5, 10, 20 and
/// 40 %), smoothed by a Hann window of 41 frames and normalised to length 1.
///
/// Source: Müller and Ewert, "Chroma Toolbox" (2011), as librosa's `chroma_cens` has it.
pub struct Cens {
    transform: ConstantQ,
    energies: Vec<[f32; CLASSES]>,
}

impl Cens {
    /// At `rate` samples per second, a frame every `hop` samples; `tuning` in bins.
    ///
    /// # Panics
    /// As [`ConstantQ::new`].
    pub fn new(rate: u32, hop: usize, tuning: f64) -> Cens {
        Cens { transform: ConstantQ::new(rate, hop, tuning), energies: Vec::new() }
    }

    /// Takes samples.
    pub fn push(&mut self, samples: &[f32]) {
        let energies = &mut self.energies;
        self.transform.push(samples, &mut |frame, bin, magnitude| add(energies, frame, bin, magnitude));
    }

    /// The pitch classes of `frames` frames, each of length 1, or 0 in silence.
    pub fn finish(mut self, frames: usize) -> Vec<[f32; CLASSES]> {
        let energies = &mut self.energies;
        self.transform.finish(&mut |frame, bin, magnitude| add(energies, frame, bin, magnitude));
        self.energies.resize(frames, [0.0; CLASSES]);
        self.energies.iter_mut().for_each(levels);
        smooth(&self.energies)
    }
}

/// Adds a bin to its class: the bins on both sides of a semitone's bin belong to it.
fn add(energies: &mut Vec<[f32; CLASSES]>, frame: usize, bin: usize, magnitude: f32) {
    if energies.len() <= frame {
        energies.resize(frame + 1, [0.0; CLASSES]);
    }
    // bin 3 n is semitone n, and 3 n - 1 and 3 n + 1 are its sides; bin 0 is a C
    energies[frame][(bin + 1) / (BINS_PER_OCTAVE / CLASSES) % CLASSES] += magnitude;
}

fn levels(classes: &mut [f32; CLASSES]) {
    let sum: f32 = classes.iter().sum();
    // as librosa's `normalize`: what is almost 0 is divided by 1
    let sum = if sum < f32::MIN_POSITIVE { 1.0 } else { sum };
    for x in classes {
        let share = *x / sum;
        *x = [0.4, 0.2, 0.1, 0.05].iter().filter(|step| share > **step).count() as f32 * 0.25;
    }
}

fn smooth(levels: &[[f32; CLASSES]]) -> Vec<[f32; CLASSES]> {
    // the symmetric window of two more frames, without its zeros at the ends
    let weight = |i: usize| 0.5 - 0.5 * (std::f64::consts::TAU * (i + 1) as f64 / (SMOOTHED + 1) as f64).cos();
    let window: [f32; SMOOTHED] = std::array::from_fn(|i| (weight(i) * 2.0 / (SMOOTHED + 1) as f64) as f32);
    let half = SMOOTHED / 2;
    let one = |f: usize| {
        let mut out = [0.0; CLASSES];
        for (i, w) in window.iter().enumerate() {
            let Some(from) = (f + i).checked_sub(half).and_then(|f| levels.get(f)) else { continue };
            out.iter_mut().zip(from).for_each(|(to, x)| *to += w * x);
        }
        let length = out.iter().map(|x| x * x).sum::<f32>().sqrt();
        let length = if length < f32::MIN_POSITIVE { 1.0 } else { length };
        out.map(|x| x / length)
    };
    (0..levels.len()).map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::f64::consts::TAU;

    #[test]
    fn a_tone_is_its_class() {
        let (rate, seconds) = (15_360, 2);
        for (midi, class) in [(69, 9), (60, 0), (31, 7), (96, 0)] {
            let hz = 440.0 * 2f64.powf((f64::from(midi) - 69.0) / 12.0);
            let x: Vec<f32> =
                (0..seconds * rate).map(|i| (TAU * hz * f64::from(i) / f64::from(rate)).sin() as f32).collect();
            let mut cens = Cens::new(rate as u32, 512, 0.0);
            x.chunks(1000).for_each(|block| cens.push(block));
            let frames = cens.finish(61);
            assert_eq!(frames.len(), 61);
            let middle = frames[30];
            let best = (0..CLASSES).max_by(|a, b| middle[*a].total_cmp(&middle[*b])).unwrap();
            assert_eq!(best, class, "{midi}: {middle:?}");
            assert!(middle[class] > 0.95);
        }
        assert_eq!(Cens::new(15_360, 512, 0.0).finish(3), [[0.0; CLASSES]; 3]);
    }
}
