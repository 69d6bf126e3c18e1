//! The likelihood of given tokens under a model.

use super::config::{ModelConfig, TokenLayout};
use super::goal::Conditioning;
use super::gpt::Gpt;
use crate::Result;

/// Windows of T tokens, B of them, whose targets are scored.
#[derive(Debug, Clone, Copy)]
pub struct TokenWindows<'a> {
    /// (B, T) the tokens read.
    pub inputs: &'a [u32],
    /// (B, T) the tokens that follow; `<pad>` counts for nothing.
    pub targets: &'a [u32],
    /// T, at most the context.
    pub length: usize,
    /// (B, H W) the frames before each window, `<pad>` where there are none; empty: none before any. H is
    /// [`ModelConfig::history`].
    pub history: &'a [u32],
    /// Conditioning on goals or music.
    pub conditioning: Option<&'a Conditioning>,
}

/// A model of any form, on any device, that gives the likelihood of tokens.
pub trait Scores {
    /// Its `[model]` table.
    fn config(&self) -> &ModelConfig;

    /// The layout of its tokens.
    fn tokens(&self) -> &TokenLayout;

    /// `out` (B, T) becomes -ln p of each target in nats, 0 where it is `<pad>`.
    ///
    /// # Errors
    /// Windows longer than the context, ids outside the vocabulary, conditioning of a model that has none, or of a reader;
    /// what the device refuses.
    ///
    /// # Panics
    /// If inputs, targets and `out` are of different length, or not of whole windows.
    fn nats(&mut self, windows: TokenWindows, out: &mut [f32]) -> Result<()>;
}

impl Scores for Gpt {
    fn config(&self) -> &ModelConfig {
        Gpt::config(self)
    }

    fn tokens(&self) -> &TokenLayout {
        Gpt::tokens(self)
    }

    fn nats(&mut self, windows: TokenWindows, out: &mut [f32]) -> Result<()> {
        let TokenWindows { inputs, targets, length, history, conditioning } = windows;
        assert_eq!((inputs.len(), targets.len()), (out.len(), out.len()), "a target for every input and its nats");
        let ids = self.ids(inputs, length)?;
        let nats = self.frozen_nats(&ids, targets, history, conditioning)?.to_vec1::<f32>()?;
        out.copy_from_slice(&nats);
        Ok(())
    }
}
