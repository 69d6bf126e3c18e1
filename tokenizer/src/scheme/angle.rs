//! Uniform bins for rotation vectors: n bins over -PI..=PI in each component.

use super::line::nearest_whole;
use kinelm_motion::rotation::exp_map;
use kinelm_motion::{Quat, Vec3};
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// Differences below this, in bins, are ties.
const TIE: f64 = 1e-4;

/// The most times that a code is decoded and encoded until it is stable.
const TRIES: usize = 8;

/// Alignment of the bins.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Form {
    /// A bin is centred on 0. Near half a turn both vectors of a rotation are candidates.
    #[default]
    Centred,
    /// A bin has its edge at 0 (compat): `floor((v - lo) / w)`. An unused joint flickers between two codes, and decoded rotations
    /// within a bin of half a turn may encode to other codes.
    Edge,
}

/// The bins of rotation vectors.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Angles {
    form: Form,
    bins: i64,
    /// Radians.
    width: f64,
    /// The largest squared length of a decoded vector, in bins: `(n/2 + 3/2)^2`, plus an eighth so that no vector of whole bins is
    /// on the border, where rounding would decide.
    longest: f64,
    /// Length from which on the vector's twin is a candidate, too, radians.
    near: f64,
}

/// One of the two vectors of a rotation, as a candidate.
#[derive(Clone, Copy)]
struct Candidate {
    /// The decoded vector, in bins.
    decoded: [i64; 3],
    /// Largest component difference from it, in bins, without wrapping.
    miss: f64,
}

impl Angles {
    /// `bins` of equal width over a full turn.
    pub fn new(form: Form, bins: u32) -> Self {
        let n = f64::from(bins);
        let longest = (0.5 * n + 1.5).powi(2) + 0.125;
        let width = TAU / n;
        // a vector of length a has a twin of length TAU - a, which must not decode beyond `longest`
        Angles { form, bins: bins.into(), width, longest, near: TAU - longest.sqrt() * width }
    }

    /// The width of a bin, radians.
    pub fn width(&self) -> f64 {
        self.width
    }

    /// The codes of a rotation, and whether they are second codes: those of the decoded first codes, more than half a bin from
    /// both of its vectors.
    ///
    /// [`Form::Edge`] encodes the canonical vector. [`Form::Centred`] encodes it or, near half a turn, its twin, whichever is
    /// nearer to its own decoding; its codes encode to themselves after decoding.
    pub fn code(&self, q: Quat) -> ([u16; 3], bool) {
        let v = exp_map::to_vector(q);
        if self.form == Form::Edge {
            let code = |x: f64| (((x + PI) / self.width).floor() as i64).clamp(0, self.bins - 1) as u16;
            return ([code(v.x), code(v.y), code(v.z)], false);
        }
        let first = self.nearest(v);
        let mut decoded = first;
        for _ in 0..TRIES {
            if !self.may_have_twin(decoded) {
                break;
            }
            let again = self.nearest(exp_map::to_vector(exp_map::from_vector(self.vector_of(decoded))));
            if again == decoded {
                break;
            }
            decoded = again;
        }
        // most second codes are the other vector's own
        let second = decoded != first && !self.both(v).iter().any(|c| c.decoded == decoded && c.miss <= 0.5);
        (decoded.map(|k| (k + self.bins / 2) as u16), second)
    }

    /// The vector of codes, radians; up to `sqrt(3) PI` long.
    pub fn vector(&self, code: [u16; 3]) -> Vec3 {
        match self.form {
            Form::Centred => self.vector_of(code.map(|k| i64::from(k) - self.bins / 2)),
            Form::Edge => Vec3::from_array(code.map(|k| (f64::from(k) + 0.5) * self.width - PI)),
        }
    }

    /// The edges between bins, ascending, radians.
    pub fn edges(&self) -> Vec<f64> {
        let value = |k: i64| self.vector([k as u16; 3]).x;
        (1..self.bins).map(|k| 0.5 * (value(k - 1) + value(k))).collect()
    }

