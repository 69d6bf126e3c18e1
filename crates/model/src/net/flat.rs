//! One stack of blocks, in which every token is a row.

use super::Memory;
use super::block::Block;
use super::input::Input;
use crate::config::{ModelConfig, TokenLayout};
use crate::dropout::Dropout;
use crate::layout;
use crate::ops::Mask;
use candle_core::{Result, Tensor};
use candle_nn::VarBuilder;

#[derive(Clone)]
pub(super) struct Flat {
    heads: usize,
    input: Input,
    blocks: Vec<Block>,
}

impl Flat {
    pub fn new(config: &ModelConfig, tokens: &TokenLayout, vars: &VarBuilder) -> Result<Flat> {
        let block = |layer| Block::new(&vars.pp(layout::block_name(layer)));
        Ok(Flat {
            heads: config.heads,
            input: Input::new(config, tokens, vars)?,
            blocks: (0..config.layers).map(block).collect::<Result<_>>()?,
        })
    }

    /// (B, T, D) of `ids` (B, T), the last of each of `windows`.
    pub fn rows(
        &self,
        ids: &Tensor,
        windows: &[Vec<u32>],
        mask: &Mask,
        dropout: Option<&Dropout>,
        memory: Option<&Memory>,
    ) -> Result<Tensor> {
        let length = ids.dim(1)?;
        let before = memory.map_or(0, |m| m.before.len());
        let mut x = self.input.forward(ids, windows, before)?;
        if let Some(dropout) = dropout {
            x = dropout.apply(&x, "embedding")?;
        }
        let rotary = self.input.rotary(windows, before, x.dim(2)? / self.heads)?;
        let hiding = mask.hiding(length, before + length, x.dtype(), x.device())?;
        for (layer, block) in self.blocks.iter().enumerate() {
            let cached = memory.map(|m| (&m.keys[layer], &m.values[layer], before));
            x = block.forward(&x, self.heads, rotary.as_ref(), hiding.as_ref(), dropout, cached)?;
        }
        Ok(x)
    }
}
