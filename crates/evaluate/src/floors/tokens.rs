//! Static floors of words that are tiles, or differ in length: bits a frame of tables of tokens, fitted on train, measured
//! on another split. The space is counted, since it says where a word ends.
//!
//! - order 0: add-one counts of all tokens;
//! - by place: separate counts for each slot of a word;
//! - by the token before: separate counts after each token, and after `<bos>` for a clip's first.
//!
//! Each of these tables backs off to order 0 with as much weight as it has seen different tokens (Witten and Bell, "The
//! zero-frequency problem", 1991), so that every token has some probability.

use super::channels::{figure_row, fmt_sample, sampled};
use super::codes;
use super::sample::{Extent, Stretch, stretches};
use crate::{Error, Result};
use kinelm_corpus::{Corpus, Split};
use kinelm_tokenizer::{SPACE, Special};
use serde_json::{Value, json};
use std::collections::HashMap;
use std::fmt;

/// The names of [`MODELS`] in tables.
const ROWS: [&str; 3] = ["order 0", "order 0 by place", "by the token before"];

/// The static models, in the order of their names, as JSON has them.
pub const MODELS: [&str; 3] = ["order0", "order0_by_place", "order1"];

/// The floors of a corpus of any words.
#[derive(Debug, Clone, PartialEq)]
pub struct TokenFloors {
    /// V.
    pub vocabulary: usize,
    /// Clips, frames and tokens that the tables were counted on.
    pub train: [usize; 3],
    /// Clips, frames and tokens that the bits were measured on.
    pub test: [usize; 3],
    /// Frames that both splits have, where these are a sample of them.
    pub of: [usize; 2],
    /// Bits per frame of each of `MODELS`.
    pub bits_per_frame: [f64; 3],
}

impl TokenFloors {
    /// Counts tokens on the train clips of `fitted` and measures the tables on the split `measured` of a corpus of the same
    /// tokenizer.
    ///
    /// # Errors
    /// [`kinelm_store::Error::File`] when a split has no frame.
    pub(crate) fn measure(fitted: &Corpus, corpus: &Corpus, measured: Split, extent: Extent) -> Result<TokenFloors> {
        // labels may have been added to one of them
        let vocabulary = corpus.manifest().vocabulary.max(fitted.manifest().vocabulary);
        let (seen, held_out) = (stretches(fitted, Split::Train, extent), stretches(corpus, measured, extent));
        let (train, test) = (size(fitted, &seen, Split::Train)?, size(corpus, &held_out, measured)?);
        // add-one counts: a token that train lacks keeps a probability, on which both other tables fall back
        let mut order0 = vec![1u64; vocabulary];
        let [mut place, mut before] = [Tables::default(), Tables::default()];
        each_token(fitted, &seen, |id, at, last| {
            order0[id as usize] += 1;
            place.count(at, id);
            before.count(last, id);
        })?;
        let total: u64 = order0.iter().sum();
        let p = |id: u32| order0[id as usize] as f64 / total as f64;
        let mut bits = [0.0; 3];
        each_token(corpus, &held_out, |id, at, last| {
            let p = p(id);
            let found = [p, place.p(at, id, p), before.p(last, id, p)];
            bits.iter_mut().zip(found).for_each(|(sum, p)| *sum -= p.log2());
        })?;
        let frames = test[1] as f64;
        let of = [codes::frames(fitted, Split::Train), codes::frames(corpus, measured)];
        Ok(TokenFloors { vocabulary, train, test, of, bits_per_frame: bits.map(|b| b / frames) })
    }

    /// Bits a frame of a code without any model: log2 V a token.
    pub fn uniform(&self) -> f64 {
        let [_, frames, tokens] = self.test;
        tokens as f64 * (self.vocabulary as f64).log2() / frames as f64
    }

    /// The lowest of the static models.
    pub(crate) fn best(&self) -> f64 {
        self.bits_per_frame.into_iter().fold(f64::INFINITY, f64::min)
    }

