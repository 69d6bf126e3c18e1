//! A small random generator, so that this crate needs no dependency for it.

/// SplitMix64. Source: Steele, Lea and Flood, "Fast Splittable Pseudorandom Number Generators" (2014).
pub struct Rng(u64);

impl Rng {
    /// A separate stream per (seed, path), so that dances don't depend on each other.
    pub fn new(seed: u64, path: &[u64]) -> Self {
        let mut rng = Rng(seed);
        for &p in path {
            rng = Rng(rng.next() ^ p.wrapping_mul(0xd6e8_feb8_6659_fd93));
        }
        rng
    }

    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mut z = self.0;
        z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        z ^ (z >> 31)
    }

    /// Uniform in `low..high`.
    pub fn range(&mut self, low: f64, high: f64) -> f64 {
        // the upper 53 bits, all that a double in 0..1 can hold
        low + (high - low) * (self.next() >> 11) as f64 / (1u64 << 53) as f64
    }

    /// Uniform in `0..n`; 0 for `n = 0`.
    pub fn below(&mut self, n: usize) -> usize {
        // rounding may give `n` itself
        ((self.range(0.0, n as f64)) as usize).min(n.saturating_sub(1))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn known_numbers_and_separate_streams() {
        // the first outputs for seed 1234567, as published by the generator's authors
        let mut r = Rng(1_234_567);
        assert_eq!([r.next(), r.next()], [6_457_827_717_110_365_317, 3_203_168_211_198_807_973]);
        assert_ne!(Rng::new(1, &[2, 3]).next(), Rng::new(1, &[3, 2]).next());
        let mut r = Rng::new(7, &[]);
        let mean = (0..10_000).map(|_| r.range(-1.0, 1.0)).sum::<f64>() / 10_000.0;
        assert!(mean.abs() < 0.03, "{mean}");
        assert!((0..1000).all(|_| r.below(3) < 3) && r.below(0) == 0);
    }
}
