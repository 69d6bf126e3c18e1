//! Gaps in training windows: runs of frames that count as free, in which the model is conditioned on the goal after them
//! ([`kinelm_model::goal`]). Nothing is hidden from it and every character is still its target.
//!
//! A window with gaps has several: known runs of 1 to 40 frames and gaps of 2 to 60 between them, log-uniform in length. In
//! 30 % of these windows only some joints are free.

use super::window::WindowId;
use crate::{Error, Result};
use kinelm_model::goal::{Conditioning, FARTHEST, GoalEncoder, GoalTrack};
use kinelm_motion::joints::Selection;
use kinelm_store::random;
use kinelm_tokenizer::Tokenizer;
use rand_chacha::rand_core::RngCore;
use std::ops::Range;

/// Share of the windows with gaps in which only some joints are free.
const SOME_JOINTS: f64 = 0.3;
/// Known runs are at least 1 frame long and shorter than this, gaps at least 2 frames.
const RUN: f64 = 40.0;
/// Gaps are shorter than this.
const GAP: f64 = 61.0;

/// Samples gaps.
#[derive(Debug)]
pub struct Gaps {
    share: f64,
    seed: u64,
    goals: GoalEncoder,
    /// The slots of each coded joint, the root's translation with joint 0.
    joints: Vec<Vec<usize>>,
}

impl Gaps {
    /// Gaps in a share of the windows; `None` where that is 0.
    ///
    /// # Errors
    /// A tokenizer whose frames can't be goals.
    pub fn new(share: f64, tokenizer: &Tokenizer, seed: u64) -> Result<Option<Gaps>> {
        if share == 0.0 {
            return Ok(None);
        }
        let places = |&joint: &usize| {
            let selection = Selection::of(vec![joint]);
            tokenizer.slots_of(&selection).map_err(|e| Error::unsupported("train.gaps", e.to_string()))
        };
        let joints = tokenizer.channels().joints().iter().map(places).collect::<Result<_>>()?;
        Ok(Some(Gaps { share, seed, goals: GoalEncoder::of(tokenizer)?, joints }))
    }

    /// Words after a window that may hold the goals of its gaps.
    pub fn reach(&self) -> usize {
        FARTHEST
    }

    /// Whether a window gets gaps.
    pub fn takes(&self, window: WindowId) -> bool {
        random::unit(&mut self.stream("gaps", window)) < self.share
    }

    /// The goal conditioning of a window of `frames` frames, from the ids (F W) of its `shown` words and those after it.
    /// Slots that are `hidden` from the model are no goals.
    pub fn conditioning(
        &self,
        window: WindowId,
        ids: &[u32],
        shown: usize,
        frames: usize,
        hidden: &[usize],
    ) -> Conditioning {
        let (codes, c) = (self.goals.codes(ids), self.goals.characters());
        let all = codes.len() / c;
        let mut rng = self.stream("gap", window);
        let free = self.free(&mut rng, hidden);
        // outside the gaps all is known, so no character there has a goal
        let mut given = vec![true; codes.len()];
        for gap in sampled(&mut rng, shown.min(all), all) {
            for word in given[gap.start * c..gap.end * c].chunks_exact_mut(c) {
                word.iter_mut().zip(&free).for_each(|(given, free)| *given = !free);
            }
        }
        GoalTrack::new(self.goals.clone(), codes, given, 0).conditioning(frames)
    }

    fn stream(&self, purpose: &str, window: WindowId) -> impl RngCore + use<> {
        random::stream(self.seed, purpose, window.round, window.number as u64)
    }

    /// (C) which slots are free in a window's gaps.
    fn free(&self, rng: &mut impl RngCore, hidden: &[usize]) -> Vec<bool> {
        let mut joints: Vec<&Vec<usize>> = self.joints.iter().collect();
        if random::unit(rng) < SOME_JOINTS && joints.len() > 1 {
            random::shuffle(&mut joints, rng);
            let some = 1 + (random::unit(rng) * (joints.len() - 1) as f64) as usize;
            joints.truncate(some);
        }
        let mut free = vec![false; self.goals.characters()];
        joints.into_iter().flatten().for_each(|&place| free[place] = true);
        // a slot that isn't free has no goal, and a hidden one has no code to lead to
        hidden.iter().for_each(|&place| free[place] = false);
        free
    }
}

