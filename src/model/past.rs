//! What the frame before tells of the token about to be predicted: two more rows of tables for its input, and what the
//! logits of its row stand for. For words of one length whose places are of one kind each.
//!
//! Letters: K tokens of the front, W tokens of a word; input i predicts word token k = i - (K - 1), which stands at place
//! c = k mod W; a is the id one frame back at that place, b the one two frames back.

use super::config::TokenLayout;
use super::questions::no_bin;
use crate::Result;
use kinelm_tokenizer::PlaceIds;

/// The largest numbers of bins of a layout's places.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Counts {
    /// Of circular places; 0 where there are none.
    pub circular: usize,
    /// Of clamped places; 0 where there are none.
    pub clamped: usize,
}

impl Counts {
    /// Those of a layout's places.
    pub fn of(tokens: &TokenLayout) -> Counts {
        let most = |circular: bool| {
            let counts = tokens.places.iter().map(|s| s.kind).filter(|kind| kind.circular == circular);
            counts.map(|kind| kind.count as usize).max().unwrap_or(0)
        };
        Counts { circular: most(true), clamped: most(false) }
    }

    /// S: that of any place.
    pub fn largest(self) -> usize {
        self.circular.max(self.clamped)
    }

    /// Steps that a clamped place can take: up and down by all bins but one.
    pub fn steps(self) -> usize {
        (2 * self.clamped).saturating_sub(1)
    }
}

/// What the logits of a row stand for.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Basis {
    /// All ids.
    Ids,
    /// The bins of a place, by their steps from the bin one frame back; no other id can come.
    Steps {
        /// The place's kind.
        kind: PlaceIds,
        /// p: the bin one frame back.
        from: u32,
    },
}

/// Reads what lies one and two frames back in a window.
#[derive(Debug, Clone)]
pub struct Past {
    word: usize,
    front: usize,
    pad: u32,
    places: Vec<PlaceIds>,
    counts: Counts,
}

impl Past {
    /// Of windows of these tokens.
    ///
    /// # Panics
    /// If a word's places have no kinds.
    pub fn of(tokens: &TokenLayout) -> Past {
        let places: Vec<PlaceIds> = tokens.place_ids().collect();
        assert!(!places.is_empty(), "places of one kind each");
        Past { word: tokens.word, front: tokens.front, pad: tokens.pad, places, counts: Counts::of(tokens) }
    }

    /// The largest numbers of bins.
    pub fn counts(&self) -> Counts {
        self.counts
    }

    /// What stands at the place that input `i` predicts; `None` for spaces, and before the front's last token.
    pub fn kind(&self, i: usize) -> Option<PlaceIds> {
        let k = (i + 1).checked_sub(self.front)?;
        self.places.get(k % self.word).copied()
    }

    /// Whether a window has something one frame before what input `i` predicts.
    pub fn has_frame_before(&self, i: usize) -> bool {
        i + 1 >= self.front + self.word
    }

    /// The id `frames` frames before the token that input `i` of `window` predicts; `None` where the window has none.
    fn back(&self, window: &[u32], i: usize, frames: usize) -> Option<u32> {
        let at = (i + 1).checked_sub(frames * self.word)?;
        (at >= self.front).then(|| window[at])
    }

    /// The rows of `previous.character.weight` and `previous.step.weight` that are added to input `i` of `window`: a, or
    /// `<pad>` where it is missing; the bins from b to a, round the circle, or S where there is no such step.
    ///
    /// Reads nothing behind `window[i]`.
    pub fn previous(&self, window: &[u32], i: usize) -> [u32; 2] {
        let (a, b) = (self.back(window, i, 1), self.back(window, i, 2));
        let step = || {
            let kind = self.kind(i)?;
            let (a, b) = (kind.bin(a?)?, kind.bin(b?)?);
            Some((a + kind.count - b) % kind.count)
        };
        [a.unwrap_or(self.pad), step().unwrap_or(self.counts.largest() as u32)]
    }

