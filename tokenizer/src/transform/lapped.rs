//! A lapped orthogonal transform over time: a cosine transform of tiles after filtering across their borders.
//!
//! A filter is applied across every border, over half a tile on each side; then each tile is transformed by the DCT-II. The
//! basis functions begin and end smoothly in the middle of the neighbouring tiles, so quantisation leaves no jump at borders.
//! The filter preserves constants: only coefficient 0 holds a tile's mean, and all other basis functions sum to 0 over time (a
//! modified cosine transform spreads the mean over its coefficients). The transform is orthonormal.
//!
//! Source: Tran, Liang and Tu, "Lapped transform via time-domain pre- and post-filtering" (2003), with the matrix of the
//! type-II fast lapped orthogonal transform of Malvar, "Signal Processing with Lapped Transforms" (1992).

use super::dct::Dct;
use rustdct::{DctPlanner, TransformType4};
use std::fmt;
use std::sync::Arc;

/// The transform of a series of tiles of N numbers (the hop), the first of them N or N - 1 long.
///
/// The two ends of the series are not filtered.
#[derive(Clone)]
pub struct Lapped {
    hop: usize,
    /// By how many numbers the first tile is shorter, 0 or 1.
    short: usize,
    tile: Dct,
    /// Transform of a shorter first tile that isn't empty.
    first: Option<Dct>,
    border: Option<Border>,
}

impl fmt::Debug for Lapped {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "Lapped({} - {})", self.hop, self.short)
    }
}

/// The filter across a border, over h numbers on each side.
#[derive(Clone)]
struct Border {
    second: Dct,
    fourth: Arc<dyn TransformType4<f64>>,
}

impl Lapped {
    /// Tiles of `hop` numbers.
    ///
    /// # Panics
    /// When `hop` is 0.
    pub fn new(hop: usize) -> Self {
        Lapped::with_first(hop, 0)
    }

    /// Tiles of `hop` numbers, the first of `hop - 1`, for the differences of a series.
    ///
    /// # Panics
    /// When `hop` is 0.
    pub fn of_differences(hop: usize) -> Self {
        Lapped::with_first(hop, 1)
    }

    fn with_first(hop: usize, short: usize) -> Self {
        assert!(hop > 0, "tiles of no numbers");
        // with an odd hop the middle number of a tile is in no filter
        let half = hop / 2;
        Lapped {
            hop,
            short,
            tile: Dct::new(hop),
            first: (short > 0 && hop > short).then(|| Dct::new(hop - short)),
            border: (half > 0).then(|| Border { second: Dct::new(half), fourth: DctPlanner::new().plan_dct4(half) }),
        }
    }

    /// By how many numbers a coefficient reaches into the neighbouring tiles.
    pub fn overlap(&self) -> usize {
        self.hop / 2
    }

    /// Length of the scratch buffer.
    pub fn scratch_len(&self) -> usize {
        let border =
            self.border.as_ref().map_or(0, |b| b.second.len() + b.second.scratch_len().max(b.fourth.get_scratch_len()));
        let first = self.first.as_ref().map_or(0, Dct::scratch_len);
        border.max(first).max(self.tile.scratch_len())
    }

    /// Replaces whole tiles of a series by N coefficients each. With a shorter first tile the first number is ignored, and that
    /// tile's last coefficient is 0. `scratch` is overwritten.
    ///
    /// # Panics
    /// When `series` isn't whole tiles or `scratch` shorter than [`Lapped::scratch_len`].
    pub fn forward(&self, series: &mut [f64], scratch: &mut [f64]) {
        self.check(series, scratch);
        self.at_borders(series, scratch, Border::smooth);
        for (k, tile) in series.chunks_exact_mut(self.hop).enumerate() {
            match &self.first {
                _ if k > 0 || self.short == 0 => self.tile.forward(tile, scratch),
                // with a hop of 1 the shorter first tile is empty
                None => tile.fill(0.0),
                Some(first) => {
                    first.forward(&mut tile[self.short..], scratch);
                    // coefficients begin at the front; the place of the missing number becomes the last, which is 0
                    tile.rotate_left(self.short);
                    tile[first.len()..].fill(0.0);
                }
            }
        }
    }

