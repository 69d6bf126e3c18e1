//! Frames of a dance while it is sampled, each decoded once: a sketch, in which no foot is locked and no end of a gap closed.
//!
//! Steps and turns of the root are coded from the frame before, so frames decoded without their beginning are right but
//! for position and heading. The last frame that was shown is decoded again with the new ones, which gives both.

use crate::Result;
use crate::open::OpenRequest;
use crate::prompt::uncoded::held;
use kinelm_motion::{Clip, Quat, Vec3};
use kinelm_tokenizer::{Tokenizer, UncodedPose, Words};

/// The sampled part of a dance on SMPL-24, at the model's rate.
pub struct Preview {
    /// The clip from which uncoded joints take their motion; made when frames are first shown, as most dances are never
    /// looked at.
    rest: Option<Clip>,
    words: Words,
    /// Words of the whole dance.
    all: usize,
    /// Frames of the lead-in, which is not shown.
    lead_in: usize,
    /// Frames after it that are.
    frames: usize,
    /// Frames that are out, those of the lead-in included.
    done: usize,
    /// Where the root was in the last of them, and its rotation.
    last: Option<(Vec3, Quat)>,
    /// Frames that were decoded.
    decoded: usize,
}

impl Preview {
    /// Of a dance of which nothing is sampled yet.
    pub fn new(open: &OpenRequest) -> Preview {
        Preview::of(open.words_in_all(), open.resolved.lead_in, open.frames)
    }

    fn of(all: usize, lead_in: usize, frames: usize) -> Preview {
        Preview { rest: None, words: Words::default(), all, lead_in, frames, done: 0, last: None, decoded: 0 }
    }

    /// Takes up the ids of a word.
    pub fn push(&mut self, tokenizer: &Tokenizer, word: &[u32]) {
        tokenizer.words_of_ids(word).words.iter().for_each(|word| self.words.push(word));
    }

    /// Frames that are out.
    pub(crate) fn shown(&self) -> usize {
        self.done.saturating_sub(self.lead_in)
    }

    /// The frames that are new since the last call, if there are any.
    ///
    /// # Errors
    /// Words that are not this tokenizer's.
    pub fn next(&mut self, open: &OpenRequest) -> Result<Option<Clip>> {
        self.next_by(&open.tokenizer, || open.rest(), |clip| open.standing(clip))
    }

