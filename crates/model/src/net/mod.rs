//! The plain form: embedded inputs, blocks of attention and a perceptron, a head, from tensors by their use.
//!
//! Linear layers and tables are candle-nn's, and its `VarBuilder` finds their tensors by name. Three more of its parts don't
//! serve: its initialisers can't be seeded on the CPU (ours are [`crate::weights::initial`], a random stream a tensor), its
//! `VarMap` has a hash's order (a model's variables are sorted by name), and [`crate::ops`] says which of its operations cut
//! the graph or are inexact.
//!
//! Letters: B batch, T tokens, D width, H heads, d = D/H, L layers, V vocabulary, W tokens of a word, K of the front.

mod block;
mod flat;
mod head;
mod input;
mod rotary;
mod two_level;

use super::config::Architecture;
use super::config::{ModelConfig, ModelKind, TokenLayout};
use super::dropout::Dropout;
use super::forecast::Forecast;
use super::goal::Conditioning;
use super::ops::Mask;
use super::sequence::Sequences;
use crate::{Error, Result};
use block::Norm;
use candle_core::{Device, Tensor};
use candle_nn::{Embedding, Module, VarBuilder};
use flat::Flat;
use head::Head;
use kinelm_engine::op::smoothing::Smoothing;
use std::collections::HashMap;
use std::sync::Arc;
use two_level::TwoLevel;

/// Added to the variance in layer norms, as in GPT-2.
pub const EPSILON: f64 = 1e-5;

/// The tensors by their use. A clone shares the numbers.
#[derive(Clone)]
pub(super) struct Net {
    config: ModelConfig,
    tokens: TokenLayout,
    forecast: Option<Arc<Forecast>>,
    kind: ModelKind,
    body: Body,
    norm: Norm,
    head: Head,
}

/// The part of a model that makes a row of every token.
#[derive(Clone)]
enum Body {
    Flat(Flat),
    TwoLevel(TwoLevel),
}

/// The tokens read earlier, with their keys and values.
pub(super) struct Memory<'a> {
    /// Keys and values (1, H, T, d) of every layer, filled from the front; keys are rotated.
    pub keys: &'a [Tensor],
    pub values: &'a [Tensor],
    /// The ids, from the window's first on.
    pub before: &'a [u32],
}

/// Inputs of a pass beside the ids.
#[derive(Clone, Copy, Default)]
pub(super) struct Beside<'a> {
    /// (B, H W) the frames before the windows; empty: none.
    pub history: &'a [u32],
    /// The dropout, if any.
    pub dropout: Option<&'a Dropout>,
    /// The goal conditioning of frames.
    pub conditioning: Option<&'a Conditioning>,
}

impl Net {
    /// Of `tensors`, which are the model's.
    pub(super) fn new<'a>(
        config: &ModelConfig,
        tokens: &TokenLayout,
        tensors: impl Iterator<Item = (&'a String, Tensor)>,
        forecast: Option<Arc<Forecast>>,
    ) -> Result<Net> {
        let tensors: HashMap<String, Tensor> = tensors.map(|(name, tensor)| (name.clone(), tensor)).collect();
        // every model has it, and all tensors share its type and device
        let table = &tensors[config.ids_table()];
        let (dtype, device) = (table.dtype(), table.device().clone());
        let vars = &VarBuilder::from_tensors(tensors, dtype, &device);
        Ok(Net {
            config: config.clone(),
            tokens: tokens.clone(),
            forecast,
            kind: config.kind,
            body: match config.architecture {
                Architecture::Flat => Body::Flat(Flat::new(config, tokens, vars)?),
                Architecture::TwoLevel => Body::TwoLevel(TwoLevel::new(config, tokens, vars)?),
            },
            norm: Norm::new(&vars.pp("norm"))?,
            head: Head::new(config, tokens, vars)?,
        })
    }

    pub(super) fn device(&self) -> &Device {
        self.head.ids().device()
    }

    /// The mask of attention.
    pub(super) fn mask(&self) -> Mask {
        match self.kind {
            ModelKind::Causal => Mask::Causal,
            ModelKind::Masked => Mask::Full,
        }
    }

