//! A sample of training frames of bounded size, independent of the order of the clips.

use kinelm_motion::Clip;
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;

/// The most frames of a sample, about 100 MB.
const MOST: usize = 131_072;

/// A longer clip is sampled in pieces of this many frames.
const PIECE: usize = 1024;

/// The pieces with the smallest hashes of their contents, up to [`MOST`] frames: all of them in a small corpus.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct Sample {
    pieces: BTreeMap<Key, Clip>,
    frames: usize,
    /// The smallest hash that didn't fit; it and all larger ones are dropped.
    full_from: Option<Key>,
}

/// The hash of a piece, and its number among equal pieces.
type Key = ([u8; 32], u32);

impl Sample {
    pub(crate) fn new() -> Self {
        Sample::default()
    }

    /// Adds a clip.
    pub(crate) fn add(&mut self, clip: &Clip) {
        for start in (0..clip.frames()).step_by(PIECE) {
            let piece = clip.slice(start..clip.frames().min(start + PIECE));
            self.offer(hash(&piece), piece);
        }
    }

    fn offer(&mut self, hash: [u8; 32], piece: Clip) {
        let mut key = (hash, 0);
        while self.pieces.contains_key(&key) {
            key.1 += 1;
        }
        // what was dropped once must stay out, or the sample would depend on the order of the clips
        if self.full_from.is_some_and(|full| key >= full) {
            return;
        }
        self.frames += piece.frames();
        self.pieces.insert(key, piece);
        // the largest hashes go: hashes are random, so the pieces that stay are a random sample
        while self.frames > MOST
            && let Some((key, piece)) = self.pieces.pop_last()
        {
            self.frames -= piece.frames();
            self.full_from = Some(key);
        }
    }

    /// Adds the sample of another part of the corpus.
    pub(crate) fn merge(&mut self, other: &Sample) {
        if let Some(full) = other.full_from
            && self.full_from.is_none_or(|own| full < own)
        {
            self.full_from = Some(full);
            // pieces that the other part had no room for would be missing from its share
            for (_, piece) in self.pieces.split_off(&full) {
                self.frames -= piece.frames();
            }
        }
        for (key, piece) in &other.pieces {
            self.offer(key.0, piece.clone());
        }
    }

    /// The pieces, in an order that depends only on their contents.
    pub(crate) fn into_clips(self) -> Vec<Clip> {
        self.pieces.into_values().collect()
    }
}

fn hash(piece: &Clip) -> [u8; 32] {
    let mut hash = Sha256::new();
    for p in piece.root() {
        p.to_array().iter().for_each(|x| hash.update(x.to_le_bytes()));
    }
    for q in piece.rotations() {
        q.to_array().iter().for_each(|x| hash.update(x.to_le_bytes()));
    }
    hash.finalize().into()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contract::bent;

    #[test]
    fn a_small_corpus_is_kept_whole() {
        let clips = [bent(1, 30), bent(2, 2500), bent(1, 30)];
        let mut s = Sample::new();
        clips.iter().for_each(|c| s.add(c));
        let mut lengths: Vec<usize> = s.clone().into_clips().iter().map(Clip::frames).collect();
        lengths.sort_unstable();
        assert_eq!(lengths, [30, 30, 452, 1024, 1024]);
        let mut other = Sample::new();
        clips.iter().rev().for_each(|c| other.add(c));
        assert_eq!(other, s);
    }

    #[test]
    fn a_large_one_in_any_order_and_in_parts() {
        let long = bent(1, PIECE);
        // clips that differ in their first frame alone, made without 200 bends
        let clips: Vec<Clip> = (0..200)
            .map(|i| {
                let mut root = long.root().to_vec();
                root[0].x += f64::from(i);
                Clip::new(long.skeleton().clone(), 20.0, root, long.rotations().to_vec()).unwrap()
            })
            .collect();
        let of = |order: &mut dyn Iterator<Item = &Clip>| {
            let mut s = Sample::new();
            order.for_each(|c| s.add(c));
            s
        };
        let all = of(&mut clips.iter());
        assert_eq!((all.pieces.len(), all.frames), (128, MOST));
        assert_eq!(of(&mut clips.iter().rev()), all);
        let mut merged = of(&mut clips[..150].iter());
        merged.merge(&of(&mut clips[150..].iter()));
        assert_eq!(merged, all);
    }
}
