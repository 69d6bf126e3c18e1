//! The dance seen in a mirror: reflection in the plane x = 0.

use crate::{Clip, Error, Quat, Result, Vec3, smpl};

/// Mirrors a clip on the SMPL-24 rig: left and right change places, every rotation (w, x, y, z) becomes
/// (w, x, -y, -z), the root's position (x, y, z) becomes (-x, y, z). Twice is the identity, exactly.
///
/// # Errors
/// [`Error::Clip`] when the clip's joints are not SMPL's 24: retarget it first.
pub fn mirror(clip: &Clip) -> Result<Clip> {
    if !clip.skeleton().names().iter().map(String::as_str).eq(smpl::NAMES) {
        let names = clip.skeleton().names();
        return Err(Error::Clip {
            clip: "mirror".into(),
            what: format!(
                "a skeleton of {} joints from {}; expected the 24 SMPL joints: retarget it first",
                names.len(),
                names[0]
            ),
        });
    }
    let root = clip.root().iter().map(|p| Vec3::new(-p.x, p.y, p.z)).collect();
    let turned = |q: Quat| Quat::from_xyzw(q.x, -q.y, -q.z, q.w);
    let rotations =
        (0..clip.frames()).flat_map(|f| smpl::MIRROR.iter().map(move |&j| turned(clip.pose(f)[j]))).collect();
    Clip::new(clip.skeleton().clone(), clip.fps(), root, rotations)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::rotation::exp_map;
    use crate::rotation::tests::any_quat;
    use proptest::prelude::*;

    #[test]
    fn a_known_value() {
        let mut pose = vec![Quat::IDENTITY; 24];
        pose[16] = exp_map::from_vector(Vec3::new(0.1, 0.2, 0.3));
        let clip = Clip::new(smpl::neutral(), 20.0, vec![Vec3::new(1.0, 2.0, 3.0)], pose).unwrap();
        let m = mirror(&clip).unwrap();
        assert_eq!(m.root()[0], Vec3::new(-1.0, 2.0, 3.0));
        assert!((exp_map::to_vector(m.pose(0)[17]) - Vec3::new(0.1, -0.2, -0.3)).length() < 1e-12);
        assert_eq!(m.pose(0)[16], Quat::IDENTITY);
    }

    proptest! {
        #[test]
        fn twice_is_the_identity_and_positions_are_mirrored(q in prop::collection::vec(any_quat(), 24)) {
            let clip = Clip::new(smpl::neutral(), 20.0, vec![Vec3::new(0.5, 1.0, -2.0)], q).unwrap();
            let once = mirror(&clip).unwrap();
            prop_assert_eq!(&mirror(&once).unwrap(), &clip);
            let (a, b) = (clip.positions(), once.positions());
            for j in 0..24 {
                let p = a[smpl::MIRROR[j]];
                prop_assert!((b[j] - Vec3::new(-p.x, p.y, p.z)).length() < 1e-9);
            }
        }
    }
}
