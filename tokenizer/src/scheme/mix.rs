//! Linear transforms of the channels to fewer or less correlated components, before quantisation.

use crate::meaning::{Series, Unit, shares};
#[cfg(feature = "fit")]
use crate::transform::{ica, pca};
use crate::{Error, Result};
use serde::{Deserialize, Serialize};

/// The transform over the joints. It excludes the translation and, with `heading_delta`, the turn.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum JointTransform {
    /// None: every channel separately.
    None {},
    /// Principal components: the directions in which the training motion varies most.
    Pca {
        /// K, 1 to 72, at most the number of channels.
        components: u32,
    },
    /// Independent components within as many principal components.
    Ica {
        /// K, 1 to 72, at most the number of channels.
        components: u32,
    },
}

/// The channels of all 24 joints.
const MOST: u32 = 72;

impl JointTransform {
    /// K, for a number of channels.
    pub fn components(&self, channels: usize) -> usize {
        match *self {
            JointTransform::None {} => channels,
            JointTransform::Pca { components } | JointTransform::Ica { components } => {
                channels.min(components as usize)
            }
        }
    }

    /// Checks every setting.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the setting, its value and its limits.
    pub fn validate(&self) -> Result<()> {
        match *self {
            JointTransform::Pca { components } | JointTransform::Ica { components }
                if !(1..=MOST).contains(&components) =>
            {
                Err(Error::setting("components", components, format!("1 to {MOST}")))
            }
            _ => Ok(()),
        }
    }
}

/// A fitted linear map from C channels to K components and back: `y = forward * (scale * (x - mean))`.
///
/// Each component of PCA and ICA is a direction of unit length in the scaled channels, so an error of a component has the same
/// length there. (FastICA's sources, of variance 1, are rescaled.)
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mix {
    /// (C).
    mean: Vec<f64>,
    /// (C), weight of each channel: 1, or its joint's lever arm in metres.
    scale: Vec<f64>,
    /// (K, C); empty without a transform.
    forward: Vec<f64>,
    /// (C, K); empty without a transform.
    inverse: Vec<f64>,
}

/// Bound of the numbers in a file.
const LARGEST: f64 = 1e12;

impl Mix {
    /// Fits the map to `data` (N, C); `channels` is C. `weights` (C), all positive, scale the channels first.
    ///
    /// Constant channels, fewer rows than channels, and no rows are allowed: components without variance are unit directions,
    /// too.
    ///
    /// # Errors
    /// [`Error::Nothing`] when numbers are out of range.
    ///
    /// # Panics
    /// When `data` isn't whole rows, or there are not C weights.
    #[cfg(feature = "fit")]
    pub fn fit(transform: &JointTransform, data: &[f64], channels: usize, weights: Option<&[f64]>) -> Result<Mix> {
        let scale = weights.map_or_else(|| vec![1.0; channels], <[f64]>::to_vec);
        assert_eq!(scale.len(), channels, "one weight per channel");
        let k = transform.components(channels);
        let scaled: Vec<f64> = data.iter().enumerate().map(|(i, x)| x * scale[i % channels]).collect();
        let (mean, forward, inverse) = match transform {
            JointTransform::None {} => (kinelm_linalg::mean(&scaled, channels), vec![], vec![]),
            JointTransform::Pca { .. } => {
                let p = pca::fit(&scaled, channels)?;
                let forward = p.components[..k * channels].to_vec();
                // components are orthonormal, so the inverse is the transpose
                let inverse = (0..channels * k).map(|i| forward[i % k * channels + i / k]).collect();
                (p.mean, forward, inverse)
            }
            JointTransform::Ica { .. } => {
                let mut a = ica::fit(&scaled, channels, k)?;
                for s in 0..k {
                    // one step for all components needs equal units: unit columns in mixing, the inverse in unmixing
                    let length = (0..channels).map(|c| a.mixing[c * k + s].powi(2)).sum::<f64>().sqrt();
                    (0..channels).for_each(|c| a.mixing[c * k + s] /= length);
                    a.unmixing[s * channels..(s + 1) * channels].iter_mut().for_each(|x| *x *= length);
                }
                (a.mean, a.unmixing, a.mixing)
            }
        };
        // `forward` subtracts the mean before it scales, and this is the mean of scaled channels
        let mean = mean.iter().zip(&scale).map(|(m, s)| m / s).collect();
        Ok(Mix { mean, scale, forward, inverse })
    }

