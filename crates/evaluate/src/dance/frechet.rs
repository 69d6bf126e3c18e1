//! Distances between sets of dances as clouds of features: Fréchet distances, and diversities.
//!
//! Limits: each set counts as one Gaussian, so that nothing beyond mean and covariance is seen. Of few vectors the
//! distance is biased upwards; [`SetDistance::at_infinity`] corrects that to first order in 1/N.
//!
//! Source: Heusel et al., "GANs trained by a two time-scale update rule converge to a local Nash equilibrium" (2017); of the
//! extrapolation Chong and Forsyth, "Effectively unbiased FID and Inception score" (2020).

use crate::{Error, Result};
use kinelm_linalg::symmetric_eigen;
use kinelm_store::random;
use serde::Serialize;

/// A feature that varies less than this over the real set is left out.
const LEAST_SD: f64 = 1e-6;
/// What is added to the diagonals of covariances.
const RIDGE: f64 = 1e-6;
/// Random subsets of each size.
const DRAWS: usize = 10;
/// Fewer vectors than this many times the features are too few.
const ENOUGH: usize = 10;

/// Vectors of one length, a row a piece of dance.
pub type Rows = Vec<Vec<f64>>;

/// A set of dances compared with the real ones.
#[derive(Debug, Clone, Serialize)]
pub struct SetDistance {
    /// Vectors of the set.
    pub vectors: usize,
    /// Fréchet distance to the real ones; `None` of fewer than three.
    pub distance: Option<f64>,
    /// The same for infinitely many vectors, by a line through 1/N.
    pub at_infinity: Option<f64>,
    /// Mean distance of two of its vectors.
    pub diversity: Option<f64>,
    /// Fewer vectors than ten times the features.
    pub too_few: bool,
}

/// Standardizes vectors by the mean and the spread of the real ones, and keeps the features that vary.
pub struct Standardizer {
    mean: Vec<f64>,
    sd: Vec<f64>,
    /// Features that are used: those that vary, or all.
    used: Vec<usize>,
}

impl Standardizer {
    /// Of the real ones; `all` keeps features that don't vary, as published code does.
    pub fn of(real: &[Vec<f64>], all: bool) -> Standardizer {
        let n = real.len().max(1) as f64;
        let length = real.first().map_or(0, Vec::len);
        let mean: Vec<f64> = (0..length).map(|i| real.iter().map(|row| row[i]).sum::<f64>() / n).collect();
        let variance = |i: usize| real.iter().map(|row| (row[i] - mean[i]).powi(2)).sum::<f64>() / n;
        let sd: Vec<f64> = (0..length).map(|i| variance(i).sqrt()).collect();
        let used = (0..length).filter(|&i| all || sd[i] >= LEAST_SD).collect();
        // published code divides by sd + 1e-10 and keeps constant features
        let sd = sd.into_iter().map(|sd| if all { sd + 1e-10 } else { sd }).collect();
        Standardizer { mean, sd, used }
    }

    /// Features that are left out.
    pub fn left_out(&self) -> Vec<usize> {
        (0..self.mean.len()).filter(|i| !self.used.contains(i)).collect()
    }

    /// Rows in these measures.
    pub fn apply(&self, rows: &[Vec<f64>]) -> Rows {
        let scaled = |row: &Vec<f64>| self.used.iter().map(|&i| (row[i] - self.mean[i]) / self.sd[i]).collect();
        rows.iter().map(scaled).collect()
    }
}

impl SetDistance {
    /// Compares a set with the real ones, both scaled; `seed` is that of the random subsets.
    ///
    /// # Errors
    /// Covariances that have no square root: numbers that aren't finite.
    pub fn between(set: &[Vec<f64>], real: &[Vec<f64>], seed: u64) -> Result<SetDistance> {
        let features = real.first().map_or(0, Vec::len);
        let distance = frechet_distance(set, real, RIDGE)?;
        // a quarter of 12 rows is 3, the fewest that have a distance
        let at_infinity =
            if distance.is_some() && set.len() >= 12 { Some(at_infinity(set, real, seed)?) } else { None };
        let too_few = set.len().min(real.len()) < ENOUGH * features;
        Ok(SetDistance { vectors: set.len(), distance, at_infinity, diversity: diversity(set), too_few })
    }
}

