//! Linear discriminant analysis with Ledoit and Wolf's shrinkage, after standardisation and principal components.
//!
//! As scikit-learn's `StandardScaler`, `PCA(64)` and `LinearDiscriminantAnalysis(solver="lsqr", shrinkage="auto")` one after
//! the other: every class's covariance is shrunk by itself in standardised numbers, and they are averaged by their priors.
//! Source of the shrinkage: Ledoit and Wolf, "A well-conditioned estimator for large-dimensional covariance matrices"
//! (2004).
//!
//! Limits: one covariance for all classes, so that their borders are planes.

use crate::{Error, Result};

/// Principal components of the features (docs/classification.md, "Plain classifiers").
pub const COMPONENTS: usize = 64;

/// A fitted classifier.
pub struct Lda {
    mean: Vec<f64>,
    scale: Vec<f64>,
    /// (components, features)
    basis: Vec<f64>,
    /// (classes, components)
    weights: Vec<f64>,
    /// By class; minus infinity for a class without examples.
    intercepts: Vec<f64>,
}

impl Lda {
    /// From rows of features and their classes.
    ///
    /// # Errors
    /// No rows; numbers that are not finite.
    pub fn fit(rows: &[Vec<f64>], labels: &[usize], classes: usize, components: usize) -> Result<Lda> {
        let Some(first) = rows.first() else {
            return Err(Error::missing("labelled examples", "a linear classifier is fitted to them"));
        };
        let features = first.len();
        let (mean, deviation) = moments(rows, features);
        // features that don't vary are divided by 1, as in StandardScaler
        let scale: Vec<f64> = deviation.iter().map(|&s| if s > 0.0 { s } else { 1.0 }).collect();
        let standard = |row: &Vec<f64>| -> Vec<f64> { (0..features).map(|i| (row[i] - mean[i]) / scale[i]).collect() };
        let standard: Vec<Vec<f64>> = rows.iter().map(standard).collect();
        // no more components than rows, as in PCA
        let components = components.min(features).min(rows.len());
        let (_, vectors) = eigen(features, &covariance(&standard, features))?;
        let basis = vectors[..components * features].to_vec();
        let points: Vec<Vec<f64>> = standard.iter().map(|row| project(&basis, row)).collect();
        let (mut within, mut means) = (vec![0.0; components * components], vec![vec![0.0; components]; classes]);
        let mut priors = vec![0.0; classes];
        for class in 0..classes {
            let of_class: Vec<Vec<f64>> =
                points.iter().zip(labels).filter(|(_, l)| **l == class).map(|(p, _)| p.clone()).collect();
            if of_class.is_empty() {
                continue;
            }
            priors[class] = of_class.len() as f64 / rows.len() as f64;
            means[class] = moments(&of_class, components).0;
            let shrunk = shrunk_covariance(&of_class, components);
            within.iter_mut().zip(shrunk).for_each(|(w, s)| *w += priors[class] * s);
        }
        let weights: Vec<f64> = solve(components, &within, &means)?;
        let intercept = |class: usize| {
            let row = &weights[class * components..][..components];
            -0.5 * dot(&means[class], row) + priors[class].ln()
        };
        let intercepts = (0..classes).map(intercept).collect();
        Ok(Lda { mean, scale, basis, weights, intercepts })
    }

    /// The names of its parts.
    pub(super) const PARTS: [&str; 5] = ["mean", "scale", "basis", "weights", "intercepts"];

