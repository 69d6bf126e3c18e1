//! The dissertation's low pass: Butterworth's gain on the spectrum of the file's Euler angles.

use super::{beyond, butterworth::MAX_ORDER};
use crate::{Error, Result};
use kinelm_motion::Clip;
use kinelm_motion::format::source::bvh::Channel;
use kinelm_motion::format::{Motion, Source};
use realfft::RealFftPlanner;

/// A clip whose file's Euler angles have passed the gain `1 / sqrt(1 + (u / u0)^(2 order))` at bin u of their Fourier
/// transforms over the whole clip; `u0 = cutoff_hz F / fps`. No phase is changed, and positions stay.
///
/// As the source has it, nothing is done about the ends, which the transform joins, nor about angles that the file writes
/// around the circle: a step from 180 to -180 degrees becomes a wave. Source: the music-to-dance dissertation, which states
/// no cut-off and leaves u in bins.
///
/// # Errors
/// A motion whose file has no Euler angles, or whose frames aren't the file's; an order outside 1..=[`MAX_ORDER`]; a cut-off
/// that isn't above 0 and below half the rate.
pub fn compat(motion: &Motion, order: usize, cutoff_hz: f64) -> Result<Clip> {
    let (frames, fps) = (motion.clip.frames(), motion.clip.fps());
    let source = match &motion.source {
        Source::Bvh(source) if source.frames == frames && frames > 0 => source,
        _ if frames == 0 => return Err(Error::file(&motion.path, "no frames", "at least one", "")),
        _ => {
            let why = "its frames have no Euler angles of a file; expected a BVH";
            return Err(Error::unsupported(format!("{}: `compat`", motion.path.display()), why));
        }
    };
    if !(1..=MAX_ORDER).contains(&order) {
        return Err(Error::invalid_parameter("butterworth", order, format!("1 to {MAX_ORDER}")));
    }
    if !(cutoff_hz > 0.0 && cutoff_hz < 0.5 * fps) {
        return Err(beyond(cutoff_hz, fps));
    }
    let cutoff = cutoff_hz * frames as f64 / fps;
    let mut planner = RealFftPlanner::<f64>::new();
    let (forward, inverse) = (planner.plan_fft_forward(frames), planner.plan_fft_inverse(frames));
    let (mut spectrum, mut filtered) = (forward.make_output_vec(), source.clone());
    let angles = source.head.nodes.iter().flat_map(|node| {
        let is_angle = |(_, channel): &(usize, &Channel)| matches!(channel, Channel::Rotation(_));
        node.channels.iter().enumerate().filter(is_angle).map(|(i, _)| node.column + i)
    });
    for column in angles {
        let at = |f: usize| f * source.head.width + column;
        let mut series: Vec<f64> = (0..frames).map(|f| source.numbers[at(f)]).collect();
        forward.process(&mut series, &mut spectrum).expect("buffers of the planned lengths");
        for (u, x) in spectrum.iter_mut().enumerate() {
            // the planned inverse doesn't scale
            *x *= 1.0 / (1.0 + (u as f64 / cutoff).powi(2 * order as i32)).sqrt() / frames as f64;
        }
        inverse.process(&mut spectrum, &mut series).expect("a spectrum of real numbers");
        series.iter().enumerate().for_each(|(f, x)| filtered.numbers[at(f)] = *x);
    }
    Ok(filtered.clip(fps)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::format::{self, ReadOptions};
    use std::f64::consts::TAU;

    /// A BVH of one joint and its tip, whose three angles are functions of the time in turns of the clip.
    fn read(frames: usize, angles: impl Fn(f64) -> [f64; 3]) -> Motion {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.bvh");
        let mut text =
            "HIERARCHY\nROOT hips\n{\nOFFSET 0 0 0\nCHANNELS 6 Xposition Yposition Zposition Zrotation Xrotation \
             Yrotation\nEnd Site\n{\nOFFSET 0 100 0\n}\n}\nMOTION\n"
                .to_string();
        text += &format!("Frames: {frames}\nFrame Time: 0.05\n");
        for f in 0..frames {
            let [z, x, y] = angles(f as f64 / frames as f64);
            text += &format!("{} 90 {} {z} {x} {y}\n", f % 7, f % 5);
        }
        std::fs::write(&path, text).unwrap();
        format::read(&path, &ReadOptions::default()).unwrap()
    }

    #[test]
    fn a_wave_is_scaled_by_the_gain_of_its_bin_and_keeps_its_phase() {
        for frames in [120, 121] {
            // waves of 3, 12 and 0 turns in the clip; the cut-off is at 6
            let waves = |gains: [f64; 2]| {
                move |t: f64| {
                    [20.0 * gains[0] * (TAU * 3.0 * t + 0.4).sin(), 9.0 * gains[1] * (TAU * 12.0 * t).cos(), 15.0]
                }
            };
            let motion = read(frames, waves([1.0; 2]));
            for order in [1, 2, 8] {
                let gain = |u: f64| 1.0 / (1.0 + (u / 6.0).powi(2 * order as i32)).sqrt();
                let expected = read(frames, waves([gain(3.0), gain(12.0)]));
                let found = compat(&motion, order, 6.0 * 20.0 / frames as f64).unwrap();
                let largest = found.rotations().iter().zip(expected.clip.rotations()).map(|(a, b)| (*a - *b).length());
                assert!(largest.fold(0.0, f64::max) < 1e-12, "{frames} frames, order {order}");
                assert_eq!(found.root(), motion.clip.root());
            }
        }
    }

    #[test]
    fn what_has_no_angles_and_no_band_is_refused() {
        let motion = read(40, |_| [0.0; 3]);
        let said = |order, hz| compat(&motion, order, hz).unwrap_err().to_string();
        assert!(said(2, 10.0).contains("half the rate") && said(9, 5.0).contains("1 to 8"));
        let plain = Motion::new("a.npz", motion.clip.clone());
        assert!(compat(&plain, 2, 5.0).unwrap_err().to_string().contains("a.npz: `compat`"));
        let cut = motion.clone().with_clip(motion.clip.slice(3..30));
        assert!(compat(&cut, 2, 5.0).is_err());
    }
}
