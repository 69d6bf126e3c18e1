//! The 6D representation: the first two columns of the rotation matrix.
//!
//! Source: Zhou et al., "On the Continuity of Rotation Representations in Neural Networks" (2019).

use super::{Mat3, Quat, Vec3};

/// The first and second column of the rotation matrix.
pub fn to_six_d(q: Quat) -> [f64; 6] {
    let m = Mat3::from_quat(q);
    [m.x_axis.x, m.x_axis.y, m.x_axis.z, m.y_axis.x, m.y_axis.y, m.y_axis.z]
}

/// The rotation by Gram-Schmidt: the first column keeps its direction, the second is made orthogonal to it.
///
/// `None` if a column is zero or the two are parallel.
pub fn from_six_d(v: [f64; 6]) -> Option<Quat> {
    let x = Vec3::new(v[0], v[1], v[2]).try_normalize()?;
    let y = Vec3::new(v[3], v[4], v[5]);
    let y = y.try_normalize()?;
    let across = y - x * x.dot(y);
    if across.length() < 1e-9 {
        return None;
    }
    let y = across.normalize();
    Some(Quat::from_mat3(&Mat3::from_cols(x, y, x.cross(y))).normalize())
}

#[cfg(test)]
mod tests {
    use super::super::{angle_between, tests::any_quat};
    use super::*;
    use proptest::prelude::*;

    proptest! {
        #[test]
        fn round_trip(q in any_quat(), scale in 0.1..10.0f64) {
            let v = to_six_d(q).map(|x| x * scale);
            prop_assert!(angle_between(from_six_d(v).unwrap(), q) < 1e-9);
        }
    }

    #[test]
    fn parallel_columns_are_no_rotation() {
        assert!(from_six_d([1.0, 0.0, 0.0, 2.0, 0.0, 0.0]).is_none());
        assert!(from_six_d([0.0; 6]).is_none());
    }
}