    /// Its parts in the order of [`Lda::PARTS`], with their names.
    pub(super) fn parts(&self) -> [(&'static str, &[f64]); 5] {
        let Lda { mean, scale, basis, weights, intercepts } = self;
        let [a, b, c, d, e] = Lda::PARTS;
        [(a, &**mean), (b, scale), (c, basis), (d, weights), (e, intercepts)]
    }

    /// From parts that fit each other.
    pub(super) fn of([mean, scale, basis, weights, intercepts]: [Vec<f64>; 5]) -> Lda {
        Lda { mean, scale, basis, weights, intercepts }
    }

    /// ln p of every class.
    pub fn log_p(&self, row: &[f64]) -> Vec<f64> {
        let standard: Vec<f64> = row.iter().zip(&self.mean).zip(&self.scale).map(|((x, m), s)| (x - m) / s).collect();
        let point = project(&self.basis, &standard);
        let logits = self.weights.chunks(point.len()).zip(&self.intercepts).map(|(w, b)| dot(w, &point) + b).collect();
        super::class_scores::normalised(logits)
    }
}

fn dot(a: &[f64], b: &[f64]) -> f64 {
    a.iter().zip(b).map(|(a, b)| a * b).sum()
}

fn project(basis: &[f64], row: &[f64]) -> Vec<f64> {
    basis.chunks(row.len()).map(|b| dot(b, row)).collect()
}

/// Means and standard deviations (over n) of the columns.
fn moments(rows: &[Vec<f64>], width: usize) -> (Vec<f64>, Vec<f64>) {
    let n = rows.len() as f64;
    let mean: Vec<f64> = (0..width).map(|i| rows.iter().map(|r| r[i]).sum::<f64>() / n).collect();
    let deviation =
        (0..width).map(|i| (rows.iter().map(|r| (r[i] - mean[i]).powi(2)).sum::<f64>() / n).sqrt()).collect();
    (mean, deviation)
}

/// X^T X / n of rows whose columns have mean 0.
fn covariance(rows: &[Vec<f64>], width: usize) -> Vec<f64> {
    let columns: Vec<f64> = (0..width).flat_map(|i| rows.iter().map(move |r| r[i])).collect();
    let mut all = kinelm_linalg::product([width, rows.len(), width], &columns, &columns, true);
    all.iter_mut().for_each(|x| *x /= rows.len() as f64);
    all
}

/// The covariance of a class: standardised, shrunk towards a multiple of the identity, brought back.
fn shrunk_covariance(rows: &[Vec<f64>], p: usize) -> Vec<f64> {
    let (mean, deviation) = moments(rows, p);
    let scale: Vec<f64> = deviation.iter().map(|&s| if s > 0.0 { s } else { 1.0 }).collect();
    let x: Vec<Vec<f64>> = rows.iter().map(|r| (0..p).map(|i| (r[i] - mean[i]) / scale[i]).collect()).collect();
    let (n, mut covariance) = (rows.len() as f64, covariance(&x, p));
    let trace: f64 = (0..p).map(|i| covariance[i * p + i]).sum();
    let mu = trace / p as f64;
    let squares = covariance.iter().map(|c| c * c).sum::<f64>();
    let fourth = x.iter().map(|row| dot(row, row).powi(2)).sum::<f64>();
    // beta and delta as in scikit-learn's `ledoit_wolf_shrinkage`
    let beta = (fourth / n - squares) / (p as f64 * n);
    let delta = (squares - 2.0 * mu * trace + p as f64 * mu * mu) / p as f64;
    let beta = beta.min(delta);
    let share = if beta == 0.0 { 0.0 } else { beta / delta };
    for i in 0..p {
        for j in 0..p {
            let target = if i == j { share * mu } else { 0.0 };
            let shrunk = (1.0 - share) * covariance[i * p + j] + target;
            covariance[i * p + j] = scale[i] * shrunk * scale[j];
        }
    }
    covariance
}

fn eigen(n: usize, matrix: &[f64]) -> Result<(Vec<f64>, Vec<f64>)> {
    let none = || Error::NotFinite("the features of a linear classifier are not finite".into());
    kinelm_linalg::symmetric_eigen(n, matrix).ok_or_else(none)
}

/// The smallest x of least |A x - b| for every b: A symmetric and not negative, as a covariance.
fn solve(n: usize, matrix: &[f64], all: &[Vec<f64>]) -> Result<Vec<f64>> {
    let (values, vectors) = eigen(n, matrix)?;
    // eigenvalues up to this are zeros with rounding, and have no inverse
    let least = values.first().map_or(0.0, |v| v.abs()) * n as f64 * f64::EPSILON;
    let one = |b: &Vec<f64>| {
        let mut x = vec![0.0; n];
        for (value, vector) in values.iter().zip(vectors.chunks(n.max(1))) {
            if *value > least {
                let along = dot(vector, b) / value;
                x.iter_mut().zip(vector).for_each(|(x, v)| *x += along * v);
            }
        }
        x
    };
    Ok(all.iter().flat_map(one).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    /// scikit-learn's results on the same numbers; `scripts/reference/lda.py`.
    #[derive(Deserialize)]
    struct Golden {
        cases: Vec<Case>,
    }

    #[derive(Deserialize)]
    struct Case {
        components: usize,
        rows: Vec<Vec<f64>>,
        labels: Vec<usize>,
        #[serde(rename = "asked")]
        rows_to_classify: Vec<Vec<f64>>,
        log_p: Vec<Vec<f64>>,
    }

    #[test]
    fn as_scikit_learn_says() {
        let golden: Golden =
            serde_json::from_str(include_str!("../tests/golden/lda.json")).expect("a golden file that is whole");
        assert!(golden.cases.len() > 1);
        for case in golden.cases {
            let classes = case.log_p[0].len();
            let lda = Lda::fit(&case.rows, &case.labels, classes, case.components).unwrap();
            for (row, expected) in case.rows_to_classify.iter().zip(&case.log_p) {
                let found = lda.log_p(row);
                let error = found.iter().zip(expected).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(error < 1e-8, "{found:?}, expected {expected:?}");
            }
        }
    }

    #[test]
    fn a_class_without_examples_is_never_predicted() {
        let rows = vec![vec![0.0, 1.0], vec![0.1, 1.2], vec![1.0, 0.0], vec![1.1, 0.3]];
        let lda = Lda::fit(&rows, &[0, 0, 2, 2], 3, 2).unwrap();
        let log_p = lda.log_p(&[0.0, 1.1]);
        assert!(log_p[0] > log_p[2] && log_p[1] == f64::NEG_INFINITY, "{log_p:?}");
        assert!(Lda::fit(&[], &[], 3, 2).is_err());
        assert!(Lda::fit(&[vec![f64::NAN]], &[0], 1, 1).is_err());
    }
}