    /// C.
    pub fn channels(&self) -> usize {
        self.mean.len()
    }

    /// K.
    pub fn components(&self) -> usize {
        if self.inverse.is_empty() { self.channels() } else { self.inverse.len() / self.channels() }
    }

    /// Whether components are more than the scaled channels.
    pub fn mixes(&self) -> bool {
        !self.inverse.is_empty()
    }

    /// The series of the components, from the joint of each channel; none without a transform.
    pub fn series(&self, joints: &[usize], unit: Unit) -> impl Iterator<Item = Series> {
        let k = if self.mixes() { self.components() } else { 0 };
        (0..k).map(move |i| {
            // a unit of a component is a vector of length 1 in the scaled channels
            let direction = self.inverse.iter().skip(i).step_by(k).copied();
            Series { name: format!("component {i}"), unit, joints: shares(joints.iter().copied().zip(direction)) }
        })
    }

    /// The weight of a channel.
    pub fn weight(&self, channel: usize) -> f64 {
        self.scale[channel]
    }

    /// Numbers that decoding needs: mean and inverse, and the scale unless it is 1.
    pub fn numbers(&self) -> u64 {
        let scaled = self.scale.iter().any(|&s| s != 1.0);
        (self.channels() * (1 + usize::from(scaled)) + self.inverse.len()) as u64
    }

    /// The components of n frames: `series` (C, n) into `out` (K, n). Leaves `series` centred and scaled.
    ///
    /// # Panics
    /// When the lengths aren't C or K series of `n` numbers.
    pub fn forward(&self, n: usize, series: &mut [f64], out: &mut [f64]) {
        assert_eq!((series.len(), out.len()), (self.channels() * n, self.components() * n), "series of {n}");
        for (x, (m, s)) in series.chunks_exact_mut(n).zip(self.mean.iter().zip(&self.scale)) {
            x.iter_mut().for_each(|x| *x = (*x - m) * s);
        }
        if self.forward.is_empty() {
            out.copy_from_slice(series);
        } else {
            multiply(&self.forward, n, series, out);
        }
    }

    /// The channels of n frames: `series` (K, n) into `out` (C, n).
    ///
    /// # Panics
    /// As [`Mix::forward`].
    pub fn inverse(&self, n: usize, series: &[f64], out: &mut [f64]) {
        assert_eq!((series.len(), out.len()), (self.components() * n, self.channels() * n), "series of {n}");
        if self.inverse.is_empty() {
            out.copy_from_slice(series);
        } else {
            multiply(&self.inverse, n, series, out);
        }
        for (x, (m, s)) in out.chunks_exact_mut(n).zip(self.mean.iter().zip(&self.scale)) {
            x.iter_mut().for_each(|x| *x = *x / s + m);
        }
    }

    /// Checks a file's numbers against the settings and the number of channels.
    ///
    /// # Errors
    /// [`Error::Setting`] when sizes are wrong or numbers out of range.
    pub fn validate(&self, transform: &JointTransform, channels: usize) -> Result<()> {
        let k = transform.components(channels);
        let size = if *transform == (JointTransform::None {}) { 0 } else { k * channels };
        let lengths = [self.mean.len(), self.scale.len(), self.forward.len(), self.inverse.len()];
        // NaN compares false, so it is refused too
        let fine = |x: &&f64| x.abs() < LARGEST;
        let all = [&self.mean, &self.scale, &self.forward, &self.inverse];
        let good = lengths == [channels, channels, size, size]
            && all.iter().all(|v| v.iter().all(|x| fine(&x)))
            // decoding divides by the scale
            && self.scale.iter().all(|&s| s > 1.0 / LARGEST);
        good.then_some(()).ok_or_else(|| {
            Error::setting(
                "joint transform",
                format!("mean, scale, forward and inverse of {lengths:?} numbers, or one out of range"),
                format!(
                    "{:?} finite numbers for {k} components of {channels} channels",
                    [channels, channels, size, size]
                ),
            )
        })
    }
}

/// Rows and columns of the blocks of a product, whose sums fit into eight registers of two numbers.
const BLOCK: usize = 4;

