//! Onset strength and its peaks, as in librosa.

use super::mel::BANDS;

/// Frames by which librosa shifts its onset strength to centre its windows.
const CENTRING: usize = super::WINDOW / (2 * super::HOP);

/// The onset strength (F): the mean rise of the bands over the previous frame, decibels.
///
/// `rises` are those of [`rise`] for each frame but the first. As in librosa's `onset_strength`, a rise is
/// `1 + 2048 / (2 hop)` frames after the frame before it, so it is late by half a window.
pub fn strength(rises: &[f32], frames: usize) -> Vec<f32> {
    // at 2048 and 512: 1 + 2 frames
    let mut out = vec![0.0; (1 + CENTRING).min(frames)];
    out.extend(rises.iter().take(frames - out.len()));
    out.resize(frames, 0.0);
    out
}

/// The mean rise of the bands over the previous frame; both frames are at least `floor`.
pub fn rise(before: &[f32; BANDS], now: &[f32; BANDS], floor: f32) -> f32 {
    let sum: f32 = before.iter().zip(now).map(|(b, n)| (n.max(floor) - b.max(floor)).max(0.0)).sum();
    sum / BANDS as f32
}

/// The frames of onsets: peaks of the strength by at least 7 % of its range above the local mean.
///
/// Source: librosa's `onset_detect`, after Böck, Krebs and Schedl, "Evaluating the Online Capabilities of Onset
/// Detection Methods" (2012).
pub fn peaks(strength: &[f32], rate: u32) -> Vec<usize> {
    let low = strength.iter().copied().fold(f32::INFINITY, f32::min);
    let high = strength.iter().map(|x| x - low).fold(0.0, f32::max);
    if high.is_nan() || high <= 0.0 {
        return Vec::new();
    }
    // 0 to 1, as `onset_detect` normalises: the 7 % are of this range
    let x: Vec<f64> = strength.iter().map(|x| f64::from((x - low) / (high + f32::MIN_POSITIVE))).collect();
    // the maximum and the wait are over 30 ms before, the mean over 100 ms on both sides
    let frames = |seconds: f64| (seconds * f64::from(rate) / super::HOP as f64).floor() as usize;
    let (near, around) = (frames(0.03), frames(0.1));
    let (mut out, mut next) = (Vec::new(), 0);
    for n in 0..x.len() {
        let greatest = &x[n.saturating_sub(near)..=n];
        let surroundings = &x[n.saturating_sub(around)..(n + around + 1).min(x.len())];
        let mean = surroundings.iter().sum::<f64>() / surroundings.len() as f64;
        let is_peak = greatest.iter().all(|y| *y <= x[n]) && x[n] >= mean + 0.07;
        if is_peak && n >= next {
            out.push(n);
            // librosa's `wait`: more than that many frames after the last peak
            next = n + near + 1;
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn peaks_stand_out_and_keep_apart() {
        let mut x = vec![1.0f32; 100];
        (x[20], x[22], x[60], x[80]) = (2.0, 1.9, 3.0, 1.05);
        // 60 frames a second: 1 frame before, 6 around
        assert_eq!(peaks(&x, 30_720), [20, 22, 60]);
        assert!(peaks(&[1.0; 50], 30_720).is_empty());
        assert!(peaks(&[], 30_720).is_empty());
    }

    #[test]
    fn a_rise_counts_and_a_fall_does_not() {
        let (mut a, b) = ([0.0; BANDS], [0.0; BANDS]);
        a[3] = 12.8;
        assert!((rise(&b, &a, -80.0) - 0.1).abs() < 1e-6);
        assert_eq!(rise(&a, &b, -80.0), 0.0);
        assert_eq!(rise(&b, &a, 20.0), 0.0);
        assert_eq!(strength(&[1.0, 2.0, 3.0, 4.0], 5), [0.0, 0.0, 0.0, 1.0, 2.0]);
        assert_eq!(strength(&[], 1), [0.0]);
    }
}
