//! Reading tokens with the engine: the fast form of [`super::Cache`], on the CPU.

use super::config::{ModelConfig, Positions, TokenLayout};
use super::gpt::Gpt;
use super::layout;
use super::scores::Scores;
use crate::{Error, Result};
use candle_core::{Device, Tensor};
use kinelm_engine::decode::{
    BlockParts, Decoder, DecoderWeights, KvKind, Logits, Pair, Parts, Positions as Tables, Shape, WeightKind,
};
use kinelm_engine::op::cross_entropy;
use std::collections::BTreeMap;
use std::sync::Arc;

/// How a model is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Reading {
    /// Sequences side by side; they share every read of a weight.
    pub streams: usize,
    /// How the weights are held.
    pub weights: WeightKind,
    /// How keys and values are held.
    pub kv: KvKind,
}

impl Default for Reading {
    fn default() -> Reading {
        Reading { streams: 1, weights: WeightKind::F32, kv: KvKind::F32 }
    }
}

/// Sequences that a model reads side by side.
pub struct Reader {
    config: ModelConfig,
    tokens: TokenLayout,
    decoder: Decoder,
}

impl Reader {
    /// A reader with the weights of a model, packed.
    ///
    /// # Errors
    /// No sequences; weights that can't be brought to the CPU.
    pub fn new(gpt: &Gpt, reading: Reading) -> Result<Reader> {
        if reading.streams == 0 {
            return Err(Error::Call("0 sequences to read; expected at least one".into()));
        }
        gpt.config().refuse_new(gpt.tokens())?;
        let weights = Arc::new(packed(gpt, reading.weights)?);
        let decoder = Decoder::new(weights, reading.streams, reading.kv);
        Ok(Reader { config: gpt.config().clone(), tokens: gpt.tokens().clone(), decoder })
    }

    /// T: the most tokens of a sequence.
    pub fn context(&self) -> usize {
        self.config.context
    }

    /// Sequences.
    pub fn streams(&self) -> usize {
        self.decoder.streams()
    }

    /// Bytes of weights that are read for a token.
    pub fn weight_bytes(&self) -> usize {
        self.decoder.weights().bytes()
    }

    /// A sequence forgets all but its first `length` tokens.
    ///
    /// # Panics
    /// A sequence that is not there.
    pub fn truncate(&mut self, stream: usize, length: usize) {
        self.decoder.truncate(stream, length);
    }

    /// Reads a block of tokens a sequence, which may be empty; logits (rows, V), the rows in the order of the sequences.
    ///
    /// Blocks cut otherwise give the same bits.
    ///
    /// # Errors
    /// Not a block a sequence, more tokens than the context has room for, ids outside the vocabulary.
    pub fn read(&mut self, blocks: &[&[u32]], wanted: Logits) -> Result<&[f32]> {
        if blocks.len() != self.streams() {
            return Err(Error::Call(format!("{} blocks of tokens for {} sequences", blocks.len(), self.streams())));
        }
        for (stream, block) in blocks.iter().enumerate() {
            let (read, context) = (self.decoder.len(stream), self.config.context);
            if read + block.len() > context {
                return Err(Error::Call(format!(
                    "{} more tokens behind {read} read; expected at most {}",
                    block.len(),
                    context - read
                )));
            }
            let vocabulary = self.tokens.vocabulary;
            if let Some(id) = block.iter().find(|&&id| id as usize >= vocabulary) {
                return Err(Error::Call(format!("token {id} is outside the vocabulary of {vocabulary} ids")));
            }
        }
        Ok(self.decoder.read(blocks, wanted))
    }
}

impl Scores for Reader {
    fn config(&self) -> &ModelConfig {
        &self.config
    }

    fn tokens(&self) -> &TokenLayout {
        &self.tokens
    }

    fn nats(&mut self, inputs: &[u32], targets: &[u32], length: usize, out: &mut [f32]) -> Result<()> {
        assert_eq!((inputs.len(), targets.len()), (out.len(), out.len()), "a target for every input and its nats");
        let pad = self.tokens.pad;
        let mut nats = vec![0.0; length];
        let windows = inputs.chunks(length).zip(targets.chunks(length)).zip(out.chunks_mut(length));
        for ((inputs, targets), out) in windows {
            self.decoder.reset();
            let mut blocks = vec![&[][..]; self.streams()];
            blocks[0] = inputs;
            let logits = self.read(&blocks, Logits::All)?;
            cross_entropy::nats(&mut nats[..out.len()], logits, targets, pad);
            out.iter_mut().zip(&nats).for_each(|(out, nats)| *out = *nats as f32);
        }
        Ok(())
    }
}

