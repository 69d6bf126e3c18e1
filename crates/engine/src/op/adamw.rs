//! AdamW in place, and the norm that clips its gradients: one pass over memory each.
//!
//! Source: Loshchilov and Hutter, "Decoupled weight decay regularization" (2019); the order of operations is PyTorch's,
//! without fused products, so that every vector width gives the same bits.

use crate::dispatch;
use pulp::{Simd, WithSimd};
use rayon::prelude::*;

/// Numbers of a parallel piece.
pub const CHUNK: usize = 65_536;

/// The numbers of one update.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    /// Factor of the gradients, before all else.
    pub share: f32,
    /// Decay factors of both moments.
    pub betas: [f32; 2],
    /// The learning rate over the first moment's correction.
    pub step: f32,
    /// One over the root of the second moment's correction.
    pub root: f32,
    /// Added to the root of the second moment.
    pub epsilon: f32,
    /// Factor of the parameters: 1 - rate * decay.
    pub keep: f32,
}

impl Step {
    /// Update number `number`, counted from 1, at the learning rate `rate`.
    pub fn new(number: u64, rate: f64, betas: [f64; 2], epsilon: f64, decay: f64, share: f64) -> Step {
        // in f64: 1 - 0.999^1 in f32 would lose half its digits
        let correction = betas.map(|b| 1.0 - b.powf(number as f64));
        Step {
            share: share as f32,
            betas: betas.map(|b| b as f32),
            step: (rate / correction[0]) as f32,
            root: (1.0 / correction[1].sqrt()) as f32,
            epsilon: epsilon as f32,
            keep: (1.0 - rate * decay) as f32,
        }
    }
}

/// Moves the parameters `x` against their gradients; `first` and `second` are the moments.
///
/// # Panics
/// Slices of different lengths.
pub fn update(x: &mut [f32], first: &mut [f32], second: &mut [f32], gradients: &[f32], step: &Step) {
    let lengths = [first.len(), second.len(), gradients.len()];
    assert!(lengths == [x.len(); 3], "adamw: {lengths:?} numbers for {} parameters", x.len());
    if x.len() <= CHUNK {
        return dispatch::run(Update { x, first, second, gradients, step });
    }
    let moments = first.par_chunks_mut(CHUNK).zip(second.par_chunks_mut(CHUNK));
    let chunks = x.par_chunks_mut(CHUNK).zip(moments).zip(gradients.par_chunks(CHUNK));
    chunks.for_each(|((x, (first, second)), gradients)| dispatch::run(Update { x, first, second, gradients, step }));
}

/// The sum of all squares, in f64: chunk by chunk, halves of chunks added up.
pub fn norm_squared(gradients: &[f32]) -> f64 {
    if gradients.len() <= CHUNK {
        return dispatch::run(Squares(gradients));
    }
    // at a whole chunk: the tree of sums depends on the length alone
    let (left, right) = gradients.split_at(gradients.len().div_ceil(CHUNK) / 2 * CHUNK);
    let (left, right) = rayon::join(|| norm_squared(left), || norm_squared(right));
    left + right
}

struct Update<'a> {
    x: &'a mut [f32],
    first: &'a mut [f32],
    second: &'a mut [f32],
    gradients: &'a [f32],
    step: &'a Step,
}

impl WithSimd for Update<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let (x, x_tail) = S::as_mut_simd_f32s(self.x);
        let (m, m_tail) = S::as_mut_simd_f32s(self.first);
        let (v, v_tail) = S::as_mut_simd_f32s(self.second);
        let (g, g_tail) = S::as_simd_f32s(self.gradients);
        let step = Splat::new(simd, self.step);
        for (((x, m), v), g) in x.iter_mut().zip(m).zip(v).zip(g) {
            [*x, *m, *v] = step.moved(simd, [*x, *m, *v], *g);
        }
        if !g_tail.is_empty() {
            // the lanes beyond the tail are 0 / epsilon and are not stored
            let [x, m, v, g] = [&*x_tail, &*m_tail, &*v_tail, g_tail].map(|t| simd.partial_load_f32s(t));
            let [x, m, v] = step.moved(simd, [x, m, v], g);
            simd.partial_store_f32s(x_tail, x);
            simd.partial_store_f32s(m_tail, m);
            simd.partial_store_f32s(v_tail, v);
        }
    }
}

/// A [`Step`] in every lane, with one minus each beta.
struct Splat<S: Simd> {
    share: S::f32s,
    betas: [S::f32s; 2],
    others: [S::f32s; 2],
    step: S::f32s,
    root: S::f32s,
    epsilon: S::f32s,
    keep: S::f32s,
}

impl<S: Simd> Splat<S> {
    #[inline(always)]
    fn new(simd: S, step: &Step) -> Splat<S> {
        let [b1, b2] = step.betas;
        Splat {
            share: simd.splat_f32s(step.share),
            betas: [simd.splat_f32s(b1), simd.splat_f32s(b2)],
            others: [simd.splat_f32s(1.0 - b1), simd.splat_f32s(1.0 - b2)],
            step: simd.splat_f32s(step.step),
            root: simd.splat_f32s(step.root),
            epsilon: simd.splat_f32s(step.epsilon),
            keep: simd.splat_f32s(step.keep),
        }
    }

