//! Which joints are given in which frames of a clip.

use crate::request::Span;
use crate::{Error, Result};
use kinelm_motion::joints::{self, Selection};
use kinelm_motion::moment::Timebase;
use kinelm_motion::{Motion, smpl};
use kinelm_store::Subject;
use kinelm_tokenizer::Tokenizer;
use std::ops::Range;

/// Why a part of the root isn't given for a time.
pub(crate) const IN_PART: &str = "path, height and tilt are given throughout, by `joints` of a prompt; for a time the root \
                                  is given or free as a whole";

/// Given joints by frame, for the F frames of a clip at its file's rate and the 24 SMPL joints, of which the coded ones are
/// given or free. The root's position goes with joint 0.
#[derive(Debug, Clone, PartialEq)]
pub struct Mask {
    /// (F) one bit per joint.
    given: Vec<u32>,
    /// The joints that can be given or free.
    coded: u32,
    /// Frames per second of the file and of the model.
    rates: (f64, f64),
}

/// A span resolved against a clip.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct ResolvedSpan {
    /// As requested, in SMPL's names.
    pub span: Span,
    /// The coded joints that it names, SMPL ids.
    pub joints: Vec<usize>,
    /// The joints that it names and that are not coded.
    pub uncoded: Vec<usize>,
    /// Frames of the clip.
    pub frames: Range<usize>,
    /// Names that the rig has for other joints too, which are not meant.
    pub ambiguous: Vec<(String, &'static str)>,
}

/// The spans of an edit, and the mask that they make.
pub(crate) struct ResolvedSpans {
    /// The spans of given joints.
    pub given: Vec<ResolvedSpan>,
    /// The spans of free joints.
    pub free: Vec<ResolvedSpan>,
    /// The joints that are given in the end.
    pub mask: Mask,
}

impl Mask {
    /// Resolves spans: those of `given` add up, those of `free` are subtracted; without `given`, all is given but `free`.
    ///
    /// # Errors
    /// Unknown joints, or of which the tokenizer codes none; times outside the clip.
    pub(crate) fn resolve(
        given: &[Span],
        free: &[Span],
        scale: Timebase,
        tokenizer: &Tokenizer,
        motion: &Motion,
    ) -> Result<ResolvedSpans> {
        let coded = bits(tokenizer.channels().joints());
        let (rig, map) = (motion.clip.skeleton(), motion.map());
        let resolve = |name: &str, span: &Span| -> Result<ResolvedSpan> {
            let wrong = |why: String| Error::unsupported(Subject::of_parameter(name).with(span), why);
            let list = joints::to_smpl_names(&span.joints, rig, map).map_err(|e| wrong(e.to_string()))?;
            let selection = joints::parse(&list).map_err(|e| wrong(e.to_string()))?;
            if selection.has_part_of_root() {
                return Err(wrong(IN_PART.into()));
            }
            let Selection { joints, .. } = selection;
            let all = list.split(',').any(|part| part.trim() == "all");
            let (joints, uncoded): (Vec<usize>, Vec<usize>) = joints.into_iter().partition(|&j| has(coded, j));
            if joints.is_empty() {
                let known: Vec<&str> = (0..24).filter(|&j| has(coded, j)).map(|j| smpl::NAMES[j]).collect();
                return Err(wrong(format!("the model knows none of these joints; it knows {}", known.join(" "))));
            }
            let frames = span.frames(scale).map_err(|e| Error::unsupported_parameter(name, e))?;
            let ambiguous = joints::ambiguous_names(&span.joints, rig, map);
            let (span, uncoded) = (Span { joints: list, ..span.clone() }, if all { Vec::new() } else { uncoded });
            Ok(ResolvedSpan { span, joints, uncoded, frames, ambiguous })
        };
        let given = given.iter().map(|span| resolve("given", span)).collect::<Result<Vec<_>>>()?;
        let free = free.iter().map(|span| resolve("free", span)).collect::<Result<Vec<_>>>()?;
        let model_fps = scale.model_fps.unwrap_or(scale.fps);
        // free spans alone cut holes into the whole clip; given ones fill an empty one
        let begin = if given.is_empty() { coded } else { 0 };
        let mut mask = Mask { given: vec![begin; scale.frames], coded, rates: (scale.fps, model_fps) };
        for span in &given {
            mask.given[span.frames.clone()].iter_mut().for_each(|bits| *bits |= self::bits(&span.joints));
        }
        for span in &free {
            mask.given[span.frames.clone()].iter_mut().for_each(|bits| *bits &= !self::bits(&span.joints));
        }
        Ok(ResolvedSpans { given, free, mask })
    }