    /// Ids (B, T), T = `length`, on the model's device.
    pub(super) fn ids(&self, ids: &[u32], length: usize) -> Result<Tensor> {
        assert!(length > 0 && ids.len().is_multiple_of(length), "{} ids in windows of {length}", ids.len());
        let vocabulary = self.head.ids().dim(0)?;
        match ids.iter().find(|&&id| id as usize >= vocabulary) {
            Some(id) => Err(Error::invalid("a token", format!("id {id}"), format!("ids below {vocabulary}"))),
            None => Ok(Tensor::from_slice(ids, (ids.len() / length, length), self.device())?),
        }
    }

    /// Logits (B, T, V), minus infinity where an id can't come; with a memory, B is 1 and `ids` continue what was read.
    pub(super) fn forward(&self, ids: &Tensor, mask: &Mask, beside: Beside, memory: Option<&Memory>) -> Result<Tensor> {
        let (batch, length) = ids.dims2()?;
        let windows = windows(ids, memory)?;
        let sequences = self.sequences(&windows, beside);
        let hidden = self.hidden(ids, &windows, &sequences, mask, beside, memory)?;
        let before = memory.map_or(0, |m| m.before.len());
        Ok(self.head.logits(&hidden, &sequences, before..before + length)?.reshape((batch, length, ()))?)
    }

    /// -ln p of each of `targets` (N), in nats, 0 where it is `<pad>`. With `smoothing` the numbers are the same, and their
    /// gradient is that of the cross-entropy with the smoothed targets.
    pub(super) fn nats(
        &self,
        ids: &Tensor,
        targets: &[u32],
        beside: Beside,
        smoothing: Option<&Smoothing>,
    ) -> Result<Tensor> {
        let windows = windows(ids, None)?;
        let sequences = self.sequences(&windows, beside);
        let hidden = self.hidden(ids, &windows, &sequences, &self.mask(), beside, None)?;
        self.head.nats(&hidden, &sequences, targets, smoothing)
    }

    /// The output of the final norm (N, D); of a two-level model the trunk's, a row a frame.
    pub(super) fn final_vectors(&self, ids: &Tensor, mask: &Mask) -> Result<Tensor> {
        let windows = windows(ids, None)?;
        let sequences = self.sequences(&windows, Beside::default());
        match &self.body {
            Body::Flat(_) => Ok(self.hidden(ids, &windows, &sequences, mask, Beside::default(), None)?),
            Body::TwoLevel(levels) => Ok(levels.vectors(&windows, &sequences, mask)?.flatten_to(1)?),
        }
    }

    /// Windows of one length in their sequences.
    fn sequences(&self, windows: &[Vec<u32>], beside: Beside) -> Sequences {
        let mut sequences = Sequences::new(&self.config, &self.tokens, windows.len(), windows[0].len());
        sequences.fill(&windows.concat(), beside.history, self.forecast.as_deref());
        sequences
    }

    fn hidden(
        &self,
        ids: &Tensor,
        windows: &[Vec<u32>],
        sequences: &Sequences,
        mask: &Mask,
        beside: Beside,
        memory: Option<&Memory>,
    ) -> candle_core::Result<Tensor> {
        let x = match &self.body {
            Body::Flat(flat) => flat.rows(ids, windows, mask, beside.dropout, memory)?,
            Body::TwoLevel(levels) => levels.rows(windows, sequences, mask, beside)?,
        };
        self.norm.forward(&x)?.flatten_to(1)
    }
}

/// The table of this name.
fn table(vars: &VarBuilder, name: &str) -> candle_core::Result<Embedding> {
    let rows = vars.get_unchecked(name)?;
    let width = rows.dim(1)?;
    Ok(Embedding::new(rows, width))
}

/// Rows (N, D) of a table.
fn rows_of(table: &Embedding, ids: Vec<u32>) -> candle_core::Result<Tensor> {
    table.forward(&Tensor::new(ids, table.embeddings().device())?)
}

/// The ids of every window, from its first on.
fn windows(ids: &Tensor, memory: Option<&Memory>) -> candle_core::Result<Vec<Vec<u32>>> {
    let mut windows = ids.to_vec2::<u32>()?;
    if let Some(memory) = memory {
        windows.iter_mut().for_each(|w| *w = [memory.before, w].concat());
    }
    Ok(windows)
}
