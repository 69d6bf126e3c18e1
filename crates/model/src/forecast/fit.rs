//! The ridge regressions that give a forecast its coefficients.

use super::{BIN, Forecast, LAGS, LARGEST, step};
use kinelm_engine::bins::Bins;

/// Added to the sum of squares of every input: as much as so many frames of steps of a bin.
const RIDGE: f64 = 30.0;
/// Frames that are multiplied at a time.
const FRAMES: usize = 512;

/// Sums over dances, from which [`Fit::forecast`] finds the coefficients: products of the steps of a frame, of the [`LAGS`]
/// frames before it, and of a constant.
#[derive(Debug, Clone)]
pub struct Fit {
    places: Vec<Bins>,
    /// (n, n), n = LAGS C + 1 + C, as the inputs of [`super::NAMES`] come.
    sums: Vec<f64>,
}

impl Fit {
    /// Before any dance.
    pub fn new(places: Vec<Bins>) -> Fit {
        let n = (LAGS + 1) * places.len() + 1;
        Fit { places, sums: vec![0.0; n * n] }
    }

    /// n.
    fn inputs(&self) -> usize {
        (LAGS + 1) * self.places.len() + 1
    }

    /// Adds a dance (F, C), whose frames count `weight` times. Frames of which fewer than [`LAGS`] steps are known before are
    /// left out; there are few, and their coefficients are fitted on the others.
    ///
    /// # Panics
    /// If there are no whole frames.
    pub fn add(&mut self, bins: &[Option<usize>], weight: f64) {
        let (c, n) = (self.places.len(), self.inputs());
        assert!(bins.len().is_multiple_of(c), "bins of whole frames");
        let pairs = bins.chunks_exact(c).zip(bins.chunks_exact(c).skip(1));
        let steps: Vec<f64> = pairs
            .flat_map(|(from, to)| self.places.iter().zip(from.iter().zip(to)))
            .map(|(place, (from, to))| from.zip(*to).map_or(0.0, |(from, to)| step(*place, from, to).into()))
            .collect();
        let frames: Vec<&[f64]> = steps.chunks_exact(c).collect();
        let rows: Vec<&[&[f64]]> = frames.windows(LAGS + 1).collect();
        for rows in rows.chunks(FRAMES) {
            // by columns, so that the product below is of rows
            let mut x = vec![0.0; n * rows.len()];
            for (row, steps) in rows.iter().enumerate() {
                let before = steps[..LAGS].iter().rev().flat_map(|steps| steps.iter());
                let inputs = before.copied().chain([1.0]).chain(steps[LAGS].iter().copied());
                inputs.enumerate().for_each(|(i, input)| x[i * rows.len() + row] = input);
            }
            // whole numbers below 2^53, so exact in any order
            let products = kinelm_linalg::product([n, rows.len(), n], &x, &x, true);
            self.sums.iter_mut().zip(products).for_each(|(sum, product)| *sum += weight * product);
        }
    }

    /// The coefficients; of what never moved, zeros.
    pub fn forecast(self) -> Forecast {
        let c = self.places.len();
        let mut forecast = Forecast::still(self.places.clone());
        for known in 0..=LAGS {
            let constant = LAGS * c;
            // inputs in the order of the tensor, of which the unknown frames are left out
            let inputs: Vec<usize> = (0..known * c).chain(constant..self.inputs()).collect();
            let lower = self.triangle(&inputs);
            let first = known * c + 1;
            for slot in 0..c {
                // regression on all that comes before the slot's own step
                for (&input, w) in inputs.iter().zip(solved(&lower, inputs.len(), first + slot)) {
                    forecast.all[(known * self.inputs() + input) * c + slot] = w;
                }
                let own: Vec<usize> =
                    (0..known).map(|lag| lag * c + slot).chain([constant, constant + 1 + slot]).collect();
                let coefficients = solved(&self.triangle(&own), own.len(), known + 1);
                // the constant comes after all lags, known or not
                for (row, w) in (0..known).chain([LAGS]).zip(coefficients) {
                    forecast.own[(known * (LAGS + 1) + row) * c + slot] = w;
                }
            }
        }
        forecast
    }

    /// The triangle of the sums of some inputs, whose squares have the ridge.
    fn triangle(&self, inputs: &[usize]) -> Vec<f64> {
        let n = self.inputs();
        let ridge = |i: usize, j: usize| if i == j { RIDGE } else { 0.0 };
        let sums = inputs.iter().flat_map(|&i| inputs.iter().map(move |&j| self.sums[i * n + j] + ridge(i, j)));
        let sums: Vec<f64> = sums.collect();
        // sums of squares with a ridge are positive definite; numbers that overflowed forecast nothing
        kinelm_linalg::cholesky(inputs.len(), &sums).unwrap_or_else(|| vec![0.0; sums.len()])
    }
}

/// The coefficients of variable `k` on those before it, from the triangle (n, n) of all: with the triangle's first k rows L and
/// row k, l, they solve L^T w = l.
fn solved(lower: &[f64], n: usize, k: usize) -> Vec<i32> {
    let mut w = lower[k * n..][..k].to_vec();
    for i in (0..k).rev() {
        let diagonal = lower[i * n + i];
        w[i] = if diagonal > 0.0 { w[i] / diagonal } else { 0.0 };
        let (before, solved) = w.split_at_mut(i);
        before.iter_mut().zip(&lower[i * n..]).for_each(|(w, l)| *w -= l * solved[0]);
    }
    let largest = f64::from(LARGEST);
    w.into_iter().map(|w| (w * f64::from(BIN)).round().clamp(-largest, largest) as i32).collect()
}
