//! Previous-frame features of a flat model: two more table rows for an input, and the bin from which a relative head counts
//! steps. For words of one length whose slots are of one kind each.
//!
//! Letters: K tokens of the front, W tokens of a word; input i predicts word token k = i - (K - 1) in slot c = k mod W; a is
//! the id one frame back in that slot, b the one two frames back.

use super::config::TokenLayout;
use crate::forecast::reached;
use crate::sequence::Sequence;
use crate::words::{Steps, Words};
use crate::{Error, Result};
use kinelm_engine::bins::Bins;

/// The ids or steps that the logits of a row belong to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Basis {
    /// All ids.
    Ids,
    /// The bins of a slot, by their steps from the bin one frame back; no other id can follow.
    Steps {
        /// The bins of the slot.
        bins: Bins,
        /// p: the bin one frame back, or where its forecast leads.
        from: usize,
    },
}

impl Basis {
    /// The head group: 0 all ids, 1 circular, 2 clamped steps.
    pub fn group(&self) -> usize {
        match self {
            Basis::Ids => 0,
            Basis::Steps { bins, .. } => 1 + usize::from(!bins.circular),
        }
    }
}

/// Reads the tokens one and two frames back in a window.
#[derive(Debug, Clone)]
pub struct PreviousFrames {
    words: Words,
    pad: u32,
}

impl PreviousFrames {
    /// For sequences of these tokens with `front` in front.
    ///
    /// # Panics
    /// If a word's slots have no kinds.
    pub fn new(tokens: &TokenLayout, front: usize) -> PreviousFrames {
        PreviousFrames { words: Words::new(front, tokens.bins()), pad: tokens.pad }
    }

    /// How tables of steps are laid out.
    pub fn steps(&self) -> Steps {
        self.words.steps()
    }

    /// The bins of the slot that input `i` predicts; `None` for spaces, and before the front's last token.
    pub fn bins(&self, i: usize) -> Option<Bins> {
        self.words.follows(i)
    }

    /// The rows of `previous.character.weight` and `previous.step.weight` that are added to input `i` of `window`: a, or
    /// `<pad>` where it is missing; the step from b to a, mod the slot's bins, or S where there is none.
    ///
    /// Reads nothing after `window[i]`.
    pub fn previous(&self, window: &[u32], i: usize) -> [u32; 2] {
        let (a, step) = self.words.previous(window, i);
        [a.unwrap_or(self.pad), step as u32]
    }

    /// The basis of the logits of input `i` of a sequence under a relative head: all ids in the first frame, for spaces,
    /// and where a is no bin of its slot (`<mask>`, `<pad>`).
    pub(crate) fn basis(&self, sequence: &Sequence, i: usize) -> Basis {
        let Some((bins, from)) = self.words.bin(sequence.ids, i, 1) else { return Basis::Ids };
        Basis::Steps { bins, from: reached(bins, from, sequence.forecast(i)) }
    }

    /// Checks that a target whose head is over all ids, though its slot has `bins`, is in the first frame.
    ///
    /// # Errors
    /// If there is an id one frame back, which is no bin then.
    pub(super) fn first_frame(&self, ids: &[u32], i: usize, bins: Bins) -> Result<()> {
        match self.words.back(ids, i, 1).filter(|&id| id != self.pad) {
            None => Ok(()),
            Some(id) => Err(no_bin("what stands a frame before the target", id, bins, i)),
        }
    }
}

pub(super) fn no_bin(what: &str, id: u32, bins: Bins, i: usize) -> Error {
    let (first, last) = (bins.first, bins.ids().end - 1);
    let expected =
        format!("a bin of its slot, {first} to {last}, or <pad> as its target: a relative head counts from bins");
    Error::invalid(format!("{what} of input {i}"), format!("id {id}"), expected)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::SlotRun;
    use kinelm_tokenizer::SlotIds;

    /// Front of 2; words of an angle of 4 bins (ids 6..10), a height of 3 (10..13), a space.
    fn tokens() -> TokenLayout {
        let kind = |first, count, circular| SlotRun { number: 1, kind: SlotIds { first, count, circular } };
        TokenLayout {
            vocabulary: 13,
            word: 3,
            varying: false,
            front: 2,
            pad: 0,
            bos: 1,
            space: 5,
            places: vec![kind(6, 4, true), kind(10, 3, false)],
        }
    }

    #[test]
    fn one_and_two_frames_back_by_hand() {
        let previous_frames = PreviousFrames::new(&tokens(), 2);
        assert_eq!(previous_frames.steps(), Steps { circular: 4, clamped: 3 });
        // bins (3, 2), (1, 0), (0, <mask>), then the third word's space
        let window = [1, 4, 9, 12, 5, 7, 10, 5, 6, 2, 5];
        let rows: Vec<[u32; 2]> = (0..window.len()).map(|i| previous_frames.previous(&window, i)).collect();
        let missing = [0, 4];
        assert_eq!(rows[..4], [missing; 4]);
        // the second word: its first frame back, no step yet
        assert_eq!(rows[4..7], [[9, 4], [12, 4], [5, 4]]);
        // 1 - 3 mod 4, 0 - 2 mod 3, a space
        assert_eq!(rows[7..10], [[7, 2], [10, 1], [5, 4]]);
        // the fourth word's first place: 0 - 1 mod 4
        assert_eq!(rows[10], [6, 3]);
        let basis: Vec<Basis> =
            (0..window.len()).map(|i| previous_frames.basis(&Sequence::alone(&window, 3), i)).collect();
        assert_eq!(basis[..4], [Basis::Ids; 4]);
        let angle = Bins { first: 6, count: 4, circular: true };
        assert_eq!(basis[4], Basis::Steps { bins: angle, from: 3 });
        assert_eq!(basis[6], Basis::Ids);
        assert_eq!(basis[10], Basis::Steps { bins: angle, from: 0 });
        // after <mask> there is no step, and nothing to count from
        let more = [&window[..], &[8]].concat();
        assert_eq!(
            (previous_frames.previous(&more, 11), previous_frames.basis(&Sequence::alone(&more, 3), 11)),
            ([2, 4], Basis::Ids)
        );
    }
}
