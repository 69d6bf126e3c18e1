//! New dances: some characters of every word are given, the model draws the rest.
//!
//! A word is drawn place by place, in the tokenizer's order. A given place takes the prompt's character; a free one is
//! drawn from the characters its place allows and from nothing else, so whatever comes out decodes. Known characters go
//! into the model in one block with the next free one. When the context is full, the oldest half of the frames is
//! dropped, whole words, and the rest read again.

pub mod prompt;
pub mod sampling;

use crate::model::{Cache, Compute, LoadedRun};
use crate::{Error, Result};
use kinelm_tokenizer::{SPACE, Special, Tokenizer};
use rand_chacha::ChaCha8Rng;
use sampling::Draw;
use std::ops::Range;

/// What generation asks of a model.
pub trait NextToken {
    /// T: tokens that one window holds, the front token included.
    fn context(&self) -> usize;

    /// Forgets every token.
    fn reset(&mut self) -> Result<()>;

    /// Reads `tokens` behind those read since the last reset; logits (V) of the token that follows.
    ///
    /// # Errors
    /// Whatever keeps the model from it; more tokens than the context holds.
    fn read(&mut self, tokens: &[u32]) -> Result<Vec<f32>>;
}

impl NextToken for Cache {
    fn context(&self) -> usize {
        Cache::context(self)
    }

    fn reset(&mut self) -> Result<()> {
        Cache::reset(self);
        Ok(())
    }

    fn read(&mut self, tokens: &[u32]) -> Result<Vec<f32>> {
        Cache::read(self, tokens)
    }
}

/// The model of a run in the form that is wanted, ready to read.
///
/// # Errors
/// Weights that don't fit the configuration, a device that isn't there.
pub fn reader(run: &LoadedRun, compute: Compute) -> Result<Box<dyn NextToken>> {
    Ok(Box::new(run.plain(&compute.device.open()?)?.cache()?))
}

/// What is to be danced.
#[derive(Debug, Clone)]
pub struct Plan<'a> {
    /// Frames wanted.
    pub frames: usize,
    /// (C) which places of a word are given.
    pub given: &'a [bool],
    /// (P, W) ids of the prompt's P words, spaces included; frames beyond them are free.
    pub prompt: &'a [u32],
    /// Ids of the characters: what a place may hold.
    pub characters: Range<u32>,
    /// The token in front of every window.
    pub bos: u32,
    /// The token that ends a word.
    pub space: u32,
    /// How free places are drawn.
    pub draw: Draw,
    /// The seed of the draws.
    pub seed: u64,
}

impl<'a> Plan<'a> {
    /// A dance in a tokenizer's words: `given` (C) places, `prompt` (P, W) ids.
    pub fn of_words(
        tokenizer: &Tokenizer,
        given: &'a [bool],
        prompt: &'a [u32],
        frames: usize,
        draw: Draw,
        seed: u64,
    ) -> Self {
        let characters = tokenizer.grammar().allowed(0);
        Plan { frames, given, prompt, characters, bos: Special::Bos.id(), space: SPACE, draw, seed }
    }
}

/// (frames, W) ids of a new dance, spaces included. `progress` is told the number of frames done.
///
/// The same model, plan and seed give the same ids.
///
/// # Errors
/// A context that holds fewer than two words, logits that are not finite (frame and place are named), and what the
/// model's own reading fails with.
pub fn dance(model: &mut dyn NextToken, plan: &Plan, progress: &mut dyn FnMut(usize)) -> Result<Vec<u32>> {
    let (c, w) = (plan.given.len(), plan.given.len() + 1);
    // a window of n words reads the front token and n words but for the last space
    let most = model.context() / w;
    if most < 2 {
        return Err(Error::Call(format!(
            "the model's context of {} tokens holds {most} words of {w}; expected at least 2: train with a longer context",
            model.context()
        )));
    }
    let mut ids: Vec<u32> = Vec::with_capacity(plan.frames * w);
    let mut unread = vec![plan.bos];
    let mut in_window = 0;
    model.reset()?;
    for frame in 0..plan.frames {
        if in_window == most {
            in_window = most - most / 2;
            model.reset()?;
            unread = vec![plan.bos];
            unread.extend_from_slice(&ids[(frame - in_window) * w..]);
        }
        let prompt = plan.prompt.chunks_exact(w).nth(frame);
        for place in 0..c {
            let id = match prompt.filter(|_| plan.given[place]) {
                Some(word) => word[place],
                None => {
                    let logits = model.read(&unread)?;
                    unread.clear();
                    let mut rng = crate::random::stream(plan.seed, "character", frame as u64, place as u64);
                    pick(plan, &logits, frame, place, &mut rng)?
                }
            };
            ids.push(id);
            unread.push(id);
        }
        ids.push(plan.space);
        unread.push(plan.space);
        in_window += 1;
        progress(frame + 1);
    }
    Ok(ids)
}

