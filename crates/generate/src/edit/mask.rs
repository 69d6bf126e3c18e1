//! Which joints are given in which frames of a clip.

use crate::request::Span;
use kinelm_motion::joints::{self, Selection};
use kinelm_motion::moment::Timebase;
use kinelm_motion::{Skeleton, smpl};
use kinelm_tokenizer::Tokenizer;
use std::ops::Range;

/// Given joints by the frames of a clip as it is in its file: F frames of the 24 SMPL joints, of which those that a
/// tokenizer codes are given or free. The root's place goes with joint 0.
#[derive(Debug, Clone, PartialEq)]
pub struct Mask {
    /// A bit a joint, for each of the F frames.
    given: Vec<u32>,
    /// The joints that can be given or free.
    coded: u32,
    /// Frames of the file and of the model in a second.
    rates: (f64, f64),
}

/// What a span means of a clip.
#[derive(Debug, Clone, PartialEq)]
pub struct Understood {
    /// As it was asked for.
    pub span: Span,
    /// The coded joints among those that it names, SMPL ids.
    pub joints: Vec<usize>,
    /// Those that it names and that are not coded.
    pub uncoded: Vec<usize>,
    /// Frames of the clip.
    pub frames: Range<usize>,
    /// Parts that the rig has for other joints too, which are not meant.
    pub twice: Vec<(String, &'static str)>,
}

/// What was understood of the spans, and the mask that they make.
pub struct Read {
    /// Given ones, in SMPL's names.
    pub given: Vec<Understood>,
    /// Free ones.
    pub free: Vec<Understood>,
    /// What is given in the end.
    pub mask: Mask,
}

impl Mask {
    /// Givens add up, frees are taken off them; without givens, all is given but the frees.
    ///
    /// # Errors
    /// Joints that are none, or of which the tokenizer codes none; times outside of the clip; nothing that is left free.
    pub fn read(
        (given, free): (&[Span], &[Span]),
        scale: Timebase,
        tokenizer: &Tokenizer,
        (rig, map): (&Skeleton, Option<&str>),
    ) -> Result<Read, String> {
        let coded = bits(tokenizer.channels().joints());
        let understood = |span: &Span| -> Result<Understood, String> {
            let wrong = |e: kinelm_motion::Error| format!("{span}: {e}");
            let list = joints::to_smpl_names(&span.joints, rig, map).map_err(wrong)?;
            let Selection { joints, .. } = joints::parse(&list).map_err(wrong)?;
            let all = list.split(',').any(|part| part.trim() == "all");
            let (joints, uncoded): (Vec<usize>, Vec<usize>) = joints.into_iter().partition(|&j| has(coded, j));
            if joints.is_empty() {
                let known: Vec<&str> = (0..24).filter(|&j| has(coded, j)).map(|j| smpl::NAMES[j]).collect();
                return Err(format!("{span}: the model knows none of these joints; it knows {}", known.join(" ")));
            }
            let frames = span.frames(scale)?;
            let twice = joints::ambiguous_names(&span.joints, rig, map);
            let (span, uncoded) = (Span { joints: list, ..span.clone() }, if all { Vec::new() } else { uncoded });
            Ok(Understood { span, joints, uncoded, frames, twice })
        };
        let of = |spans: &[Span]| spans.iter().map(understood).collect::<Result<Vec<_>, _>>();
        let (given, free) = (of(given)?, of(free)?);
        let model_fps = scale.model_fps.unwrap_or(scale.fps);
        let begin = if given.is_empty() { coded } else { 0 };
        let mut mask = Mask { given: vec![begin; scale.frames], coded, rates: (scale.fps, model_fps) };
        for span in &given {
            mask.given[span.frames.clone()].iter_mut().for_each(|bits| *bits |= self::bits(&span.joints));
        }
        for span in &free {
            mask.given[span.frames.clone()].iter_mut().for_each(|bits| *bits &= !self::bits(&span.joints));
        }
        Ok(Read { given, free, mask })
    }

