//! Which of several continuations of a dance is the most believable.

use super::OpenRequest;
use crate::Result;
use crate::feet::fixed;
use crate::prompt::uncoded::held;
use crate::request::FootMode;
use crate::sampler::{Chooser, LookAhead};
use crate::score::{BEFORE_S, BLOCK_S, Limits, Scorer};
use kinelm_motion::Clip;
use kinelm_motion::feet::{FixedParts, lock};
use kinelm_motion::rig::Humanoid;
use kinelm_store::FileRecord;
use kinelm_tokenizer::{Tokenizer, UncodedPose};
use rayon::prelude::*;
use std::ops::Range;
use std::sync::Arc;

/// Seconds of a dance's first block: the studio shows it while the next is sampled.
const FIRST_BLOCK_S: f64 = 0.5;
/// The most candidates.
pub const MOST_CANDIDATES: usize = 64;

/// Chooses by the scores of the blocks' motion, decoded and with its feet locked as the whole dance will be.
#[derive(Debug)]
pub(super) struct BlockChooser {
    tokenizer: Tokenizer,
    scorer: Scorer,
    limits: Limits,
    rest: Clip,
    /// What foot locking must not move; `None`: feet aren't locked.
    fixed: Option<FixedParts>,
}

impl BlockChooser {
    /// The score of a block of a dance whose words from `first` on have these ids.
    fn score(&self, ids: &[u32], first: usize, block: &Range<usize>) -> Result<f64> {
        let length = self.tokenizer.frames_per_word();
        let words = self.tokenizer.words_of_ids(ids).words;
        let rest = held(&self.rest, first * length..block.end * length);
        let mut clip = self.tokenizer.decode(&words, UncodedPose::Clip(&rest))?;
        let humanoid = Humanoid::neutral();
        let floor_m = if self.tokenizer.config().above_floor() { 0.0 } else { humanoid.floor(&clip)?.height_m };
        if let Some(fixed) = self.fixed {
            clip = lock(&clip, humanoid, floor_m, fixed)?.0;
        }
        let clip = clip.raised(-floor_m);
        let frames = (block.start - first) * length..clip.frames();
        Ok(self.scorer.score(&self.scorer.measures(&clip, frames), &self.limits))
    }
}

impl Chooser for BlockChooser {
    fn best(&self, dances: &[&[u32]], first: usize, block: Range<usize>) -> Result<usize> {
        let scores: Vec<f64> = dances.par_iter().map(|ids| self.score(ids, first, &block)).collect::<Result<_>>()?;
        // of equals the first
        let best = scores.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1));
        Ok(best.map_or(0, |(i, _)| i))
    }
}

impl OpenRequest {
    /// The look-ahead of the dance, if it is to have one.
    pub(super) fn look_ahead(&self) -> Result<Option<LookAhead>> {
        let Some(limits) = self.limits.clone() else { return Ok(None) };
        let words = |s: f64| s * self.tokenizer.fps() / self.tokenizer.frames_per_word() as f64;
        let block = |s: f64| (words(s).round() as usize).max(1);
        let given = self.prompt.as_ref().and_then(|prompt| prompt.selection.as_ref());
        let chooser = BlockChooser {
            scorer: Scorer::new(self.tokenizer.channels().joints())?,
            rest: self.rest()?,
            // the frames that a dance continues are before its blocks
            fixed: (self.resolved.feet == FootMode::Lock).then(|| fixed(given, self.way.is_some(), 0)),
            tokenizer: self.tokenizer.clone(),
            limits,
        };
        Ok(Some(LookAhead {
            candidates: self.resolved.look_ahead,
            first: block(FIRST_BLOCK_S),
            block: block(BLOCK_S),
            before: words(BEFORE_S).ceil() as usize,
            chooser: Arc::new(chooser),
        }))
    }

    /// SHA-256 of the limits that blocks are chosen by.
    pub(crate) fn limits_sha256(&self) -> Option<String> {
        self.limits.as_ref().map(|limits| FileRecord::of(limits.to_json().as_bytes()).sha256)
    }
}
