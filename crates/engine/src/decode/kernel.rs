//! The one product of decoding: rows times a matrix that is streamed from memory.
//!
//! The matrix is stored in panels of two vectors' columns, [panel][k][2 vectors], as f32, as signed bytes or as half
//! floats; narrower numbers are widened in registers. All rows take their share of a panel while it is in the nearest
//! cache, so they cost one pass through memory; one row reads four panels side by side and two rows two, since one
//! stream does not keep memory busy. Each sum runs over k in order in one accumulator, whatever rows are computed
//! beside it: reading a block of tokens gives the bits that reading them one by one gives.

use crate::element::Element;
use pulp::{Simd, WithSimd};

/// Rows that share a number of the matrix in registers.
const TILE: usize = 6;

/// Steps of k before a tile goes back to memory: a panel of 512 steps of 16 floats fills a 32 KB cache on AVX2.
const STRETCH: usize = 512;

/// How many steps of k ahead memory is prefetched; measured with 4 to 8 rows, where neither memory nor arithmetic
/// waits for the other without it: 1.2 times the speed.
const AHEAD: usize = 16;

/// The left operand (m, k), rows in segments of `width` numbers: number j of row i is
/// `data[(j / width * rows + i) * stride + j % width]`. Contiguous rows are one segment.
#[derive(Clone, Copy)]
pub(super) struct Left<'a> {
    pub data: &'a [f32],
    pub rows: usize,
    pub width: usize,
    pub stride: usize,
}

impl<'a> Left<'a> {
    /// Contiguous rows, one every `stride` numbers, of which `width` count.
    pub fn whole(data: &'a [f32], rows: usize, width: usize, stride: usize) -> Self {
        Left { data, rows, width, stride }
    }
}

/// `c` (m, n) = `left` (m, k) times `panels`, times `scale` and plus `bias` where they are not empty.
pub(super) struct Product<'a, E: Element> {
    /// A row every `ldc` numbers, of whole panels.
    pub c: &'a mut [f32],
    pub ldc: usize,
    pub left: Left<'a>,
    pub k: usize,
    pub panels: &'a [E],
    /// Numbers from one panel to the next.
    pub panel_stride: usize,
    /// Panels in all.
    pub count: usize,
    /// A number a column, or none.
    pub scale: &'a [f32],
    /// A number a column, or none.
    pub bias: &'a [f32],
}

impl<E: Element> WithSimd for Product<'_, E> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(mut self, simd: S) {
        let mut panel = 0;
        while panel < self.count {
            let left = self.count - panel;
            panel += match self.left.rows {
                1 if left >= 4 => self.tile::<S, 1, 4>(simd, 0, panel, 0, self.k),
                1 if left >= 2 => self.tile::<S, 1, 2>(simd, 0, panel, 0, self.k),
                2 if left >= 2 => self.tile::<S, 2, 2>(simd, 0, panel, 0, self.k),
                _ => self.panel(simd, panel),
            };
        }
        self.finish(simd);
    }
}

