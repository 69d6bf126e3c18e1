//! Rotations and conversions between their representations.
//!
//! Code works with unit quaternions in f64 ([`Quat`]; its named fields rule out a confusion of (w, x, y, z) with
//! (x, y, z, w)). Other representations are rotation vectors ([`exp_map`]), Euler angles in all twelve orders ([`euler`])
//! and the matrix ([`Mat3`]).

pub mod euler;
pub mod exp_map;

pub use euler::{Axis, EulerOrder};
pub use glam::{DMat3 as Mat3, DQuat as Quat, DVec3 as Vec3};

/// Geodesic distance of two rotations, radians in `0..=PI`. `q` and `-q` are equal.
///
/// `2 atan2(|q.xyz|, |q.w|)` of `q = conj(a) b`, which is exact at every size; an arc cosine loses angles below 0.03
/// degrees. Source: Huynh, "Metrics for 3D Rotations" (2009).
///
/// ```
/// use kinelm_motion::Quat;
/// use kinelm_motion::rotation::angle_between;
///
/// let quarter = Quat::from_rotation_y(std::f64::consts::FRAC_PI_2);
/// assert!((angle_between(Quat::IDENTITY, -quarter) - std::f64::consts::FRAC_PI_2).abs() < 1e-12);
/// ```
pub fn angle_between(a: Quat, b: Quat) -> f64 {
    let d = a.conjugate() * b;
    2.0 * d.xyz().length().atan2(d.w.abs())
}

/// `q` or `-q`, whichever is nearer to `reference`.
pub fn nearest_sign(q: Quat, reference: Quat) -> Quat {
    if q.dot(reference) < 0.0 { -q } else { q }
}

/// Spherical linear interpolation along the shorter arc, `t` in `0..=1`; exactly `a` and `b` (up to sign) at the ends.
///
/// Source: Shoemake, "Animating rotation with quaternion curves" (1985).
pub fn slerp(a: Quat, b: Quat, t: f64) -> Quat {
    if t <= 0.0 {
        return a;
    }
    let b = nearest_sign(b, a);
    if t >= 1.0 {
        return b;
    }
    // from the chord, because the arc cosine of the dot product loses small angles
    let chord = (b - a).length().min(2.0);
    let angle = 2.0 * (0.5 * chord).asin();
    if angle < 1e-9 {
        return (a * (1.0 - t) + b * t).normalize();
    }
    let s = angle.sin();
    (a * (((1.0 - t) * angle).sin() / s) + b * ((t * angle).sin() / s)).normalize()
}

/// The smallest rotation that takes direction `from` to direction `to`.
///
/// The vectors need not be unit. For opposite directions the axis is the perpendicular nearest to the y axis, so that the
/// result is deterministic. Identity if either is zero.
pub fn swing(from: Vec3, to: Vec3) -> Quat {
    let (Some(from), Some(to)) = (from.try_normalize(), to.try_normalize()) else { return Quat::IDENTITY };
    let w = 1.0 + from.dot(to);
    // opposite directions: the cross product vanishes and any perpendicular is an axis
    if w < 1e-12 {
        let axis = if from.y.abs() < 0.9 { Vec3::Y } else { Vec3::Z };
        let axis = (axis - from * axis.dot(from)).normalize();
        return Quat::from_xyzw(axis.x, axis.y, axis.z, 0.0);
    }
    let c = from.cross(to);
    Quat::from_xyzw(c.x, c.y, c.z, w).normalize()
}

/// Heading of a rotation: the angle about +y of its local +z projected onto the ground, radians in `-PI..=PI`; `None` if
/// that points straight up or down.
pub fn heading(q: Quat) -> Option<f64> {
    let z = q * Vec3::Z;
    (z.x.hypot(z.z) > 1e-6).then(|| z.x.atan2(z.z))
}

/// The 24 pairs of orthogonal signed axes.
pub(crate) fn quarter_axes() -> impl Iterator<Item = (Vec3, Vec3)> {
    let axes = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z];
    axes.into_iter().flat_map(move |x| axes.into_iter().filter(move |y| x.dot(*y) == 0.0).map(move |y| (x, y)))
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Unit quaternions, uniform over rotations.
    pub fn any_quat() -> impl Strategy<Value = Quat> {
        prop::array::uniform4(-1.0..1.0f64)
            .prop_filter("too short", |v| v.iter().map(|x| x * x).sum::<f64>() > 1e-4)
            .prop_map(|v| Quat::from_xyzw(v[0], v[1], v[2], v[3]).normalize())
    }

    #[test]
    fn small_angles_are_seen() {
        for angle in [1e-12, 1e-9, 1e-6, 1e-3, 1.0, 3.0, std::f64::consts::PI] {
            let q = Quat::from_axis_angle(Vec3::new(0.6, 0.0, 0.8), angle);
            assert!((angle_between(Quat::IDENTITY, q) - angle).abs() <= 1e-15 + 1e-12 * angle);
            assert!((angle_between(Quat::IDENTITY, -q) - angle).abs() <= 1e-15 + 1e-12 * angle);
        }
    }

    proptest! {
        #[test]
        fn slerp_moves_at_even_speed(a in any_quat(), b in any_quat(), t in 0.0..1.0f64) {
            let whole = angle_between(a, b);
            let q = slerp(a, b, t);
            prop_assert!((angle_between(a, q) - t * whole).abs() < 1e-7);
            prop_assert!((angle_between(q, b) - (1.0 - t) * whole).abs() < 1e-7);
        }

        #[test]
        fn swing_carries_the_direction(a in any_quat(), b in any_quat()) {
            let (from, to) = (a * Vec3::X, b * Vec3::X);
            let q = swing(from, to);
            prop_assert!((q * from - to).length() < 1e-6);
            prop_assert!((angle_between(Quat::IDENTITY, q) - from.angle_between(to)).abs() < 1e-6);
        }
    }

    #[test]
    fn swing_of_opposites() {
        for v in [Vec3::X, Vec3::Y, Vec3::Z, Vec3::new(1.0, -2.0, 0.5)] {
            assert!((swing(v, -v) * v + v).length() < 1e-12);
        }
    }
}