    /// Replaces coefficients by their series; the inverse of [`Lapped::forward`]. With a shorter first tile the first number
    /// becomes 0.
    ///
    /// # Panics
    /// As [`Lapped::forward`].
    pub fn inverse(&self, coefficients: &mut [f64], scratch: &mut [f64]) {
        self.check(coefficients, scratch);
        for (k, tile) in coefficients.chunks_exact_mut(self.hop).enumerate() {
            match &self.first {
                _ if k > 0 || self.short == 0 => self.tile.inverse(tile, scratch),
                None => tile.fill(0.0),
                Some(first) => {
                    tile[first.len()..].fill(0.0);
                    tile.rotate_right(self.short);
                    first.inverse(&mut tile[self.short..], scratch);
                }
            }
        }
        self.at_borders(coefficients, scratch, Border::unsmooth);
    }

    fn check(&self, series: &[f64], scratch: &[f64]) {
        assert!(series.len().is_multiple_of(self.hop), "{} numbers are no whole tiles of {}", series.len(), self.hop);
        assert!(scratch.len() >= self.scratch_len(), "scratch of {}, expected {}", scratch.len(), self.scratch_len());
    }

    fn at_borders(&self, series: &mut [f64], scratch: &mut [f64], filter: fn(&Border, &mut [f64], &mut [f64])) {
        let Some(border) = &self.border else { return };
        let half = self.overlap();
        for at in (self.hop..series.len()).step_by(self.hop) {
            filter(border, &mut series[at - half..at + half], scratch);
        }
    }
}

impl Border {
    /// Before the tiles' transform. Sums of values that mirror each other at the border stay, differences are
    /// multiplied by an orthonormal matrix.
    fn smooth(&self, around: &mut [f64], scratch: &mut [f64]) {
        self.turn_differences(around, scratch, |differences, scratch| {
            self.fourth(differences, scratch);
            self.second.inverse(differences, scratch);
        });
    }

    /// After the tiles' inverse transform: the inverse of [`Border::smooth`].
    fn unsmooth(&self, around: &mut [f64], scratch: &mut [f64]) {
        self.turn_differences(around, scratch, |differences, scratch| {
            self.second.forward(differences, scratch);
            self.fourth(differences, scratch);
        });
    }

    fn turn_differences(&self, around: &mut [f64], scratch: &mut [f64], turn: impl Fn(&mut [f64], &mut [f64])) {
        let half = self.second.len();
        let (before, after) = around.split_at_mut(half);
        let (differences, scratch) = scratch.split_at_mut(half);
        // from the border outward: entry i of both sides is i + 1/2 away from it
        for (i, d) in differences.iter_mut().enumerate() {
            *d = before[half - 1 - i] - after[i];
        }
        // counted from the far end, as Malvar's matrix is
        differences.reverse();
        turn(differences, scratch);
        differences.reverse();
        for (i, d) in differences.iter().enumerate() {
            let sum = before[half - 1 - i] + after[i];
            before[half - 1 - i] = 0.5 * (sum + d);
            after[i] = 0.5 * (sum - d);
        }
    }

    /// The orthonormal DCT-IV, its own inverse.
    fn fourth(&self, x: &mut [f64], scratch: &mut [f64]) {
        self.fourth.process_dct4_with_scratch(x, scratch);
        // rustdct leaves out the normalisation
        let scale = (2.0 / x.len() as f64).sqrt();
        x.iter_mut().for_each(|x| *x *= scale);
    }
}

