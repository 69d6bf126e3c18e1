//! Dropout without a mask in memory: whether a number stays is a pure function of a key, its row and its column, so the
//! backward pass finds the same mask again, and neither threads nor vectors change it.
//!
//! A key and a row become 32 bits by two rounds of splitmix64's mix, columns step from there by the golden ratio, and
//! murmur3's last mix makes the 32 bits that are compared with the share.
//!
//! Limits: a row's key has 32 bits, so among 77,000 rows of one key two have the same mask with probability 1/2. A
//! share is rounded to 2^-32.
//!
//! Source: Steele, Lea and Flood, "Fast splittable pseudorandom number generators" (2014); Appleby, MurmurHash3 (2011).

use super::math::lane_numbers;
use crate::dispatch;
use pulp::{Simd, WithSimd};

/// 2^32 over the golden ratio: steps that spread over all 32 bits.
const STEP: u32 = 0x9E37_79B9;

/// The mask of rows that begin with `first_row`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Mask {
    /// The key of the mask, for all rows of all calls: another key is another mask.
    pub key: u64,
    /// The number of the first row, so that pieces of a whole have the whole's mask.
    pub first_row: u64,
    /// The share that is dropped, 0 to below 1; at 0 nothing is computed.
    pub share: f64,
}

impl Mask {
    /// Drops nothing.
    pub const NONE: Mask = Mask { key: 0, first_row: 0, share: 0.0 };
}

/// The key of a row of a mask.
pub(crate) fn row_key(key: u64, row: u64) -> u32 {
    (mix(mix(key).wrapping_add(row)) >> 32) as u32
}

/// splitmix64's next number after state `z`.
fn mix(z: u64) -> u64 {
    let z = z.wrapping_add(0x9E37_79B9_7F4A_7C15);
    let z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    let z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// Numbers with bits below this are dropped: a `share` of all.
///
/// # Panics
/// A share outside `0.0..1.0`.
pub fn threshold(share: f64) -> u32 {
    assert!((0.0..1.0).contains(&share), "a dropout of {share}, expected 0 to below 1");
    // a share within 2^-33 of 1 saturates at u32::MAX, and one number in 2^32 stays
    (share * 2f64.powi(32)).round() as u32
}

/// The factor of the numbers that stay: the expected sum is that of all.
pub fn growth(share: f64) -> f32 {
    (1.0 / (1.0 - share)) as f32
}

/// Whether the number in `row` and `column` stays: the definition.
pub fn kept(key: u64, row: u64, column: u32, threshold: u32) -> bool {
    bits(row_key(key, row), column) >= threshold
}

/// murmur3's last mix of the row's key and the column.
fn bits(row_key: u32, column: u32) -> u32 {
    let z = row_key.wrapping_add(column.wrapping_mul(STEP));
    let z = (z ^ (z >> 16)).wrapping_mul(0x85EB_CA6B);
    let z = (z ^ (z >> 13)).wrapping_mul(0xC2B2_AE35);
    z ^ (z >> 16)
}

/// Drops a `share` of the numbers of `row`, which starts with column `first_column`, and lets the others grow.
///
/// # Panics
/// A share outside `0.0..1.0`.
pub fn apply(x: &mut [f32], key: u64, row: u64, first_column: usize, share: f64) {
    let threshold = threshold(share);
    if threshold > 0 {
        let (row_key, first_column) = (row_key(key, row), first_column as u32);
        dispatch::run(Apply { x, row_key, first_column, threshold, growth: growth(share) });
    }
}

struct Apply<'a> {
    x: &'a mut [f32],
    row_key: u32,
    first_column: u32,
    threshold: u32,
    growth: f32,
}

impl WithSimd for Apply<'_> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let Apply { x, row_key, mut first_column, threshold, growth } = self;
        let (vectors, tail) = S::as_mut_simd_f32s(x);
        for x in vectors {
            *x = simd.mul_f32s(*x, factors(simd, row_key, first_column, threshold, growth));
            first_column = first_column.wrapping_add(S::F32_LANES as u32);
        }
        if !tail.is_empty() {
            let x = simd.partial_load_f32s(tail);
            let x = simd.mul_f32s(x, factors(simd, row_key, first_column, threshold, growth));
            simd.partial_store_f32s(tail, x);
        }
    }
}

/// For the columns from `first_column` on: `growth` where the number stays, 0 where it is dropped.
#[inline(always)]
pub(crate) fn factors<S: Simd>(simd: S, row_key: u32, first_column: u32, threshold: u32, growth: f32) -> S::f32s {
    let lanes = lane_numbers(simd);
    // first + lane * STEP is `bits` of column first_column + lane, modulo 2^32
    let first = row_key.wrapping_add(first_column.wrapping_mul(STEP));
    let z = simd.add_u32s(simd.splat_u32s(first), simd.mul_u32s(lanes, simd.splat_u32s(STEP)));
    let z = simd.mul_u32s(fold(simd, z, 16), simd.splat_u32s(0x85EB_CA6B));
    let z = simd.mul_u32s(fold(simd, z, 13), simd.splat_u32s(0xC2B2_AE35));
    let stays = simd.greater_than_or_equal_u32s(fold(simd, z, 16), simd.splat_u32s(threshold));
    simd.select_f32s(stays, simd.splat_f32s(growth), simd.splat_f32s(0.0))
}

