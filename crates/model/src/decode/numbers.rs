//! A model's numbers by the names of its tensors, packed for decoding.

use crate::gpt::Gpt;
use crate::weights::{Array, Weights};
use crate::{Result, layout};
use kinelm_engine::arena::Floats;
use kinelm_engine::decode::{BlockParts, Norm, Pair, Stack, StackWeights, WeightKind};
use kinelm_engine::op::rope::Angles;

/// The numbers of all tensors.
pub(super) struct Numbers(Weights);

impl Numbers {
    /// # Errors
    /// If the weights can't be brought to the CPU.
    pub fn of(gpt: &Gpt) -> Result<Numbers> {
        Ok(Numbers(gpt.weights()?))
    }

    pub fn get(&self, name: &str) -> &[f32] {
        self.0[name].numbers()
    }

    /// Empty where the model has no such tensor.
    pub fn optional(&self, name: &str) -> &[f32] {
        self.0.get(name).map(Array::numbers).unwrap_or_default()
    }

    pub fn floats(&self, name: &str) -> Floats {
        Floats::of(self.get(name))
    }

    pub fn pair(&self, name: &str) -> Pair<'_> {
        (self.get(&format!("{name}.weight")), self.get(&format!("{name}.bias")))
    }

    pub fn norm(&self, name: &str, width: usize) -> Norm {
        Norm::new(self.pair(name), width)
    }

    /// The stack whose blocks' names begin with `prefix`.
    pub fn stack(&self, prefix: &str, stack: Stack, kind: WeightKind, angles: Option<Angles>) -> StackWeights {
        let block = |layer: usize| {
            let name = format!("{prefix}{}", layout::block_name(layer));
            BlockParts {
                norm1: self.pair(&format!("{name}.norm1")),
                qkv: self.pair(&format!("{name}.attention.qkv")),
                out: self.pair(&format!("{name}.attention.out")),
                norm2: self.pair(&format!("{name}.norm2")),
                up: self.pair(&format!("{name}.mlp.up")),
                down: self.pair(&format!("{name}.mlp.down")),
            }
        };
        let blocks: Vec<BlockParts> = (0..stack.layers).map(block).collect();
        StackWeights::new(&blocks, stack, kind, angles)
    }
}
