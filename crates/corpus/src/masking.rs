//! Windows of a masked model: some tokens are hidden, and each chosen one is its own target (docs/training.md, "Masked
//! models").

use crate::{Error, Result};
use kinelm_motion::joints::Selection;
use kinelm_store::random;
use kinelm_tokenizer::{Special, Tokenizer};
use rand_chacha::rand_core::RngCore;

/// The fraction of eligible tokens that are chosen.
const CHOSEN: f64 = 0.15;
/// The fraction of chosen tokens that become `<mask>`; the others stay visible.
const HIDDEN: f64 = 0.9;

/// How many of `n` tokens are chosen: 15 %, rounded up.
pub fn chosen(n: usize) -> usize {
    (CHOSEN * n as f64).ceil() as usize
}

/// Writes a sequence of T places from the tokens of a window: `front` and the tokens to `input`, `pad` after them. Of the
/// tokens whose number `may` allows, 15 % (rounded up) are chosen; the target of each stands at its own place, not one
/// before as in [`fill_sequence`](super::fill_sequence), and all others are `pad`. Each of the chosen becomes `<mask>` in
/// the input with probability 0.9.
///
/// One number of `rng` is sampled for each token, and those with the least are chosen; then one for each chosen token,
/// by place.
///
/// # Panics
/// If `input` and `target` differ in length, or front and tokens don't fit.
pub fn fill_masked(
    window: WindowTokens,
    may: &dyn Fn(usize) -> bool,
    rng: &mut impl RngCore,
    input: &mut [u32],
    target: &mut [u32],
) {
    window.fill(input, target);
    let k = window.front.len();
    // for every token, so that a token's number doesn't depend on which others are eligible
    let numbers: Vec<f64> = window.tokens.iter().map(|_| random::unit(rng)).collect();
    let mut open: Vec<usize> = (0..numbers.len()).filter(|&i| may(i)).collect();
    let number = chosen(open.len());
    open.sort_by(|&a, &b| numbers[a].total_cmp(&numbers[b]));
    open.truncate(number);
    // back in the order of places, in which the second numbers are sampled
    open.sort_unstable();
    for place in open.into_iter().map(|i| k + i) {
        target[place] = input[place];
        if random::unit(rng) < HIDDEN {
            input[place] = Special::Mask.id();
        }
    }
}

/// The tokens of a masked model's window before any is hidden.
#[derive(Debug, Clone, Copy)]
pub struct WindowTokens<'a> {
    /// Conditioning tokens.
    pub front: &'a [u32],
    /// The tokens of words.
    pub tokens: &'a [u32],
    /// The id that fills the rest.
    pub pad: u32,
}

impl WindowTokens<'_> {
    /// Writes them as inputs; no target yet.
    fn fill(&self, input: &mut [u32], target: &mut [u32]) {
        assert_eq!(input.len(), target.len(), "input and target of one length");
        let (k, end) = (self.front.len(), self.front.len() + self.tokens.len());
        assert!(end <= input.len(), "{end} tokens for {} places", input.len());
        input[..k].copy_from_slice(self.front);
        input[k..end].copy_from_slice(self.tokens);
        input[end..].fill(self.pad);
        target.fill(self.pad);
    }
}

/// Hides characters as a gap or an occluded joint does: of some joints, over a run of words.
///
/// The run is 1 word to all of the window, log-uniform in length. In half of the windows all joints are hidden in it, else 1
/// to half of them. In half of the windows all their characters there are hidden, else a share that is uniform, as after a
/// few passes of generation. Spaces are never hidden.
#[derive(Debug, Clone)]
pub struct SpanMasking {
    /// W.
    word: usize,
    /// The slots of each coded joint, the root's translation with joint 0.
    joints: Vec<Vec<usize>>,
}

impl SpanMasking {
    /// The spans of a tokenizer's words.
    ///
    /// # Errors
    /// Words that differ in length, or whose characters belong to no one joint.
    pub fn of(tokenizer: &Tokenizer) -> Result<SpanMasking> {
        let refused = |why: String| Error::unsupported("masking of spans", why);
        let Some(word) = tokenizer.tokens_per_word() else {
            return Err(refused("the words of this tokenizer differ in length".into()));
        };
        let slots = |&joint: &usize| {
            let selection = Selection::of(vec![joint]);
            tokenizer.slots_of(&selection).map_err(|e| refused(e.to_string()))
        };
        let joints = tokenizer.channels().joints().iter().map(slots).collect::<Result<_>>()?;
        Ok(SpanMasking { word, joints })
    }

    /// As [`fill_masked`], with a span in place of 15 % of the tokens; every target is hidden.
    ///
    /// # Panics
    /// As [`fill_masked`].
    pub fn fill(
        &self,
        window: WindowTokens,
        may: &dyn Fn(usize) -> bool,
        rng: &mut impl RngCore,
        input: &mut [u32],
        target: &mut [u32],
    ) {
        window.fill(input, target);
        let words = window.tokens.len() / self.word;
        if words == 0 {
            return;
        }
        // a uniform exponent gives log-uniform lengths
        let length = (((words + 1) as f64).powf(random::unit(rng)) as usize).clamp(1, words);
        // `unit` is below 1, so the run ends inside the window
        let first = (random::unit(rng) * (words + 1 - length) as f64) as usize;
        let slots = self.slots(rng);
        let of_word = |word: usize| slots.iter().map(move |slot| word * self.word + slot);
        let mut hidden: Vec<usize> = (first..first + length).flat_map(of_word).filter(|&i| may(i)).collect();
        if random::unit(rng) < 0.5 {
            let number = (random::unit(rng) * hidden.len() as f64).ceil() as usize;
            random::shuffle(&mut hidden, rng);
            hidden.truncate(number);
        }
        for place in hidden.into_iter().map(|i| window.front.len() + i) {
            target[place] = input[place];
            input[place] = Special::Mask.id();
        }
    }

