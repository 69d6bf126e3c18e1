//! A dance that keeps close to a way over the floor.
//!
//! A drawn way has no sway, and a model whose root is forced to it soon falls: it has seen no dance that moves so. Here the
//! steps stay the model's. Before the root's step in x, in z and in turn is sampled, the logit of each is lowered by the
//! square of how far from the way it leads: a prior, a Gaussian about the place where the way is at that time, times the
//! model's own probabilities. What strays is drawn back the harder the farther it has gone.

use kinelm_tokenizer::root_path::{ROOT_SLOTS, RootPath, RootState, STEP_SLOTS};
use kinelm_tokenizer::{Result, SlotIds, Tokenizer, Words};
use std::f64::consts::TAU;
use std::sync::Arc;

/// The prior's deviation in place, metres. Of 16 dances along four ways 1.7 cm from them on average; at 2 cm it was 5.5, at
/// 5 mm 1.1, where a quarter of them leaned.
const NEAR_M: f64 = 0.008;
/// The same in heading, radians.
const NEAR_RADIANS: f64 = 1.5 / 360.0 * TAU;

/// A way over the floor, frame by frame.
#[derive(Debug, Clone)]
pub struct Way {
    root_path: RootPath,
    /// (F) where the root is.
    states: Vec<RootState>,
    /// Tokens of a word, its space included.
    word: usize,
    /// At [`STEP_SLOTS`]: their ids, and how many of them are one deviation.
    slots: Vec<(SlotIds, f64)>,
}

impl Way {
    /// The way of a clip's words (F, C).
    ///
    /// # Errors
    /// A tokenizer whose codes of the root aren't steps: [`RootPath::of`].
    pub(crate) fn of(words: &Words, tokenizer: &Tokenizer) -> Result<Way> {
        let root_path = RootPath::of(tokenizer)?;
        let mut state = root_path.start();
        let states = words.iter().map(|word| {
            root_path.follow(&mut state, word);
            state.clone()
        });
        let states = states.collect();
        let (from, to) = (root_path.step_codes([0.0; 3]), root_path.step_codes([NEAR_M, NEAR_M, NEAR_RADIANS]));
        let ids = tokenizer.slot_ids();
        let slots = (0..3).map(|i| (ids[STEP_SLOTS[i]], to[i] - from[i])).collect();
        Ok(Way { root_path, states, word: tokenizer.longest_word(), slots })
    }
}

/// Where a dance is beside its way.
#[derive(Debug, Clone)]
pub(super) struct Follower {
    way: Arc<Way>,
    /// The word that is the way's first frame.
    first: usize,
    /// The root's state after each word from `first` on, as far as it was needed.
    states: Vec<RootState>,
}

impl Follower {
    pub fn new(way: Arc<Way>, first: usize) -> Follower {
        Follower { way, first, states: Vec::new() }
    }

    /// The share of a slot of a word, after the words of `ids`, in the logits of its codes; `None` where the way asks nothing:
    /// of other slots, of the first frame, from which the way begins wherever it is, and after its end.
    pub fn pull(&mut self, word: usize, slot: usize, ids: &[u32]) -> Option<impl Fn(u32) -> f32> {
        let (step, frame) = (STEP_SLOTS.iter().position(|&at| at == slot)?, word.checked_sub(self.first)?);
        if frame >= self.way.states.len() {
            return None;
        }
        self.follow(frame.checked_sub(1)?, ids)?;
        let (there, here) = (self.way.states.get(frame)?, &self.states[frame - 1]);
        let target = self.way.root_path.step_codes(here.step_to(there))[step];
        let (SlotIds { first, count, circular }, near) = self.way.slots[step];
        let round = f64::from(count);
        Some(move |id: u32| {
            let off = f64::from(id) - f64::from(first) - target;
            // a turn of nearly a round is a small one to the other side
            let off = if circular { (off + round / 2.0).rem_euclid(round) - round / 2.0 } else { off };
            (-0.5 * (off / near).powi(2)) as f32
        })
    }

    /// Brings the states up to that after a frame.
    fn follow(&mut self, frame: usize, ids: &[u32]) -> Option<()> {
        let Way { root_path, states, word, slots } = &*self.way;
        let code = |id: &u32| id.saturating_sub(slots[0].0.first) as u16;
        for next in self.states.len()..=frame {
            let Some(before) = next.checked_sub(1) else {
                // the way begins where the dance does
                self.states.push(states[0].clone());
                continue;
            };
            let at = (self.first + next) * word;
            let codes: Vec<u16> = ids.get(at..at + ROOT_SLOTS)?.iter().map(code).collect();
            let mut state = self.states[before].clone();
            root_path.follow(&mut state, &codes);
            self.states.push(state);
        }
        Some(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_tokenizer::{RootRotation, TokenizerConfig};

    #[test]
    fn the_likeliest_step_leads_back_to_the_way() {
        let clip = kinelm_corpus::samples::walk(120);
        let config = TokenizerConfig::uniform(&[0, 4], 20.0, 120);
        let config = TokenizerConfig { root_rotation: RootRotation::HeadingDelta, ..config };
        let tokenizer = Tokenizer::fit([&clip], config).unwrap();
        // a walk that ends after 60 frames, so that who comes late can be there
        let still = tokenizer.neutral();
        let walk = tokenizer.encode(&clip).unwrap().words;
        let codes = walk.iter().take(60).chain(std::iter::repeat_n(&still[..], 60)).flatten().copied().collect();
        let words = Words::fixed(codes, still.len());
        let way = Arc::new(Way::of(&words, &tokenizer).unwrap());
        // two words come before the way; then the dance stands still for ten frames
        let mut ids: Vec<u32> = Vec::new();
        let push = |ids: &mut Vec<u32>, codes: &[u16]| {
            let words = kinelm_tokenizer::Words::fixed(codes.to_vec(), codes.len());
            ids.extend(tokenizer.ids_of_words(&words).unwrap());
        };
        (0..12).for_each(|_| push(&mut ids, &still));
        let mut follower = Follower::new(way.clone(), 2);
        let likeliest = |follower: &mut Follower, word: usize, slot: usize, ids: &[u32]| {
            let SlotIds { first, count, .. } = way.slots[0].0;
            let pull = follower.pull(word, slot, ids)?;
            (first..first + count).max_by(|a, b| pull(*a).total_cmp(&pull(*b))).map(|id| (id - first) as u16)
        };
        assert_eq!(likeliest(&mut follower, 2, 0, &ids), None, "the first frame is anywhere");
        assert_eq!(likeliest(&mut follower, 12, 1, &ids), None, "a height is free");
        // taking the likeliest step in each slot, it is on the way again as soon as steps are long enough
        for word in 12..80 {
            let mut codes = still.clone();
            for slot in STEP_SLOTS {
                codes[slot] = likeliest(&mut follower, word, slot, &ids).unwrap();
            }
            push(&mut ids, &codes);
        }
        follower.follow(77, &ids).unwrap();
        let [x, z, turn] = follower.states[77].step_to(&way.states[77]);
        assert!(x.hypot(z) < 0.02 && turn.abs() < 0.06, "{x} {z} {turn}");
        let [x, z, _] = follower.states[9].step_to(&way.states[9]);
        assert!(x.hypot(z) > 0.05, "it was off before: {x} {z}");
        assert_eq!(likeliest(&mut follower, 2 + words.len(), 0, &ids), None, "after its end the way asks nothing");
    }
}