/// `|m1 - m2|² + tr(S1 + S2 - 2 (S1 S2)^(1/2))`, covariances dividing by N - 1; `None` where a set has fewer than three rows.
///
/// # Errors
/// Covariances that have no square root.
pub fn frechet_distance(a: &[Vec<f64>], b: &[Vec<f64>], ridge: f64) -> Result<Option<f64>> {
    if a.len() < 3 || b.len() < 3 {
        return Ok(None);
    }
    let n = a[0].len();
    let ((m, s), (k, t)) = (gaussian(a, ridge), gaussian(b, ridge));
    let means: f64 = m.iter().zip(&k).map(|(x, y)| (x - y).powi(2)).sum();
    let trace = |s: &[f64]| (0..n).map(|i| s[i * n + i]).sum::<f64>();
    // (S1 S2)^(1/2) has the trace of (R S2 R)^(1/2) with R² = S1, which is symmetric
    let root = map_eigen(n, &s, f64::sqrt)?;
    let both = product(n, &product(n, &root, &t), &root);
    let (values, _) = eigen(n, &both)?;
    // rounding leaves eigenvalues of a singular product just below 0
    let cross: f64 = values.into_iter().map(|value| value.max(0.0).sqrt()).sum();
    Ok(Some(means + trace(&s) + trace(&t) - 2.0 * cross))
}

/// Where a line through the distances of N, N/2 and N/4 rows, over 1/N, meets 0.
fn at_infinity(set: &[Vec<f64>], real: &[Vec<f64>], seed: u64) -> Result<f64> {
    let mut points = Vec::new();
    for (i, share) in [1, 2, 4].into_iter().enumerate() {
        let count = set.len() / share;
        for draw in 0..if share == 1 { 1 } else { DRAWS } {
            let mut rng = random::stream(seed, "frechet", i as u64, draw as u64);
            let mut order: Vec<usize> = (0..set.len()).collect();
            random::shuffle(&mut order, &mut rng);
            let part: Rows = order[..count].iter().map(|&row| set[row].clone()).collect();
            if let Some(distance) = frechet_distance(&part, real, RIDGE)? {
                // each count weighs as much as the others
                points.push((1.0 / count as f64, distance, if share == 1 { DRAWS as f64 } else { 1.0 }));
            }
        }
    }
    let sum = |of: &dyn Fn(&(f64, f64, f64)) -> f64| points.iter().map(of).sum::<f64>();
    let weight = sum(&|p| p.2);
    let (x, y) = (sum(&|p| p.0 * p.2) / weight, sum(&|p| p.1 * p.2) / weight);
    let slope = sum(&|p| p.2 * (p.0 - x) * (p.1 - y)) / sum(&|p| p.2 * (p.0 - x).powi(2));
    Ok(y - slope * x)
}

/// Mean distance of two rows; `None` of fewer than two.
pub fn diversity(rows: &[Vec<f64>]) -> Option<f64> {
    let pairs = (0..rows.len()).flat_map(|i| (0..i).map(move |j| (i, j)));
    let norm = |(i, j): (usize, usize)| rows[i].iter().zip(&rows[j]).map(|(x, y)| (x - y).powi(2)).sum::<f64>().sqrt();
    let count = rows.len() * rows.len().saturating_sub(1) / 2;
    (count > 0).then(|| pairs.map(norm).sum::<f64>() / count as f64)
}

/// Mean and covariance (n, n) of rows, a little added to its diagonal.
fn gaussian(rows: &[Vec<f64>], ridge: f64) -> (Vec<f64>, Vec<f64>) {
    let (n, count) = (rows[0].len(), rows.len() as f64);
    let mean: Vec<f64> = (0..n).map(|i| rows.iter().map(|row| row[i]).sum::<f64>() / count).collect();
    let mut covariance = vec![0.0; n * n];
    for row in rows {
        for i in 0..n {
            for j in 0..n {
                covariance[i * n + j] += (row[i] - mean[i]) * (row[j] - mean[j]) / (count - 1.0);
            }
        }
    }
    (0..n).for_each(|i| covariance[i * n + i] += ridge);
    (mean, covariance)
}

