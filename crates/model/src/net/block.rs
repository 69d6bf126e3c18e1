//! A block: `middle = x + attention(norm1(x))`, `out = middle + mlp(norm2(middle))`.

use super::EPSILON;
use super::rotary::Rotary;
use crate::dropout::Dropout;
use crate::ops;
use crate::ops::Hiding;
use candle_core::{Result, Tensor};

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

#[derive(Clone)]
pub(super) struct Linear {
    weight: Tensor, // (in, out)
    bias: Tensor,
}

impl Block {
    pub fn new(name: String, tensor: &dyn Fn(&str) -> Tensor) -> Block {
        let linear = |part: &str| Linear::new(&format!("{name}.{part}"), tensor);
        Block {
            norm1: Norm::new(&format!("{name}.norm1"), tensor),
            qkv: linear("attention.qkv"),
            out: linear("attention.out"),
            norm2: Norm::new(&format!("{name}.norm2"), tensor),
            up: linear("mlp.up"),
            down: linear("mlp.down"),
            name,
        }
    }

    /// (B, T, D) from (B, T, D). `kept`: keys and values (1, H, T', d) that were kept, and how many tokens they are of; the
    /// new ones are written behind them.
    pub fn forward(
        &self,
        x: &Tensor,
        heads: usize,
        rotary: Option<&Rotary>,
        hiding: Option<&Hiding>,
        dropout: Option<&Dropout>,
        kept: Option<(&Tensor, &Tensor, usize)>,
    ) -> Result<Tensor> {
        let (batch, length, width) = x.dims3()?;
        let drop = |x: Tensor, part: &str| match dropout {
            Some(d) => d.apply(&x, &format!("{} {part}", self.name)),
            None => Ok(x),
        };
        let (mut q, mut k, mut v) = self.qkv(x, heads)?;
        if let Some(rotary) = rotary {
            (q, k) = (rotary.apply(&q)?, rotary.apply(&k)?);
        }
        if let Some((keys, values, before)) = kept {
            (k, v) = (behind(keys, &k, before)?, behind(values, &v, before)?);
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

/// Writes `new` (1, H, n, d) behind the first `before` that are `kept`; gives them all.
fn behind(kept: &Tensor, new: &Tensor, before: usize) -> Result<Tensor> {
    kept.slice_set(new, 2, before)?;
    kept.narrow(2, 0, before + new.dim(2)?)
}

impl Norm {
    pub fn new(name: &str, tensor: &dyn Fn(&str) -> Tensor) -> Norm {
        Norm { weight: tensor(&format!("{name}.weight")), bias: tensor(&format!("{name}.bias")) }
    }

    pub fn forward(&self, x: &Tensor) -> Result<Tensor> {
        ops::layer_norm(x, &self.weight, &self.bias, EPSILON)
    }
}

impl Linear {
    pub fn new(name: &str, tensor: &dyn Fn(&str) -> Tensor) -> Linear {
        Linear { weight: tensor(&format!("{name}.weight")), bias: tensor(&format!("{name}.bias")) }
    }

    pub fn forward(&self, x: &Tensor) -> Result<Tensor> {
        let (batch, length, _) = x.dims3()?;
        // one product of 2-D views; a batched one would copy the weight for every sequence
        x.flatten_to(1)?.matmul(&self.weight)?.broadcast_add(&self.bias)?.reshape((batch, length, ()))
    }
}
