//! A block: `middle = x + attention(norm1(x))`, `out = middle + mlp(norm2(middle))`.

use super::EPSILON;
use super::rotary::Rotary;
use crate::dropout::Dropout;
use crate::ops;
use crate::ops::Hiding;
use candle_core::{Result, Tensor};
use candle_nn::{Linear, Module, VarBuilder};

#[derive(Clone)]
pub(super) struct Block {
    name: String,
    norm1: Norm,
    qkv: Linear,
    out: Linear,
    norm2: Norm,
    up: Linear,
    down: Linear,
}

#[derive(Clone)]
pub(super) struct Norm {
    weight: Tensor,
    bias: Tensor,
}

impl Block {
    pub fn new(vars: &VarBuilder) -> Result<Block> {
        Ok(Block {
            name: vars.prefix(),
            norm1: Norm::new(&vars.pp("norm1"))?,
            qkv: linear(&vars.pp("attention.qkv"))?,
            out: linear(&vars.pp("attention.out"))?,
            norm2: Norm::new(&vars.pp("norm2"))?,
            up: linear(&vars.pp("mlp.up"))?,
            down: linear(&vars.pp("mlp.down"))?,
        })
    }

    /// (B, T, D) from (B, T, D). `cached`: earlier keys and values (1, H, T', d), and how many tokens they are of; the
    /// new ones are written after those.
    pub fn forward(
        &self,
        x: &Tensor,
        heads: usize,
        rotary: Option<&Rotary>,
        hiding: Option<&Hiding>,
        dropout: Option<&Dropout>,
        cached: Option<(&Tensor, &Tensor, usize)>,
    ) -> Result<Tensor> {
        let (batch, length, width) = x.dims3()?;
        let drop = |x: Tensor, part: &str| match dropout {
            Some(d) => d.apply(&x, &format!("{} {part}", self.name)),
            None => Ok(x),
        };
        let (mut q, mut k, mut v) = self.qkv(x, heads)?;
        if let Some(rotary) = rotary {
            // before caching: a key is rotated by its own word, whatever reads it later
            (q, k) = (rotary.apply(&q)?, rotary.apply(&k)?);
        }
        if let Some((keys, values, before)) = cached {
            (k, v) = (append(keys, &k, before)?, append(values, &v, before)?);
        }
        let scores = (q.matmul(&k.t()?)? / ((width / heads) as f64).sqrt())?;
        let weights = drop(ops::masked_softmax(&scores, hiding)?, "attention")?;
        // (B, H, T, d) -> (B, T, D)
        let mixed = weights.matmul(&v)?.transpose(1, 2)?.reshape((batch, length, width))?;
        let x = (x + drop(self.out.forward(&mixed)?, "attention out")?)?;
        &x + drop(self.mlp(&x)?, "mlp")?
    }

    /// Queries, keys and values (B, H, T, d).
    fn qkv(&self, x: &Tensor, heads: usize) -> Result<(Tensor, Tensor, Tensor)> {
        let (batch, length, width) = x.dims3()?;
        let all = self.qkv.forward(&self.norm1.forward(x)?)?.reshape((batch, length, 3, heads, width / heads))?;
        let one = |i| all.narrow(2, i, 1)?.squeeze(2)?.transpose(1, 2)?.contiguous();
        Ok((one(0)?, one(1)?, one(2)?))
    }

    fn mlp(&self, x: &Tensor) -> Result<Tensor> {
        self.down.forward(&ops::gelu(&self.up.forward(&self.norm2.forward(x)?)?)?)
    }
}

/// Writes `new` (1, H, n, d) into `cached` after the first `before`; returns all of them.
fn append(cached: &Tensor, new: &Tensor, before: usize) -> Result<Tensor> {
    cached.slice_set(new, 2, before)?;
    cached.narrow(2, 0, before + new.dim(2)?)
}

impl Norm {
    pub fn new(vars: &VarBuilder) -> Result<Norm> {
        Ok(Norm { weight: vars.get_unchecked("weight")?, bias: vars.get_unchecked("bias")? })
    }

    pub fn forward(&self, x: &Tensor) -> Result<Tensor> {
        ops::layer_norm(x, &self.weight, &self.bias, EPSILON)
    }
}

/// A linear layer. Our weights are (in, out), the library's (out, in).
pub(super) fn linear(vars: &VarBuilder) -> Result<Linear> {
    Ok(Linear::new(vars.get_unchecked("weight")?.t()?, Some(vars.get_unchecked("bias")?)))
}
