//! A model's tensors by the names that the engine has for their uses.

use crate::config::{HeadKind, ModelConfig, Positions, TokenLayout};
use crate::frames::SPELT;
use crate::gpt::Gpt;
use crate::{Result, layout};
use candle_core::{Device, Tensor};
use kinelm_engine::decode::{
    Before, BlockParts, ConditioningParts, DecoderWeights, FrameParts, FrameSizes, FrameWeights, Pair, Parts,
    Positions as Tables, Previous, Relative, Rope, Sizes, Stack, WeightKind,
};
use std::collections::BTreeMap;

/// A model's numbers by the names of its tensors.
struct Numbers<'a>(BTreeMap<&'a str, Vec<f32>>);

impl<'a> Numbers<'a> {
    fn of(gpt: &'a Gpt) -> Result<Numbers<'a>> {
        let numbers = |tensor: &Tensor| -> Result<Vec<f32>> {
            Ok(tensor.to_device(&Device::Cpu)?.flatten_all()?.to_vec1::<f32>()?)
        };
        let all = gpt.vars().iter().map(|(name, var)| Ok((name.as_str(), numbers(var.as_tensor())?)));
        all.collect::<Result<_>>().map(Numbers)
    }

    fn get(&self, name: &str) -> &[f32] {
        &self.0[name]
    }

    /// Nothing where the model has no such tensor.
    fn some(&self, name: &str) -> &[f32] {
        self.0.get(name).map(Vec::as_slice).unwrap_or_default()
    }

    fn pair(&self, name: &str) -> Pair<'_> {
        (self.get(&format!("{name}.weight")), self.get(&format!("{name}.bias")))
    }

    /// The blocks whose names begin with `prefix`.
    fn blocks(&self, prefix: &str, layers: usize) -> Vec<BlockParts<'_>> {
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
        (0..layers).map(block).collect()
    }

    /// A table exists only if such places do.
    fn relative(&self) -> Relative<'_> {
        Relative { circular: self.some("head.circular.weight"), clamped: self.some("head.clamped.weight") }
    }
}

/// The weights of a two-level model as the engine streams them.
pub(super) fn frame_weights(gpt: &Gpt, kind: WeightKind) -> Result<FrameWeights> {
    let (config, tokens, numbers) = (gpt.config(), gpt.tokens(), Numbers::of(gpt)?);
    let (decoder, places) = (config.decoder(), tokens.bins());
    let [last, place, back, step] = SPELT.map(|name| numbers.get(name));
    // the numbers that are told ahead, and behind them those of music
    let [trunk, speller, tables @ ..] = layout::GOAL.map(|name| numbers.some(name));
    let music = layout::MUSIC.map(|name| numbers.some(name));
    let conditioning = [[trunk, music[0]].concat(), [speller, music[1]].concat()];
    let parts = FrameParts {
        sizes: FrameSizes {
            trunk: Stack { layers: config.layers, heads: config.heads, width: config.width },
            speller: Stack { layers: decoder.layers, heads: decoder.heads, width: decoder.width },
            character: decoder.character_width,
            vocabulary: tokens.vocabulary,
            frames: config.frames(tokens),
            front: tokens.front,
        },
        places: &places,
        bins: numbers.get("frame.character.weight"),
        frames: numbers.pair("frame.join"),
        positions: numbers.get("frame.position.weight"),
        labels: [layout::LABEL, layout::SPELT_LABEL].map(|name| numbers.some(name)),
        trunk: numbers.blocks(layout::TRUNK, config.layers),
        trunk_norm: numbers.pair("trunk.norm"),
        join: numbers.pair("spell.frame"),
        last,
        place,
        back,
        step,
        speller: numbers.blocks(layout::SPELL, decoder.layers),
        norm: numbers.pair("norm"),
        head: numbers.get(config.ids_table()),
        relative: numbers.relative(),
        conditioning: config.is_conditioned().then_some(ConditioningParts {
            trunk: &conditioning[0],
            speller: &conditioning[1],
            rows: tables,
        }),
    };
    Ok(FrameWeights::new(&parts, kind))
}

/// The weights of a flat model as the engine streams them.
pub(super) fn weights(gpt: &Gpt, kind: WeightKind) -> Result<DecoderWeights> {
    let (config, tokens, numbers) = (gpt.config(), gpt.tokens(), Numbers::of(gpt)?);
    let get = |name: &str| numbers.get(name);
    let token = get("token.weight");
    // a word of rope has no row of its own
    let (places, no_row) = (positions(config, tokens, &numbers), vec![0.0; config.width]);
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
    let bins = tokens.bins();
    let previous = config.reads_previous(tokens).then(|| Previous {
        character: get("previous.character.weight"),
        missing: tokens.pad,
        step: get("previous.step.weight"),
    });
    let relative = (config.head_of(tokens) == HeadKind::Relative).then(|| numbers.relative());
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
        blocks: numbers.blocks("", config.layers),
        norm: numbers.pair("norm"),
        head: get(config.ids_table()),
    };
    Ok(DecoderWeights::new(&parts, kind))
}

/// (T, D): what is added to the token at each place; nothing where words are counted.
fn positions(config: &ModelConfig, tokens: &TokenLayout, numbers: &Numbers) -> Vec<f32> {
    let (width, word) = (config.width, tokens.word);
    let row = |name: &str, i: usize| &numbers.get(name)[i * width..][..width];
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
        Positions::Absolute => numbers.get("position.absolute.weight").to_vec(),
        _ if tokens.varying => Vec::new(),
        Positions::FrameJoint | Positions::Rope => (0..config.context).flat_map(joint).collect(),
    }
}
