//! Random streams: one seed, and a separate stream for every use.
//!
//! No generator is shared, so results don't depend on the number of threads, on resuming, or on other uses. Streams are
//! for results that can be made again, never for secrets: seeds are in files.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::{RngCore, SeedableRng};
use sha2::{Digest, Sha256};

/// The stream of (`seed`, `purpose`, `step`, `index`); different values give unrelated streams.
///
/// ```
/// use kinelm_store::random::{stream, unit};
///
/// let first = |index| unit(&mut stream(7, "example", 0, index));
/// assert_eq!(first(1), first(1));
/// assert_ne!(first(1), first(2));
/// ```
pub fn stream(seed: u64, purpose: &str, step: u64, index: u64) -> ChaCha8Rng {
    let mut hash = Sha256::new();
    // the version of this derivation: another one would change all results
    hash.update(b"kinelm stream 1");
    // lengths before texts: no two inputs are hashed as the same bytes
    for number in [seed, step, index, purpose.len() as u64] {
        hash.update(number.to_le_bytes());
    }
    hash.update(purpose.as_bytes());
    ChaCha8Rng::from_seed(hash.finalize().into())
}

/// A uniform number in `0.0..1.0`, of 53 random bits.
pub fn unit(rng: &mut impl RngCore) -> f64 {
    (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

/// A number from the standard normal distribution, by the Box-Muller method.
pub fn normal(rng: &mut impl RngCore) -> f64 {
    // 1 - u is above 0
    let radius = (-2.0 * (1.0 - unit(rng)).ln()).sqrt();
    // the sine would be a second number, but a state between calls too
    radius * (std::f64::consts::TAU * unit(rng)).cos()
}

/// Shuffles `all` by the Fisher-Yates method. Up to 2^32 items, the bias of the 64-bit remainder is negligible.
pub fn shuffle<T>(all: &mut [T], rng: &mut impl RngCore) {
    for last in (1..all.len()).rev() {
        all.swap(last, (rng.next_u64() % (last as u64 + 1)) as usize);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn streams_are_their_own() {
        let first = |seed, purpose, step, index| stream(seed, purpose, step, index).next_u64();
        let a = first(1, "batch", 2, 3);
        assert_eq!(a, first(1, "batch", 2, 3));
        for other in [first(2, "batch", 2, 3), first(1, "mask", 2, 3), first(1, "batch", 3, 2), first(1, "batch", 2, 4)]
        {
            assert_ne!(a, other);
        }
    }

    #[test]
    fn normal_numbers_have_their_moments() {
        let mut rng = stream(1, "normal", 0, 0);
        let all: Vec<f64> = (0..20_000).map(|_| normal(&mut rng)).collect();
        let mean = |f: &dyn Fn(f64) -> f64| all.iter().map(|x| f(*x)).sum::<f64>() / all.len() as f64;
        assert!(mean(&|x| x).abs() < 0.03 && (mean(&|x| x * x) - 1.0).abs() < 0.05, "deviations 0.007 and 0.01");
        assert!((mean(&|x| x.powi(4)) - 3.0).abs() < 0.4 && all.iter().all(|x| x.is_finite()));
    }

    #[test]
    fn orders_are_all_about_as_frequent() {
        let mut counts = std::collections::BTreeMap::new();
        for i in 0..6000 {
            let mut all = [0, 1, 2];
            shuffle(&mut all, &mut stream(1, "shuffle", i, 0));
            *counts.entry(all).or_insert(0) += 1;
        }
        assert_eq!(counts.len(), 6);
        // 1,000 each, deviation 29
        assert!(counts.values().all(|n| (880..1120).contains(n)), "{counts:?}");
    }
}
