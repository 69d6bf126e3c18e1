//! Token-by-token reading in the plain form: the keys and values of earlier tokens are cached.
//!
//! Flat models only. Blocks cut otherwise give logits that differ by rounding; the fast form ([`super::Reader`]) gives
//! the same bits.

use super::net::{Beside, Memory, Net};
use super::ops::Mask;
use crate::{Error, Result};
use candle_core::{DType, Device, IndexOp, Tensor};

/// One sequence being read by a model.
///
/// Known tokens are read in blocks of any length, so a window that slides is read again in one pass:
/// [`Cache::reset`], then [`Cache::read`] the window.
pub struct Cache {
    net: Net,
    keys: Vec<Tensor>,   // L x (1, H, T, d)
    values: Vec<Tensor>, // L x (1, H, T, d)
    context: usize,
    /// The tokens read.
    read: Vec<u32>,
}

impl Cache {
    pub(super) fn new(
        net: Net,
        layers: usize,
        heads: usize,
        context: usize,
        d: usize,
        device: &Device,
    ) -> Result<Cache> {
        let room = || -> Result<Vec<Tensor>> {
            // the whole context at once: growing by concatenation would copy all keys for every token
            (0..layers).map(|_| Ok(Tensor::zeros((1, heads, context, d), DType::F32, device)?)).collect()
        };
        Ok(Cache { net, keys: room()?, values: room()?, context, read: Vec::with_capacity(context) })
    }

    /// T: the most tokens it holds.
    pub fn context(&self) -> usize {
        self.context
    }

    /// Tokens read since the last reset.
    pub fn len(&self) -> usize {
        self.read.len()
    }

    /// Whether nothing was read since the last reset.
    pub fn is_empty(&self) -> bool {
        self.read.is_empty()
    }

    /// Forgets every token.
    pub fn reset(&mut self) {
        // keys and values stay where they are: tokens count by `read` alone, and the next ones overwrite them
        self.read.clear();
    }

    /// Forgets all but the first `length` tokens.
    pub fn truncate(&mut self, length: usize) {
        self.read.truncate(length);
    }

    /// Reads `tokens` after those read before; logits (V) of the token that follows the last.
    ///
    /// # Errors
    /// No tokens, more than the context has room for, ids outside the vocabulary.
    pub fn read(&mut self, tokens: &[u32]) -> Result<Vec<f32>> {
        let logits = self.read_all(tokens)?;
        Ok(logits.i(tokens.len() - 1)?.to_vec1()?)
    }

    /// As [`Cache::read`], with the logits (n, V) after each of the n tokens.
    ///
    /// # Errors
    /// As [`Cache::read`].
    pub fn read_all(&mut self, tokens: &[u32]) -> Result<Tensor> {
        let read = self.read.len();
        if tokens.is_empty() || read + tokens.len() > self.context {
            let name = format!("the number of tokens after {read}");
            return Err(Error::invalid(name, tokens.len(), format!("1 to {}", self.context - read)));
        }
        let ids = self.net.ids(tokens, tokens.len())?;
        let memory = Memory { keys: &self.keys, values: &self.values, before: &self.read };
        let logits = self.net.forward(&ids, &Mask::Causal, Beside::default(), Some(&memory))?;
        // after the pass: where it fails, the tokens don't count as read
        self.read.extend_from_slice(tokens);
        Ok(logits.squeeze(0)?)
    }
}
