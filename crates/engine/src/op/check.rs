//! For the tests: kernels on vectors of every width, numbers to feed them, errors that a message shows.

use crate::dispatch;
use pulp::{Scalar, Scalar128b, Scalar512b, WithSimd};

/// On which vectors a kernel runs.
#[derive(Debug, Clone, Copy)]
pub(crate) enum Lanes {
    Dispatched,
    One,
    Four,
    /// As AVX-512 has them, on any CPU.
    Sixteen,
}

impl Lanes {
    pub(crate) const ALL: [Lanes; 4] = [Lanes::Dispatched, Lanes::One, Lanes::Four, Lanes::Sixteen];

    /// Those that multiply and add in one step, as all processors' vectors do; plain floats don't.
    pub(crate) fn fused() -> impl Iterator<Item = Lanes> {
        let is_fused = |lanes: &Lanes| match lanes {
            Lanes::Dispatched => dispatch::name() != "portable",
            Lanes::One => false,
            Lanes::Four | Lanes::Sixteen => true,
        };
        Lanes::ALL.into_iter().filter(is_fused)
    }

    pub(crate) fn run<Op: WithSimd>(self, op: Op) -> Op::Output {
        match self {
            Lanes::Dispatched => dispatch::run(op),
            Lanes::One => op.with_simd(Scalar),
            Lanes::Four => op.with_simd(Scalar128b),
            Lanes::Sixteen => op.with_simd(Scalar512b),
        }
    }
}

/// `len` numbers in -range..range, the same for the same seed.
pub(crate) fn numbers(seed: u64, len: usize, range: f32) -> Vec<f32> {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ 0xD1B5_4A32_D192_ED03;
    let mut number = || {
        state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407);
        ((state >> 40) as f32 / (1u32 << 23) as f32 - 1.0) * range
    };
    (0..len).map(|_| number()).collect()
}

/// Asserts that each number is within `bound * max(1, its size)` of what is expected.
#[track_caller]
pub(crate) fn near(what: &str, found: &[f32], expected: &[f64], bound: f64) {
    assert_eq!(found.len(), expected.len(), "{what}");
    for (i, (f, e)) in found.iter().zip(expected).enumerate() {
        let error = (*f as f64 - e).abs() / e.abs().max(1.0);
        assert!(
            error <= bound,
            "{what}: number {i} of {}: {f}, expected {e}, error {error:e} > {bound:e}",
            found.len()
        );
    }
}
