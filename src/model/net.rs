//! What the plain form computes: blocks of attention and a perceptron, from tensors by their use.
//!
//! Letters: B batch, T tokens, D width, H heads, d = D/H, L layers, V vocabulary, W tokens of a word.

use super::config::{ModelConfig, Positions, TokenLayout};
use super::dropout::Dropout;
use super::layout;
use super::ops::{self, Mask};
use super::position::{Counter, Stand};
use crate::{Error, Result};
use candle_core::{Device, Tensor};

/// Added to the variance in layer norms, as in GPT-2.
pub const EPSILON: f64 = 1e-5;

/// The tensors by their use. A clone shares the numbers.
#[derive(Clone)]
pub(super) struct Net {
    heads: usize,
    token: Tensor,
    position: Position,
    blocks: Vec<Block>,
    norm: Norm,
    head: Tensor,
}

#[derive(Clone)]
enum Position {
    Absolute(Tensor),
    FrameJoint { front: Tensor, frame: Tensor, place: Tensor, counter: Option<Counter> },
}

#[derive(Clone)]
struct Block {
    name: String,
    norm1: Norm,
    qkv: Linear,
    out: Linear,
    norm2: Norm,
    up: Linear,
    down: Linear,
}

#[derive(Clone)]
struct Norm {
    weight: Tensor,
    bias: Tensor,
}

#[derive(Clone)]
struct Linear {
    weight: Tensor, // (in, out)
    bias: Tensor,
}

/// Keys and values (1, H, T, d) of every layer, filled from the front.
pub(super) struct Memory<'a> {
    pub keys: &'a [Tensor],
    pub values: &'a [Tensor],
    /// Tokens read before.
    pub read: usize,
    /// Where the next one stands, if words are counted.
    pub stand: Stand,
}

impl Net {
    pub(super) fn new(config: &ModelConfig, tokens: &TokenLayout, tensor: &dyn Fn(&str) -> Tensor) -> Net {
        let norm =
            |name: &str| Norm { weight: tensor(&format!("{name}.weight")), bias: tensor(&format!("{name}.bias")) };
        let linear =
            |name: &str| Linear { weight: tensor(&format!("{name}.weight")), bias: tensor(&format!("{name}.bias")) };
        let block = |layer| {
            let name = layout::block_name(layer);
            Block {
                norm1: norm(&format!("{name}.norm1")),
                qkv: linear(&format!("{name}.attention.qkv")),
                out: linear(&format!("{name}.attention.out")),
                norm2: norm(&format!("{name}.norm2")),
                up: linear(&format!("{name}.mlp.up")),
                down: linear(&format!("{name}.mlp.down")),
                name,
            }
        };
        let position = match config.positions {
            Positions::Absolute => Position::Absolute(tensor("position.absolute.weight")),
            Positions::FrameJoint => Position::FrameJoint {
                front: tensor("position.front.weight"),
                frame: tensor("position.frame.weight"),
                place: tensor("position.place.weight"),
                counter: Counter::of(config, tokens),
            },
        };
        Net {
            heads: config.heads,
            token: tensor("token.weight"),
            position,
            blocks: (0..config.layers).map(block).collect(),
            norm: norm("norm"),
            head: tensor(if config.tied_head { "token.weight" } else { "head.weight" }),
        }
    }

    /// How words are counted, if they are.
    pub(super) fn counter(&self) -> Option<Counter> {
        match self.position {
            Position::FrameJoint { counter, .. } => counter,
            Position::Absolute(_) => None,
        }
    }

    pub(super) fn device(&self) -> &Device {
        self.token.device()
    }

    /// Ids (B, T), T = `length`, on the model's device.
    pub(super) fn ids(&self, ids: &[u32], length: usize) -> Result<Tensor> {
        assert!(length > 0 && ids.len().is_multiple_of(length), "{} ids in windows of {length}", ids.len());
        let vocabulary = self.token.dim(0)?;
        match ids.iter().find(|&&id| id as usize >= vocabulary) {
            Some(id) => Err(Error::Call(format!("id {id} outside the vocabulary of {vocabulary} ids"))),
            None => Ok(Tensor::from_slice(ids, (ids.len() / length, length), self.token.device())?),
        }
    }

    /// Logits (B, T, V); with a memory, B is 1 and `ids` continue what was read.
    pub(super) fn forward(
        &self,
        ids: &Tensor,
        mask: &Mask,
        dropout: Option<&Dropout>,
        memory: Option<&Memory>,
    ) -> candle_core::Result<Tensor> {
        let (batch, length) = ids.dims2()?;
        let width = self.token.dim(1)?;
        let drop = |x: Tensor, purpose: &str| match dropout {
            Some(d) => d.apply(&x, purpose),
            None => Ok(x),
        };
        let token = self.token.index_select(&ids.flatten_all()?, 0)?.reshape((batch, length, width))?;
        let before = memory.map_or(0, |m| m.read);
        let hiding = mask.hiding(length, before + length, self.token.dtype(), self.token.device())?;
        let position = self.position.rows(before, ids, memory.map_or(Stand::default(), |m| m.stand))?;
        let mut x = drop(token.broadcast_add(&position)?, "embedding")?;
        for (layer, block) in self.blocks.iter().enumerate() {
            let (q, mut k, mut v) = block.qkv(&x, self.heads)?;
            if let Some(memory) = memory {
                (k, v) = memory.append(layer, &k, &v)?;
            }
            let scores = (q.matmul(&k.t()?)? / ((width / self.heads) as f64).sqrt())?;
            let weights = drop(ops::masked_softmax(&scores, hiding.as_ref())?, &format!("{} attention", block.name))?;
            // (B, H, T, d) -> (B, T, D)
            let mixed = weights.matmul(&v)?.transpose(1, 2)?.reshape((batch, length, width))?;
            x = (x + drop(block.out.forward(&mixed)?, &format!("{} attention out", block.name))?)?;
            x = (&x + drop(block.mlp(&x)?, &format!("{} mlp", block.name))?)?;
        }
        let x = self.norm.forward(&x)?.flatten_to(1)?;
        x.matmul(&self.head.t()?)?.reshape((batch, length, ()))
    }
}