/// Gaps that begin within the first `shown` frames and end before the last of `all`.
fn sampled(rng: &mut impl RngCore, shown: usize, all: usize) -> Vec<Range<usize>> {
    // log-uniform: as many gaps of 2 to 4 frames as of 30 to 60
    let mut length = |least: f64, most: f64| (least * (random::unit(rng) * (most / least).ln()).exp()) as usize;
    let (mut gaps, mut at) = (Vec::new(), 0);
    loop {
        let start = at + length(1.0, RUN);
        let end = start + length(2.0, GAP);
        // a gap that no given frame follows would have no goal
        if start >= shown || end >= all {
            return gaps;
        }
        gaps.push(start..end);
        at = end;
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::augment::AugmentConfig;
    use crate::batches::{Batch, Batches};
    use crate::run::RunFile;
    use crate::{Data, TrainConfig, fixture};
    use kinelm_corpus::Split;
    use kinelm_model::{Architecture, ModelConfig};
    use kinelm_tokenizer::{RootRotation, TokenizerConfig};

    #[test]
    fn gaps_begin_in_the_window_and_end_before_a_given_frame() {
        let (mut known, mut free, mut longest) = (0, 0, 0);
        for seed in 0..300 {
            let gaps = sampled(&mut random::stream(seed, "gap", 0, 0), 128, 192);
            let mut at = 0;
            for gap in gaps {
                assert!(gap.start > at && gap.start < 128 && gap.end < 192 && (2..61).contains(&gap.len()), "{gap:?}");
                (known, free, longest) = (known + gap.start - at, free + gap.len(), longest.max(gap.len()));
                at = gap.end;
            }
        }
        // runs of 1 to 40 frames are 10.6 long on average, gaps of 2 to 61 17.3
        let share = free as f64 / (known + free) as f64;
        assert!((0.55..0.7).contains(&share) && longest > 55, "{share} {longest}");
    }

    fn batch(data: &Data, gaps: f64, augment: AugmentConfig) -> Batch {
        let model = ModelConfig {
            architecture: Architecture::TwoLevel,
            layers: 1,
            heads: 1,
            width: 8,
            window: Some(24),
            goal: true,
            ..Default::default()
        };
        let train = TrainConfig { batch: 200, gaps, ..Default::default() };
        let run = RunFile { augment, ..RunFile::new(&model, &train, data).unwrap() };
        Batches::of_run(&run, data).unwrap().batch(3).unwrap()
    }

    #[test]
    fn a_share_of_the_windows_is_conditioned_and_nothing_else_changes() {
        let dir = tempfile::tempdir().unwrap();
        let corpus = fixture::turning(dir.path(), &[(150, Split::Train), (40, Split::Train), (30, Split::Valid)]);
        let data = Data::one(corpus).unwrap();
        let augment = AugmentConfig { mirror: 0.5, history_noise: 1.0, ..Default::default() };
        let (without, with) = (batch(&data, 0.0, augment), batch(&data, 0.5, augment));
        assert_eq!((&without.inputs, &without.targets, &without.clips), (&with.inputs, &with.targets, &with.clips));
        assert_eq!(without.conditioning, None);
        let conditioning = with.conditioning.clone().unwrap();
        assert_eq!((conditioning.rows[0].len(), conditioning.numbers.len() % (200 * 24)), (200 * 24 * 10, 0));
        let of_window = conditioning.numbers.len() / 200;
        let is_conditioned = |window: &&[f32]| window.iter().any(|x| *x != 0.0);
        let windows = conditioning.numbers.chunks(of_window).filter(is_conditioned).count();
        assert!((75..110).contains(&windows), "{windows} of 200 windows");
        // sometimes the root is the only goal, or none
        let words: Vec<&[u32]> = conditioning.rows[0].chunks(10).collect();
        let has = |word: &&&[u32], place: usize| word[place] != kinelm_engine::op::embedding::NONE;
        for (root, knee) in [(true, false), (false, true), (true, true)] {
            assert!(words.iter().any(|word| has(&word, 0) == root && has(&word, 6) == knee), "{root} {knee}");
        }
        let one = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
        assert_eq!(one.install(|| batch(&data, 0.5, augment)), with);
    }

    #[test]
    fn gaps_need_a_goal_conditioned_model_and_a_tokenizer_of_frames() {
        let dir = tempfile::tempdir().unwrap();
        let data = Data::one(fixture::turning(dir.path(), &[(50, Split::Train)])).unwrap();
        let train = TrainConfig { gaps: 0.5, ..Default::default() };
        let two = ModelConfig { architecture: Architecture::TwoLevel, ..Default::default() };
        let said = |model: &ModelConfig, train: &TrainConfig, data: &Data| {
            RunFile::new(model, train, data).unwrap_err().to_string()
        };
        assert!(said(&two, &train, &data).contains("train.gaps is 0.5; expected 0, or a goal-conditioned model"));
        let config = TokenizerConfig::uniform(&[0], 20.0, 20);
        let config = TokenizerConfig { root_rotation: RootRotation::Absolute, ..config };
        let other = Data::one(fixture::danced(&dir.path().join("other"), config, &[(50, Split::Train)])).unwrap();
        let message = said(&ModelConfig { goal: true, ..two }, &TrainConfig::default(), &other);
        assert!(message.contains("model.goal = true") && message.contains("heading_delta"), "{message}");
    }
}