/// The weights of a model as the engine streams them.
fn packed(gpt: &Gpt, kind: WeightKind) -> Result<DecoderWeights> {
    let (config, tokens) = (gpt.config(), gpt.tokens());
    let numbers =
        |tensor: &Tensor| -> Result<Vec<f32>> { Ok(tensor.to_device(&Device::Cpu)?.flatten_all()?.to_vec1::<f32>()?) };
    let tensors: BTreeMap<&str, Vec<f32>> =
        gpt.vars().iter().map(|(name, var)| Ok((name.as_str(), numbers(var.as_tensor())?))).collect::<Result<_>>()?;
    let get = |name: &str| tensors[name].as_slice();
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
    let places;
    let positions = match config.positions {
        Positions::FrameJoint if tokens.varying => Tables::Words {
            front: get("position.front.weight"),
            word: get("position.frame.weight"),
            place: get("position.place.weight"),
            end: tokens.space,
        },
        _ => {
            places = positions(config, tokens, &get);
            Tables::Places(&places)
        }
    };
    let parts = Parts {
        shape: Shape {
            layers: config.layers,
            heads: config.heads,
            width: config.width,
            vocabulary: tokens.vocabulary,
            context: config.context,
        },
        token,
        positions,
        rope: None,
        before: None,
        blocks: (0..config.layers).map(block).collect(),
        norm: pair("norm"),
        head: if config.tied_head { token } else { get("head.weight") },
    };
    Ok(DecoderWeights::new(&parts, kind))
}

