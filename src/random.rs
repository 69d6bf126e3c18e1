//! Randomness: one seed, and a stream of its own for every use.
//!
//! No generator is shared, so the number of threads, resuming, and a new use elsewhere change nothing.

use rand_chacha::ChaCha8Rng;
use rand_chacha::rand_core::SeedableRng;
use sha2::{Digest, Sha256};

/// The stream of (`seed`, `purpose`, `step`, `index`); another purpose, step or index is another, unrelated stream.
pub fn stream(seed: u64, purpose: &str, step: u64, index: u64) -> ChaCha8Rng {
    let mut hash = Sha256::new();
    hash.update(b"kinelm stream 1");
    for number in [seed, step, index, purpose.len() as u64] {
        hash.update(number.to_le_bytes());
    }
    hash.update(purpose.as_bytes());
    ChaCha8Rng::from_seed(hash.finalize().into())
}

/// A number in `0.0..1.0` of 53 random bits.
pub fn unit(rng: &mut impl rand_chacha::rand_core::RngCore) -> f64 {
    (rng.next_u64() >> 11) as f64 / (1u64 << 53) as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::rand_core::RngCore;

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
}
