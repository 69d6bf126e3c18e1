//! What a model thinks of given tokens.

use super::config::{ModelConfig, TokenLayout};
use super::goal::Conditioning;
use super::gpt::Gpt;
use crate::Result;

/// A model of any form, on any device, that gives the likelihood of tokens.
pub trait Scores {
    /// Its `[model]` table.
    fn config(&self) -> &ModelConfig;

    /// What its tokenizer decided.
    fn tokens(&self) -> &TokenLayout;

    /// `out` (B, T) becomes -ln p of each of `targets` (B, T) in nats, 0 where the target is `<pad>`.
    ///
    /// `inputs` (B, T) are the tokens read, T = `length` is at most the context.
    ///
    /// # Errors
    /// Windows longer than the context, ids outside the vocabulary, what the device refuses.
    ///
    /// # Panics
    /// If the three are of different length, or not of whole windows.
    fn nats(&mut self, inputs: &[u32], targets: &[u32], length: usize, out: &mut [f32]) -> Result<()> {
        self.nats_conditioned((inputs, targets), length, None, out)
    }

    /// As [`Scores::nats`] of inputs and targets, with goal conditioning.
    ///
    /// # Errors
    /// As [`Scores::nats`]; conditioning of a model that has none, or of a reader.
    ///
    /// # Panics
    /// As [`Scores::nats`].
    fn nats_conditioned(
        &mut self,
        windows: (&[u32], &[u32]),
        length: usize,
        conditioning: Option<&Conditioning>,
        out: &mut [f32],
    ) -> Result<()>;
}

impl Scores for Gpt {
    fn config(&self) -> &ModelConfig {
        Gpt::config(self)
    }

    fn tokens(&self) -> &TokenLayout {
        Gpt::tokens(self)
    }

    fn nats_conditioned(
        &mut self,
        (inputs, targets): (&[u32], &[u32]),
        length: usize,
        conditioning: Option<&Conditioning>,
        out: &mut [f32],
    ) -> Result<()> {
        assert_eq!((inputs.len(), targets.len()), (out.len(), out.len()), "a target for every input and its nats");
        let ids = self.ids(inputs, length)?;
        let nats = self.frozen_nats(&ids, targets, conditioning)?.to_vec1::<f32>()?;
        out.copy_from_slice(&nats);
        Ok(())
    }
}
