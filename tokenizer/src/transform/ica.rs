//! Independent components: directions in which the data are least Gaussian.

use super::pca::{self, eigen};
use crate::Result;
use kinelm_linalg::{Pca, largest_positive, product};

/// Sources that are as independent as a linear map can make them, of variance 1.
#[derive(Debug, Clone, PartialEq)]
pub struct Ica {
    /// Mean of each channel, (C).
    pub mean: Vec<f64>,
    /// From channels less their mean to sources, (K, C).
    pub unmixing: Vec<f64>,
    /// From sources to channels less their mean, (C, K). Sources are in order of falling column length; in each column the number
    /// of largest magnitude is positive.
    pub mixing: Vec<f64>,
    /// The number of independent sources: K, or the rank of the data if less. The others are unit directions without variance.
    pub rank: usize,
    /// Iterations until convergence.
    pub rounds: usize,
}

/// Directions whose variance is below this share of the largest count as constant.
const RANK: f64 = 1e-12;
/// The most rows that are used; of more, every n-th.
const ROWS: usize = 32_768;
/// The most iterations.
const ROUNDS: usize = 200;
/// Convergence: the largest rotation of a direction, as 1 less the cosine of the angle.
const TURNED: f64 = 1e-6;

/// `components` (K, at most C) independent components of `data` (N, C): `channels` is C.
///
/// FastICA, all directions at once, with the logarithm of the hyperbolic cosine as contrast, on the data whitened along
/// their first K principal components. It starts from fixed numbers and runs on one thread: the same data give the same bytes.
///
/// # Errors
/// As [`pca::fit`].
///
/// # Panics
/// When `data` isn't whole rows.
///
/// Source: Hyvärinen and Oja, "Independent component analysis: algorithms and applications" (2000).
pub fn fit(data: &[f64], channels: usize, components: usize) -> Result<Ica> {
    let pca = pca::fit(data, channels)?;
    let k = components.min(channels);
    // whitening divides by deviations: noise of constant channels must not be blown up to variance 1
    let floor = RANK * pca.variances.first().copied().unwrap_or(0.0);
    let rank = pca.variances[..k].iter().take_while(|&&v| v > floor).count();
    let (turn, rounds) = search(&whitened(data, &pca, rank), rank)?;
    let deviation = |i: usize| pca.variances[i].sqrt();
    // columns of the mixing matrix, rows of the unmixing matrix
    let mut sources: Vec<(Vec<f64>, Vec<f64>)> = (0..rank)
        .map(|s| {
            let along = |scale: &dyn Fn(usize) -> f64| -> Vec<f64> {
                let weight: Vec<f64> = (0..rank).map(|i| turn[s * rank + i] * scale(i)).collect();
                (0..channels)
                    .map(|c| weight.iter().enumerate().map(|(i, w)| w * pca.components[i * channels + c]).sum())
                    .collect()
            };
            (along(&deviation), along(&|i| 1.0 / deviation(i)))
        })
        .collect();
    for (mixing, unmixing) in &mut sources {
        let before = mixing.clone();
        largest_positive(mixing);
        // both or none: otherwise unmixing and mixing would no longer be inverse
        if *mixing != before {
            unmixing.iter_mut().for_each(|x| *x = -*x);
        }
    }
    let length = |v: &[f64]| v.iter().map(|x| x * x).sum::<f64>();
    sources.sort_by(|a, b| length(&b.0).total_cmp(&length(&a.0)));
    let still = pca.components[rank * channels..k * channels].chunks_exact(channels.max(1));
    sources.extend(still.map(|v| (v.to_vec(), v.to_vec())));
    let mixing = (0..channels).flat_map(|c| sources.iter().map(move |s| s.0[c])).collect();
    let unmixing = sources.iter().flat_map(|s| s.1.iter().copied()).collect();
    Ok(Ica { mean: pca.mean, unmixing, mixing, rank, rounds })
}