impl<E: Element> Product<'_, E> {
    /// All rows of one panel; the number of panels.
    #[inline(always)]
    fn panel<S: Simd>(&mut self, simd: S, panel: usize) -> usize {
        let rows = self.left.rows;
        let tiles = rows.div_ceil(TILE);
        for done in (0..self.k).step_by(STRETCH) {
            let steps = STRETCH.min(self.k - done);
            let mut first = 0;
            for tile in 0..tiles {
                // 7 rows as 4 and 3, not 6 and 1: a tile costs a pass over the panel, whatever its height
                first += match (rows - first).div_ceil(tiles - tile) {
                    1 => self.tile::<S, 1, 1>(simd, first, panel, done, steps),
                    2 => self.tile::<S, 2, 1>(simd, first, panel, done, steps),
                    3 => self.tile::<S, 3, 1>(simd, first, panel, done, steps),
                    4 => self.tile::<S, 4, 1>(simd, first, panel, done, steps),
                    5 => self.tile::<S, 5, 1>(simd, first, panel, done, steps),
                    _ => self.tile::<S, TILE, 1>(simd, first, panel, done, steps),
                };
            }
        }
        1
    }

    /// M rows from `first` on, P panels from `panel` on: adds the products of `steps` numbers of k from `done` on
    /// to `c`. Returns the larger of M and P: the rows or panels that the caller counts.
    #[inline(always)]
    fn tile<S: Simd, const M: usize, const P: usize>(
        &mut self,
        simd: S,
        first: usize,
        panel: usize,
        done: usize,
        steps: usize,
    ) -> usize {
        let pair = 2 * S::F32_LANES;
        let mut sums = [[[simd.splat_f32s(0.0); 2]; P]; M];
        // goes on where the last stretch stopped: the same accumulator, so STRETCH changes no bit
        if done > 0 {
            for (i, sums) in sums.iter_mut().enumerate() {
                for (p, sums) in sums.iter_mut().enumerate() {
                    *sums = f32::pair::<S>(&self.c[(first + i) * self.ldc + (panel + p) * pair..][..pair]);
                }
            }
        }
        let Left { data, rows, width, stride } = self.left;
        let mut at = done;
        while at < done + steps {
            let n = (done + steps - at).min(width - at % width);
            let start = (at / width * rows + first) * stride + at % width;
            let mut left: [&[f32]; M] = [&[]; M];
            for (i, left) in left.iter_mut().enumerate() {
                *left = &data[start + i * stride..][..n];
            }
            let mut right: [&[E]; P] = [&[]; P];
            for (p, right) in right.iter_mut().enumerate() {
                *right = &self.panels[(panel + p) * self.panel_stride + at * pair..][..n * pair];
            }
            sums = run::<S, E, M, P>(simd, sums, left, right, first == 0);
            at += n;
        }
        for (i, sums) in sums.iter().enumerate() {
            for (p, sums) in sums.iter().enumerate() {
                let c = &mut self.c[(first + i) * self.ldc + (panel + p) * pair..][..pair];
                S::as_mut_simd_f32s(c).0.copy_from_slice(sums);
            }
        }
        M.max(P)
    }

    #[inline(always)]
    fn finish<S: Simd>(&mut self, simd: S) {
        if self.scale.is_empty() && self.bias.is_empty() {
            return;
        }
        let columns = self.count * 2 * S::F32_LANES;
        for row in self.c.chunks_mut(self.ldc).take(self.left.rows) {
            let (row, _) = S::as_mut_simd_f32s(&mut row[..columns]);
            if !self.scale.is_empty() {
                let (scale, _) = S::as_simd_f32s(&self.scale[..columns]);
                for (c, s) in row.iter_mut().zip(scale) {
                    *c = simd.mul_f32s(*c, *s);
                }
            }
            if !self.bias.is_empty() {
                let (bias, _) = S::as_simd_f32s(&self.bias[..columns]);
                for (c, b) in row.iter_mut().zip(bias) {
                    *c = simd.add_f32s(*c, *b);
                }
            }
        }
    }
}

/// `sums` plus the products of the numbers of `left` with the rows of `right`; `fetch`: these panels aren't in the
/// cache yet.
#[inline(always)]
pub(super) fn run<S: Simd, E: Element, const M: usize, const P: usize>(
    simd: S,
    mut sums: [[[S::f32s; 2]; P]; M],
    mut left: [&[f32]; M],
    mut right: [&[E]; P],
    fetch: bool,
) -> [[[S::f32s; 2]; P]; M] {
    let (n, pair) = (left[0].len(), 2 * S::F32_LANES);
    // lengths that the compiler knows to be equal: no bounds checks in the loop
    for row in &mut left {
        *row = &row[..n];
    }
    for panel in &mut right {
        *panel = &panel[..n * pair];
    }
    // one prefetch for each line of 64 bytes
    let every = (64 / size_of::<E>() / pair).max(1);
    for j in 0..n {
        for p in 0..P {
            // a single row reads up to four panels at once, which keeps memory busy without it
            if M > 1 && fetch && j % every == 0 {
                prefetch(right[p].as_ptr().wrapping_add((j + AHEAD) * pair));
            }
            let [x, y] = E::pair::<S>(&right[p][j * pair..(j + 1) * pair]);
            for i in 0..M {
                let a = simd.splat_f32s(left[i][j]);
                sums[i][p][0] = simd.mul_add_e_f32s(a, x, sums[i][p][0]);
                sums[i][p][1] = simd.mul_add_e_f32s(a, y, sums[i][p][1]);
            }
        }
    }
    sums
}

