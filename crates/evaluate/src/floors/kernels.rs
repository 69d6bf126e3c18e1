//! Mixtures of fixed densities over bins, their weights fitted by expectation maximisation.
//!
//! Limits: a fixed number of rounds without a test of convergence, as in the reference.

/// Kernels around one centre.
pub const KERNELS: usize = 1 + LAPLACE.len() + CAUCHY.len() + 1;

/// A class of cases of which training has fewer takes the weights of all classes.
pub const LEAST_CASES: usize = 200;

/// Scales of the Laplace kernels and of the Cauchy kernels, in bins.
const LAPLACE: [f64; 9] = [0.35, 0.7, 1.2, 2.0, 3.5, 6.0, 11.0, 20.0, 40.0];
const CAUCHY: [f64; 2] = [1.0, 5.0];

/// Rounds of expectation maximisation, and what is added to every kernel's share in each so that none dies.
const ROUNDS: usize = 60;
const FLOOR: f64 = 1e-3;

/// Densities around a centre bin: a spike, discretised Laplace of nine scales, discretised Cauchy of two, uniform. Each
/// is cut to the bins 0..n and sums to 1 over them.
///
/// Source: the mixtures of the project's reference floors (order0.py).
#[derive(Debug, Clone)]
pub struct Kernels {
    by_distance: Vec<[f64; KERNELS]>, // (n) before normalising
    inverse_sum: Vec<[f64; KERNELS]>, // (n) by centre
}

impl Kernels {
    /// The kernels over `n` bins. Memory grows with n, not with its square.
    pub fn new(n: usize) -> Self {
        let by_distance: Vec<_> = (0..n).map(|d| shape(d as f64)).collect();
        let mut before = vec![[0.0; KERNELS]; n + 1]; // sums over the distances below
        for d in 0..n {
            for k in 0..KERNELS {
                before[d + 1][k] = before[d][k] + by_distance[d][k];
            }
        }
        // distances 0..=c to the left, 0..n-c to the right, the centre counted once
        let sum = |c: usize, k: usize| before[c + 1][k] + before[n - c][k] - by_distance[0][k];
        let inverse_sum = (0..n).map(|c| std::array::from_fn(|k| 1.0 / sum(c, k))).collect();
        Kernels { by_distance, inverse_sum }
    }

    /// n.
    pub fn bins(&self) -> u32 {
        self.by_distance.len() as u32
    }

    /// The probability of `bin` under each kernel around `centre`.
    pub fn row(&self, centre: u32, bin: u32) -> [f64; KERNELS] {
        let (shape, scale) = (&self.by_distance[centre.abs_diff(bin) as usize], &self.inverse_sum[centre as usize]);
        std::array::from_fn(|k| shape[k] * scale[k])
    }
}

/// Each kernel at a distance, before normalising.
fn shape(d: f64) -> [f64; KERNELS] {
    let mut row = [1.0; KERNELS]; // the last stays: uniform
    row[0] = f64::from(u8::from(d == 0.0));
    let (laplace, rest) = row[1..].split_at_mut(LAPLACE.len());
    laplace.iter_mut().zip(LAPLACE).for_each(|(r, s)| *r = (-d / s).exp());
    rest.iter_mut().zip(CAUCHY).for_each(|(r, s)| *r = 1.0 / (1.0 + (d / s).powi(2)));
    row
}

/// The weights of a mixture of N densities, fitted to `counts` by expectation maximisation from equal weights.
/// `row(i)` gives the densities of case i, of which at least one is positive; `counts[i]` says how often it occurred.
pub fn fit<const N: usize>(counts: &[f64], row: impl Fn(usize) -> [f64; N]) -> [f64; N] {
    let mut weights = [1.0 / N as f64; N];
    for _ in 0..ROUNDS {
        let mut share = [0.0; N];
        for (i, &count) in counts.iter().enumerate() {
            let mut part = row(i);
            part.iter_mut().zip(&weights).for_each(|(p, w)| *p *= w);
            // above 0: a density of the case is positive by contract, and FLOOR keeps every weight so
            let scale = count / part.iter().sum::<f64>();
            share.iter_mut().zip(&part).for_each(|(s, p)| *s += p * scale);
        }
        let total: f64 = share.iter().map(|s| s + FLOOR).sum();
        weights.iter_mut().zip(&share).for_each(|(w, s)| *w = (s + FLOOR) / total);
    }
    weights
}

/// Bits of a case under a mixture.
pub fn bits<const N: usize>(weights: &[f64; N], row: &[f64; N]) -> f64 {
    -weights.iter().zip(row).map(|(w, p)| w * p).sum::<f64>().log2()
}

/// Distinct cases in ascending order and how often each occurred.
pub fn distinct<T: Ord + Copy>(mut cases: Vec<T>) -> (Vec<T>, Vec<f64>) {
    cases.sort_unstable();
    let (mut values, mut counts) = (Vec::new(), Vec::new());
    for run in cases.chunk_by(|a, b| a == b) {
        values.push(run[0]);
        counts.push(run.len() as f64);
    }
    (values, counts)
}

/// Add-one counts.
pub struct Histogram {
    counts: Vec<f64>,
    total: f64,
}

impl Histogram {
    /// Of these codes, below `bins`.
    pub fn fit(bins: usize, codes: impl Iterator<Item = u32>) -> Self {
        let mut counts = vec![1.0; bins];
        codes.for_each(|c| counts[c as usize] += 1.0);
        let total = counts.iter().sum();
        Histogram { counts, total }
    }

    /// The probability of a code.
    pub fn p(&self, code: u32) -> f64 {
        self.counts[code as usize] / self.total
    }

    /// Bits of a code.
    pub fn bits(&self, code: u32) -> f64 {
        -self.p(code).log2()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_kernel_sums_to_one_around_every_centre() {
        for n in [1, 2, 7, 360] {
            let kernels = Kernels::new(n);
            for c in [0, n / 3, n - 1] {
                let mut sums = [0.0; KERNELS];
                for x in 0..n {
                    let row = kernels.row(c as u32, x as u32);
                    sums.iter_mut().zip(row).for_each(|(s, p)| *s += p);
                }
                sums.iter().for_each(|s| assert!((s - 1.0).abs() < 1e-12, "{n} {c}: {sums:?}"));
            }
        }
    }

    #[test]
    fn weights_are_found_again() {
        // cases 0 and 1 occur 30 and 10 times; the densities tell them apart fully, so the weights are 3/4 and 1/4
        let rows = [[1.0, 0.0], [0.0, 1.0]];
        let w = fit(&[30.0, 10.0], |i| rows[i]);
        assert!((w[0] - 0.75).abs() < 1e-4 && (w[1] - 0.25).abs() < 1e-4, "{w:?}");
        assert!((bits(&w, &rows[1]) - 2.0).abs() < 1e-3);
    }

    #[test]
    fn distinct_counts() {
        assert_eq!(distinct(vec![(2, 1), (1, 1), (2, 1)]), (vec![(1, 1), (2, 1)], vec![1.0, 2.0]));
    }
}