    /// The rotation of codes.
    pub fn rotation(&self, code: [u16; 3]) -> Quat {
        exp_map::from_vector(self.vector(code))
    }

    fn vector_of(&self, decoded: [i64; 3]) -> Vec3 {
        Vec3::from_array(decoded.map(|k| k as f64 * self.width))
    }

    /// Whether a decoded vector is long enough for its twin to be a candidate.
    fn may_have_twin(&self, decoded: [i64; 3]) -> bool {
        // a tenth of a bin early; this only saves time
        length_squared(decoded) as f64 > (self.near / self.width - 0.1).max(0.0).powi(2)
    }

    /// The decoded vector of a canonical one, in bins.
    fn nearest(&self, v: Vec3) -> [i64; 3] {
        let angle = v.length();
        // the twin of a zero vector has no direction
        if angle <= self.near || angle < 1e-9 {
            return v.to_array().map(|x| self.wrapped(x / self.width));
        }
        let [own, twin] = self.both(v);
        let fits = |c: Candidate| length_squared(c.decoded) as f64 <= self.longest;
        match (fits(own), fits(twin)) {
            (true, false) => own.decoded,
            (false, true) => twin.decoded,
            _ if (own.miss - twin.miss).abs() >= TIE => {
                if own.miss < twin.miss {
                    own.decoded
                } else {
                    twin.decoded
                }
            }
            // decided by whole bins, since the sign of a zero component is rounding noise
            _ if first_is_positive(own.decoded) => own.decoded,
            _ => twin.decoded,
        }
    }

    /// A non-zero vector and its twin.
    fn both(&self, v: Vec3) -> [Candidate; 2] {
        let angle = v.length();
        [self.candidate(v), self.candidate(v * ((angle - TAU) / angle))]
    }

    fn candidate(&self, v: Vec3) -> Candidate {
        let (mut decoded, mut miss) = ([0; 3], 0.0f64);
        for (i, x) in v.to_array().into_iter().enumerate() {
            let x = x / self.width;
            decoded[i] = self.wrapped(x);
            miss = miss.max((x - decoded[i] as f64).abs());
        }
        Candidate { decoded, miss }
    }

    /// The nearest whole bin, modulo a full turn.
    fn wrapped(&self, x: f64) -> i64 {
        let (k, half) = (nearest_whole(x), self.bins / 2);
        // once is enough: a canonical vector and its twin are shorter than a full turn
        if k + half >= self.bins {
            k - self.bins
        } else if k + half < 0 {
            k + self.bins
        } else {
            k
        }
    }
}

fn length_squared(v: [i64; 3]) -> i64 {
    v.iter().map(|x| x * x).sum()
}

