//! For the tests: models of every form, and batches as their tokenizers would make them.

use super::config::{Architecture, DecoderConfig, HeadKind, ModelConfig, ModelKind, Positions, SlotRun, TokenLayout};
use super::frames::Frames;
use super::goal::{self, Conditioning};
use super::gpt::Gpt;
use super::music::Music;
#[cfg(test)]
use super::weights::Weights;
use super::weights::{self, Array};
use super::{DeviceName, forecast};
use candle_core::{DType, Device, Tensor};
use kinelm_corpus::windows::fill_sequence;
use kinelm_tokenizer::{SlotIds, Special};
use rand_chacha::rand_core::RngCore;

/// Of [`kinelm_corpus::fixture::corpus`].
pub const TOKENS: TokenLayout =
    TokenLayout { vocabulary: 16, word: 7, varying: false, front: 1, pad: 0, bos: 1, space: 5, places: Vec::new() };

/// Words of two angles of 7 bins, one of 5, heights of 6 and of 4 that share ids, and a space; three tokens in front.
pub(crate) fn placed() -> TokenLayout {
    let kind = |number, first, count, circular| SlotRun { number, kind: SlotIds { first, count, circular } };
    TokenLayout {
        vocabulary: 26,
        word: 6,
        varying: false,
        front: 3,
        pad: 0,
        bos: 1,
        space: 5,
        places: vec![kind(2, 6, 7, true), kind(1, 13, 5, true), kind(1, 18, 6, false), kind(1, 19, 4, false)],
    }
}

/// The same tokens in words of any length.
pub fn varying() -> TokenLayout {
    TokenLayout { varying: true, places: Vec::new(), ..placed() }
}

/// A small model of every form: kind, positions, inputs and heads in all ways that go together.
pub fn all(length: usize) -> Vec<(ModelConfig, TokenLayout)> {
    let mut fixtures = Vec::new();
    for positions in [Positions::Absolute, Positions::FrameJoint, Positions::Rope] {
        let base = ModelConfig { layers: 2, heads: 2, width: 12, context: length, positions, ..Default::default() };
        for kind in [ModelKind::Causal, ModelKind::Masked] {
            let form = |tied_head, previous, head| ModelConfig {
                kind,
                tied_head,
                previous_frame: Some(previous),
                head: Some(head),
                ..base.clone()
            };
            fixtures.push((form(true, false, HeadKind::Absolute), varying()));
            fixtures.push((form(positions != Positions::Rope, false, HeadKind::Absolute), placed()));
            if kind == ModelKind::Causal {
                fixtures.push((form(true, true, HeadKind::Absolute), placed()));
                fixtures.push((form(positions == Positions::Rope, false, HeadKind::Relative), placed()));
                fixtures.push((form(positions != Positions::Absolute, true, HeadKind::Relative), placed()));
            }
        }
    }
    fixtures
}

/// The same and small two-level models, in windows of about `length` tokens: each has its own context.
pub fn every(length: usize) -> Vec<(ModelConfig, TokenLayout)> {
    let alone = TokenLayout { front: 1, ..placed() };
    let decoder = DecoderConfig { layers: 2, heads: 2, width: 8, character_width: 3 };
    let levels = ModelConfig {
        architecture: Architecture::TwoLevel,
        layers: 2,
        heads: 2,
        width: 12,
        window: Some((length / alone.word).max(2)),
        decoder: Some(decoder),
        ..Default::default()
    };
    let conditioning = ModelConfig { goal: true, ..levels.clone() };
    let danced = ModelConfig { music: Music::Beats, ..levels.clone() };
    let both = ModelConfig { music: Music::Both, ..conditioning.clone() };
    let plain = ModelConfig { forecast: Some(false), ..levels.clone() };
    let two = [
        (plain.clone(), alone.clone()),
        (plain, placed()),
        (levels.clone(), alone.clone()),
        (levels, placed()),
        (conditioning.clone(), alone.clone()),
        (conditioning, placed()),
        (danced, placed()),
        (both, alone),
    ];
    all(length).into_iter().chain(two.map(|(levels, tokens)| (levels.resolved(&tokens), tokens))).collect()
}

/// Goal conditioning for a batch, where the model has one: two of three frames, some rows missing.
pub fn conditioning(config: &ModelConfig, tokens: &TokenLayout, windows: usize) -> Option<Conditioning> {
    if !config.is_conditioned() {
        return None;
    }
    let (frames, n) = (Frames::of(tokens), windows * config.frames(tokens));
    let mut conditioning =
        if config.goal { Conditioning::none(n, frames.characters()) } else { Conditioning::default() };
    let mut rng = kinelm_store::random::stream(5, "told", 0, 0);
    conditioning.music =
        (0..n * config.music.numbers()).map(|_| kinelm_store::random::unit(&mut rng) as f32 - 0.5).collect();
    let numbers = goal::numbers(frames.characters());
    for (frame, of_frame) in conditioning.numbers.chunks_mut(numbers).enumerate().filter(|(frame, _)| frame % 3 != 1) {
        of_frame.iter_mut().for_each(|x| *x = kinelm_store::random::unit(&mut rng) as f32 - 0.5);
        for row in conditioning.rows.iter_mut().flat_map(|rows| &mut rows[frame * tokens.word..][..frames.characters()])
        {
            if !rng.next_u32().is_multiple_of(4) {
                *row = rng.next_u32() % frames.steps().all() as u32;
            }
        }
    }
    Some(conditioning)
}

