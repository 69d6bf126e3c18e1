//! Which joints cost the bits.

use crate::{Error, Result};
use kinelm_corpus::{ClipRecord, Conditions, Corpus};
use kinelm_model::likelihood::likelihood_by_token;
use kinelm_model::scored_windows::Likelihood;
use kinelm_model::{ModelKind, Scores};
use kinelm_motion::smpl;
use kinelm_tokenizer::{Channel, Tokenizer};
use serde::Serialize;

/// The bits of one slot of a word.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct SlotBits {
    /// The slot's channel, or `space`.
    pub channel: String,
    /// The part of the body that it belongs to: `translation`, a joint, or `space`.
    pub part: String,
    /// Bits a frame.
    pub bits_per_frame: f64,
}

/// The slots of a tokenizer's words, the space last, without bits.
///
/// # Errors
/// [`Error::Tokenizer`] or [`kinelm_store::Error::Invalid`] with the reason, where a character belongs to no one joint.
pub fn slots(tokenizer: &Tokenizer) -> Result<Vec<SlotBits>> {
    if tokenizer.tokens_per_word().is_none() || tokenizer.frames_per_word() != 1 {
        let why = "a word of this tokenizer is no frame of one character a channel, so no token is one joint's";
        return Err(Error::unsupported("bits of each joint", why));
    }
    let channels = tokenizer
        .scheme()
        .slot_channels(tokenizer.channels())
        .map_err(|why| Error::unsupported("bits of each joint", why))?;
    let part = |channel: &Channel| match channel {
        Channel::Translation(_) => "translation",
        Channel::Turn | Channel::Tilt(_) => smpl::NAMES[0],
        Channel::Rotation { joint, .. } => smpl::NAMES[*joint],
    };
    let of = |channel: String, part: &str| SlotBits { channel, part: part.into(), bits_per_frame: 0.0 };
    let mut all: Vec<SlotBits> = channels.iter().map(|c| of(c.to_string(), part(c))).collect();
    all.push(of("space".into(), "space"));
    Ok(all)
}

/// [`kinelm_model::likelihood::likelihood`], and its bits by slot.
///
/// # Errors
/// A masked model; those of [`slots`] and of the likelihood.
pub fn by_slot(
    model: &mut dyn Scores,
    corpus: &Corpus,
    clips: &[&ClipRecord],
    most: usize,
    conditions: &Conditions,
) -> Result<Option<(Likelihood, Vec<SlotBits>)>> {
    if model.config().kind == ModelKind::Masked {
        let why = "a masked model predicts a few of the tokens, too few to tell what each joint costs";
        return Err(Error::unsupported("bits of each joint", why));
    }
    let mut all = slots(corpus.tokenizer())?;
    let word = all.len();
    let mut nats = vec![0.0; word];
    let found =
        // `token` is the index in the clip, which begins with a whole word
        likelihood_by_token(model, corpus, clips, most, conditions, &mut |_, token, x| nats[token % word] += x)?;
    Ok(found.map(|found| {
        let frames = found.tokens as f64 / word as f64;
        for (slot, nats) in all.iter_mut().zip(&nats) {
            slot.bits_per_frame = nats / std::f64::consts::LN_2 / frames;
        }
        (found, all)
    }))
}

/// The bits of each part of the body, in the order in which they come first.
pub(crate) fn by_part(slots: &[SlotBits]) -> Vec<(String, f64)> {
    let mut parts: Vec<(String, f64)> = Vec::new();
    for slot in slots {
        match parts.iter_mut().find(|(part, _)| *part == slot.part) {
            Some((_, bits)) => *bits += slot.bits_per_frame,
            None => parts.push((slot.part.clone(), slot.bits_per_frame)),
        }
    }
    parts
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_corpus::Split;
    use kinelm_model::likelihood::likelihood;
    use kinelm_model::{Gpt, ModelConfig};
    use kinelm_train::fixture;

    #[test]
    fn the_parts_cost_what_the_whole_costs() {
        let dir = tempfile::tempdir().unwrap();
        let corpus = fixture::corpus(dir.path(), &[(31, Split::Valid), (4, Split::Valid)]);
        let clips: Vec<_> = corpus.split(Split::Valid).collect();
        let config = ModelConfig { layers: 1, heads: 1, width: 8, context: 36, ..Default::default() };
        let mut gpt = Gpt::new(&config, &fixture::TOKENS, 3).unwrap();
        let (found, slots) = by_slot(&mut gpt, &corpus, &clips, 0, &Conditions::none()).unwrap().unwrap();
        assert_eq!(found, likelihood(&mut gpt, &corpus, &clips, 0, &Conditions::none()).unwrap().unwrap());
        let parts = by_part(&slots);
        let names: Vec<&str> = parts.iter().map(|(name, _)| name.as_str()).collect();
        assert_eq!((names, slots.len()), (vec!["translation", "pelvis", "space"], 7));
        let sum: f64 = parts.iter().map(|(_, bits)| bits).sum();
        assert!((sum - found.bits_per_frame).abs() < 1e-9 * sum && parts.iter().all(|(_, bits)| *bits > 0.0), "{sum}");

        let merged = fixture::merged(&dir.path().join("m"), &[(20, Split::Valid)]);
        assert!(slots_error(&merged).contains("no token is one joint's"));
    }

    fn slots_error(corpus: &Corpus) -> String {
        super::slots(corpus.tokenizer()).unwrap_err().to_string()
    }
}
