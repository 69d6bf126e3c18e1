//! Single rows, each times a matrix of its own: the attention of several streams, a row each.
//!
//! One row's sums wait for their last product; those of four rows side by side don't. Each sum runs over k in order in one
//! accumulator, as in [`super::kernel`]: the bits are the same.

use super::kernel::run;
use crate::element::Element;
use pulp::{Simd, WithSimd};

/// Rows side by side.
pub(super) const APART: usize = 4;

/// `c` = `left` (k) times panels, times `scale` where it isn't empty.
pub(super) struct Single<'a, E> {
    /// Whole panels.
    pub c: &'a mut [f32],
    pub left: &'a [f32],
    pub panels: &'a [E],
    /// Numbers from one panel to the next.
    pub panel_stride: usize,
    /// A number a column, or none.
    pub scale: &'a [f32],
}

/// All products of some rows; those that are there come first.
pub(super) struct Apart<'a, 'b, E>(pub &'a mut [Option<Single<'b, E>>; APART]);

impl<E: Element> WithSimd for Apart<'_, '_, E> {
    type Output = ();

    #[inline(always)]
    fn with_simd<S: Simd>(self, simd: S) {
        let pair = 2 * S::F32_LANES;
        let panels = self.0.iter().flatten().map(|row| row.c.len() / pair).max().unwrap_or(0);
        for panel in 0..panels {
            // a row may have fewer than the others
            let mut left = self.0.each_mut().map(|row| row.as_mut().filter(|row| row.c.len() >= (panel + 1) * pair));
            left.sort_by_key(Option::is_none);
            match left {
                [Some(a), Some(b), Some(c), Some(d)] => panel_of(simd, [a, b, c, d], panel),
                [Some(a), Some(b), Some(c), None] => panel_of(simd, [a, b, c], panel),
                [Some(a), Some(b), ..] => panel_of(simd, [a, b], panel),
                [Some(a), ..] => panel_of(simd, [a], panel),
                _ => {}
            }
        }
    }
}

/// One panel of each row.
#[inline(always)]
fn panel_of<S: Simd, E: Element, const R: usize>(simd: S, rows: [&mut Single<E>; R], panel: usize) {
    let pair = 2 * S::F32_LANES;
    let shared = rows.iter().map(|row| row.left.len()).min().unwrap_or(0);
    let mut left: [&[f32]; R] = [&[]; R];
    let mut right: [&[E]; R] = [&[]; R];
    for (i, row) in rows.iter().enumerate() {
        left[i] = &row.left[..shared];
        right[i] = &row.panels[panel * row.panel_stride..][..shared * pair];
    }
    let mut sums = [[simd.splat_f32s(0.0); 2]; R];
    for j in 0..shared {
        for i in 0..R {
            let [x, y] = E::pair::<S>(&right[i][j * pair..(j + 1) * pair]);
            let a = simd.splat_f32s(left[i][j]);
            sums[i] = [simd.mul_add_e_f32s(a, x, sums[i][0]), simd.mul_add_e_f32s(a, y, sums[i][1])];
        }
    }
    for (row, sums) in rows.into_iter().zip(sums) {
        // what this row has beyond the others: the same accumulators go on
        let more = row.panels[panel * row.panel_stride..][..row.left.len() * pair].split_at(shared * pair).1;
        let [[mut sums]] = run::<S, E, 1, 1>(simd, [[sums]], [&row.left[shared..]], [more], false);
        if !row.scale.is_empty() {
            let (scale, _) = S::as_simd_f32s(&row.scale[panel * pair..][..pair]);
            sums = [simd.mul_f32s(sums[0], scale[0]), simd.mul_f32s(sums[1], scale[1])];
        }
        S::as_mut_simd_f32s(&mut row.c[panel * pair..][..pair]).0.copy_from_slice(&sums);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::decode::kernel::{Left, Product};
    use crate::op::check::{Lanes, numbers};

    /// Four rows of other lengths, apart and one by one.
    struct Check;

    impl WithSimd for Check {
        type Output = ();

        #[inline(always)]
        fn with_simd<S: Simd>(self, simd: S) {
            let panel = 2 * S::F32_LANES;
            for sizes in [[(7, 3), (7, 3), (7, 3), (7, 3)], [(9, 1), (5, 3), (0, 2), (12, 2)]] {
                let matrices = sizes.map(|(k, count)| numbers(k as u64, (k + 2) * panel * count, 1.0));
                let lefts = sizes.map(|(k, _)| numbers(k as u64 + 50, k, 1.0));
                let scales = sizes.map(|(k, count)| if k == 5 { Vec::new() } else { numbers(3, count * panel, 1.0) });
                let mut found = sizes.map(|(_, count)| vec![7.0; count * panel]);
                let mut expected = found.clone();
                for rows in 1..=APART {
                    let mut all = [const { None }; APART];
                    for (i, (row, c)) in all.iter_mut().zip(&mut found).enumerate().take(rows) {
                        let panel_stride = (sizes[i].0 + 2) * panel;
                        let (left, panels, scale) = (&lefts[i], &matrices[i], &scales[i]);
                        *row = Some(Single { c, left, panels, panel_stride, scale });
                    }
                    Apart(&mut all).with_simd(simd);
                    for (i, c) in expected.iter_mut().enumerate().take(rows) {
                        let ((k, count), scale) = (sizes[i], &scales[i]);
                        let left = Left::whole(&lefts[i], 1, k, k.max(1));
                        let (panels, panel_stride) = (&matrices[i], (k + 2) * panel);
                        let ldc = count * panel;
                        Product { c, ldc, left, k, panels, panel_stride, count, scale, bias: &[] }.with_simd(simd);
                    }
                    assert_eq!(found, expected, "{rows} rows");
                }
            }
        }
    }

    #[test]
    fn rows_apart_have_the_bits_of_rows_alone() {
        Lanes::ALL.into_iter().for_each(|lanes| lanes.run(Check));
    }
}