impl Memory<'_> {
    /// Writes `k` and `v` (1, H, T, d) behind those read before; gives all that were read.
    fn append(&self, layer: usize, k: &Tensor, v: &Tensor) -> candle_core::Result<(Tensor, Tensor)> {
        let all = |kept: &Tensor, new: &Tensor| {
            kept.slice_set(new, 2, self.read)?;
            kept.narrow(2, 0, self.read + new.dim(2)?)
        };
        Ok((all(&self.keys[layer], k)?, all(&self.values[layer], v)?))
    }
}

impl Position {
    /// Rows (n, D) of the places `first..first + n` of `ids` (B, n), or (B, n, D) where words are counted; the first id
    /// stands at `stand` then.
    fn rows(&self, first: usize, ids: &Tensor, stand: Stand) -> candle_core::Result<Tensor> {
        let (batch, n) = ids.dims2()?;
        let Position::FrameJoint { front, frame, place, counter } = self else {
            let Position::Absolute(table) = self else { unreachable!("there are two kinds") };
            return table.narrow(0, first, n);
        };
        let (all, rows) = (front.dim(0)?, n);
        let fronts = all.saturating_sub(first).min(rows);
        let sum = |words: Vec<u32>, places: Vec<u32>| {
            let rows = |table: &Tensor, ids: Vec<u32>| table.index_select(&Tensor::new(ids, table.device())?, 0);
            rows(frame, words)? + rows(place, places)?
        };
        let Some(counter) = counter else {
            let word = place.dim(0)?;
            let behind = |f: &dyn Fn(usize) -> usize| (first.max(all)..first + n).map(|i| f(i - all) as u32).collect();
            let words = || sum(behind(&|k| k / word), behind(&|k| k % word));
            return match fronts {
                0 => words(),
                whole if whole == n => front.narrow(0, first, n),
                some => Tensor::cat(&[front.narrow(0, first, some)?, words()?], 0),
            };
        };
        let front = || front.narrow(0, first, fronts)?.unsqueeze(0)?.broadcast_as((batch, fronts, front.dim(1)?));
        if fronts == n {
            return front();
        }
        let (words, places) = counted(*counter, &ids.narrow(1, fronts, n - fronts)?.to_vec2()?, stand);
        let words = sum(words, places)?.reshape((batch, n - fronts, ()))?;
        if fronts == 0 { Ok(words) } else { Tensor::cat(&[front()?, words], 1) }
    }
}

/// Rows of the tables of words and of places for all `windows`, which begin at `stand`.
fn counted(counter: Counter, windows: &[Vec<u32>], stand: Stand) -> (Vec<u32>, Vec<u32>) {
    let row = |at: &mut Stand, id: u32| {
        let [word, place] = counter.rows(*at);
        *at = counter.after(*at, id);
        (word, place)
    };
    let window = |ids: &Vec<u32>| {
        let mut at = stand;
        ids.iter().map(|&id| row(&mut at, id)).collect::<Vec<_>>()
    };
    windows.iter().flat_map(window).unzip()
}

impl Block {
    /// Queries, keys and values (B, H, T, d).
    fn qkv(&self, x: &Tensor, heads: usize) -> candle_core::Result<(Tensor, Tensor, Tensor)> {
        let (batch, length, width) = x.dims3()?;
        let all = self.qkv.forward(&self.norm1.forward(x)?)?.reshape((batch, length, 3, heads, width / heads))?;
        let one = |i| all.narrow(2, i, 1)?.squeeze(2)?.transpose(1, 2)?.contiguous();
        Ok((one(0)?, one(1)?, one(2)?))
    }

    fn mlp(&self, x: &Tensor) -> candle_core::Result<Tensor> {
        self.down.forward(&ops::gelu(&self.up.forward(&self.norm2.forward(x)?)?)?)
    }
}

impl Norm {
    fn forward(&self, x: &Tensor) -> candle_core::Result<Tensor> {
        ops::layer_norm(x, &self.weight, &self.bias, EPSILON)
    }
}

impl Linear {
    fn forward(&self, x: &Tensor) -> candle_core::Result<Tensor> {
        let (batch, length, _) = x.dims3()?;
        // one product of 2-D views; a batched one would copy the weight for every sequence
        x.flatten_to(1)?.matmul(&self.weight)?.broadcast_add(&self.bias)?.reshape((batch, length, ()))
    }
}
