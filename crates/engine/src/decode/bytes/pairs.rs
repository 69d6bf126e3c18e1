//! Two numbers of k at a time: `vpmaddwd` of AVX2, plain loops elsewhere.
//!
//! The instruction multiplies whole numbers of 16 bits, to which bytes are widened in registers, and adds them two by two: no
//! sum can overflow. (`vpmaddubsw`, which takes bytes, saturates.)

use super::Product;
#[cfg(target_arch = "x86_64")]
use pulp::x86::V3;

/// Numbers of k in a word.
pub(super) const WORD: usize = 2;

/// A word of a row.
pub(super) fn packed([a, b]: [i8; WORD]) -> u32 {
    let [a, b] = [a, b].map(|x| u32::from(i16::from(x).cast_unsigned()));
    a | b << 16
}

fn unpacked(word: u32) -> [i32; WORD] {
    [word as i16, (word >> 16) as i16].map(i32::from)
}

/// All rows of the product, of so many words.
#[cfg(target_arch = "x86_64")]
pub(super) fn run(simd: V3, product: &mut Product, words: usize) {
    simd.vectorize(avx2::Rows { simd, product, words });
}

/// Most columns of a panel.
const MOST: usize = 32;

/// The same in plain loops.
pub(super) fn plain(product: &mut Product, words: usize) {
    let Product { m, panel, rows, panels, .. } = *product;
    for (row, left) in rows.numbers.chunks_exact(words.max(1)).enumerate().take(m) {
        for column in (0..product.scale.len()).step_by(panel) {
            let mut sums = [0; MOST];
            for (word, right) in left.iter().zip(panels[column * words * WORD..].chunks_exact(panel * WORD)) {
                let [a, b] = unpacked(*word);
                for (sum, [x, y]) in sums.iter_mut().zip(right.as_chunks().0) {
                    *sum += a * i32::from(*x) + b * i32::from(*y);
                }
            }
            product.write(row, column, &sums[..panel]);
        }
    }
}

impl Product<'_> {
    /// Writes columns of a row, from `column` on, by their sums of whole numbers.
    #[inline(always)]
    fn write(&mut self, row: usize, column: usize, sums: &[i32]) {
        let (row_scale, columns) = (self.rows.scales[row], column..column + sums.len());
        let c = &mut self.c[row * self.ldc + column..][..sums.len()];
        let factors = self.scale[columns.clone()].iter().zip(&self.bias[columns]);
        for ((c, sum), (scale, bias)) in c.iter_mut().zip(sums).zip(factors) {
            // as `quads` does it: the same bits
            *c = *sum as f32 * (row_scale * scale) + bias;
        }
    }
}

#[cfg(target_arch = "x86_64")]
mod avx2 {
    use super::{Product, WORD};
    use bytemuck::cast;
    use pulp::NullaryFnOnce;
    use pulp::x86::V3;
    use std::arch::x86_64::__m256i;

    /// Columns whose sums are in registers: two vectors.
    const COLUMNS: usize = 16;

    pub struct Rows<'a, 'b> {
        pub simd: V3,
        pub product: &'a mut Product<'b>,
        pub words: usize,
    }

    impl NullaryFnOnce for Rows<'_, '_> {
        type Output = ();

        #[inline(always)]
        fn call(mut self) {
            let mut first = 0;
            while first < self.product.m {
                // four rows by two vectors, and what they are multiplied by, take 11 of the 16 registers
                first += match self.product.m - first {
                    1 => self.tile::<1>(first),
                    2 => self.tile::<2>(first),
                    3 => self.tile::<3>(first),
                    _ => self.tile::<4>(first),
                };
            }
        }
    }

    impl Rows<'_, '_> {
        /// M rows from `first` on, of all columns; returns M.
        #[inline(always)]
        fn tile<const M: usize>(&mut self, first: usize) -> usize {
            let Rows { simd, ref mut product, words } = *self;
            let (rows, panels, panel) = (product.rows, product.panels, product.panel);
            assert!(panel.is_multiple_of(COLUMNS), "panels of {panel}");
            let mut left = [&rows.numbers[..0]; M];
            for (i, left) in left.iter_mut().enumerate() {
                *left = &rows.numbers[(first + i) * words..][..words];
            }
            for column in (0..product.scale.len()).step_by(COLUMNS) {
                let start = column / panel * panel * words * WORD + column % panel * WORD;
                let right = panels[start..].chunks(panel * WORD);
                let mut sums = [[cast::<[i32; 8], __m256i>([0; 8]); 2]; M];
                for (word, right) in (0..words).zip(right) {
                    let [low, high] = [0, COLUMNS].map(|at| {
                        let bytes = *right[at..].first_chunk::<COLUMNS>().expect("a panel of whole vectors");
                        simd.avx2._mm256_cvtepi8_epi16(cast(bytes))
                    });
                    for (i, [x, y]) in sums.iter_mut().enumerate() {
                        let two = simd.avx._mm256_set1_epi32(left[i][word].cast_signed());
                        *x = simd.avx2._mm256_add_epi32(*x, simd.avx2._mm256_madd_epi16(two, low));
                        *y = simd.avx2._mm256_add_epi32(*y, simd.avx2._mm256_madd_epi16(two, high));
                    }
                }
                for (i, sums) in sums.into_iter().enumerate() {
                    product.write(first + i, column, &cast::<[__m256i; 2], [i32; COLUMNS]>(sums));
                }
            }
            M
        }
    }
}