fn pick(plan: &Plan, logits: &[f32], frame: usize, place: usize, rng: &mut ChaCha8Rng) -> Result<u32> {
    let Range { start, end } = plan.characters.clone();
    let allowed = logits.get(start as usize..end as usize).ok_or_else(|| {
        Error::Call(format!("the model knows {} tokens, the tokenizer {end}: they don't belong together", logits.len()))
    })?;
    let drawn = plan.draw.pick(allowed, rng).ok_or_else(|| {
        Error::Call(format!("frame {frame}, place {place}: the model's logits are not finite; the run is broken"))
    })?;
    Ok(start + drawn as u32)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Wants the token that is the sum of all it has read, plus one, modulo the characters; checks its context.
    struct Summing {
        context: usize,
        read: Vec<u32>,
        calls: usize,
    }

    impl NextToken for Summing {
        fn context(&self) -> usize {
            self.context
        }

        fn reset(&mut self) -> Result<()> {
            self.read.clear();
            Ok(())
        }

        fn read(&mut self, tokens: &[u32]) -> Result<Vec<f32>> {
            self.read.extend_from_slice(tokens);
            self.calls += 1;
            assert!(self.read.len() <= self.context, "{} tokens in {}", self.read.len(), self.context);
            assert_eq!(self.read[0], 1, "every window begins with the front token");
            let mut logits = vec![0.0; 16];
            logits[0] = 99.0; // never allowed
            logits[6 + (self.read.iter().sum::<u32>() as usize + 1) % 10] = 5.0;
            Ok(logits)
        }
    }

    fn plan<'a>(frames: usize, given: &'a [bool], prompt: &'a [u32], draw: Draw) -> Plan<'a> {
        Plan { frames, given, prompt, characters: 6..16, bos: 1, space: 5, draw, seed: 7 }
    }

    fn run(context: usize, plan: &Plan) -> Result<(Vec<u32>, usize)> {
        let mut model = Summing { context, read: vec![], calls: 0 };
        let ids = dance(&mut model, plan, &mut |_| {})?;
        Ok((ids, model.calls))
    }

    #[test]
    fn given_characters_come_out_as_they_went_in() {
        let prompt = [6, 7, 8, 5, 9, 10, 11, 5];
        let given = [false, true, false];
        let (ids, calls) = run(100, &plan(4, &given, &prompt, Draw::Temperature(1.0))).unwrap();
        assert_eq!(ids.len(), 16);
        assert_eq!((ids[1], ids[5]), (7, 10));
        assert!(ids.chunks(4).all(|w| w[3] == 5 && w[..3].iter().all(|id| (6..16).contains(id))));
        // two free places in the two prompted frames, three in the others: known characters cost no call
        assert_eq!(calls, 2 * 2 + 2 * 3);
    }

    #[test]
    fn a_window_that_moves_never_overflows() {
        for context in 8..40 {
            let p = plan(25, &[false, false, false], &[], Draw::Greedy);
            let (ids, _) = run(context, &p).unwrap();
            assert_eq!(ids.len(), 100);
        }
        assert!(run(7, &plan(3, &[false; 3], &[], Draw::Greedy)).unwrap_err().to_string().contains("holds 1 words"));
    }

    #[test]
    fn the_whole_window_is_read_before_it_moves() {
        // as long as everything fits, the sum of all tokens before decides
        let (ids, _) = run(100, &plan(8, &[false; 3], &[], Draw::Greedy)).unwrap();
        let mut sum = 1;
        for word in ids.chunks(4) {
            for &id in &word[..3] {
                assert_eq!(id, 6 + (sum + 1) % 10);
                sum += id;
            }
            sum += 5;
        }
    }

    #[test]
    fn the_same_seed_gives_the_same_dance() {
        let p = plan(20, &[false; 3], &[], Draw::Temperature(3.0));
        assert_eq!(run(30, &p).unwrap(), run(30, &p).unwrap());
        assert_ne!(run(30, &p).unwrap(), run(30, &Plan { seed: 8, ..p.clone() }).unwrap());
    }

    #[test]
    fn everything_given_needs_no_model() {
        let (ids, calls) = run(30, &plan(2, &[true; 3], &[6, 6, 6, 5, 6, 6, 6, 5], Draw::Greedy)).unwrap();
        assert_eq!((ids, calls), (vec![6, 6, 6, 5, 6, 6, 6, 5], 0));
    }
}
