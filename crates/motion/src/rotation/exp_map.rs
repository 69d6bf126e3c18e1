//! Rotation vectors (exponential map): axis times angle.

use super::{Quat, Vec3};
use std::f64::consts::PI;

/// The rotation of a rotation vector of any length.
pub fn from_vector(v: Vec3) -> Quat {
    let angle = v.length();
    // near 0 the series of sin(angle/2)/angle, where the quotient loses digits
    let k = if angle < 1e-4 { 0.5 - angle * angle / 48.0 } else { (0.5 * angle).sin() / angle };
    Quat::from_xyzw(k * v.x, k * v.y, k * v.z, (0.5 * angle).cos()).normalize()
}

/// The canonical rotation vector: angle in `0..=PI`; at exactly PI the first non-zero component is positive.
pub fn to_vector(q: Quat) -> Vec3 {
    let q = if q.w < 0.0 { -q } else { q };
    let (v, s) = (q.xyz(), q.xyz().length());
    // sin(angle / 2) = angle / 2 to the last bit; the quotient below would be 0 / 0 at 0
    if s < 1e-8 {
        return v * 2.0;
    }
    let vector = v * (2.0 * s.atan2(q.w) / s);
    if q.w == 0.0 { positive_first(vector) } else { vector }
}

/// The canonical form of a rotation vector of any length.
pub fn canonical(v: Vec3) -> Vec3 {
    let angle = v.length();
    if angle < PI {
        return v;
    }
    if angle == PI {
        return positive_first(v);
    }
    let turns = (angle / (2.0 * PI)).round();
    v * ((angle - turns * 2.0 * PI) / angle)
}

/// The other vector of the same rotation, `v - 2 PI v/|v|`; `None` at 0, where the axis is arbitrary.
pub fn twin(v: Vec3) -> Option<Vec3> {
    let angle = v.length();
    (angle > 1e-9).then(|| v * ((angle - 2.0 * PI) / angle))
}

fn positive_first(v: Vec3) -> Vec3 {
    let first = [v.x, v.y, v.z].into_iter().find(|x| *x != 0.0).unwrap_or(0.0);
    if first < 0.0 { -v } else { v }
}

#[cfg(test)]
mod tests {
    use super::super::{angle_between, tests::any_quat};
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn canonical_of_long_vectors() {
        let v = canonical(Vec3::new(0.0, 0.0, 4.0));
        assert!((v - Vec3::new(0.0, 0.0, 4.0 - 2.0 * PI)).length() < 1e-15);
        assert_eq!(canonical(Vec3::new(-PI, 0.0, 0.0)), Vec3::new(PI, 0.0, 0.0));
        assert_eq!(canonical(Vec3::ZERO), Vec3::ZERO);
    }

    proptest! {
        #[test]
        fn round_trip(q in any_quat()) {
            let v = to_vector(q);
            prop_assert!(v.length() <= PI + 1e-12);
            prop_assert!(angle_between(from_vector(v), q) < 1e-9);
        }

        #[test]
        fn tiny_round_trip(x in -1e-5..1e-5f64, y in -1e-9..1e-9f64, z in -1e-12..1e-12f64) {
            let v = Vec3::new(x, y, z);
            prop_assert!((to_vector(from_vector(v)) - v).length() < 1e-15);
        }

        #[test]
        fn canonical_is_the_same_rotation(x in -20.0..20.0f64, y in -20.0..20.0f64, z in -20.0..20.0f64) {
            let v = Vec3::new(x, y, z);
            prop_assert!(canonical(v).length() <= PI + 1e-12);
            prop_assert!(angle_between(from_vector(v), from_vector(canonical(v))) < 1e-9);
            if let Some(t) = twin(canonical(v)) {
                prop_assert!(angle_between(from_vector(v), from_vector(t)) < 1e-9);
            }
        }
    }
}