/// (T, D): what is added to the token at each place.
fn positions<'a>(config: &ModelConfig, tokens: &TokenLayout, get: &dyn Fn(&str) -> &'a [f32]) -> Vec<f32> {
    let (width, word) = (config.width, tokens.word);
    let row = |name: &str, i: usize| &get(name)[i * width..][..width];
    let joint = |i: usize| -> Vec<f32> {
        match i.checked_sub(tokens.front) {
            None => row("position.front.weight", i).to_vec(),
            Some(i) => {
                let (frame, place) = (row("position.frame.weight", i / word), row("position.place.weight", i % word));
                frame.iter().zip(place).map(|(a, b)| a + b).collect()
            }
        }
    };
    match config.positions {
        Positions::Absolute => get("position.absolute.weight").to_vec(),
        Positions::FrameJoint | Positions::Rope => (0..config.context).flat_map(joint).collect(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rand_chacha::rand_core::RngCore;

    const TOKENS: TokenLayout =
        TokenLayout { vocabulary: 51, word: 7, varying: false, front: 1, pad: 0, bos: 1, space: 5, places: Vec::new() };

    /// A model whose numbers are large enough to matter.
    fn model(positions: Positions, tied_head: bool) -> Gpt {
        model_of(&TOKENS, positions, tied_head)
    }

    fn model_of(tokens: &TokenLayout, positions: Positions, tied_head: bool) -> Gpt {
        let config =
            ModelConfig { layers: 3, heads: 4, width: 48, context: 70, positions, tied_head, ..Default::default() };
        let mut tensors = layout::initial(&config, tokens, 5).unwrap();
        tensors.values_mut().for_each(|t| *t = (&*t * 3.0).unwrap());
        Gpt::from_tensors(&config, tokens, tensors).unwrap()
    }

    fn ids(n: usize, seed: u64) -> Vec<u32> {
        let mut rng = crate::random::stream(seed, "ids", 0, 0);
        (0..n).map(|_| rng.next_u32() % 51).collect()
    }

    /// The largest difference by the largest logit.
    fn apart(a: &[f32], b: &[f32]) -> f32 {
        assert_eq!(a.len(), b.len());
        let largest = |x: &mut dyn Iterator<Item = f32>| x.fold(0.0, |m: f32, x| m.max(x.abs()));
        largest(&mut a.iter().zip(b).map(|(a, b)| a - b)) / largest(&mut b.iter().copied())
    }

    #[test]
    fn reading_gives_the_logits_of_the_plain_form_to_1e_5() {
        let varying = TokenLayout { varying: true, ..TOKENS };
        for (tokens, positions, tied) in [
            (&TOKENS, Positions::FrameJoint, true),
            (&varying, Positions::FrameJoint, true),
            (&TOKENS, Positions::Absolute, false),
        ] {
            let gpt = model_of(tokens, positions, tied);
            let mut sequences = [ids(70, 1), ids(70, 2), ids(70, 3)];
            // words of 9 and of 4
            sequences[0].iter_mut().step_by(9).for_each(|id| *id = 5);
            sequences[1].iter_mut().step_by(4).for_each(|id| *id = 5);
            let truth: Vec<Vec<f32>> = sequences
                .iter()
                .map(|ids| {
                    let input = Tensor::new(ids.as_slice(), &Device::Cpu).unwrap().unsqueeze(0).unwrap();
                    gpt.forward(&input, None).unwrap().flatten_all().unwrap().to_vec1::<f32>().unwrap()
                })
                .collect();
            let mut reader = Reader::new(&gpt, Reading { streams: 3, ..Reading::default() }).unwrap();
            for cuts in [vec![70], vec![1; 70], vec![30, 1, 33, 6]] {
                let mut read = 0;
                (0..3).for_each(|stream| reader.truncate(stream, 0));
                for n in cuts {
                    let blocks: Vec<&[u32]> = sequences.iter().map(|ids| &ids[read..read + n]).collect();
                    let found = reader.read(&blocks, Logits::All).unwrap();
                    for (found, truth) in found.chunks(n * 51).zip(&truth) {
                        let apart = apart(found, &truth[read * 51..][..n * 51]);
                        assert!(apart < 1e-5, "block of {n} behind {read}: {apart:e}");
                    }
                    read += n;
                }
            }
        }
    }

    #[test]
    fn what_cannot_be_read_is_refused() {
        let mut reader = Reader::new(&model(Positions::Absolute, true), Reading::default()).unwrap();
        let mut said = |blocks: &[&[u32]]| reader.read(blocks, Logits::Last).unwrap_err().to_string();
        assert_eq!(said(&[&[1, 51]]), "token 51 is outside the vocabulary of 51 ids");
        assert_eq!(said(&[&[1; 71]]), "71 more tokens behind 0 read; expected at most 70");
        assert_eq!(said(&[]), "0 blocks of tokens for 1 sequences");
        reader.read(&[&[1; 69]], Logits::Last).unwrap();
        let message = reader.read(&[&[1; 2]], Logits::Last).unwrap_err().to_string();
        assert_eq!(message, "2 more tokens behind 69 read; expected at most 1");
    }

    #[test]
    fn scores_are_those_of_the_plain_form() {
        let mut gpt = model(Positions::FrameJoint, true);
        let mut reader = Reader::new(&gpt, Reading { streams: 2, ..Reading::default() }).unwrap();
        let (inputs, mut targets) = (ids(60, 1), ids(60, 2));
        targets[25..].fill(0);
        let (mut found, mut expected) = (vec![9.0; 60], vec![9.0; 60]);
        reader.nats(&inputs, &targets, 30, &mut found).unwrap();
        gpt.nats(&inputs, &targets, 30, &mut expected).unwrap();
        assert!(apart(&found, &expected) < 1e-5);
    }

    #[test]
    fn bytes_and_half_floats_cost_less_than_half_a_percent() {
        let gpt = model(Positions::FrameJoint, true);
        let (inputs, targets) = (ids(70, 1), ids(70, 2));
        let nats = |weights, kv| {
            let mut out = vec![0.0; 70];
            Reader::new(&gpt, Reading { streams: 1, weights, kv })
                .unwrap()
                .nats(&inputs, &targets, 70, &mut out)
                .unwrap();
            out.iter().sum::<f32>()
        };
        let plain = nats(WeightKind::F32, KvKind::F32);
        for (weights, kv) in [(WeightKind::Int8, KvKind::F32), (WeightKind::F32, KvKind::F16)] {
            let other = nats(weights, kv);
            assert!(other != plain && (other / plain - 1.0).abs() < 5e-3, "{weights:?} {kv:?}: {other}, {plain}");
        }
    }
}