    /// Of a clip of so many frames in which all of `joints` are free in a gap, and given elsewhere.
    pub fn with_gap(frames: usize, joints: &[usize], fps: f64, gap: Range<usize>) -> Mask {
        let coded = bits(joints);
        let given = (0..frames).map(|frame| if gap.contains(&frame) { 0 } else { coded }).collect();
        Mask { given, coded, rates: (fps, fps) }
    }

    /// F, the clip's frames.
    pub fn frames(&self) -> usize {
        self.given.len()
    }

    /// Whether a coded joint is given in a frame of the clip; beyond the clip none is.
    pub fn is_given(&self, frame: usize, joint: usize) -> bool {
        self.given.get(frame).is_some_and(|bits| has(*bits, joint))
    }

    /// Whether nothing is given in a frame.
    pub fn is_all_free(&self, frame: usize) -> bool {
        self.given.get(frame).is_none_or(|bits| *bits == 0)
    }

    /// Whether a joint is one that can be given.
    pub fn is_coded(&self, joint: usize) -> bool {
        has(self.coded, joint)
    }

    /// Whether anything is free within the clip.
    pub fn frees_anything(&self) -> bool {
        self.given.iter().any(|bits| *bits != self.coded)
    }

    /// The same at the model's rate: `frames` frames, each as the nearest of the clip; the first `of_clip` are its, and
    /// beyond them nothing is given.
    pub fn at_model_rate(&self, frames: usize, of_clip: usize) -> Mask {
        let (own, model) = self.rates;
        let nearest =
            |frame: usize| ((frame as f64 * own / model).round() as usize).min(self.frames().saturating_sub(1));
        let at = |frame: usize| self.given.get(nearest(frame)).copied().filter(|_| frame < of_clip).unwrap_or(0);
        Mask { given: (0..frames).map(at).collect(), coded: self.coded, rates: (model, model) }
    }

    /// The runs of frames, of `frames` in all, in which something is so.
    pub fn runs(frames: usize, is_so: impl Fn(usize) -> bool) -> Vec<Range<usize>> {
        let mut runs: Vec<Range<usize>> = Vec::new();
        for frame in (0..frames).filter(|&frame| is_so(frame)) {
            match runs.last_mut() {
                Some(run) if run.end == frame => run.end += 1,
                _ => runs.push(frame..frame + 1),
            }
        }
        runs
    }

    /// The runs in which a coded joint is free.
    pub fn free_runs(&self, joint: usize) -> Vec<Range<usize>> {
        Mask::runs(self.frames(), |frame| !self.is_given(frame, joint))
    }
}

fn bits(joints: &[usize]) -> u32 {
    joints.iter().fold(0, |bits, &joint| bits | 1 << joint)
}

fn has(bits: u32, joint: usize) -> bool {
    bits >> joint & 1 == 1
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A mask of all 24 joints at 20 frames a second, given where `given` says of a frame and a joint.
    pub fn mask(frames: usize, given: impl Fn(usize, usize) -> bool) -> Mask {
        let bits = |f: usize| (0..24).filter(|&j| given(f, j)).fold(0, |bits, j| bits | 1 << j);
        Mask { given: (0..frames).map(bits).collect(), coded: (1 << 24) - 1, rates: (20.0, 20.0) }
    }

    #[test]
    fn a_mask_at_the_models_rate_is_that_of_the_nearest_frame() {
        let fine = Mask { rates: (60.0, 20.0), ..mask(100, |f, j| !(30..45).contains(&f) || j == 5) };
        let coarse = fine.at_model_rate(40, 34);
        assert_eq!(coarse.free_runs(3), [10..15, 34..40]);
        assert_eq!(coarse.free_runs(5), vec![34..40]);
        // 99 / 3 = 33: the last of the clip
        assert!(coarse.is_given(33, 3) && !coarse.is_given(34, 3) && coarse.is_all_free(39) && !coarse.is_all_free(12));
        assert_eq!(Mask::runs(5, |f| f % 2 == 0), [0..1, 2..3, 4..5]);
    }
}
