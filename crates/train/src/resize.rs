//! Weights of a model whose input gets more ids, label fields or conditioning: tables are extended, all else stays.

use crate::{Error, Result};
use kinelm_corpus::conditions::in_order;
use kinelm_model::layout::{self, CLASS, GOAL, MUSIC};
use kinelm_model::weights::{Array, Weights};
use kinelm_model::{ModelConfig, TokenLayout, forecast};

/// The contents of a model's windows: its tokens, and the label fields after `<bos>`.
#[derive(Debug, Clone, Copy)]
pub struct Inputs<'a> {
    /// The layout of its tokens, the front included.
    pub tokens: &'a TokenLayout,
    /// The label fields.
    pub conditions: &'a [String],
}

/// The weights of a model of shape `config` for the inputs `new`, from those for `old`, whose ids are the same.
///
/// Rows of new ids and fields are random, from `seed`, as in a new model. All other rows are copied bit for bit, each
/// field's to its new position. Of absolute positions, those of new fields are inserted, words keep theirs, and those past
/// the context are dropped. Tensors of conditioning that the model didn't have begin as in a new model.
///
/// # Errors
/// New inputs with fewer ids, words of another length, or without an old field; weights that are missing or of another
/// shape, each named.
pub fn resize(weights: &Weights, config: &ModelConfig, old: Inputs, new: Inputs, seed: u64) -> Result<Weights> {
    let (was, is) = (old.tokens, new.tokens);
    let fields = [old, new].map(|inputs| in_order(inputs.conditions));
    if !is.reads(was) {
        let of = |tokens: &TokenLayout| format!("{} ids and words of {} tokens", tokens.vocabulary, tokens.word);
        return Err(Error::invalid("the tokenizer", of(is), format!("the model's {}, or more ids", of(was))));
    }
    if let Some(gone) = fields[0].iter().find(|f| !fields[1].contains(f)) {
        return Err(Error::missing(format!("label field `{gone}`"), "the model is conditioned on it; keep it"));
    }
    let front = front_rows(&fields[0], &fields[1]);
    let before = layout::parameters(config, was);
    let resized = layout::parameters(config, is).into_iter().map(|p| {
        let name = p.name.as_str();
        let expected = before.iter().find(|b| b.name == name).map(|b| b.shape.as_slice());
        // the only tensors that a source may lack; any other missing one is an error
        let is_conditioning = GOAL.contains(&name) || MUSIC.contains(&name) || name == CLASS;
        let Some(expected) = expected.filter(|_| weights.contains_key(name) || !is_conditioning) else {
            let array = Array::new(&p.shape, p.initial(seed));
            return Ok((p.name, array));
        };
        let array = weights.get(name).filter(|array| array.shape() == expected);
        let array = array.ok_or_else(|| Error::Weights(format!("no tensor {name} of shape {expected:?}")))?;
        let (&[rows, width], &[had, _]) = (p.shape.as_slice(), array.shape()) else {
            return Ok((p.name, array.clone()));
        };
        // per new row: the old one
        let from: Vec<Option<usize>> = match name {
            "position.front.weight" => front.clone(),
            // front positions move with their fields, and those of words with the length of the front
            "position.absolute.weight" => {
                let words = (was.front..had).map(Some);
                front.iter().copied().chain(words).take(rows).collect()
            }
            _ => (0..rows).map(|row| (row < had).then_some(row)).collect(),
        };
        if from.iter().copied().eq((0..had).map(Some)) {
            return Ok((p.name, array.clone()));
        }
        // new rows are those of a new model of this seed, whatever was copied
        let mut all = p.initial(seed);
        for (row, from) in all.chunks_exact_mut(width).zip(from) {
            if let Some(from) = from {
                row.copy_from_slice(&array.numbers()[from * width..][..width]);
            }
        }
        Ok((p.name.clone(), Array::new(&p.shape, all)))
    });
    let mut resized: Weights = resized.collect::<Result<_>>()?;
    // no words have changed, so what is forecast of them stays
    resized.extend(
        weights.iter().filter(|(name, _)| forecast::is_tensor(name)).map(|(name, x)| (name.clone(), x.clone())),
    );
    Ok(resized)
}

