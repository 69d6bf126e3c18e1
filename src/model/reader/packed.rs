//! A model's tensors by the names that the engine has for their uses.

use crate::Result;
use crate::model::config::{HeadKind, ModelConfig, Positions, TokenLayout};
use crate::model::gpt::Gpt;
use crate::model::layout;
use candle_core::{Device, Tensor};
use kinelm_engine::bins::Bins;
use kinelm_engine::decode::{
    Before, BlockParts, DecoderWeights, Pair, Parts, Positions as Tables, Previous, Relative, Rope, Sizes, WeightKind,
};
use std::collections::BTreeMap;

/// The weights of a model as the engine streams them.
pub(super) fn weights(gpt: &Gpt, kind: WeightKind) -> Result<DecoderWeights> {
    let (config, tokens) = (gpt.config(), gpt.tokens());
    let numbers =
        |tensor: &Tensor| -> Result<Vec<f32>> { Ok(tensor.to_device(&Device::Cpu)?.flatten_all()?.to_vec1::<f32>()?) };
    let tensors: BTreeMap<&str, Vec<f32>> =
        gpt.vars().iter().map(|(name, var)| Ok((name.as_str(), numbers(var.as_tensor())?))).collect::<Result<_>>()?;
    let get = |name: &str| tensors[name].as_slice();
    let some = |name: &str| tensors.get(name).map(Vec::as_slice).unwrap_or_default();
    let pair = |name: &str| -> Pair { (get(&format!("{name}.weight")), get(&format!("{name}.bias"))) };
    let block = |layer: usize| {
        let name = layout::block_name(layer);
        BlockParts {
            norm1: pair(&format!("{name}.norm1")),
            qkv: pair(&format!("{name}.attention.qkv")),
            out: pair(&format!("{name}.attention.out")),
            norm2: pair(&format!("{name}.norm2")),
            up: pair(&format!("{name}.mlp.up")),
            down: pair(&format!("{name}.mlp.down")),
        }
    };
    let token = get("token.weight");
    // a word of rope has no row of its own
    let (places, no_row) = (positions(config, tokens, &get), vec![0.0; config.width]);
    let counted = |word| Tables::Words {
        front: get("position.front.weight"),
        word,
        place: get("position.place.weight"),
        end: tokens.space,
    };
    let positions = match config.positions {
        Positions::FrameJoint if tokens.varying => counted(get("position.frame.weight")),
        Positions::Rope if tokens.varying => counted(&no_row),
        _ => Tables::Places(&places),
    };
    let word = (!tokens.varying).then_some(tokens.word);
    let bins: Vec<Bins> =
        tokens.place_ids().map(|kind| Bins { first: kind.first, count: kind.count, circular: kind.circular }).collect();
    let previous = config.reads_previous(tokens).then(|| Previous {
        character: get("previous.character.weight"),
        missing: tokens.pad,
        step: get("previous.step.weight"),
    });
    // a table exists only if such places do
    let (circular, clamped) = (some("head.circular.weight"), some("head.clamped.weight"));
    let relative = (config.head_of(tokens) == HeadKind::Relative).then_some(Relative { circular, clamped });
    let before = Before { front: tokens.front, places: &bins, previous, relative };
    let parts = Parts {
        sizes: Sizes {
            layers: config.layers,
            heads: config.heads,
            width: config.width,
            vocabulary: tokens.vocabulary,
            context: config.context,
        },
        token,
        positions,
        rope: (config.positions == Positions::Rope).then_some(Rope { front: tokens.front, word }),
        before: (previous.is_some() || relative.is_some()).then_some(before),
        blocks: (0..config.layers).map(block).collect(),
        norm: pair("norm"),
        head: if config.tied_head { token } else { get("head.weight") },
    };
    Ok(DecoderWeights::new(&parts, kind))
}

/// (T, D): what is added to the token at each place; nothing where words are counted.
fn positions<'a>(config: &ModelConfig, tokens: &TokenLayout, get: &dyn Fn(&str) -> &'a [f32]) -> Vec<f32> {
    let (width, word) = (config.width, tokens.word);
    let row = |name: &str, i: usize| &get(name)[i * width..][..width];
    let joint = |i: usize| -> Vec<f32> {
        match i.checked_sub(tokens.front) {
            None => row("position.front.weight", i).to_vec(),
            Some(i) => {
                let place = row("position.place.weight", i % word);
                match config.positions {
                    Positions::Rope => place.to_vec(),
                    _ => row("position.frame.weight", i / word).iter().zip(place).map(|(a, b)| a + b).collect(),
                }
            }
        }
    };
    match config.positions {
        Positions::Absolute => get("position.absolute.weight").to_vec(),
        _ if tokens.varying => Vec::new(),
        Positions::FrameJoint | Positions::Rope => (0..config.context).flat_map(joint).collect(),
    }
}