    /// The slots of the joints that are hidden.
    fn slots(&self, rng: &mut impl RngCore) -> Vec<usize> {
        let mut joints: Vec<usize> = (0..self.joints.len()).collect();
        if random::unit(rng) < 0.5 {
            let half = (joints.len() / 2).max(1);
            let number = 1 + (random::unit(rng) * half as f64) as usize;
            random::shuffle(&mut joints, rng);
            joints.truncate(number);
        }
        joints.into_iter().flat_map(|joint| self.joints[joint].iter().copied()).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_store::random;
    use std::collections::BTreeSet;

    #[test]
    fn spans_hide_joints_over_words_that_follow_one_another() {
        let masking = SpanMasking { word: 5, joints: vec![vec![0, 1], vec![2], vec![3]] };
        // 20 words, and the beginning of one more
        let tokens: Vec<u32> = (0..103).map(|i| if i % 5 == 4 { 5 } else { 10 + i }).collect();
        let (mut all_joints, mut whole, mut longest) = (0, 0, 0);
        for number in 0..400 {
            let (mut input, mut target) = ([9; 110], [9; 110]);
            let mut rng = random::stream(1, "mask", 0, number);
            let window = WindowTokens { front: &[1, 7], tokens: &tokens, pad: 0 };
            masking.fill(window, &|i| i % 5 != 3, &mut rng, &mut input, &mut target);
            assert_eq!((input[..2].to_vec(), &input[105..], &target[105..]), (vec![1, 7], &[0; 5][..], &[0; 5][..]));
            let hidden: Vec<usize> = (0..103).filter(|&i| target[2 + i] != 0).collect();
            for i in 0..103 {
                let expected = if hidden.contains(&i) { (3, tokens[i]) } else { (tokens[i], 0) };
                assert_eq!((input[2 + i], target[2 + i]), expected);
                assert!(!hidden.contains(&i) || i < 100 && i % 5 < 3, "{i} may be hidden");
            }
            let words: BTreeSet<usize> = hidden.iter().map(|i| i / 5).collect();
            let slots: BTreeSet<usize> = hidden.iter().map(|i| i % 5).collect();
            let Some((first, last)) = words.first().zip(words.last()) else { continue };
            longest = longest.max(last + 1 - first);
            whole += usize::from(hidden.len() == (last + 1 - first) * slots.len());
            all_joints += usize::from(slots.len() == 3);
        }
        assert!((140..=260).contains(&all_joints) && whole > 190 && longest == 20, "{all_joints} {whole} {longest}");
    }

    #[test]
    fn fifteen_percent_are_chosen_and_about_a_tenth_of_them_stays() {
        assert_eq!([0, 1, 6, 7, 20, 100, 101].map(chosen), [0, 1, 1, 2, 3, 15, 16]);
        let tokens: Vec<u32> = (10..210).collect();
        let (mut counts, mut hidden) = (vec![0; 200], 0);
        for number in 0..400 {
            let (mut input, mut target) = ([9; 220], [9; 220]);
            let mut rng = random::stream(1, "mask", 0, number);
            let window = WindowTokens { front: &[1, 7], tokens: &tokens, pad: 0 };
            fill_masked(window, &|_| true, &mut rng, &mut input, &mut target);
            assert_eq!((input[..2].to_vec(), &input[202..], &target[202..]), (vec![1, 7], &[0; 18][..], &[0; 18][..]));
            let chosen: Vec<usize> = (0..220).filter(|&i| target[i] != 0).collect();
            assert_eq!(chosen.len(), 30);
            hidden += input.iter().filter(|id| **id == 3).count();
            for i in 2..202 {
                let own = tokens[i - 2];
                assert!(target[i] == 0 && input[i] == own || target[i] == own && [own, 3].contains(&input[i]));
            }
            chosen.iter().for_each(|i| counts[i - 2] += 1);
        }
        // 60 each; five standard deviations of a binomial are 36
        // 0.9 of 12,000; five standard deviations of a binomial are 164
        assert!(hidden.abs_diff(10_800) < 164, "{hidden}");
        assert!(counts.iter().all(|&c: &i32| (c - 60).abs() < 36), "{counts:?}");
    }

    #[test]
    fn what_may_not_be_chosen_is_not_and_does_not_count() {
        let (mut input, mut target) = ([9; 41], [9; 41]);
        let tokens = [5; 40];
        let mut rng = random::stream(1, "mask", 0, 0);
        let window = WindowTokens { front: &[1], tokens: &tokens, pad: 0 };
        fill_masked(window, &|i| i % 2 == 0, &mut rng, &mut input, &mut target);
        assert_eq!(target.iter().filter(|id| **id == 5).count(), 3);
        assert!((1..41).all(|i| target[i] == 0 || (i - 1) % 2 == 0));
    }
}
