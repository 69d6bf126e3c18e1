//! Windows with another heading.

use crate::Result;
use kinelm_motion::Clip;
use kinelm_tokenizer::scheme::pelvis::about_y;

/// The clip turned about the vertical axis through the origin, radians.
///
/// # Errors
/// None in practice.
pub fn turned(clip: &Clip, radians: f64) -> Result<Clip> {
    let turn = about_y(radians);
    let root = clip.root().iter().map(|&p| turn * p).collect();
    let mut rotations = clip.rotations().to_vec();
    // the root's rotation alone is global: all other joints turn with it
    rotations.chunks_exact_mut(clip.joints()).for_each(|pose| pose[0] = turn * pose[0]);
    Ok(Clip::new(clip.skeleton().clone(), clip.fps(), root, rotations)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::{Vec3, synth};

    #[test]
    fn a_turned_body_keeps_its_poses_and_heights() {
        let clip = synth::corpus(3, 1, 2.0, 20.0).unwrap().remove(0).clip;
        let found = turned(&clip, 1.3).unwrap();
        for f in 0..clip.frames() {
            assert_eq!(clip.pose(f)[1..], found.pose(f)[1..]);
            assert!((clip.root()[f].y - found.root()[f].y).abs() < 1e-12);
            let step = found.root()[f] - found.root()[0];
            assert!((step.length() - (clip.root()[f] - clip.root()[0]).length()).abs() < 1e-12);
        }
        // 90 degrees to the left: forward becomes left
        let left = turned(&clip, std::f64::consts::FRAC_PI_2).unwrap();
        let (a, b) = (clip.pose(9)[0] * Vec3::Z, left.pose(9)[0] * Vec3::Z);
        assert!((b - Vec3::new(a.z, a.y, -a.x)).length() < 1e-12);
    }
}
