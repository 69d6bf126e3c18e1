//! Faster and slower windows.

use crate::Result;
use kinelm_motion::Clip;
use kinelm_motion::resample::{Method, resample};

/// The clip `factor` times as fast, at its own rate: frame i is the clip at i times `factor`, interpolated by slerp. Changes
/// are small, so nothing is filtered.
///
/// # Errors
/// A factor that is not positive.
pub fn stretched(clip: &Clip, factor: f64) -> Result<Clip> {
    let fps = clip.fps();
    Ok(resample(clip, fps / factor, Method::Slerp)?.with_fps(fps)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::synth;

    #[test]
    fn a_factor_changes_the_length_and_not_the_path() {
        let clip = synth::corpus(3, 1, 5.0, 20.0).unwrap().remove(0).clip;
        for factor in [0.9, 1.0, 1.1] {
            let found = stretched(&clip, factor).unwrap();
            assert_eq!(found.frames(), ((clip.frames() - 1) as f64 / factor + 1e-9) as usize + 1);
            assert_eq!(found.fps(), clip.fps());
            // every tenth frame of the slower one is a frame of the clip
            let last = (found.frames() - 1) / 10 * 10;
            let at = (last as f64 * factor).round() as usize;
            assert!((found.root()[last] - clip.root()[at]).length() < 1e-9, "{factor}");
        }
    }
}