#[inline(always)]
fn fold<S: Simd>(simd: S, z: S::u32s, by: u32) -> S::u32s {
    simd.xor_u32s(z, simd.wrapping_dyn_shr_u32s(z, simd.splat_u32s(by)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::op::check::Lanes;

    #[test]
    fn vectors_drop_what_the_definition_says() {
        let (key, share) = (0x1234_5678_9ABC_DEF0, 0.3);
        for lanes in Lanes::ALL {
            for (len, first_column, row) in (0..=67).map(|n| (n, n * 3, n as u64)).chain([(5000, 17, u64::MAX)]) {
                let mut x: Vec<f32> = (0..len).map(|i| i as f32 - 20.5).collect();
                let expected: Vec<f32> = (first_column..first_column + len)
                    .zip(&x)
                    .map(|(c, x)| x * if kept(key, row, c as u32, threshold(share)) { growth(share) } else { 0.0 })
                    .collect();
                let row_key = row_key(key, row);
                let (first_column, threshold) = (first_column as u32, threshold(share));
                lanes.run(Apply { x: &mut x, row_key, first_column, threshold, growth: growth(share) });
                assert_eq!(x, expected, "{lanes:?}, {len} numbers");
            }
        }
        let mut all = [1.0; 40];
        apply(&mut all, key, 1, 0, 0.0);
        assert_eq!(all, [1.0; 40]);
        apply(&mut all, key, 1, 5, share);
        assert_eq!(all[7] != 0.0, kept(key, 1, 12, threshold(share)));
    }

    /// Standard deviations that a count may be off: one in 1.7 million falls outside, and the keys are fixed.
    const DEVIATIONS: f64 = 5.0;

    /// Of `n` events of probability `p`.
    #[track_caller]
    fn as_often(what: &str, count: usize, n: usize, p: f64) {
        let off = (count as f64 - n as f64 * p) / (n as f64 * p * (1.0 - p)).sqrt();
        assert!(off.abs() < DEVIATIONS, "{what}: {count} of {n}, expected a share of {p}: {off} deviations");
    }

    #[test]
    fn the_share_is_met() {
        let (rows, columns) = (512, 512);
        for (key, share) in [(0, 0.1), (1, 0.1), (u64::MAX, 0.5), (1 << 40, 0.9), (7, 0.001)] {
            let dropped = |row, c| usize::from(!kept(key, row, c, threshold(share)));
            let all: usize = (0..rows).map(|r| (0..columns).map(|c| dropped(r, c)).sum::<usize>()).sum();
            as_often("all", all, (rows * columns as u64) as usize, share);
            for i in 0..columns {
                as_often("a row", (0..4096).map(|c| dropped(i as u64, c)).sum(), 4096, share);
                as_often("a column", (0..4096).map(|r| dropped(r, i)).sum(), 4096, share);
            }
        }
    }

    #[test]
    fn neighbours_do_not_agree() {
        let (n, share) = (512u64, 0.5);
        let kept = |key, row, column: u64| kept(key, row, column as u32, threshold(share));
        for key in [0u64, 1, 2, 99, 1 << 32, u64::MAX - 1] {
            // a column on, a row on, along both diagonals, a key on, a key in the row's place
            type Other = fn(u64, u64, u64) -> (u64, u64, u64);
            let others: [(&str, Other); 6] = [
                ("columns", |k, r, c| (k, r, c + 1)),
                ("rows", |k, r, c| (k, r + 1, c)),
                ("diagonals", |k, r, c| (k, r + 1, c + 1)),
                ("antidiagonals", |k, r, c| (k, r + 1, c.wrapping_sub(1))),
                ("keys", |k, r, c| (k + 1, r, c)),
                ("keys and rows", |k, r, c| (k + 1, r.wrapping_sub(1), c)),
            ];
            for (what, other) in others {
                let agree = |r, c| {
                    let (k, s, d) = other(key, r, c);
                    usize::from(kept(key, r, c) == kept(k, s, d))
                };
                let count = (0..n).map(|r| (0..n).map(|c| agree(r, c)).sum::<usize>()).sum();
                as_often(&format!("{what} at key {key}"), count, (n * n) as usize, 0.5);
            }
        }
    }

    #[test]
    #[should_panic(expected = "a dropout of 1, expected 0 to below 1")]
    fn not_all_can_be_dropped() {
        threshold(1.0);
    }
}
