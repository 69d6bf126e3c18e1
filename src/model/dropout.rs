//! Dropout whose masks come from the seed.

use crate::random;
use candle_core::{Result, Tensor};
use rand_chacha::rand_core::RngCore;

/// The masks of one training step.
#[derive(Debug, Clone, Copy)]
pub struct Dropout {
    /// Share that is dropped, below 1.
    pub share: f64,
    /// The run's seed.
    pub seed: u64,
    /// The step.
    pub step: u64,
    /// Number, in the step's batch, of the first sequence passed in.
    pub first: u64,
}

impl Dropout {
    /// Drops from `x`, whose first dimension is `batch` sequences (or a multiple: their heads).
    ///
    /// What is kept grows by 1/(1 - share). The mask is a function of (seed, `purpose`, step, sequence), so it doesn't
    /// matter how a batch is cut up.
    pub(super) fn apply(&self, x: &Tensor, batch: usize, purpose: &str) -> Result<Tensor> {
        let mask = self.mask(batch, x.elem_count() / batch.max(1), purpose);
        x.mul(&Tensor::from_vec(mask, x.shape(), x.device())?.to_dtype(x.dtype())?)
    }

    fn mask(&self, batch: usize, per_sequence: usize, purpose: &str) -> Vec<f32> {
        let keep = (1.0 / (1.0 - self.share)) as f32;
        // 16 bits a number: shares are met to 1 in 65,536
        let below = (self.share * 65_536.0).round() as u32;
        let mut mask = Vec::with_capacity(batch * per_sequence);
        for sequence in 0..batch as u64 {
            let mut rng = random::stream(self.seed, &format!("dropout {purpose}"), self.step, self.first + sequence);
            let mut bits = vec![0u8; 2 * per_sequence];
            rng.fill_bytes(&mut bits);
            let drawn = bits.chunks_exact(2).map(|b| u16::from_le_bytes([b[0], b[1]]) as u32);
            mask.extend(drawn.map(|x| if x < below { 0.0 } else { keep }));
        }
        mask
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_keep_their_share_and_belong_to_their_sequence() {
        let dropout = Dropout { share: 0.1, seed: 1, step: 5, first: 2 };
        let mask = dropout.mask(2, 50_000, "x");
        let dropped = mask.iter().filter(|&&m| m == 0.0).count() as f64 / 100_000.0;
        // sd 0.00095
        assert!((dropped - 0.1).abs() < 0.005, "{dropped}");
        assert!(mask.iter().all(|&m| m == 0.0 || (m - 1.0 / 0.9).abs() < 1e-6));
        assert_eq!(mask[50_000..], Dropout { first: 3, ..dropout }.mask(1, 50_000, "x"));
        assert_ne!(mask[50_000..], mask[..50_000]);
        assert_ne!(mask, dropout.mask(2, 50_000, "y"));
    }
}
