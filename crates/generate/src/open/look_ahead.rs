//! Which of several continuations of a dance is the most believable.

use super::OpenRequest;
use crate::feet::fixed;
use crate::request::FootMode;
use crate::sampler::{Chooser, LookAhead};
use crate::score::{BEFORE_S, BLOCK_S, Limits, Scorer};
use crate::{Error, Result};
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
    fn score(&self, ids: &[u32], block: &Range<usize>) -> Result<f64> {
        let length = self.tokenizer.frames_per_word();
        let before = (BEFORE_S * self.tokenizer.fps()).ceil() as usize;
        let first = block.start.saturating_sub(before.div_ceil(length));
        let words = self.tokenizer.words_of_ids(ids).words.slice(first..block.end);
        // at least one frame of it, which decoding holds to the end
        let held = (first * length).min(self.rest.frames().saturating_sub(1));
        let rest = self.rest.slice(held..(block.end * length).clamp(held + 1, self.rest.frames().max(held + 1)));
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
    fn best(&self, dances: &[&[u32]], block: Range<usize>) -> Result<usize> {
        let scores: Vec<f64> = dances.par_iter().map(|ids| self.score(ids, &block)).collect::<Result<_>>()?;
        // of equals the first
        let best = scores.iter().enumerate().min_by(|a, b| a.1.total_cmp(b.1));
        Ok(best.map_or(0, |(i, _)| i))
    }
}

impl OpenRequest {
    /// The look-ahead of the dance, if it is to have one.
    pub(super) fn look_ahead(&self) -> Result<Option<LookAhead>> {
        let candidates = self.resolved.look_ahead;
        let Some(limits) = self.limits.clone().filter(|_| candidates > 1) else { return Ok(None) };
        let words =
            |s: f64| ((s * self.tokenizer.fps() / self.tokenizer.frames_per_word() as f64).round() as usize).max(1);
        let given = self.prompt.as_ref().and_then(|prompt| prompt.selection.as_ref());
        let chooser = BlockChooser {
            scorer: Scorer::new(self.tokenizer.channels().joints())?,
            rest: self.rest()?,
            // the frames that a dance continues are before its blocks
            fixed: (self.resolved.feet == FootMode::Lock).then(|| fixed(given, 0)),
            tokenizer: self.tokenizer.clone(),
            limits,
        };
        let (first, block) = (words(FIRST_BLOCK_S), words(BLOCK_S));
        Ok(Some(LookAhead { candidates, first, block, chooser: Arc::new(chooser) }))
    }

    /// The limits that blocks are chosen by; `None` where nothing is.
    pub(super) fn load_limits(&mut self) -> Result<()> {
        if self.resolved.look_ahead > 1 {
            if self.resolved.look_ahead > MOST_CANDIDATES {
                let expected = format!("{MOST_CANDIDATES} at most");
                return Err(Error::invalid_parameter("look_ahead", self.resolved.look_ahead, expected));
            }
            self.limits = Some(Limits::load(&self.resolved.run)?);
        }
        Ok(())
    }

    /// SHA-256 of the limits that blocks are chosen by.
    pub(crate) fn limits_sha256(&self) -> Option<String> {
        self.limits.as_ref().map(|limits| FileRecord::of(limits.to_json().as_bytes()).sha256)
    }
}