/// A form in words, for messages.
pub fn name(config: &ModelConfig, tokens: &TokenLayout) -> String {
    let ModelConfig { architecture, kind, positions, previous_frame, head, tied_head, dropout, goal, music, .. } =
        config;
    let forecast = config.forecast();
    let words = if tokens.varying { "any words" } else { "words of one length" };
    format!(
        "{architecture:?} {kind:?} {positions:?} previous {previous_frame:?} {head:?} tied {tied_head} dropout {dropout} goal {goal} forecast {forecast} music {music:?}, {words}"
    )
}

/// Every number times `factor`.
#[cfg(test)]
pub(crate) fn scale(weights: &mut Weights, factor: f32) {
    let scaled = |array: &Array| Array::new(array.shape(), array.numbers().iter().map(|x| x * factor).collect());
    weights.values_mut().for_each(|array| *array = scaled(array));
}

/// A model away from zeros and ones, where gradients could be right by accident.
pub fn model(config: &ModelConfig, tokens: &TokenLayout) -> Gpt {
    let mut weights = weights::initial(config, tokens, 1);
    for (name, array) in weights.iter_mut().filter(|(name, _)| forecast::is_tensor(name)) {
        let mut rng = kinelm_store::random::stream(7, name, 0, 0);
        // up to a third of a bin a step: sums of many are bins
        let whole = (0..array.numbers().len()).map(|_| (rng.next_u32() % 40_001) as f32 - 20_000.0);
        *array = Array::new(array.shape(), whole.collect());
    }
    let gpt = Gpt::from_weights(config, tokens, &weights, DeviceName::Cpu).unwrap();
    for (name, var) in gpt.vars() {
        let shift = super::ops::check::random(name, var.dims(), 0.3).to_dtype(DType::F32).unwrap();
        var.set(&(var.as_tensor() + shift).unwrap()).unwrap();
    }
    gpt
}

/// Inputs and targets (B, T) as training has them: the last window has an end, the second a dropped place; in masked models
/// some tokens are chosen.
pub fn batch(config: &ModelConfig, tokens: &TokenLayout, windows: usize, length: usize) -> (Vec<u32>, Vec<u32>) {
    let (mask, unknown) = (Special::Mask.id(), Special::Unk.id());
    let mut rng = kinelm_store::random::stream(3, "forms", 0, 0);
    let mut draw = |below: u32| rng.next_u32() % below;
    // labels of a window's own, the last window's first one hidden
    let front = |row: usize| -> Vec<u32> {
        let label = |field: usize| match row + 1 == windows && field == 1 {
            true => unknown,
            false => tokens.vocabulary as u32 - 1 - (row + 2 * field) as u32 % 4,
        };
        (0..tokens.front).map(|i| if i == 0 { tokens.bos } else { label(i) }).collect()
    };
    let (mut inputs, mut targets) = (vec![0; windows * length], vec![0; windows * length]);
    let kinds: Vec<SlotIds> = tokens.slot_ids().collect();
    for (row, (input, target)) in inputs.chunks_mut(length).zip(targets.chunks_mut(length)).enumerate() {
        let room = (length + 1).saturating_sub(tokens.front);
        let shown = if row + 1 == windows { room - room / 5 } else { room };
        let id = |k: usize| match kinds.get(k % tokens.word) {
            Some(kind) => kind.first + draw(kind.count),
            None if !kinds.is_empty() || draw(4) == 0 => tokens.space,
            None => 6 + draw(tokens.vocabulary as u32 - 6),
        };
        let ids: Vec<u32> = (0..shown).map(id).collect();
        if config.kind == ModelKind::Causal {
            fill_sequence(&ids, &front(row), tokens.pad, input, target);
            if row == 1 && !kinds.is_empty() {
                // a joint is dropped from the second word on: neither it nor its conditioning counts
                for k in (tokens.word + 2..shown).step_by(tokens.word) {
                    if let Some(at) = input.get_mut(tokens.front + k) {
                        *at = mask;
                    }
                    target[tokens.front - 1 + k] = tokens.pad;
                }
            }
            continue;
        }
        let fronts = tokens.front.min(length);
        input[..fronts].copy_from_slice(&front(row)[..fronts]);
        for (k, &id) in ids.iter().enumerate().take(length - fronts) {
            let chosen = k % 5 == row % 5 || k == 1;
            input[fronts + k] = if chosen && k != 1 { mask } else { id };
            target[fronts + k] = if chosen { id } else { tokens.pad };
        }
    }
    (inputs, targets)
}

/// (B, H W) what lies before the windows of a batch: before the first nothing, before others more and more frames.
pub fn history(config: &ModelConfig, tokens: &TokenLayout, windows: usize) -> Vec<u32> {
    let mut rng = kinelm_store::random::stream(6, "history", 0, 0);
    let kinds: Vec<SlotIds> = tokens.slot_ids().collect();
    let (frames, mut all) = (config.history(), Vec::new());
    for window in 0..windows {
        let shown = frames * window / windows.max(1);
        all.extend(std::iter::repeat_n(tokens.pad, (frames - shown) * tokens.word));
        for _ in 0..shown {
            all.extend(kinds.iter().map(|kind| kind.first + rng.next_u32() % kind.count));
            all.push(tokens.space);
        }
    }
    all
}

/// The batch's inputs as a model takes them.
pub fn ids(inputs: &[u32], length: usize) -> Tensor {
    Tensor::from_slice(inputs, (inputs.len() / length, length), &Device::Cpu).unwrap()
}
