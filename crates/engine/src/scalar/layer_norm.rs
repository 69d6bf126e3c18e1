//! Layer norm over rows of `weight.len()` numbers, in f64 throughout.

use crate::op::layer_norm::EPSILON;

/// Mean and 1/sd of a row.
pub fn moments(row: &[f32]) -> (f64, f64) {
    let n = row.len() as f64;
    let mean = row.iter().map(|&x| x as f64).sum::<f64>() / n;
    let variance = row.iter().map(|&x| (x as f64 - mean).powi(2)).sum::<f64>() / n;
    (mean, 1.0 / (variance + EPSILON as f64).sqrt())
}

/// Rows with mean 0 and variance 1.
pub fn normalised(x: &[f32], width: usize) -> Vec<f64> {
    let rows = x.chunks(width).map(|row| (row, moments(row)));
    rows.flat_map(|(row, (mean, rsd))| row.iter().map(move |&x| (x as f64 - mean) * rsd)).collect()
}

/// The normalised rows times `weight` plus `bias`.
pub fn forward(x: &[f32], weight: &[f32], bias: &[f32]) -> Vec<f64> {
    let mut out = normalised(x, weight.len());
    for row in out.chunks_mut(weight.len()) {
        for ((o, &w), &b) in row.iter_mut().zip(weight).zip(bias) {
            *o = *o * w as f64 + b as f64;
        }
    }
    out
}

/// The gradients of `x`, `weight` and `bias`: with g = dy weight, the first is (g - mean(g) - y mean(g y))/sd for
/// normalised rows y.
pub fn backward(x: &[f32], weight: &[f32], dy: &[f32]) -> [Vec<f64>; 3] {
    let width = weight.len();
    let y = normalised(x, width);
    let [mut dx, mut dweight, mut dbias] = [vec![], vec![0.0; width], vec![0.0; width]];
    for ((x, y), dy) in x.chunks(width).zip(y.chunks(width)).zip(dy.chunks(width)) {
        let (_, rsd) = moments(x);
        let g: Vec<f64> = dy.iter().zip(weight).map(|(&dy, &w)| dy as f64 * w as f64).collect();
        let mean = g.iter().sum::<f64>() / width as f64;
        let mean_gy = g.iter().zip(y).map(|(g, y)| g * y).sum::<f64>() / width as f64;
        dx.extend(g.iter().zip(y).map(|(g, y)| (g - mean - y * mean_gy) * rsd));
        for (c, &dy) in dy.iter().enumerate() {
            dweight[c] += dy as f64 * y[c];
            dbias[c] += dy as f64;
        }
    }
    [dx, dweight, dbias]
}