    /// One object, as the floors of channels have it.
    pub(crate) fn to_json(&self) -> Value {
        let mut bits: serde_json::Map<_, _> =
            MODELS.iter().zip(self.bits_per_frame).map(|(m, b)| ((*m).to_owned(), json!(b))).collect();
        bits.insert("uniform".into(), json!(self.uniform()));
        let of = |i: usize| json!({ "train": self.train[i], "test": self.test[i] });
        let mut line = json!({
            "schema": 1, "vocabulary": self.vocabulary,
            "clips": of(0), "frames": of(1), "tokens": of(2), "bits_per_frame": bits,
        });
        if let Some(of) = sampled([self.train[1], self.test[1]], self.of) {
            line["frames_of"] = json!({ "train": of[0], "test": of[1] });
        }
        line
    }
}

impl fmt::Display for TokenFloors {
    /// A table, a row a model, without a line end after the last.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ([tc, tf, tt], [mc, mf, mt]) = (self.train, self.test);
        writeln!(f, "tables of tokens, since a word is no frame of one character a channel")?;
        writeln!(
            f,
            "fitted on {tc} clips, {tf} frames, {tt} tokens; measured on {mc} clips, {mf} frames, {mt} tokens"
        )?;
        fmt_sample(f, [tf, mf], self.of)?;
        writeln!(f, "{:<32} {:>12}", "bits/frame", "all frames")?;
        write!(f, "{}", figure_row("uniform", self.uniform(), None))?;
        for (name, bits) in ROWS.iter().zip(self.bits_per_frame) {
            write!(f, "\n{}", figure_row(name, bits, None))?;
        }
        Ok(())
    }
}

/// Clips, frames and tokens of the measured stretches; an error where they have no frame.
fn size(corpus: &Corpus, stretches: &[Stretch], split: Split) -> Result<[usize; 3]> {
    let size = stretches.iter().fold([0; 3], |[c, f, t], of| {
        let words = corpus.words(of.clip);
        let tokens = words.start(of.words.end) - words.start(of.words.start);
        [c + 1, f + corpus.frames_of(of.clip, of.words.clone()), t + tokens]
    });
    match size[1] {
        0 => Err(Error::file(corpus.dir(), format!("no frame in the {split} split"), "some", "try another split")),
        _ => Ok(size),
    }
}

/// Calls `take` with every token of the stretches, its slot, and the token before it.
fn each_token(corpus: &Corpus, stretches: &[Stretch], mut take: impl FnMut(u32, u32, u32)) -> Result<()> {
    for of in stretches {
        // a stretch counts as a clip of its own: its first token follows `<bos>`
        let (mut at, mut last) = (0, Special::Bos.id());
        for id in corpus.word_ids(of.clip, of.words.clone())? {
            take(id, at, last);
            (at, last) = (if id == SPACE { 0 } else { at + 1 }, id);
        }
    }
    Ok(())
}

/// Counts of tokens after each context: a slot, or a previous token.
#[derive(Default)]
struct Tables {
    cases: HashMap<(u32, u32), u64>,
    /// Cases and different tokens.
    totals: HashMap<u32, [u64; 2]>,
}

impl Tables {
    fn count(&mut self, known: u32, id: u32) {
        let cases = self.cases.entry((known, id)).or_default();
        let total = self.totals.entry(known).or_default();
        total[0] += 1;
        // a first case, since `cases` is raised below
        total[1] += u64::from(*cases == 0);
        *cases += 1;
    }

    /// The probability of a token that order 0 gives `p`.
    fn p(&self, known: u32, id: u32, p: f64) -> f64 {
        let Some(&[cases, different]) = self.totals.get(&known) else { return p };
        let own = self.cases.get(&(known, id)).copied().unwrap_or(0);
        (own as f64 + different as f64 * p) / (cases + different) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_table_takes_as_many_cases_from_order_0_as_it_has_tokens() {
        let mut t = Tables::default();
        for id in [7, 7, 7, 8] {
            t.count(1, id);
        }
        assert_eq!((t.p(1, 7, 0.5), t.p(1, 9, 0.25), t.p(2, 9, 0.25)), ((3.0 + 1.0) / 6.0, 0.5 / 6.0, 0.25));
        let all: f64 = (0..10).map(|id| t.p(1, id, 0.1)).sum();
        assert!((all - 1.0).abs() < 1e-12);
    }
}