    /// Parameter and moments after the gradient `g`.
    #[inline(always)]
    fn moved(&self, simd: S, [x, m, v]: [S::f32s; 3], g: S::f32s) -> [S::f32s; 3] {
        let g = simd.mul_f32s(g, self.share);
        let m = simd.add_f32s(simd.mul_f32s(self.betas[0], m), simd.mul_f32s(self.others[0], g));
        let v = simd.add_f32s(simd.mul_f32s(self.betas[1], v), simd.mul_f32s(simd.mul_f32s(self.others[1], g), g));
        let below = simd.add_f32s(simd.mul_f32s(simd.sqrt_f32s(v), self.root), self.epsilon);
        let by = simd.div_f32s(simd.mul_f32s(self.step, m), below);
        [simd.sub_f32s(simd.mul_f32s(x, self.keep), by), m, v]
    }
}

struct Squares<'a>(&'a [f32]);

impl WithSimd for Squares<'_> {
    type Output = f64;

    /// Sixteen sums whatever the vectors, so that every width gives the same bits; the compiler vectorises the loop.
    #[inline(always)]
    fn with_simd<S: Simd>(self, _: S) -> f64 {
        let (blocks, rest) = self.0.as_chunks::<16>();
        let mut sums = [0.0; 16];
        for block in blocks {
            for (s, &x) in sums.iter_mut().zip(block) {
                *s += x as f64 * x as f64;
            }
        }
        for (s, &x) in sums.iter_mut().zip(rest) {
            *s += x as f64 * x as f64;
        }
        sums.iter().sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::op::check::{Lanes, numbers};
    use crate::scalar::adamw as scalar;

    fn step(number: u64) -> Step {
        Step::new(number, 3e-4, [0.9, 0.95], 1e-8, 0.1, 0.37)
    }

    #[test]
    fn every_width_gives_the_bits_of_the_plain_loop() {
        for len in (0..=67).chain([1000]) {
            let [x, m] = [1, 2].map(|seed| numbers(seed, len, 1.0));
            let v: Vec<f32> = numbers(3, len, 1.0).iter().map(|v| v * v).collect();
            let gradients = numbers(4, len, 1.0);
            let mut expected = [x.clone(), m.clone(), v.clone()];
            let [ex, em, ev] = &mut expected;
            scalar::update(ex, em, ev, &gradients, &step(3));
            for lanes in Lanes::ALL {
                let [mut x, mut first, mut second] = [x.clone(), m.clone(), v.clone()];
                let (x_, m_, v_) = (&mut x[..], &mut first[..], &mut second[..]);
                lanes.run(Update { x: x_, first: m_, second: v_, gradients: &gradients, step: &step(3) });
                assert_eq!([x, first, second], expected, "{lanes:?} {len}");
            }
        }
    }

    #[test]
    fn two_updates_by_hand() {
        // gradients 1 and -1: first moments 0.1, then 0.09 - 0.1 = -0.01; second ones 0.01, then 0.0199
        let (mut x, mut m, mut v) = ([0.7f32], [0.0], [0.0]);
        update(&mut x, &mut m, &mut v, &[2.0], &Step::new(1, 0.1, [0.9, 0.99], 1e-8, 0.5, 0.5));
        update(&mut x, &mut m, &mut v, &[-1.0], &Step::new(2, 0.1, [0.9, 0.99], 1e-8, 0.5, 1.0));
        let expected = (0.7 * 0.95 - 0.1) * 0.95 - 0.1 * (-0.01 / 0.19);
        assert!((x[0] as f64 - expected).abs() < 2e-7, "{x:?}, expected {expected}");
    }

    #[test]
    fn pieces_are_the_whole_at_any_number_of_threads() {
        let len = 5 * CHUNK + 77;
        let [x, gradients] = [1, 2].map(|seed| numbers(seed, len, 1.0));
        let zeros = || vec![0.0; len];
        let [mut expected, mut m, mut v] = [x.clone(), zeros(), zeros()];
        scalar::update(&mut expected, &mut m, &mut v, &gradients, &step(1));
        let norms = [1, 2, 5].map(|threads| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let [mut x, mut m, mut v] = [x.clone(), zeros(), zeros()];
            pool.install(|| update(&mut x, &mut m, &mut v, &gradients, &step(1)));
            assert_eq!(x, expected);
            pool.install(|| norm_squared(&gradients))
        });
        assert!(norms.iter().all(|n| *n == norms[0]), "{norms:?}");
        // f64 sums of 300,000 numbers in another order
        assert!((norms[0] / scalar::norm_squared(&gradients) - 1.0).abs() < 1e-12);
    }

    #[test]
    fn norms_of_every_length_and_width() {
        for len in 0..=67 {
            let x = numbers(len as u64, len, 3.0);
            for lanes in Lanes::ALL {
                let found = lanes.run(Squares(&x));
                assert_eq!(found, norm_squared(&x), "{lanes:?}");
                assert!((found - scalar::norm_squared(&x)).abs() <= 1e-13 * found, "{lanes:?} {len}");
            }
        }
        assert!(norm_squared(&[1.0, f32::NAN]).is_nan());
        assert_eq!(norm_squared(&[1e30, 1e30]), 2.0 * (1e30f32 as f64).powi(2));
    }
}
