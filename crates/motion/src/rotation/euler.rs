//! Intrinsic Euler angles in all twelve orders: each rotation is about the already rotated axis.

use super::{Mat3, Quat, Vec3};

/// One of the three axes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Axis {
    /// +x, the body's left at rest.
    X,
    /// +y, up.
    Y,
    /// +z, the body's front at rest.
    Z,
}

impl Axis {
    /// 0, 1 or 2.
    pub fn index(self) -> usize {
        self as usize
    }

    /// The unit vector.
    pub fn vector(self) -> Vec3 {
        [Vec3::X, Vec3::Y, Vec3::Z][self.index()]
    }

    /// Rotation by `angle` radians about this axis.
    pub fn turn(self, angle: f64) -> Quat {
        let (s, c) = (0.5 * angle).sin_cos();
        let v = self.vector() * s;
        Quat::from_xyzw(v.x, v.y, v.z, c)
    }
}

/// Three axes, the second different from its neighbours: `L = R(0) R(1) R(2)`, in the order of a BVH's channels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub struct EulerOrder(pub [Axis; 3]);

impl EulerOrder {
    /// All twelve orders.
    pub const ALL: [EulerOrder; 12] = {
        use Axis::*;
        [
            EulerOrder([X, Y, Z]),
            EulerOrder([X, Z, Y]),
            EulerOrder([Y, X, Z]),
            EulerOrder([Y, Z, X]),
            EulerOrder([Z, X, Y]),
            EulerOrder([Z, Y, X]),
            EulerOrder([X, Y, X]),
            EulerOrder([X, Z, X]),
            EulerOrder([Y, X, Y]),
            EulerOrder([Y, Z, Y]),
            EulerOrder([Z, X, Z]),
            EulerOrder([Z, Y, Z]),
        ]
    };

    /// The order of three axes; `None` if the second equals a neighbour.
    pub fn new(axes: [Axis; 3]) -> Option<Self> {
        (axes[0] != axes[1] && axes[1] != axes[2]).then_some(EulerOrder(axes))
    }

    /// The rotation with these angles, radians.
    pub fn to_quat(self, angles: [f64; 3]) -> Quat {
        self.0[0].turn(angles[0]) * self.0[1].turn(angles[1]) * self.0[2].turn(angles[2])
    }

    /// The angles of a rotation, radians: the middle one in `-PI/2..=PI/2` (three axes) or `0..=PI` (two axes).
    ///
    /// Within 1e-6 degrees of gimbal lock only the sum of the outer angles is defined: the third angle is `previous_third`
    /// and the first is the rest.
    pub fn from_quat(self, q: Quat, previous_third: f64) -> [f64; 3] {
        let (i, j) = (self.0[0].index(), self.0[1].index());
        let m = Mat3::from_quat(q.normalize());
        let at = |r: usize, c: usize| m.col(c)[r];
        let proper = self.0[2] == self.0[0];
        let k = if proper { 3 - i - j } else { self.0[2].index() };
        // +1 for an even permutation of the axes, -1 for an odd one
        let e = if (j + 3 - i) % 3 == 1 { 1.0 } else { -1.0 };
        let pole = 1e-6f64.to_radians();
        let (first, middle, third) = if proper {
            let across = at(i, j).hypot(at(i, k));
            let middle = across.atan2(at(i, i));
            if across < pole.sin() {
                return self.at_pole(q, middle, previous_third);
            }
            (at(j, i).atan2(-e * at(k, i)), middle, at(i, j).atan2(e * at(i, k)))
        } else {
            let across = at(i, i).hypot(at(i, j));
            let middle = (e * at(i, k)).atan2(across);
            if across < pole.sin() {
                return self.at_pole(q, middle, previous_third);
            }
            ((-e * at(j, k)).atan2(at(k, k)), middle, (-e * at(i, j)).atan2(at(i, i)))
        };
        [first, middle, third]
    }

    /// The angles at gimbal lock, with middle and third angle given: `R(0) = L R(2)^-1 R(1)^-1`.
    fn at_pole(self, q: Quat, middle: f64, third: f64) -> [f64; 3] {
        // both outer axes coincide here, so what the other two leave is a rotation about the first
        let rest = q * self.0[2].turn(-third) * self.0[1].turn(-middle);
        // signed, unlike the length of the vector part
        let along = rest.xyz().dot(self.0[0].vector());
        let first = 2.0 * along.atan2(rest.w);
        [wrap(first), middle, third]
    }
}

/// `angle` plus whole turns, in `-PI..=PI`.
pub fn wrap(angle: f64) -> f64 {
    use std::f64::consts::TAU;
    angle - TAU * (angle / TAU).round()
}

/// `angle` plus whole turns, within PI of `reference`.
pub fn unwrap_near(angle: f64, reference: f64) -> f64 {
    reference + wrap(angle - reference)
}

#[cfg(test)]
mod tests {
    use super::super::{angle_between, tests::any_quat};
    use super::*;
    use proptest::prelude::*;
    use std::f64::consts::{FRAC_PI_2, PI};

    proptest! {
        #[test]
        fn round_trip_in_every_order(q in any_quat()) {
            for order in EulerOrder::ALL {
                let angles = order.from_quat(q, 0.0);
                prop_assert!(angle_between(order.to_quat(angles), q) < 1e-9, "{order:?}");
            }
        }

        #[test]
        fn angles_come_back(a in -3.1..3.1f64, b in 0.05..1.5f64, c in -3.1..3.1f64) {
            for order in EulerOrder::ALL {
                let got = order.from_quat(order.to_quat([a, b, c]), 0.0);
                for (g, w) in got.iter().zip([a, b, c]) {
                    prop_assert!(wrap(g - w).abs() < 1e-8, "{order:?} {got:?}");
                }
            }
        }

        #[test]
        fn the_pole_keeps_the_third_angle(a in -3.0..3.0f64, c in -3.0..3.0f64, previous in -3.0..3.0f64, up in any::<bool>()) {
            for order in EulerOrder::ALL {
                let middle = match (order.0[0] == order.0[2], up) {
                    (true, true) => PI,
                    (true, false) => 0.0,
                    (false, true) => FRAC_PI_2,
                    (false, false) => -FRAC_PI_2,
                };
                let q = order.to_quat([a, middle, c]);
                let got = order.from_quat(q, previous);
                prop_assert_eq!(got[2], previous);
                prop_assert!(angle_between(order.to_quat(got), q) < 1e-7, "{:?}", order);
            }
        }
    }

    #[test]
    fn bvh_order_is_intrinsic() {
        let zxy = EulerOrder([Axis::Z, Axis::X, Axis::Y]);
        let deg = |d: f64| d.to_radians();
        let p = zxy.to_quat([deg(90.0), deg(90.0), 0.0]) * Vec3::new(0.0, 10.0, 0.0);
        assert!((p - Vec3::new(0.0, 0.0, 10.0)).length() < 1e-12);
        let xzy = EulerOrder([Axis::X, Axis::Z, Axis::Y]);
        let p = xzy.to_quat([deg(90.0), deg(90.0), 0.0]) * Vec3::new(0.0, 10.0, 0.0);
        assert!((p - Vec3::new(-10.0, 0.0, 0.0)).length() < 1e-12);
    }
}
