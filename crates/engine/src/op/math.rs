//! Parts that several kernels share: the exponential function, sums and maxima over a vector's lanes.

use pulp::Simd;

/// 1.5 * 2^23 + 127: a float added to it is rounded to a whole number, in its lowest bits with the bias of a float's
/// exponent.
const ROUND: f32 = 12_583_039.0;
/// Below -126.5 ln 2, powers of 2 end and e^x is 0; here the exponent's bits are 0.
const LOWEST: f32 = -88.0;
/// ln 2 in two parts: multiples of the first, up to 128 of them, are exact.
const LN_2: [f32; 2] = [355.0 / 512.0, -2.121_944_4e-4];
/// e^r for |r| <= ln 2 / 2, from the highest power down, without 1 + r; the relative error is below 4e-9 (Remez).
const P: [f32; 5] = [0.001_381_454, 0.008_368_745, 0.041_668_39, 0.166_665_2, 0.499_999_94];

/// e^x for x up to 88, as those of a softmax; relative error at most 2e-7 where the result is a normal number, 0 from
/// -87.69 down (and for -inf), NaN for NaN, anything above 88.
#[inline(always)]
pub(crate) fn exp_falling<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
    // no maximum: which of the two it gives for NaN depends on the CPU
    let lowest = simd.splat_f32s(LOWEST);
    exp_within(simd, simd.select_f32s(simd.less_than_f32s(x, lowest), lowest, x))
}

/// [`exp_falling`] for x that are not below -88 either.
#[inline(always)]
pub(crate) fn exp_within<S: Simd>(simd: S, x: S::f32s) -> S::f32s {
    let (round, one) = (simd.splat_f32s(ROUND), simd.splat_f32s(1.0));
    let shifted = simd.mul_add_e_f32s(x, simd.splat_f32s(std::f32::consts::LOG2_E), round);
    let n = simd.sub_f32s(shifted, round);
    // x - n ln 2 in two steps: the first is exact, so what cancels costs no digits
    let r = simd.negate_mul_add_e_f32s(n, simd.splat_f32s(LN_2[0]), x);
    let r = simd.negate_mul_add_e_f32s(n, simd.splat_f32s(LN_2[1]), r);
    let mut p = simd.splat_f32s(P[0]);
    for c in &P[1..] {
        p = simd.mul_add_e_f32s(p, r, simd.splat_f32s(*c));
    }
    let p = simd.mul_add_e_f32s(simd.mul_add_e_f32s(p, r, one), r, one);
    // by 23 bits only the exponent remains; n = -127 gives the bits of 0, which makes the product 0
    let bits = simd.wrapping_dyn_shl_u32s(simd.transmute_u32s_f32s(shifted), simd.splat_u32s(23));
    simd.mul_f32s(p, simd.transmute_f32s_u32s(bits))
}

/// The sum of the lanes, added in pairs: the order depends on the width alone.
#[inline(always)]
pub(crate) fn sum<S: Simd>(simd: S, x: S::f32s) -> f32 {
    simd.reduce_sum_f32s(x)
}

/// The lanes of [`LaneSums`]: those of the widest vector.
pub(crate) const SUM_LANES: usize = 16;

/// LaneSums in 16 lanes, however wide the vectors are: the order of the additions, and so every bit, is that of all processors
/// that multiply and add in one step.
#[derive(Clone, Copy)]
pub(crate) struct LaneSums<S: Simd>([S::f32s; SUM_LANES]);

impl<S: Simd> LaneSums<S> {
    /// Vectors that they take.
    pub const VECTORS: usize = SUM_LANES / S::F32_LANES;

    #[inline(always)]
    pub fn new(simd: S) -> LaneSums<S> {
        LaneSums([simd.splat_f32s(0.0); SUM_LANES])
    }

    /// Each sum by `next`, from itself and the number in its lane; there may be fewer vectors.
    #[inline(always)]
    pub fn update(&mut self, vectors: &[S::f32s], next: impl Fn(S::f32s, S::f32s) -> S::f32s) {
        for (sum, x) in self.0[..Self::VECTORS].iter_mut().zip(vectors) {
            *sum = next(*sum, *x);
        }
    }

