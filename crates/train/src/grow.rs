//! Weights of a model that gets more labels: its tables grow, what it knows stays.

use crate::{Error, Result};
use candle_core::{Device, Tensor};
use kinelm_corpus::conditions::in_order;
use kinelm_model::layout;
pub use kinelm_model::layout::{CLASS, GOAL, MUSIC};
use kinelm_model::{ModelConfig, TokenLayout};
use std::collections::BTreeMap;

/// What stands in front of and in a model's windows: its tokens and the label fields behind `<bos>`.
#[derive(Debug, Clone, Copy)]
pub struct Language<'a> {
    /// What the tokenizer and the fields decide.
    pub tokens: &'a TokenLayout,
    /// The fields.
    pub conditions: &'a [String],
}

/// The weights of a model of shape `config` that knew `old` and is to know `new`, whose earlier ids are the same.
///
/// Rows of ids and of fields that are new are drawn as a model begins with them, from `seed`; all others are what they
/// were, bit for bit, each field's at the place where it now stands. Of learned places (`absolute`) those of new fields
/// are put in where these stand, words keep theirs, and what is too much falls away at the end; so do rows of frames that
/// no longer fit into a window. Tensors that the model had no use for begin as they do in a new one.
///
/// # Errors
/// A new vocabulary that has fewer ids, words of another length, fields that are gone; weights that are missing or of
/// another shape, each named.
pub fn grow(
    weights: &BTreeMap<String, Tensor>,
    config: &ModelConfig,
    old: Language,
    new: Language,
    seed: u64,
) -> Result<BTreeMap<String, Tensor>> {
    let (was, is) = (old.tokens, new.tokens);
    let fields = [old, new].map(|l| in_order(l.conditions));
    if !is.reads(was) {
        let (found, expected) = ((is.vocabulary, is.word), (was.vocabulary, was.word));
        return Err(Error::call(format!(
            "{} ids and words of {} tokens; the model knows {} ids and words of {}: it can only learn more ids",
            found.0, found.1, expected.0, expected.1
        )));
    }
    if let Some(gone) = fields[0].iter().find(|f| !fields[1].contains(f)) {
        return Err(Error::call(format!("the model knows the label field `{gone}`, which is gone; keep it")));
    }
    let front = front_rows(&fields[0], &fields[1]);
    let before = layout::parameters(config, was);
    let grown = layout::parameters(config, is).into_iter().map(|p| {
        let expected = before.iter().find(|b| b.name == p.name).map(|b| b.shape.as_slice());
        let name = p.name.as_str();
        let may_come = GOAL.contains(&name) || MUSIC.contains(&name) || name == CLASS;
        let comes_new = may_come && !weights.contains_key(name);
        if expected.is_none() || comes_new {
            // what comes with the first labels, with being told what is ahead, or music, or with a classifier
            let tensor = Tensor::from_vec(p.initial(seed), p.shape.as_slice(), &Device::Cpu)?;
            return Ok((p.name, tensor));
        }
        let tensor = weights.get(&p.name).ok_or_else(|| Error::call(format!("no tensor {}", p.name)))?;
        if expected != Some(tensor.dims()) {
            let (name, found) = (&p.name, tensor.dims());
            return Err(Error::call(format!("tensor {name} has the shape {found:?}; expected {expected:?}")));
        }
        let (&[rows, width], &[had, _]) = (p.shape.as_slice(), tensor.dims()) else {
            return Ok((p.name, tensor.clone()));
        };
        // per new row: the old one
        let from: Vec<Option<usize>> = match p.name.as_str() {
            "position.front.weight" => front.clone(),
            "position.absolute.weight" => {
                let words = (was.front..had).map(Some);
                front.iter().copied().chain(words).take(rows).collect()
            }
            _ => (0..rows).map(|row| (row < had).then_some(row)).collect(),
        };
        if from.iter().copied().eq((0..had).map(Some)) {
            return Ok((p.name, tensor.clone()));
        }
        let (numbers, mut all) = (tensor.flatten_all()?.to_vec1::<f32>()?, p.initial(seed));
        for (row, from) in all.chunks_exact_mut(width).zip(from) {
            if let Some(from) = from {
                row.copy_from_slice(&numbers[from * width..][..width]);
            }
        }
        Ok((p.name.clone(), Tensor::from_vec(all, (rows, width), &Device::Cpu)?))
    });
    grown.collect()
}

