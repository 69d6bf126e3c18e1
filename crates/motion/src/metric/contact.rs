//! Physical foot contact score (PFC): whether a body that accelerates has a foot on the ground.

use crate::resample::{Method, resample};
use crate::{Clip, Result};

/// The rate at which it is defined, frames per second.
const FPS: f64 = 30.0;
/// Ankle and ball of each foot, SMPL ids.
const FEET: [[usize; 2]; 2] = [[7, 10], [8, 11]];

/// PFC of a clip on SMPL-24 with y up, times 10,000 as published; lower is supposed to be better. `None` for fewer than
/// three frames at 30 per second, and for a root that never accelerates.
///
/// The mean over frames of |a| / max |a| times the steps of both feet, where a is the root's acceleration without its
/// downward part, and a foot's step the smaller horizontal step of ankle and ball. Because of the division by the
/// clip's own maximum, scores of different clips are not comparable: a jump improves the rest of its clip. Source: Tseng,
/// Castellon, Liu, "EDGE: editable dance generation from music" (2023), section 4.1 and its code.
///
/// # Errors
/// Those of [`resample`].
pub fn physical_foot_contact(clip: &Clip) -> Result<Option<f64>> {
    let clip = resample(clip, FPS, Method::Auto)?;
    let (positions, j) = (clip.positions(), clip.joints());
    let at = |frame: usize, joint: usize| positions[frame * j + joint];
    let frames = clip.frames().saturating_sub(2);
    let speeding: Vec<f64> = (0..frames)
        .map(|f| {
            let a = at(f + 2, 0) - at(f + 1, 0) * 2.0 + at(f, 0);
            (a.with_y(a.y.max(0.0)) * FPS * FPS).length()
        })
        .collect();
    let most = speeding.iter().fold(0.0, |most: f64, a| most.max(*a));
    if most == 0.0 {
        return Ok(None);
    }
    let step = |f: usize, joint: usize| (at(f + 2, joint) - at(f + 1, joint)).with_y(0.0).length();
    let steps = |f: usize| FEET.iter().map(|foot| step(f, foot[0]).min(step(f, foot[1]))).product::<f64>();
    let sum: f64 = speeding.iter().enumerate().map(|(f, a)| a / most * steps(f)).sum();
    Ok(Some(1e4 * sum / frames as f64))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Quat, Vec3, smpl};

    /// A body at rest that moves along x and y by these metres.
    fn going(path: &[(f64, f64)]) -> Clip {
        let root = path.iter().map(|&(x, y)| Vec3::new(x, y, 0.0)).collect();
        Clip::new(smpl::neutral(), FPS, root, vec![Quat::IDENTITY; 24 * path.len()]).unwrap()
    }

    #[test]
    fn a_statue_that_is_pushed_slides_and_one_that_is_lifted_does_not() {
        // it accelerates by 2 cm per frame: steps of 2, 4, 6 cm after the first
        let pushed = going(&[(0.0, 0.0), (0.0, 0.0), (0.02, 0.0), (0.06, 0.0), (0.12, 0.0)]);
        let found = physical_foot_contact(&pushed).unwrap().unwrap();
        assert!((found - 1e4 * (0.02f64.powi(2) + 0.04f64.powi(2) + 0.06f64.powi(2)) / 3.0).abs() < 1e-9, "{found}");
        let lifted = going(&[(0.0, 0.0), (0.0, 0.0), (0.0, 0.02), (0.0, 0.06)]);
        assert_eq!(physical_foot_contact(&lifted).unwrap(), Some(0.0));
        // falling and a constant speed are no acceleration
        assert_eq!(physical_foot_contact(&going(&[(0.0, 0.0), (0.0, -0.1), (0.0, -0.3)])).unwrap(), None);
        assert_eq!(physical_foot_contact(&going(&[(0.0, 0.0), (0.5, 0.0)])).unwrap(), None);
    }

    #[test]
    fn the_quieter_part_of_a_foot_counts() {
        // feet rotate about their ankles while the body moves: the ball's step differs from the ankle's
        let mut clip = going(&[(0.0, 0.0), (0.0, 0.0), (0.02, 0.0), (0.06, 0.0)]);
        let whole = physical_foot_contact(&clip).unwrap().unwrap();
        let mut rotations = clip.rotations().to_vec();
        [7, 8].iter().for_each(|foot| rotations[3 * 24 + foot] = Quat::from_rotation_y(0.3));
        clip = Clip::new(clip.skeleton().clone(), FPS, clip.root().to_vec(), rotations).unwrap();
        assert!(physical_foot_contact(&clip).unwrap().unwrap() <= whole);
    }
}