    /// The same; `rest` makes the clip of the uncoded joints, `standing` moves the first frames, lead-in included, to the
    /// dance's place, and drops the lead-in.
    fn next_by(
        &mut self,
        tokenizer: &Tokenizer,
        rest: impl FnOnce() -> Result<Clip>,
        standing: impl FnOnce(Clip) -> Result<Clip>,
    ) -> Result<Option<Clip>> {
        let (length, reach) = (tokenizer.frames_per_word(), tokenizer.scheme().reach());
        let sampled = self.words.len() * length;
        // where windows overlap, the next word changes the last frames
        let settled = if self.words.len() < self.all { sampled.saturating_sub(reach) } else { sampled };
        let end = settled.min(self.lead_in + self.frames);
        if end <= self.done.max(self.lead_in) {
            return Ok(None);
        }
        // a word that lacks the one before is right from its end on, beyond the window's reach: there is the last frame
        let from = self.done.saturating_sub(1 + reach) / length;
        let from = if self.done == 0 { 0 } else { from.saturating_sub(1) };
        let words = self.words.slice(from..self.words.len());
        self.decoded += words.len() * length;
        let first = from * length;
        let rest = match &mut self.rest {
            Some(rest) => rest,
            none => none.insert(rest()?),
        };
        let rest = held(rest, first..first + words.len() * length);
        let clip = tokenizer.decode(&words, UncodedPose::Clip(&rest))?;
        let clip = match self.last {
            None => standing(clip.slice(0..end))?,
            Some((at, facing)) => {
                let before = self.done - 1 - first;
                let (turn, there) = (facing * clip.pose(before)[0].conjugate(), clip.root()[before]);
                let new = clip.slice(before + 1..end - first);
                let root = new.root().iter().map(|p| turn * (*p - there) + at).collect();
                let mut rotations = new.rotations().to_vec();
                // normalised, as the turn is multiplied from chunk to chunk
                rotations.iter_mut().step_by(24).for_each(|pelvis| *pelvis = (turn * *pelvis).normalize());
                Clip::new(new.skeleton().clone(), new.fps(), root, rotations)?
            }
        };
        self.done = end;
        self.last = clip.root().last().map(|at| (*at, clip.pose(clip.frames() - 1)[0]));
        Ok(Some(clip))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::rotation::angle_between;
    use kinelm_motion::synth;
    use kinelm_tokenizer::DctConfig;
    use kinelm_tokenizer::LappedConfig;
    use kinelm_tokenizer::{SchemeConfig, TokenizerConfig};

    /// Tokenizers of words of a frame, of a tile, and of overlapping tiles.
    fn tokenizers(clips: &[Clip]) -> Vec<Tokenizer> {
        let joints: Vec<usize> = (0..22).collect();
        let frames = TokenizerConfig::uniform(&joints, 20.0, 360);
        let of = |scheme: SchemeConfig| TokenizerConfig { scheme, ..frames.clone() };
        let dct = SchemeConfig::Dct(DctConfig { tile: 20, ..DctConfig::default() });
        let lapped = SchemeConfig::Lapped(LappedConfig::default());
        [frames.clone(), of(dct), of(lapped)].map(|config| Tokenizer::fit(clips, config).unwrap()).into()
    }

    #[test]
    fn each_frame_is_decoded_once_and_as_in_the_whole_dance() {
        let clips: Vec<Clip> = synth::corpus(2, 3, 30.0, 20.0).unwrap().into_iter().map(|dance| dance.clip).collect();
        for tokenizer in tokenizers(&clips) {
            let words = tokenizer.encode(&clips[1]).unwrap().words;
            // joints that aren't coded are those of a clip that ends before the dance
            let rest = clips[2].slice(0..200);
            let whole = tokenizer.decode(&words, UncodedPose::Clip(&rest)).unwrap();
            let (lead_in, frames) = (20, clips[1].frames() - 20);
            let standing = |clip: Clip| Ok(clip.slice(lead_in..clip.frames()));
            let mut preview = Preview::of(words.len(), lead_in, frames);
            let mut shown = Vec::new();
            for word in words.iter() {
                let mut one = Words::default();
                one.push(word);
                preview.push(&tokenizer, &tokenizer.ids_of_words(&one).unwrap());
                shown.extend(preview.next_by(&tokenizer, || Ok(rest.clone()), standing).unwrap());
                assert!(
                    preview.next_by(&tokenizer, || Ok(rest.clone()), standing).unwrap().is_none(),
                    "nothing is new"
                );
            }
            let mut frame = lead_in;
            for clip in &shown {
                for own in 0..clip.frames() {
                    let (found, expected) = (clip.root()[own], whole.root()[frame]);
                    assert!((found - expected).length() < 1e-9, "frame {frame}: {found} {expected}");
                    let joints = clip.pose(own).iter().zip(whole.pose(frame));
                    assert!(joints.map(|(a, b)| angle_between(*a, *b)).all(|angle| angle < 1e-9), "frame {frame}");
                    frame += 1;
                }
            }
            assert_eq!((frame, preview.shown()), (lead_in + frames, frames));
            // in each call one new word, and the two or three from which its place follows
            let looks = words.len() * (3 + tokenizer.scheme().reach().div_ceil(tokenizer.frames_per_word()));
            let most = looks * tokenizer.frames_per_word() + lead_in;
            assert!(preview.decoded <= most, "{} of {most} frames", preview.decoded);
        }
    }
}