fn first_is_positive(v: [i64; 3]) -> bool {
    v.into_iter().find(|&x| x != 0).unwrap_or(0) > 0
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::rotation::angle_between;
    use proptest::prelude::*;

    const BINS: [u32; 6] = [360, 361, 60, 1080, 7, 363];

    /// Numbers in 0..1 that don't change from run to run (Weyl sequences of three irrational steps, scrambled).
    struct Numbers(u64);

    impl Numbers {
        fn next(&mut self) -> f64 {
            // Steele, Lea, Flood, "Fast splittable pseudorandom number generators" (2014)
            self.0 = self.0.wrapping_add(0x9E37_79B9_7F4A_7C15);
            let mut z = self.0;
            z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
            z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
            ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 53) as f64
        }

        fn direction(&mut self) -> Vec3 {
            loop {
                let v = Vec3::new(self.next(), self.next(), self.next()) * 2.0 - Vec3::ONE;
                if (0.01..=1.0).contains(&v.length_squared()) {
                    return v.normalize();
                }
            }
        }

        fn rotation(&mut self) -> Quat {
            loop {
                let v = [self.next(), self.next(), self.next(), self.next()].map(|x| 2.0 * x - 1.0);
                let n = v.iter().map(|x| x * x).sum::<f64>();
                if (0.01..=1.0).contains(&n) {
                    return Quat::from_array(v).normalize();
                }
            }
        }
    }

    /// Smallest over the vector and its twin of the largest component error, in bins.
    fn miss(a: &Angles, q: Quat, code: [u16; 3]) -> f64 {
        let v = exp_map::to_vector(q);
        let d = a.vector(code);
        let of = |v: Vec3| (v - d).abs().max_element() / a.width();
        exp_map::twin(v).map_or(of(v), |t| of(v).min(of(t)))
    }

    /// Mean square of the nearer vector's component errors, in bins.
    fn square(a: &Angles, q: Quat, code: [u16; 3]) -> f64 {
        let v = exp_map::to_vector(q);
        let d = a.vector(code);
        let of = |v: Vec3| (v - d).length_squared() / (3.0 * a.width().powi(2));
        exp_map::twin(v).map_or(of(v), |t| of(v).min(of(t)))
    }

    #[derive(Default, Debug)]
    struct Worst {
        count: u64,
        angle_sum: f64,
        square_sum: f64,
        miss: f64,
        angle: f64,
        second_miss: f64,
        second_angle: f64,
        near: u64,
        second: u64,
        unstable: u64,
    }

    fn measure(a: &Angles, rotations: impl Iterator<Item = Quat>) -> Worst {
        let mut w = Worst::default();
        for q in rotations {
            let (code, second) = a.code(q);
            let back = a.rotation(code);
            let (m, e) = (miss(a, q, code), angle_between(q, back) / a.width());
            w.count += 1;
            w.angle_sum += e;
            w.square_sum += square(a, q, code);
            if second {
                (w.second_miss, w.second_angle) = (w.second_miss.max(m), w.second_angle.max(e));
            } else {
                (w.miss, w.angle) = (w.miss.max(m), w.angle.max(e));
            }
            w.near += u64::from(angle_between(q, Quat::IDENTITY) > PI - 3.0 * a.width());
            w.second += u64::from(second);
            w.unstable += u64::from(a.code(back) != (code, false));
        }
        w
    }

    /// Bounds in bins, with what rounding may add.
    const SLACK: f64 = 1e-6;

    fn check(bins: u32, w: &Worst) {
        println!("{bins} bins: {w:?}");
        let root3 = 3f64.sqrt();
        assert!(w.miss <= 0.5 + SLACK && w.angle <= 0.5 * root3 + SLACK, "{bins}: {w:?}");
        assert!(w.second_miss <= 1.0 + SLACK && w.second_angle <= root3 + SLACK, "{bins}: {w:?}");
        assert_eq!(w.unstable, 0, "{bins}: {w:?}");
        assert!(w.second * 1000 <= w.near, "{bins}: {w:?}");
    }

    #[test]
    fn small_table() {
        let codes = |form, v: Vec3| Angles::new(form, 360).code(exp_map::from_vector(v)).0[0];
        let at = |form, k| Angles::new(form, 360).vector([k, 0, 0]).x.to_degrees();
        for (form, zero, one) in [(Form::Centred, 180, 237), (Form::Edge, 180, 237)] {
            assert_eq!((codes(form, Vec3::ZERO), codes(form, Vec3::X)), (zero, one));
        }
        assert_eq!((codes(Form::Centred, Vec3::X * -PI), codes(Form::Centred, Vec3::X * PI)), (0, 0));
        // half a turn has one canonical vector, so the edge form meets -pi only as the clamp of a longer one
        assert_eq!(codes(Form::Edge, Vec3::X * PI), 359);
        assert_eq!(codes(Form::Edge, Vec3::X * -(PI - 1e-9)), 0);
        let near = |a: f64, b: f64| assert!((a - b).abs() < 1e-9, "{a} {b}");
        for (k, v) in [(180, 0.0), (0, -180.0), (237, 57.0)] {
            near(at(Form::Centred, k), v);
        }
        for (k, v) in [(180, 0.5), (0, -179.5), (359, 179.5), (237, 57.5)] {
            near(at(Form::Edge, k), v);
        }
    }

    #[test]
    fn a_million_rotations() {
        let mut n = Numbers(1);
        let all: Vec<Quat> = (0..1_000_000).map(|_| n.rotation()).collect();
        let a = Angles::new(Form::Centred, 360);
        let w = measure(&a, all.iter().copied());
        check(360, &w);
        // sqrt(1/12) bins, and at most the mean distance in a cube from its middle
        let n = w.count as f64;
        let (rms, mean) = ((w.square_sum / n).sqrt(), w.angle_sum / n);
        assert!((rms - 0.2887).abs() < 0.0005, "{rms}");
        assert!(mean <= 0.4804 && mean > 0.35, "{mean}");
        println!("component rms {rms}, mean angle {mean} bins");
        let edge = Angles::new(Form::Edge, 360);
        for &q in &all {
            let code = edge.code(q).0;
            assert!(miss(&edge, q, code) <= 0.5 + SLACK);
            assert!(angle_between(edge.rotation(code), q) <= 0.5 * 3f64.sqrt() * edge.width() + SLACK);
        }
        for bins in BINS {
            check(bins, &measure(&Angles::new(Form::Centred, bins), all.iter().copied().take(100_000)));
        }
    }

    #[test]
    fn near_half_a_turn() {
        for bins in BINS {
            let a = Angles::new(Form::Centred, bins);
            let mut n = Numbers(u64::from(bins));
            let turn = |n: &mut Numbers| n.direction() * (PI - 3.0 * a.width() * n.next()).max(0.0);
            let w = measure(&a, (0..200_000).map(|_| exp_map::from_vector(turn(&mut n))));
            check(bins, &w);
        }
    }

    #[test]
    fn half_turns_about_axes_of_whole_bins() {
        for bins in BINS {
            let a = Angles::new(Form::Centred, bins);
            for axis in [[1, 0, 0], [0, -1, 0], [3, 4, 0], [-3, -4, 0], [1, 2, 2], [0, -3, 4], [-2, 3, 6], [1, 1, 1]] {
                let axis = Vec3::from_array(axis.map(f64::from)).normalize();
                for off in [0.0, 1e-12, -1e-12, 1e-7, -1e-7, 0.3, -0.3, 0.5, -0.5, 1.5, -1.5] {
                    let q = exp_map::from_vector(axis * (PI + off * a.width()));
                    let (code, _) = a.code(q);
                    assert_eq!(a.code(a.rotation(code)), (code, false), "{bins} {axis} {off}");
                    assert_eq!(a.code(-q), a.code(q), "{bins} {axis} {off}");
                }
            }
        }
    }

    proptest! {
        #[test]
        fn rounding_changes_no_code(bins in prop::sample::select(&BINS[..]), v in prop::array::uniform3(-PI..PI), noise in prop::array::uniform4(-1e-8..1e-8)) {
            let a = Angles::new(Form::Centred, bins);
            let (code, _) = a.code(exp_map::from_vector(Vec3::from_array(v)));
            let q = a.rotation(code);
            let blurred = Quat::from_array(std::array::from_fn(|i| q.to_array()[i] + noise[i])).normalize();
            prop_assert_eq!(a.code(blurred), (code, false));
        }

        #[test]
        fn any_codes_are_a_rotation(bins in 2u32..5000, k in prop::array::uniform3(0.0..1.0f64)) {
            for form in [Form::Centred, Form::Edge] {
                let a = Angles::new(form, bins);
                let q = a.rotation(k.map(|x| (x * f64::from(bins)) as u16));
                prop_assert!(q.is_finite() && (q.length() - 1.0).abs() < 1e-12);
                let (code, _) = a.code(q);
                prop_assert!(code.iter().all(|&c| u32::from(c) < bins));
            }
        }
    }
}