/// Per token of the new front: its index in the old one.
fn front_rows(old: &[String], new: &[String]) -> Vec<Option<usize>> {
    let of_field = |field: &String| old.iter().position(|f| f == field).map(|at| 1 + at);
    std::iter::once(Some(0)).chain(new.iter().map(of_field)).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fixture::TOKENS;
    use kinelm_model::{DeviceName, Gpt, HeadKind, Positions, weights};

    fn model(positions: Positions, tied_head: bool) -> ModelConfig {
        ModelConfig { layers: 2, heads: 2, width: 8, context: 36, positions, tied_head, ..Default::default() }
    }

    fn names(all: &[&str]) -> Vec<String> {
        all.iter().map(|f| f.to_string()).collect()
    }

    fn rows(array: &Array) -> Vec<&[f32]> {
        array.rows().collect()
    }

    #[test]
    fn more_ids_change_no_logit_of_the_old_ones() {
        let more = TokenLayout { vocabulary: TOKENS.vocabulary + 3, ..TOKENS };
        let few = TOKENS;
        let [old, new] = [&few, &more].map(|tokens| Inputs { tokens, conditions: &[] });
        for positions in [Positions::Absolute, Positions::FrameJoint, Positions::Rope] {
            for tied_head in [true, false] {
                let config = model(positions, tied_head);
                let weights = weights::initial(&config, &TOKENS, 3);
                let resized = resize(&weights, &config, old, new, 9).unwrap();
                let logits = |tokens: &TokenLayout, weights: &Weights| {
                    let gpt = Gpt::from_weights(&config, tokens, weights, DeviceName::Cpu).unwrap();
                    let ids: Vec<u32> = (0..30).map(|i| if i == 0 { 1 } else { 5 + i * i % 11 }).collect();
                    gpt.predict(&gpt.ids(&ids, 30).unwrap())
                        .unwrap()
                        .reshape((30, ()))
                        .unwrap()
                        .to_vec2::<f32>()
                        .unwrap()
                };
                let (a, b) = (logits(&TOKENS, &weights), logits(&more, &resized));
                for (a, b) in a.iter().zip(&b) {
                    assert!(a.iter().zip(b).all(|(a, b)| (a - b).abs() < 1e-5), "{a:?} {b:?}");
                }
                let fresh = weights::initial(&config, &more, 9);
                assert_eq!(rows(&resized["token.weight"])[16..], rows(&fresh["token.weight"])[16..]);
            }
        }
    }

    #[test]
    fn rows_of_fields_move_with_them_and_words_keep_theirs() {
        let (front, more) =
            (TokenLayout { front: 3, vocabulary: 20, ..TOKENS }, TokenLayout { front: 4, vocabulary: 22, ..TOKENS });
        let (two, three) = (names(&["style", "genre"]), names(&["style", "dancer", "genre"]));
        let (old, new) = (Inputs { tokens: &front, conditions: &two }, Inputs { tokens: &more, conditions: &three });
        for positions in [Positions::Absolute, Positions::FrameJoint] {
            let config = model(positions, true);
            let weights = weights::initial(&config, &front, 3);
            let resized = resize(&weights, &config, old, new, 9).unwrap();
            Gpt::from_weights(&config, &more, &resized, DeviceName::Cpu).unwrap();
            let (name, words) = match positions {
                Positions::Absolute => ("position.absolute.weight", true),
                _ => ("position.front.weight", false),
            };
            let (before, after) = (rows(&weights[name]), rows(&resized[name]));
            // <bos>, genre, style became <bos>, genre, dancer, style
            assert_eq!([&after[0], &after[1], &after[3]], [&before[0], &before[1], &before[2]]);
            let fresh = weights::initial(&config, &more, 9);
            assert_eq!(after[2], rows(&fresh[name])[2]);
            if words {
                assert_eq!((after.len(), &after[4..]), (36, &before[3..35]));
            }
            for (name, array) in &weights {
                if !name.starts_with("position") && name != "token.weight" {
                    assert_eq!(*array, resized[name], "{name}");
                }
            }
        }
    }

    #[test]
    fn what_would_lose_something_is_refused() {
        let all = TOKENS;
        let fewer = TokenLayout { vocabulary: 15, ..TOKENS };
        let config = ModelConfig { head: Some(HeadKind::Absolute), ..model(Positions::FrameJoint, true) };
        let weights = weights::initial(&config, &TOKENS, 3);
        let of = |tokens| Inputs { tokens, conditions: &[] };
        let message = resize(&weights, &config, of(&all), of(&fewer), 1).unwrap_err().to_string();
        assert!(
            message.starts_with("the tokenizer is 15 ids and words of 7 tokens; expected the model's 16 ids"),
            "{message}"
        );
        let genre = names(&["genre"]);
        let front = TokenLayout { front: 2, ..TOKENS };
        let known = Inputs { tokens: &front, conditions: &genre };
        let message = resize(&weights, &config, known, of(&all), 1).unwrap_err().to_string();
        assert!(message.contains("no label field `genre`"), "{message}");
        let mut missing = weights;
        missing.remove("norm.bias");
        let message = resize(&missing, &config, of(&all), of(&all), 1).unwrap_err().to_string();
        assert!(message.starts_with("no tensor norm.bias of shape"), "{message}");
    }
}