/// The data along their first `rank` principal components, of variance 1 each: (rank, rows).
fn whitened(data: &[f64], pca: &Pca, rank: usize) -> Vec<f64> {
    let c = pca.mean.len().max(1);
    let stride = (data.len() / c).div_ceil(ROWS).max(1);
    let rows = data.chunks_exact(c).step_by(stride);
    let n = rows.len();
    let off: Vec<f64> = rows.flat_map(|row| row.iter().zip(&pca.mean).map(|(x, m)| x - m)).collect();
    let scale = |(i, x): (usize, &f64)| x / pca.variances[i / c].sqrt();
    let basis: Vec<f64> = pca.components[..rank * c].iter().enumerate().map(scale).collect();
    product([rank, c, n], &basis, &off, true)
}

/// The rotation (K, K) of whitened data (K, N) that makes its rows independent, and the number of iterations.
fn search(data: &[f64], k: usize) -> Result<(Vec<f64>, usize)> {
    if k == 0 {
        return Ok((vec![], 0));
    }
    let n = data.len() / k;
    let mut turn = decorrelated(k, &start(k))?;
    for round in 0..ROUNDS {
        // tanh and its derivative 1 - tanh^2 are the contrast's first two derivatives
        let mut bent = product([k, k, n], &turn, data, false);
        let slopes: Vec<f64> = bent.chunks_exact_mut(n).map(bend).collect();
        let mut next = product([k, n, k], &bent, data, true);
        for (i, x) in next.iter_mut().enumerate() {
            *x = (*x - slopes[i / k] * turn[i]) / n as f64;
        }
        let next = decorrelated(k, &next)?;
        let rows = next.chunks_exact(k).zip(turn.chunks_exact(k));
        // a direction and its opposite are the same source, hence the absolute value
        let cosine = rows.map(|(a, b)| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>().abs());
        let turned = cosine.map(|c| 1.0 - c).fold(0.0, f64::max);
        turn = next;
        if turned < TURNED {
            return Ok((turn, round + 1));
        }
    }
    Ok((turn, ROUNDS))
}

/// Numbers into their hyperbolic tangents; gives the sum of its derivatives.
fn bend(row: &mut [f64]) -> f64 {
    row.iter_mut().for_each(|x| *x = tanh(*x));
    row.iter().map(|x| 1.0 - x * x).sum()
}

/// The hyperbolic tangent to 1e-14, in plain arithmetic that becomes vector instructions: the search is made of it, and the
/// C library's took four fifths of a fit.
fn tanh(x: f64) -> f64 {
    use std::f64::consts::{LN_2, LOG2_E};
    // added and subtracted, it rounds to a whole number, which is then in the sum's lowest bits
    const ROUND: f64 = 1.5 * (1u64 << 52) as f64;
    // beyond, the result is 1 to the last bit, and the exponent stays within a double's
    let x = (2.0 * x).clamp(-40.0, 40.0);
    let rounded = x * LOG2_E + ROUND;
    let rest = x - (rounded - ROUND) * LN_2;
    // 2^k from its bits: the exponent's bias is 1023, and the shift drops all but the whole number
    let power = f64::from_bits(rounded.to_bits().wrapping_add(1023) << 52);
    // the exponential of the rest, at most 0.35, by the first terms of its series
    let exponential = (1..=12).rev().fold(1.0, |sum, k| 1.0 + sum * rest * (1.0 / f64::from(k))) * power;
    1.0 - 2.0 / (exponential + 1.0)
}

/// Where the search starts: numbers without a pattern, always the same.
fn start(k: usize) -> Vec<f64> {
    let mut state = 0u64;
    let mut next = move || {
        // Steele, Lea, Flood, "Fast splittable pseudorandom number generators" (2014)
        state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
        let mut z = state;
        z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
        ((z ^ (z >> 31)) >> 11) as f64 / (1u64 << 52) as f64 - 1.0
    };
    (0..k * k).map(|_| next()).collect()
}

