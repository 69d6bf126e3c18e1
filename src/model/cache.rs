//! Reading token after token: keys and values of what was read are kept.

use super::gpt::{Memory, Net};
use crate::{Error, Result};
use candle_core::{DType, Device, IndexOp, Tensor};
use rayon::{ThreadPool, ThreadPoolBuilder};

/// Blocks of so many tokens or fewer run on one thread: waking others costs more than their help brings.
const ALONE: usize = 8;

/// One sequence being read by a model.
///
/// Known tokens go in in blocks as long as one likes, so that a window that slides is read again in one go:
/// [`Cache::reset`], then [`Cache::read`] the window.
pub struct Cache {
    net: Net,
    keys: Vec<Tensor>,   // L x (H, T, D/H)
    values: Vec<Tensor>, // L x (H, T, D/H)
    context: usize,
    read: usize,
    alone: ThreadPool,
}

impl Cache {
    pub(super) fn new(net: Net, layers: usize, heads: usize, context: usize, d: usize) -> Result<Cache> {
        let room = || -> Result<Vec<Tensor>> {
            let one = |_| Ok(Tensor::zeros((heads, context, d), DType::F32, &Device::Cpu)?);
            (0..layers).map(one).collect()
        };
        let alone = ThreadPoolBuilder::new().num_threads(1).build();
        let alone = alone.map_err(|e| Error::Call(format!("no thread to read with: {e}")))?;
        Ok(Cache { net, keys: room()?, values: room()?, context, read: 0, alone })
    }

    /// T: the most tokens it holds.
    pub fn context(&self) -> usize {
        self.context
    }

    /// Tokens read since the last reset.
    pub fn len(&self) -> usize {
        self.read
    }

    /// Whether nothing was read since the last reset.
    pub fn is_empty(&self) -> bool {
        self.read == 0
    }

    /// Forgets every token.
    pub fn reset(&mut self) {
        self.read = 0;
    }

    /// Forgets all but the first `length` tokens.
    pub fn truncate(&mut self, length: usize) {
        self.read = self.read.min(length);
    }

    /// Reads `tokens` behind those read before; logits (V) of the token that follows the last.
    ///
    /// # Errors
    /// No tokens, more than the context has room for, ids outside the vocabulary.
    pub fn read(&mut self, tokens: &[u32]) -> Result<Vec<f32>> {
        let logits = self.read_all(tokens)?;
        Ok(logits.i(tokens.len() - 1)?.to_vec1()?)
    }

    /// As [`Cache::read`], with the logits (n, V) behind every one of the n tokens.
    ///
    /// # Errors
    /// As [`Cache::read`].
    pub fn read_all(&mut self, tokens: &[u32]) -> Result<Tensor> {
        if tokens.is_empty() || self.read + tokens.len() > self.context {
            return Err(Error::Call(format!(
                "{} more tokens behind {} read; expected 1 to {}",
                tokens.len(),
                self.read,
                self.context - self.read
            )));
        }
        let ids = Tensor::from_slice(tokens, (1, tokens.len()), &Device::Cpu)?;
        let memory = Memory { keys: &self.keys, values: &self.values, read: self.read };
        let forward = || self.net.forward(&ids, None, Some(&memory));
        let logits = if tokens.len() <= ALONE { self.alone.install(forward) } else { forward() }?;
        self.read += tokens.len();
        Ok(logits.squeeze(0)?)
    }
}