    /// What the logits of input `i` of `window` stand for under a relative head: all ids in the first frame, for spaces,
    /// and where a is no bin of its place (`<mask>`, `<pad>`).
    pub fn basis(&self, window: &[u32], i: usize) -> Basis {
        let of = |kind: PlaceIds| Some(Basis::Steps { kind, from: kind.bin(self.back(window, i, 1)?)? });
        self.kind(i).and_then(of).unwrap_or(Basis::Ids)
    }

    /// Holds a target at a place of this `kind` that has nothing to count from to the window's first frame.
    ///
    /// # Errors
    /// An id one frame back that is no bin.
    pub(super) fn first_frame(&self, window: &[u32], i: usize, kind: PlaceIds) -> Result<()> {
        match self.back(window, i, 1) {
            None => Ok(()),
            Some(id) => Err(no_bin("what stands a frame before the target", id, kind, i)),
        }
    }

    /// The row of its table that bin `bin` has, `from` bins one frame back: (bin - from) mod n of `head.circular.weight`,
    /// bin - from + m - 1 of `head.clamped.weight`, m bins at the largest clamped place.
    pub fn column(&self, kind: PlaceIds, from: u32, bin: u32) -> u32 {
        match kind.circular {
            true => (bin + kind.count - from) % kind.count,
            false => bin + self.counts.clamped as u32 - 1 - from,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::config::Stretch;

    /// Front of 2; words of an angle of 4 bins (ids 6..10), a height of 3 (10..13), a space.
    fn tokens() -> TokenLayout {
        let kind = |first, count, circular| Stretch { number: 1, kind: PlaceIds { first, count, circular } };
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
        let past = Past::of(&tokens());
        assert_eq!((past.counts(), past.counts().steps()), (Counts { circular: 4, clamped: 3 }, 5));
        // bins (3, 2), (1, 0), (0, <mask>), then the third word's space
        let window = [1, 4, 9, 12, 5, 7, 10, 5, 6, 2, 5];
        let rows: Vec<[u32; 2]> = (0..window.len()).map(|i| past.previous(&window, i)).collect();
        let missing = [0, 4];
        assert_eq!(rows[..4], [missing; 4]);
        // the second word: its first frame back, no step yet
        assert_eq!(rows[4..7], [[9, 4], [12, 4], [5, 4]]);
        // 1 - 3 mod 4, 0 - 2 mod 3, a space
        assert_eq!(rows[7..10], [[7, 2], [10, 1], [5, 4]]);
        // the fourth word's first place: 0 - 1 mod 4
        assert_eq!(rows[10], [6, 3]);
        let basis: Vec<Basis> = (0..window.len()).map(|i| past.basis(&window, i)).collect();
        assert_eq!(basis[..4], [Basis::Ids; 4]);
        let angle = PlaceIds { first: 6, count: 4, circular: true };
        assert_eq!(basis[4], Basis::Steps { kind: angle, from: 3 });
        assert_eq!(basis[6], Basis::Ids);
        assert_eq!(basis[10], Basis::Steps { kind: angle, from: 0 });
        // behind <mask> there is no step, and nothing to count from
        let more = [&window[..], &[8]].concat();
        assert_eq!((past.previous(&more, 11), past.basis(&more, 11)), ([2, 4], Basis::Ids));
    }

    #[test]
    fn columns_are_steps() {
        let past = Past::of(&tokens());
        let [angle, height] =
            [(6, 4, true), (10, 3, false)].map(|(first, count, circular)| PlaceIds { first, count, circular });
        let columns =
            |kind: PlaceIds, from| (0..kind.count).map(|bin| past.column(kind, from, bin)).collect::<Vec<_>>();
        assert_eq!(columns(angle, 3), [1, 2, 3, 0]);
        assert_eq!(columns(height, 0), [2, 3, 4]);
        assert_eq!(columns(height, 2), [0, 1, 2]);
    }
}
