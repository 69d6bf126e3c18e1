//! The frames that static floors are of: all of a split, or of a large one a sample.

use kinelm_corpus::{ClipRecord, Corpus, Split};
use std::ops::Range;

/// A split with more frames than this is sampled down to about this many.
pub const MOST_FRAMES: usize = 200_000;

/// Frames of a stretch of a sample, at most: each counts as a clip of its own.
const STRETCH: usize = 1_000;

/// How much of a split is measured.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Extent {
    /// All of it; memory grows with its hours.
    All,
    /// At most `MOST_FRAMES`, spread evenly.
    #[default]
    Sample,
}

impl Extent {
    /// Whether all of so many frames are measured.
    pub fn is_all_of(self, frames: usize) -> bool {
        self == Extent::All || frames <= MOST_FRAMES
    }

    /// Stretches of clips, given each clip's units (frames, or words of `frames` frames): the clip's number and its
    /// units.
    /// Whole clips, in order, where they have few enough frames.
    pub(crate) fn stretches(self, clips: &[usize], frames: usize) -> Vec<(usize, Range<usize>)> {
        let all: usize = clips.iter().map(|units| units * frames).sum();
        if self.is_all_of(all) {
            return clips.iter().enumerate().map(|(clip, &units)| (clip, 0..units)).collect();
        }
        // a stretch has a word at least, even where a word is longer than [`STRETCH`]
        let step = (STRETCH / frames).max(1);
        let of_clip = |(clip, &units): (usize, &usize)| {
            (0..units).step_by(step).map(move |first| (clip, first..(first + step).min(units)))
        };
        let stretches: Vec<_> = clips.iter().enumerate().flat_map(of_clip).collect();
        let there = stretches.len();
        let taken = (there * MOST_FRAMES / all).max(1);
        // the i-th of `taken` equal parts begins at `i * there / taken`, so the sample is spread over all clips
        (0..taken).map(|i| stretches[i * there / taken].clone()).collect()
    }
}

/// Words of a clip.
#[derive(Debug, Clone)]
pub struct Stretch<'a> {
    /// The clip.
    pub clip: &'a ClipRecord,
    /// The range of its words.
    pub words: Range<usize>,
}

/// The stretches of a split that are measured.
pub fn stretches(corpus: &Corpus, split: Split, extent: Extent) -> Vec<Stretch<'_>> {
    let clips: Vec<&ClipRecord> = corpus.split(split).collect();
    let words: Vec<usize> = clips.iter().map(|clip| corpus.words(clip).len()).collect();
    let found = extent.stretches(&words, corpus.manifest().frames_per_word);
    found.into_iter().map(|(clip, words)| Stretch { clip: clips[clip], words }).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn few_clips_are_taken_whole_and_of_many_a_spread_sample() {
        assert_eq!(
            Extent::Sample.stretches(&[3, 0, MOST_FRAMES - 3], 1),
            [(0, 0..3), (1, 0..0), (2, 0..MOST_FRAMES - 3)]
        );
        let clips = vec![2_500; 800];
        assert_eq!(Extent::All.stretches(&clips, 1).len(), 800);
        for (units, frames) in [(2_500, 1), (125, 20)] {
            let found = Extent::Sample.stretches(&vec![units; 800], frames);
            let taken: usize = found.iter().map(|(_, words)| words.len() * frames).sum();
            assert!((190_000..=210_000).contains(&taken), "{taken}");
            assert!(found.iter().all(|(_, words)| words.len() * frames <= STRETCH && words.end <= units));
            assert!(found.first().unwrap().0 == 0 && found.last().unwrap().0 > 790);
        }
        // one clip of many hours
        assert_eq!(Extent::Sample.stretches(&[2_000_000], 1)[1], (0, 10_000..11_000));
    }
}