/// Per token of the new front: its place in the old one.
fn front_rows(old: &[String], new: &[String]) -> Vec<Option<usize>> {
    let of_field = |field: &String| old.iter().position(|f| f == field).map(|at| 1 + at);
    std::iter::once(Some(0)).chain(new.iter().map(of_field)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::TOKENS;
    use kinelm_model::{Gpt, HeadKind, Positions};

    fn model(positions: Positions, tied_head: bool) -> ModelConfig {
        ModelConfig { layers: 2, heads: 2, width: 8, context: 36, positions, tied_head, ..Default::default() }
    }

    fn names(all: &[&str]) -> Vec<String> {
        all.iter().map(|f| f.to_string()).collect()
    }

    fn rows(tensor: &Tensor) -> Vec<Vec<f32>> {
        tensor.to_vec2().unwrap()
    }

    #[test]
    fn more_ids_change_no_logit_of_the_old_ones() {
        let more = TokenLayout { vocabulary: TOKENS.vocabulary + 3, ..TOKENS };
        let few = TOKENS;
        let [old, new] = [&few, &more].map(|tokens| Language { tokens, conditions: &[] });
        for positions in [Positions::Absolute, Positions::FrameJoint, Positions::Rope] {
            for tied_head in [true, false] {
                let config = model(positions, tied_head);
                let weights = layout::initial(&config, &TOKENS, 3).unwrap();
                let grown = grow(&weights, &config, old, new, 9).unwrap();
                let logits = |tokens: &TokenLayout, weights| {
                    let gpt = Gpt::from_tensors(&config, tokens, weights).unwrap();
                    let ids: Vec<u32> = (0..30).map(|i| if i == 0 { 1 } else { 5 + i * i % 11 }).collect();
                    gpt.predict(&gpt.ids(&ids, 30).unwrap())
                        .unwrap()
                        .reshape((30, ()))
                        .unwrap()
                        .to_vec2::<f32>()
                        .unwrap()
                };
                let (a, b) = (logits(&TOKENS, weights), logits(&more, grown.clone()));
                for (a, b) in a.iter().zip(&b) {
                    assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5), "{a:?} {b:?}");
                }
                let fresh = layout::initial(&config, &more, 9).unwrap();
                assert_eq!(rows(&grown["token.weight"])[16..], rows(&fresh["token.weight"])[16..]);
            }
        }
    }

    #[test]
    fn fields_bring_their_rows_along_and_words_keep_theirs() {
        let (front, more) =
            (TokenLayout { front: 3, vocabulary: 20, ..TOKENS }, TokenLayout { front: 4, vocabulary: 22, ..TOKENS });
        let (two, three) = (names(&["style", "genre"]), names(&["style", "dancer", "genre"]));
        let (old, new) =
            (Language { tokens: &front, conditions: &two }, Language { tokens: &more, conditions: &three });
        for positions in [Positions::Absolute, Positions::FrameJoint] {
            let config = model(positions, true);
            let weights = layout::initial(&config, &front, 3).unwrap();
            let grown = grow(&weights, &config, old, new, 9).unwrap();
            Gpt::from_tensors(&config, &more, grown.clone()).unwrap();
            let (name, words) = match positions {
                Positions::Absolute => ("position.absolute.weight", true),
                _ => ("position.front.weight", false),
            };
            let (before, after) = (rows(&weights[name]), rows(&grown[name]));
            // <bos>, genre, style became <bos>, genre, dancer, style
            assert_eq!([&after[0], &after[1], &after[3]], [&before[0], &before[1], &before[2]]);
            let fresh = rows(&layout::initial(&config, &more, 9).unwrap()[name]);
            assert_eq!(after[2], fresh[2]);
            if words {
                assert_eq!((after.len(), &after[4..]), (36, &before[3..35]));
            }
            for (name, tensor) in &weights {
                if !name.starts_with("position") && name != "token.weight" {
                    assert_eq!(
                        tensor.flatten_all().unwrap().to_vec1::<f32>().unwrap(),
                        grown[name].flatten_all().unwrap().to_vec1::<f32>().unwrap(),
                        "{name}"
                    );
                }
            }
        }
    }

    #[test]
    fn what_would_lose_something_is_refused() {
        let all = TOKENS;
        let fewer = TokenLayout { vocabulary: 15, ..TOKENS };
        let config = ModelConfig { head: Some(HeadKind::Absolute), ..model(Positions::FrameJoint, true) };
        let weights = layout::initial(&config, &TOKENS, 3).unwrap();
        let of = |tokens| Language { tokens, conditions: &[] };
        let message = grow(&weights, &config, of(&all), of(&fewer), 1).unwrap_err().to_string();
        assert!(message.starts_with("15 ids and words of 7 tokens; the model knows 16 ids"), "{message}");
        let genre = names(&["genre"]);
        let front = TokenLayout { front: 2, ..TOKENS };
        let known = Language { tokens: &front, conditions: &genre };
        let message = grow(&weights, &config, known, of(&all), 1).unwrap_err().to_string();
        assert!(message.contains("`genre`, which is gone"), "{message}");
        let mut missing = weights;
        missing.remove("norm.bias");
        assert_eq!(grow(&missing, &config, of(&all), of(&all), 1).unwrap_err().to_string(), "no tensor norm.bias");
    }
}