/// The orthonormal rows nearest to those of `w` (K, K): `(w w')^(-1/2) w`.
fn decorrelated(k: usize, w: &[f64]) -> Result<Vec<f64>> {
    let (values, vectors) = eigen(k, &product([k; 3], w, w, true))?;
    // for rows in one plane, up to rounding, the part outside it stays small instead of growing without bound
    let floor = values.first().map_or(0.0, |v| v * 1e-14).max(f64::MIN_POSITIVE);
    let mut along = product([k; 3], &vectors, w, false);
    for (i, x) in along.iter_mut().enumerate() {
        *x /= values[i / k].max(floor).sqrt();
    }
    let back: Vec<f64> = (0..k * k).map(|i| vectors[i % k * k + i / k]).collect();
    Ok(product([k; 3], &back, &along, false))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transform::pca::tests::{Golden, dot, noise};

    /// Source `s` of every row.
    fn source(ica: &Ica, data: &[f64], s: usize) -> Vec<f64> {
        let c = ica.mean.len();
        let row = &ica.unmixing[s * c..(s + 1) * c];
        data.chunks_exact(c).map(|x| (0..c).map(|i| row[i] * (x[i] - ica.mean[i])).sum()).collect()
    }

    fn correlation(a: &[f64], b: &[f64]) -> f64 {
        let centred = |x: &[f64]| -> Vec<f64> {
            let mean = x.iter().sum::<f64>() / x.len() as f64;
            x.iter().map(|x| x - mean).collect()
        };
        let (a, b) = (centred(a), centred(b));
        dot(&a, &b) / (dot(&a, &a) * dot(&b, &b)).sqrt()
    }

    /// Mixing undoes unmixing: their product (K, K) is the identity.
    fn check_inverse(ica: &Ica, k: usize) {
        let c = ica.mean.len();
        assert_eq!((ica.mixing.len(), ica.unmixing.len()), (c * k, k * c));
        assert!(ica.mixing.iter().chain(&ica.unmixing).all(|x| x.is_finite()));
        for i in 0..k {
            for j in 0..k {
                let product: f64 = (0..c).map(|x| ica.unmixing[i * c + x] * ica.mixing[x * k + j]).sum();
                assert!((product - f64::from(i == j)).abs() < 1e-6, "{i} {j} {product}");
            }
        }
    }

    #[test]
    fn as_scikit_learn_has_it() {
        let case = Golden::load().ica;
        let k = case.sources.len();
        let ica = fit(&case.data, case.channels, k).unwrap();
        check_inverse(&ica, k);
        assert!(ica.rank == k && ica.rounds < ROUNDS, "{} {}", ica.rank, ica.rounds);
        let mut taken = vec![false; k];
        for s in 0..k {
            let ours = source(&ica, &case.data, s);
            assert!((dot(&ours, &ours) / ours.len() as f64 - 1.0).abs() < 1e-9, "variance of {s}");
            let found = (0..k).find(|&t| correlation(&ours, &case.sources[t]).abs() > 0.999);
            let t = found.unwrap_or_else(|| panic!("source {s} is none of scikit-learn's"));
            assert!(!std::mem::replace(&mut taken[t], true), "{t} twice");
        }
    }

    #[test]
    fn data_of_low_rank() {
        let mut data = noise(9, 300 * 6);
        for row in data.chunks_exact_mut(6) {
            (row[4], row[5]) = (2.0, row[0] - row[1]);
        }
        for k in 0..=6 {
            let ica = fit(&data, 6, k).unwrap();
            check_inverse(&ica, k);
            assert_eq!(ica.rank, k.min(4));
        }
        for data in [vec![], vec![1.0; 6], noise(3, 2 * 6)] {
            let ica = fit(&data, 6, 4).unwrap();
            check_inverse(&ica, 4);
            assert!(ica.rank <= 1);
        }
    }

    #[test]
    fn tangents() {
        for i in -4000..=4000 {
            let x = f64::from(i) * 0.01 + 1e-3;
            assert!((tanh(x) - x.tanh()).abs() < 1e-14, "{x}: {} {}", tanh(x), x.tanh());
        }
        assert_eq!((tanh(0.0), tanh(1e300), tanh(f64::NEG_INFINITY)), (0.0, 1.0, -1.0));
    }

    #[test]
    fn the_same_bytes_again() {
        let data = noise(2, 500 * 8);
        assert_eq!(fit(&data, 8, 5).unwrap(), fit(&data, 8, 5).unwrap());
    }
}