fn eigen(n: usize, matrix: &[f64]) -> Result<(Vec<f64>, Vec<f64>)> {
    // rounding leaves products a little unsymmetric
    let even: Vec<f64> = (0..n * n).map(|at| (matrix[at] + matrix[at % n * n + at / n]) / 2.0).collect();
    symmetric_eigen(n, &even).ok_or_else(|| {
        Error::unsupported("a Fréchet distance", "the features are not finite, so their covariance has no square root")
    })
}

/// A symmetric matrix with `of` of its eigenvalues, those below 0 as 0.
fn map_eigen(n: usize, matrix: &[f64], of: fn(f64) -> f64) -> Result<Vec<f64>> {
    let (values, vectors) = eigen(n, matrix)?;
    let mut mapped = vec![0.0; n * n];
    for (value, vector) in values.into_iter().zip(vectors.chunks(n)) {
        let value = of(value.max(0.0));
        for i in 0..n {
            for j in 0..n {
                mapped[i * n + j] += value * vector[i] * vector[j];
            }
        }
    }
    Ok(mapped)
}

fn product(n: usize, a: &[f64], b: &[f64]) -> Vec<f64> {
    let mut out = vec![0.0; n * n];
    for i in 0..n {
        for k in 0..n {
            let x = a[i * n + k];
            (0..n).for_each(|j| out[i * n + j] += x * b[k * n + j]);
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    fn rows(value: &serde_json::Value) -> Rows {
        let row = |row: &serde_json::Value| row.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect();
        value.as_array().unwrap().iter().map(row).collect()
    }

    #[test]
    fn it_is_that_of_scipy() {
        let golden: serde_json::Value = serde_json::from_str(include_str!("../../tests/golden/frechet.json")).unwrap();
        let (real, dances) = (rows(&golden["real"]), rows(&golden["dances"]));
        let scale = Standardizer::of(&real, true);
        let (a, b) = (scale.apply(&real), scale.apply(&dances));
        let found = frechet_distance(&b, &a, 0.0).unwrap().unwrap();
        assert!((found - golden["frechet"].as_f64().unwrap()).abs() < 1e-9, "{found}");
        assert!((diversity(&b).unwrap() - golden["diversity"].as_f64().unwrap()).abs() < 1e-12);
        assert!(frechet_distance(&a, &a, RIDGE).unwrap().unwrap().abs() < 1e-6);
    }

    /// Rows of independent numbers with mean `m` and spread `s`.
    fn normal(count: usize, n: usize, (m, s): (f64, f64), seed: u64) -> Rows {
        let mut rng = random::stream(seed, "rows", 0, 0);
        let mut one = || m + s * random::normal(&mut rng);
        (0..count).map(|_| (0..n).map(|_| one()).collect()).collect()
    }

    #[test]
    fn gaussians_have_the_closed_form_and_few_rows_a_bias_that_the_line_takes_off() {
        let (a, b) = (normal(50_000, 3, (0.0, 1.0), 1), normal(50_000, 3, (0.5, 2.0), 2));
        let found = frechet_distance(&a, &b, 0.0).unwrap().unwrap();
        // of each feature: (0.5 - 0)^2 of the means, (2 - 1)^2 of the deviations
        let wanted = 3.0 * (0.25 + 1.0);
        assert!((found / wanted - 1.0).abs() < 0.02, "{found}, {wanted}");
        let (few, real) = (normal(60, 8, (0.0, 1.0), 3), normal(4000, 8, (0.0, 1.0), 4));
        let set_distance = SetDistance::between(&few, &real, 5).unwrap();
        let (plain, far) = (set_distance.distance.unwrap(), set_distance.at_infinity.unwrap());
        assert!(plain > 0.2 && far.abs() < 0.5 * plain && set_distance.too_few, "{plain} {far}");
        assert!(SetDistance::between(&few[..2], &real, 5).unwrap().distance.is_none());
    }

    #[test]
    fn what_doesn_t_vary_is_left_out() {
        let real: Rows = (0..9).map(|i| vec![f64::from(i), 3.0]).collect();
        let scale = Standardizer::of(&real, false);
        assert_eq!((scale.left_out(), scale.apply(&real)[0].len()), (vec![1], 1));
        assert_eq!(Standardizer::of(&real, true).left_out(), Vec::<usize>::new());
    }
}