    #[inline(always)]
    pub fn plus(mut self, simd: S, other: LaneSums<S>) -> LaneSums<S> {
        self.update(&other.0, |sum, x| simd.add_f32s(sum, x));
        self
    }

    /// The sum of all lanes, added in pairs.
    #[inline(always)]
    pub fn total(mut self, simd: S) -> f32 {
        let mut left = Self::VECTORS;
        while left > 1 {
            left /= 2;
            // as the lanes of one vector are halved
            for i in 0..left {
                self.0[i] = simd.add_f32s(self.0[i], self.0[i + left]);
            }
        }
        sum(simd, self.0[0])
    }
}

/// The numbers of the lanes.
static LANES: [u32; 16] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15];

/// The lanes that hold the numbers of a tail of `len`.
#[inline(always)]
pub(crate) fn lanes_below<S: Simd>(simd: S, len: usize) -> S::m32s {
    simd.less_than_u32s(lane_numbers(simd), simd.splat_u32s(len as u32))
}

/// 0, 1, 2 and so on.
#[inline(always)]
pub(crate) fn lane_numbers<S: Simd>(_: S) -> S::u32s {
    S::as_simd_u32s(&LANES[..S::U32_LANES]).0[0]
}

/// The largest lane; which number comes out is open where one is NaN.
#[inline(always)]
pub(crate) fn largest<S: Simd>(simd: S, x: S::f32s) -> f32 {
    simd.reduce_max_f32s(x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::op::check::Lanes;
    use pulp::WithSimd;

    /// Half a unit in the last place for the last sum, a third of one for what is added; without fused products some more.
    const EXP_ERROR: f64 = 2e-7;

    struct Exp<'a>(&'a mut [f32]);

    impl WithSimd for Exp<'_> {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            for chunk in self.0.chunks_mut(S::F32_LANES) {
                let x = simd.partial_load_f32s(chunk);
                simd.partial_store_f32s(chunk, exp_falling(simd, x));
            }
        }
    }

    #[test]
    fn exp_is_exp() {
        let x: Vec<f32> = (-873_300..=880_000).map(|i| i as f32 * 1e-4).collect();
        for lanes in Lanes::ALL {
            let mut y = x.clone();
            lanes.run(Exp(&mut y));
            let error = |(x, y): (&f32, &f32)| (*y as f64 / (*x as f64).exp() - 1.0).abs();
            let worst = x.iter().zip(&y).map(error).fold(0.0, f64::max);
            assert!(worst <= EXP_ERROR, "{lanes:?}: error {worst:e}");
        }
    }

    #[test]
    fn the_ends_of_exp() {
        let ends = [f32::NEG_INFINITY, f32::MIN, -1e6, -1000.0, -104.0, -88.0, -87.7, -0.0, 0.0, 1e-30];
        let values = [0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 1.0, 1.0, 1.0];
        for lanes in Lanes::ALL {
            let mut y = ends;
            lanes.run(Exp(&mut y));
            assert_eq!(y, values, "{lanes:?}");
            let mut nan = [f32::NAN, -f32::NAN, f32::from_bits(0x7f80_0001), f32::from_bits(0xffff_ffff)];
            lanes.run(Exp(&mut nan));
            assert!(nan.iter().all(|y| y.is_nan()), "{lanes:?}: {nan:?}");
        }
    }

    struct Reductions<'a>(&'a [f32]);

    impl WithSimd for Reductions<'_> {
        type Output = (f32, f32);

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) -> (f32, f32) {
            let (x, tail) = S::as_simd_f32s(self.0);
            assert!(tail.is_empty());
            x.iter().fold((0.0, f32::MIN), |(s, m), x| (s + sum(simd, *x), m.max(largest(simd, *x))))
        }
    }

    #[test]
    fn all_lanes_count() {
        let x: Vec<f32> = (0..64).map(|i| ((i * 37) % 64) as f32).collect();
        for lanes in Lanes::ALL {
            assert_eq!(lanes.run(Reductions(&x)), (2016.0, 63.0), "{lanes:?}");
        }
    }
}
