//! Dropout whose masks come from the seed, for every form of the model.

use candle_core::{Result, Tensor};
use kinelm_engine::op::dropout;
use kinelm_store::random;
use rand_chacha::rand_core::RngCore;
use rayon::prelude::*;

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

/// The purpose of a mask, formatted once.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Purpose(String);

impl Purpose {
    /// By its name: see [`Dropout::key`].
    pub fn new(name: &str) -> Purpose {
        Purpose(format!("dropout {name}"))
    }
}

impl Dropout {
    /// What the mask of a tensor is made from, for one of the sequences passed in.
    ///
    /// Purposes: `embedding`, and of every block `block.00 attention` (the weights, row = head * T + query, column = key),
    /// `block.00 attention out` and `block.00 mlp` (row = token, column = feature, as for the embedding). The mask is a
    /// function of (seed, purpose, step, sequence, row, column): it doesn't matter how a batch is cut up or who computes.
    pub(crate) fn key(&self, purpose: &Purpose, sequence: usize) -> u64 {
        random::stream(self.seed, &purpose.0, self.step, self.first + sequence as u64).next_u64()
    }

    /// Drops from `x` (B, .., columns). Numbers that stay grow by 1/(1 - share).
    pub(super) fn apply(&self, x: &Tensor, purpose: &str) -> Result<Tensor> {
        let (batch, columns) = (x.dim(0)?, x.dim(candle_core::D::Minus1)?);
        // attention weights (B, H, T, T) have H T rows a sequence, everything else T
        let rows = x.elem_count() / (batch * columns).max(1);
        let mask = self.mask(batch, rows, columns, purpose);
        x.mul(&Tensor::from_vec(mask, x.shape(), x.device())?.to_dtype(x.dtype())?)
    }

    fn mask(&self, batch: usize, rows: usize, columns: usize, purpose: &str) -> Vec<f32> {
        let (keep, threshold) = (dropout::growth(self.share), dropout::threshold(self.share));
        let purpose = Purpose::new(purpose);
        let keys: Vec<u64> = (0..batch).map(|sequence| self.key(&purpose, sequence)).collect();
        let mut mask = vec![0.0; batch * rows * columns];
        mask.par_chunks_mut(columns.max(1)).enumerate().for_each(|(i, row)| {
            for (column, x) in row.iter_mut().enumerate() {
                if dropout::kept(keys[i / rows], (i % rows) as u64, column as u32, threshold) {
                    *x = keep;
                }
            }
        });
        mask
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_keep_their_share_and_belong_to_their_sequence() {
        let dropout = Dropout { share: 0.1, seed: 1, step: 5, first: 2 };
        let mask = dropout.mask(2, 500, 100, "x");
        let dropped = mask.iter().filter(|&&m| m == 0.0).count() as f64 / 100_000.0;
        // sd 0.00095
        assert!((dropped - 0.1).abs() < 0.005, "{dropped}");
        assert!(mask.iter().all(|&m| m == 0.0 || (m - 1.0 / 0.9).abs() < 1e-6));
        assert_eq!(mask[50_000..], Dropout { first: 3, ..dropout }.mask(1, 500, 100, "x"));
        assert_ne!(mask[50_000..], mask[..50_000]);
        assert_ne!(mask, dropout.mask(2, 500, 100, "y"));
    }
}