    /// The mask of a clip of `frames` frames in which all of `joints` are free in a gap, and given elsewhere.
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
    pub(crate) fn is_given(&self, frame: usize, joint: usize) -> bool {
        self.given.get(frame).is_some_and(|bits| has(*bits, joint))
    }

    /// Whether nothing is given in a frame.
    pub(crate) fn is_all_free(&self, frame: usize) -> bool {
        self.given.get(frame).is_none_or(|bits| *bits == 0)
    }

    /// Whether a joint can be given.
    pub(crate) fn is_coded(&self, joint: usize) -> bool {
        has(self.coded, joint)
    }

    /// Whether anything is free within the clip.
    pub(crate) fn has_free(&self) -> bool {
        self.given.iter().any(|bits| *bits != self.coded)
    }

    /// The same at the model's rate: `frames` frames, each as the nearest of the clip. The first `of_clip` are the clip's;
    /// beyond them nothing is given.
    pub(crate) fn at_model_rate(&self, frames: usize, of_clip: usize) -> Mask {
        let (own, model) = self.rates;
        let nearest =
            // the model's last frame may be after the file's last
            |frame: usize| ((frame as f64 * own / model).round() as usize).min(self.frames().saturating_sub(1));
        let at = |frame: usize| self.given.get(nearest(frame)).copied().filter(|_| frame < of_clip).unwrap_or(0);
        Mask { given: (0..frames).map(at).collect(), coded: self.coded, rates: (model, model) }
    }

    /// The runs of frames, of `frames` in all, in which a condition holds.
    pub(crate) fn runs(frames: usize, holds: impl Fn(usize) -> bool) -> Vec<Range<usize>> {
        runs_of(frames, holds).into_iter().filter(|(_, holds)| *holds).map(|(run, _)| run).collect()
    }

    /// The runs in which a coded joint is free.
    pub(crate) fn free_runs(&self, joint: usize) -> Vec<Range<usize>> {
        Mask::runs(self.frames(), |frame| !self.is_given(frame, joint))
    }
}

/// The runs of frames of which `of` says the same, of `frames` in all, and what it says.
pub(crate) fn runs_of<T: PartialEq>(frames: usize, of: impl Fn(usize) -> T) -> Vec<(Range<usize>, T)> {
    let mut runs: Vec<(Range<usize>, T)> = Vec::new();
    for (frame, here) in (0..frames).map(|frame| (frame, of(frame))) {
        match runs.last_mut() {
            Some((run, same)) if *same == here => run.end += 1,
            _ => runs.push((frame..frame + 1, here)),
        }
    }
    runs
}

fn bits(joints: &[usize]) -> u32 {
    // 24 joints fit into 32 bits
    joints.iter().fold(0, |bits, &joint| bits | 1 << joint)
}

fn has(bits: u32, joint: usize) -> bool {
    bits >> joint & 1 == 1
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// A mask of all 24 joints at 20 frames a second, given where `given` says of a frame and a joint.
    pub(crate) fn mask(frames: usize, given: impl Fn(usize, usize) -> bool) -> Mask {
        let bits = |f: usize| (0..24).filter(|&j| given(f, j)).fold(0, |bits, j| bits | 1 << j);
        Mask { given: (0..frames).map(bits).collect(), coded: (1 << 24) - 1, rates: (20.0, 20.0) }
    }

    #[test]
    fn a_mask_at_the_models_rate_takes_the_nearest_frame() {
        let fine = Mask { rates: (60.0, 20.0), ..mask(100, |f, j| !(30..45).contains(&f) || j == 5) };
        let coarse = fine.at_model_rate(40, 34);
        assert_eq!(coarse.free_runs(3), [10..15, 34..40]);
        assert_eq!(coarse.free_runs(5), vec![34..40]);
        // 99 / 3 = 33: the last of the clip
        assert!(coarse.is_given(33, 3) && !coarse.is_given(34, 3) && coarse.is_all_free(39) && !coarse.is_all_free(12));
        assert_eq!(Mask::runs(5, |f| f % 2 == 0), [0..1, 2..3, 4..5]);
    }
}