/// Prefetches the line of memory at `at`, any address: a prefetch never faults.
#[inline(always)]
fn prefetch<E>(at: *const E) {
    #[cfg(target_arch = "x86_64")]
    if let Some(sse) = pulp::core_arch::x86::Sse::try_new() {
        sse._mm_prefetch::<{ std::arch::x86_64::_MM_HINT_T0 }>(at.cast());
    }
    #[cfg(not(target_arch = "x86_64"))]
    let _ = at;
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::op::check::{Lanes, numbers};
    use half::f16;

    /// Products of every kind, of whole numbers, which every order of summation gives exactly.
    struct Check {
        rows: usize,
        k: usize,
        width: usize,
        count: usize,
    }

    impl WithSimd for Check {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            self.typed::<S, f32>(simd, |x| x);
            self.typed::<S, i8>(simd, |x| x as i8);
            self.typed::<S, u16>(simd, |x| f16::from_f32(x).to_bits());
        }
    }

    impl Check {
        #[inline(always)]
        fn typed<S: Simd, E: Element>(&self, simd: S, number: fn(f32) -> E) {
            let Check { rows, k, width, count } = *self;
            let (panel, stride) = (2 * S::F32_LANES, width + 3);
            let whole = |seed, n| numbers(seed, n, 127.0).into_iter().map(f32::round).collect::<Vec<f32>>();
            let data: Vec<f32> = whole(1, k.div_ceil(width) * rows * stride).iter().map(|x| x * E::LEFT).collect();
            let right = whole(2, (k + 1) * panel * count);
            let panels: Vec<E> = right.iter().map(|&x| number(x)).collect();
            let (scale, bias) = (whole(3, count * panel), whole(4, count * panel));
            let ldc = count * panel + 1;
            let mut c = vec![7.0; rows * ldc];
            let left = Left { data: &data, rows, width, stride };
            let panel_stride = (k + 1) * panel;
            Product { c: &mut c, ldc, left, k, panels: &panels, panel_stride, count, scale: &scale, bias: &bias }
                .with_simd(simd);
            for (row, c) in c.chunks(ldc).enumerate() {
                assert_eq!(c[count * panel], 7.0);
                for (j, c) in c[..count * panel].iter().enumerate() {
                    let a = |i: usize| f64::from(data[(i / width * rows + row) * stride + i % width] / E::LEFT);
                    let b = |i: usize| f64::from(right[j / panel * panel_stride + i * panel + j % panel]);
                    let sum: f64 = (0..k).map(|i| a(i) * b(i)).sum();
                    let expected = sum * f64::from(scale[j]) + f64::from(bias[j]);
                    // scaled sums go beyond 24 bits
                    let bound = 1.2e-7 * (expected.abs() + (sum * f64::from(scale[j])).abs());
                    assert!((f64::from(*c) - expected).abs() <= bound, "{rows} rows, k {k}: {c}, expected {expected}");
                }
            }
        }
    }

    #[test]
    fn products_are_those_of_plain_loops_on_every_vector() {
        for lanes in Lanes::ALL {
            for rows in [1, 2, 3, 4, 5, 6, 7, 8, 13] {
                for (k, width) in [(1, 1), (7, 3), (64, 64), (130, 64)] {
                    for count in [1, 2, 3, 7] {
                        lanes.run(Check { rows, k, width, count });
                    }
                }
            }
            lanes.run(Check { rows: 7, k: 1030, width: 100, count: 2 });
        }
    }

    #[test]
    fn half_floats_are_widened_exactly() {
        struct Widen<'a>(&'a [u16], &'a mut [f32]);
        impl WithSimd for Widen<'_> {
            type Output = ();
            #[inline(always)]
            fn with_simd<S: Simd>(self, _: S) {
                let pair = 2 * S::F32_LANES;
                for (bits, wide) in self.0.chunks_exact(pair).zip(self.1.chunks_exact_mut(pair)) {
                    S::as_mut_simd_f32s(wide).0.copy_from_slice(&u16::pair::<S>(bits));
                }
            }
        }
        let bits: Vec<u16> = (0..=u16::MAX).filter(|&b| f16::from_bits(b).is_finite()).collect();
        for lanes in Lanes::ALL {
            let mut wide = vec![0.0; bits.len()];
            lanes.run(Widen(&bits, &mut wide));
            for (&bits, wide) in bits.iter().zip(wide) {
                assert_eq!(wide * u16::LEFT, f16::from_bits(bits).to_f32());
            }
        }
    }
}