/// The transform as it is defined, `[I J; J -I] diag(I, V) [I J; J -I] / 2` with `V = J C2' C4 J` across each border and
/// then a DCT-II a tile, by dense matrices: what [`Lapped::forward`] is checked against. `first` is the first tile's
/// length.
#[cfg(test)]
fn naive_forward(series: &[f64], hop: usize, first: usize) -> Vec<f64> {
    use super::dct::naive_forward as dct2;
    use std::f64::consts::PI;
    let h = hop / 2;
    let unit = |t: usize| (0..h).map(|i| f64::from(u8::from(i == t))).collect::<Vec<_>>();
    let c2: Vec<Vec<f64>> = (0..h).map(|t| dct2(&unit(t))).collect();
    let c4 = |k: usize, t: usize| (2.0 / h as f64).sqrt() * (PI / h as f64 * (k as f64 + 0.5) * (t as f64 + 0.5)).cos();
    let entry = |i: usize, j: usize| (0..h).map(|k| c2[h - 1 - i][k] * c4(k, h - 1 - j)).sum::<f64>();
    let v: Vec<Vec<f64>> = (0..h).map(|i| (0..h).map(|j| entry(i, j)).collect()).collect();
    let mut x = series.to_vec();
    for at in (first..x.len()).step_by(hop) {
        let before = x[at - h..at].to_vec();
        let after = x[at..at + h].to_vec();
        let up: Vec<f64> = (0..h).map(|i| before[i] + after[h - 1 - i]).collect();
        let down: Vec<f64> = (0..h).map(|i| before[h - 1 - i] - after[i]).collect();
        let turned: Vec<f64> = (0..h).map(|i| (0..h).map(|j| v[i][j] * down[j]).sum()).collect();
        for i in 0..h {
            x[at - h + i] = 0.5 * (up[i] + turned[h - 1 - i]);
            x[at + i] = 0.5 * (up[h - 1 - i] - turned[i]);
        }
    }
    let mut out = dct2(&x[..first]);
    out.resize(hop, 0.0);
    x[first..].chunks(hop).for_each(|tile| out.extend(dct2(tile)));
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transform::pca::tests::noise;

    /// Relative to the series' length: what the additions of f64 may lose.
    const CLOSE: f64 = 1e-13;

    fn length(x: &[f64]) -> f64 {
        x.iter().map(|x| x * x).sum::<f64>().sqrt()
    }

    fn distance(a: &[f64], b: &[f64]) -> f64 {
        assert_eq!(a.len(), b.len());
        a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()
    }

    fn both(hop: usize) -> [Lapped; 2] {
        [Lapped::new(hop), Lapped::of_differences(hop)]
    }

    fn forward(t: &Lapped, x: &[f64]) -> Vec<f64> {
        let mut y = x.to_vec();
        t.forward(&mut y, &mut vec![1e100; t.scratch_len()]);
        y
    }

    fn inverse(t: &Lapped, y: &[f64]) -> Vec<f64> {
        let mut x = y.to_vec();
        t.inverse(&mut x, &mut vec![-1e100; t.scratch_len()]);
        x
    }

    /// Against the definition, there and back, and of the same length.
    fn check_lapped(t: &Lapped, tiles: usize) {
        let (hop, short) = (t.hop, t.short);
        let mut x = noise((hop * 8 + tiles) as u64, hop * tiles);
        let y = forward(t, &x);
        let naive = naive_forward(&x[short..], hop, hop - short);
        let size = length(&x);
        assert!(distance(&y, &naive) < CLOSE * size, "{t:?}, {tiles} tiles: {}", distance(&y, &naive));
        let back = inverse(t, &y);
        x[..short].fill(0.0);
        assert!(distance(&back, &x) < CLOSE * size, "{t:?}, {tiles} tiles");
        assert!((length(&y) - length(&x)).abs() < CLOSE * size, "{t:?}, {tiles} tiles");
    }

    #[test]
    fn every_hop_against_the_definition() {
        for hop in 1..=64 {
            for t in both(hop) {
                (1..=4).for_each(|tiles| check_lapped(&t, tiles));
                assert!(forward(&t, &[]).is_empty());
            }
        }
        both(120).iter().for_each(|t| check_lapped(t, 3));
    }

    #[test]
    fn constants_have_one_coefficient_a_tile_and_the_others_add_up_to_nothing() {
        for hop in 1..=40 {
            for t in both(hop) {
                let y = forward(&t, &vec![0.7; hop * 5]);
                for (k, tile) in y.chunks(hop).enumerate() {
                    let n = if k == 0 { hop - t.short } else { hop };
                    assert!((tile[0] - 0.7 * (n as f64).sqrt()).abs() < 1e-12, "{t:?}");
                    assert!(tile[1..].iter().all(|x| x.abs() < 1e-12), "{t:?}");
                }
            }
        }
    }

    #[test]
    fn a_coefficient_reaches_half_a_tile_and_ends_softly() {
        for hop in [2, 7, 16, 30] {
            let t = Lapped::new(hop);
            for k in 0..hop {
                let mut y = vec![0.0; 5 * hop];
                y[2 * hop + k] = 1.0;
                let x = inverse(&t, &y);
                let reach = 2 * hop - t.overlap()..3 * hop + t.overlap();
                assert!(x.iter().enumerate().all(|(i, x)| reach.contains(&i) || x.abs() < 1e-15));
                if hop >= 16 && k < hop / 2 {
                    assert!(x[reach.start].abs() < 0.25 * (2.0 / hop as f64).sqrt(), "{hop} {k}: {}", x[reach.start]);
                }
            }
        }
    }
}