/// `matrix` (R, C) times `series` (C, n) into `out` (R, n). Every sum is in the order of the channels, independent of blocks.
fn multiply(matrix: &[f64], n: usize, series: &[f64], out: &mut [f64]) {
    let c = series.len() / n.max(1);
    for (rows, out) in matrix.chunks(BLOCK * c.max(1)).zip(out.chunks_mut(BLOCK * n.max(1))) {
        // c is not 0 here: a matrix without channels has no rows
        match rows.len() / c {
            4 => multiply_rows::<4>(rows, n, series, out),
            3 => multiply_rows::<3>(rows, n, series, out),
            2 => multiply_rows::<2>(rows, n, series, out),
            _ => multiply_rows::<1>(rows, n, series, out),
        }
    }
}

/// R rows of a product.
fn multiply_rows<const R: usize>(rows: &[f64], n: usize, series: &[f64], out: &mut [f64]) {
    let c = rows.len() / R;
    let rows: [&[f64]; R] = std::array::from_fn(|r| &rows[r * c..(r + 1) * c]);
    // the rest is summed in the same order of channels, so a frame's bits don't depend on its place in a block
    let whole = n - n % BLOCK;
    for t in (0..whole).step_by(BLOCK) {
        let mut sums = [[0.0; BLOCK]; R];
        for (i, x) in series.chunks_exact(n).enumerate() {
            let x = &x[t..t + BLOCK];
            for (sums, row) in sums.iter_mut().zip(&rows) {
                sums.iter_mut().zip(x).for_each(|(s, x)| *s += row[i] * x);
            }
        }
        sums.iter().enumerate().for_each(|(r, sums)| out[r * n + t..r * n + t + BLOCK].copy_from_slice(sums));
    }
    for (row, out) in rows.iter().zip(out.chunks_exact_mut(n)) {
        for (t, out) in out.iter_mut().enumerate().skip(whole) {
            *out = row.iter().zip(series.chunks_exact(n)).fold(0.0, |sum, (weight, x)| sum + weight * x[t]);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::transform::pca::tests::noise;

    const C: usize = 6;

    /// Rows in which channel 4 stands still and channel 5 says what 0 and 1 say.
    fn data(rows: usize) -> Vec<f64> {
        let mut data = noise(9, rows * C);
        for row in data.chunks_exact_mut(C) {
            (row[0], row[4], row[5]) = (3.0 * row[0] + 1.0, 2.0, row[0] - row[1]);
        }
        data
    }

    /// Series (C, n) of rows (n, C).
    fn series(rows: &[f64]) -> Vec<f64> {
        let n = rows.len() / C;
        (0..C * n).map(|i| rows[i % n * C + i / n]).collect()
    }

    fn through(mix: &Mix, series: &[f64]) -> (Vec<f64>, Vec<f64>) {
        let n = series.len() / C;
        let (mut mixed, mut back) = (vec![7.0; mix.components() * n], vec![7.0; C * n]);
        mix.forward(n, &mut series.to_vec(), &mut mixed);
        mix.inverse(n, &mixed, &mut back);
        (mixed, back)
    }

    fn furthest(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
    }

    const WEIGHTS: [f64; C] = [0.1, 0.5, 1.0, 0.02, 0.3, 0.2];

    #[test]
    fn all_components_lose_nothing() {
        let x = series(&data(50));
        for weights in [None, Some(&WEIGHTS[..])] {
            for t in [
                JointTransform::None {},
                JointTransform::Pca { components: 4 },
                JointTransform::Pca { components: 72 },
                JointTransform::Ica { components: 4 },
                JointTransform::Ica { components: 6 },
            ] {
                let mix = Mix::fit(&t, &data(50), C, weights).unwrap();
                mix.validate(&t, C).unwrap();
                assert_eq!(mix.components(), t.components(C));
                // four components are all there is to know
                let (mixed, back) = through(&mix, &x);
                assert!(furthest(&x, &back) < 1e-9, "{t:?}: {}", furthest(&x, &back));
                assert!(mixed.chunks(50).all(|s| s.iter().sum::<f64>().abs() < 1e-9), "{t:?}");
                let text = serde_json::to_string(&mix).unwrap();
                assert_eq!(serde_json::from_str::<Mix>(&text).unwrap(), mix);
            }
        }
    }

    #[test]
    fn an_error_of_a_component_is_as_long_in_the_scaled_channels() {
        for t in [JointTransform::Pca { components: 3 }, JointTransform::Ica { components: 3 }] {
            let mix = Mix::fit(&t, &data(200), C, Some(&WEIGHTS)).unwrap();
            for k in 0..3 {
                let mut y = vec![0.0; 3];
                y[k] = 0.5;
                let mut back = vec![0.0; C];
                mix.inverse(1, &y, &mut back);
                let long = |c: usize| ((back[c] - mix.mean[c]) * WEIGHTS[c]).powi(2);
                assert!(((0..C).map(long).sum::<f64>().sqrt() - 0.5).abs() < 1e-12);
            }
        }
    }

    #[test]
    fn weights_decide_what_is_kept() {
        let rows = noise(5, 400 * C);
        let mix =
            Mix::fit(&JointTransform::Pca { components: 1 }, &rows, C, Some(&[1.0, 1.0, 1.0, 9.0, 1.0, 1.0])).unwrap();
        let (_, back) = through(&mix, &series(&rows));
        let miss = |c: usize| furthest(&back[c * 400..(c + 1) * 400], &series(&rows)[c * 400..(c + 1) * 400]);
        assert!(miss(3) < 0.1 && miss(0) > 0.5, "{} {}", miss(3), miss(0));
    }

    #[test]
    fn products_of_every_shape() {
        for (rows, c, n) in [(1, 3, 1), (4, 5, 4), (5, 2, 7), (8, 1, 9), (7, 7, 3), (9, 4, 16), (0, 3, 4)] {
            let (m, x) = (noise(1, rows * c), noise(2, c * n));
            let mut out = vec![9.0; rows * n];
            multiply(&m, n, &x, &mut out);
            for (i, out) in out.iter().enumerate() {
                let plain = (0..c).fold(0.0, |sum, k| sum + m[i / n * c + k] * x[k * n + i % n]);
                assert_eq!(*out, plain, "{rows} {c} {n}: {i}");
            }
        }
    }

    #[test]
    fn little_to_learn_from() {
        for rows in [0, 1, 3] {
            for t in
                [JointTransform::None {}, JointTransform::Pca { components: 5 }, JointTransform::Ica { components: 5 }]
            {
                let mix = Mix::fit(&t, &data(rows), C, None).unwrap();
                mix.validate(&t, C).unwrap();
                let (_, back) = through(&mix, &series(&data(rows.max(1))));
                assert!(rows == 0 || furthest(&back, &series(&data(rows))) < 1e-9, "{t:?} {rows}");
                assert!(back.iter().all(|x| x.is_finite()));
            }
        }
        assert_eq!(Mix::fit(&JointTransform::Pca { components: 3 }, &[], 0, None).unwrap().components(), 0);
    }

    #[test]
    fn what_a_file_says_is_checked() {
        let t = JointTransform::Pca { components: 3 };
        let mix = Mix::fit(&t, &data(30), C, None).unwrap();
        let wrong = |f: fn(&mut Mix)| {
            let mut m = mix.clone();
            f(&mut m);
            m.validate(&t, C).unwrap_err().to_string().contains("3 components of 6 channels")
        };
        assert!(wrong(|m| m.mean.truncate(5)));
        assert!(wrong(|m| m.forward.push(1.0)));
        assert!(wrong(|m| m.inverse[4] = f64::NAN));
        assert!(wrong(|m| m.scale[0] = 0.0));
        assert!(mix.validate(&JointTransform::None {}, C).is_err());
        assert!(mix.validate(&t, C + 3).is_err());
        assert_eq!(mix.numbers(), 6 + 18);
        for json in [r#"{"type":"pca"}"#, r#"{"type":"none","components":3}"#, r#"{"type":"svd"}"#] {
            assert!(serde_json::from_str::<JointTransform>(json).is_err(), "{json}");
        }
        assert!(JointTransform::Ica { components: 0 }.validate().unwrap_err().to_string().contains("1 to 72"));
        assert_eq!(serde_json::from_str::<JointTransform>(r#"{"type":"none"}"#).unwrap(), JointTransform::None {});
    }
}
