//! How well a model fills a gap: docs/measures.md, "Gaps".
//!
//! Gaps of one length are spread evenly over the clips of a split. The model is given up to 64 frames before a gap and
//! the frame after it, coded and decoded; a masked model gets as many frames after it as its window holds. It samples
//! the frames between several times, each sample is closed as `generate --given --free` closes it, and the joints at
//! the gap's middle are compared with the recorded ones.

use super::bootstrap;
use crate::number::number;
use crate::{Error, Result};
use kinelm_corpus::{Conditions, Corpus, Split};
use kinelm_generate::edit::feet;
use kinelm_generate::edit::gap::{ClosingError, aligned, close};
use kinelm_generate::edit::mask::Mask;
use kinelm_generate::edit::splice::extended;
use kinelm_generate::sampling::Sampling;
use kinelm_generate::{RunModel, SamplingPlan, unwatched, variation_seed};
use kinelm_model::goal::{GoalEncoder, GoalTrack};
use kinelm_model::scored_windows::room;
use kinelm_model::{LoadedRun, ModelKind};
use kinelm_motion::metric::{InBetween, PositionScale, TrueGap};
use kinelm_motion::rotation::slerp;
use kinelm_motion::{Clip, Vec3};
use kinelm_tokenizer::Tokenizer;
use serde::Serialize;
use std::ops::Range;
use std::sync::Arc;

/// Frames before a gap that the model is given, at most.
pub(super) const CONTEXT_FRAMES: usize = 64;
/// Frames after it that border jerk is measured with.
const FRAMES_AFTER: usize = 3;

/// A piece of a clip with a gap in it.
#[derive(Debug, Clone, PartialEq)]
pub struct Gap {
    /// The recording that it is of.
    pub take: String,
    /// The words' ids, spaces included.
    ids: Vec<u32>,
    /// The frames of the gap.
    frames: Range<usize>,
}

/// `most` gaps of `frames` frames, spread evenly over all positions in a split's clips that have `before` frames before
/// them.
/// Each comes with the clip's next frames, at least three and at most `after`.
///
/// # Errors
/// [`kinelm_store::Error::Missing`] where no clip is long enough; what reading the corpus fails with.
pub fn gaps(
    corpus: &Corpus,
    split: Split,
    before: usize,
    frames: usize,
    after: usize,
    most: usize,
) -> Result<Vec<Gap>> {
    let length = before + frames + FRAMES_AFTER;
    let clips: Vec<_> = corpus.split(split).filter(|clip| clip.frames >= length).collect();
    let places: usize = clips.iter().map(|clip| clip.frames + 1 - length).sum();
    if places == 0 {
        let help = format!("{before} stand before a gap of {frames}, {FRAMES_AFTER} after it");
        return Err(Error::missing(format!("{split} clip of {length} frames"), help));
    }
    let count = most.min(places);
    let mut found = Vec::with_capacity(count);
    let (mut clip, mut passed) = (0, 0);
    for i in 0..count {
        // the middle of the i-th of `count` equal stretches of positions: neither end of the data is favoured
        let at = (2 * i + 1) * places / (2 * count);
        while at >= passed + clips[clip].frames + 1 - length {
            passed += clips[clip].frames + 1 - length;
            clip += 1;
        }
        // words are frames of one length, see [`frames_around`]
        let word = clips[clip].tokens / clips[clip].frames;
        let from = (at - passed) * word;
        let to = (from + (before + frames + after.max(FRAMES_AFTER)) * word).min(clips[clip].tokens);
        let ids = corpus.ids(clips[clip], from..to)?;
        found.push(Gap { take: clips[clip].take.clone(), ids, frames: before..before + frames });
    }
    Ok(found)
}

/// Spread of the coded joints' positions in at most 1,000 gaps of the train clips; in `gaps` where no train clip is
/// long enough.
///
/// # Errors
/// Words that can't be decoded.
pub fn position_scale(corpus: &Corpus, before: usize, frames: usize, gaps: &[Gap]) -> Result<PositionScale> {
    let tokenizer = corpus.tokenizer();
    let train = self::gaps(corpus, Split::Train, before, frames, FRAMES_AFTER, 1000).ok();
    let mut scale = PositionScale::of(tokenizer.channels().joints());
    for gap in train.as_deref().unwrap_or(gaps) {
        scale.add(&decoded(tokenizer, &gap.ids)?, &gap.frames);
    }
    Ok(scale)
}

/// The clip of some ids.
fn decoded(tokenizer: &Tokenizer, ids: &[u32]) -> Result<Clip> {
    Ok(tokenizer.decode(&tokenizer.words_of_ids(ids).words, tokenizer.uncoded_pose())?)
}

/// The errors of one method in one gap.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize)]
pub struct GapError {
    /// Mean distance of the coded joints in the middle frame, cm.
    pub global_cm: f64,
    /// The same with the pelvises in one place.
    pub root_cm: f64,
    /// Mean third difference of joints over both borders, m/s³.
    pub border_jerk: f64,
    /// L2P, L2Q and NPSS.
    #[serde(skip)]
    pub in_between: InBetween,
}

/// The errors of one method over all gaps.
#[derive(Debug, Clone, Serialize)]
pub struct Row {
    /// Its name.
    pub method: String,
    /// Mean over gaps.
    pub mean: GapError,
    /// 95 % interval of `global_cm` over takes.
    pub interval: [f64; 2],
    /// Mean distance of positions, in standard deviations of real ones: L2P.
    pub l2p: Option<f64>,
    /// Mean distance of world rotations: L2Q.
    pub l2q: Option<f64>,
    /// Normalised power spectrum similarity; 0 is alike.
    pub npss: Option<f64>,
}

/// The errors of all methods.
#[derive(Debug, Clone, Serialize)]
pub struct GapReport {
    /// Frames of a gap.
    pub frames: usize,
    /// Gaps.
    pub gaps: usize,
    /// Recordings that they are of.
    pub takes: usize,
    /// Samples of each.
    pub samples: usize,
    /// Methods: slerp and a straight path, the last frame held, one sample (the mean of all), the sample that ended
    /// nearest, the best.
    pub rows: Vec<Row>,
    /// Border jerk of the clips themselves, m/s³.
    pub real_jerk: f64,
    /// How far samples ended from the given frame before they were closed: median and 90th percentile, cm and degrees
    /// of heading.
    pub closing_cm: [f64; 2],
    /// See `closing_cm`.
    pub closing_degrees: [f64; 2],
    /// Share within 10 cm and 10 degrees: of all samples, and of those that end nearest.
    pub within: [f64; 2],
}

impl GapReport {
    /// A table for a terminal.
    pub fn table(&self) -> String {
        let found = self;
        let mut table = format!(
            "{:<28} {:>10} {:>16} {:>9} {:>11} {:>21} {:>6} {:>6} {:>7}\n",
            "", "middle, cm", "95 %", "root, cm", "of slerp's", "border jerk, of real", "L2P", "L2Q", "NPSS"
        );
        let slerp = found.rows.first().map_or(1.0, |row| row.mean.global_cm);
        for row in &found.rows {
            let interval = format!("{:.1} to {:.1}", row.interval[0], row.interval[1]);
            let (ratio, jerk) = (row.mean.global_cm / slerp, row.mean.border_jerk / found.real_jerk);
            table += &format!(
                "{:<28} {:>10.2} {interval:>16} {:>9.2} {ratio:>11.2} {jerk:>21.2} {:>6} {:>6} {:>7}\n",
                row.method,
                row.mean.global_cm,
                row.mean.root_cm,
                number(row.l2p, 3),
                number(row.l2q, 3),
                number(row.npss, 4)
            );
        }
        let ([cm, cm90], [degrees, degrees90], [all, kept]) = (found.closing_cm, found.closing_degrees, found.within);
        table
            + &format!(
                "\nbefore they were closed, samples ended {cm:.1} cm and {degrees:.0} degrees off (median; {cm90:.1} and {degrees90:.0} \
             in the worst tenth);\nwithin 10 cm and 10 degrees: {:.0} % of the samples, {:.0} % of those that end nearest\n",
                100.0 * all,
                100.0 * kept
            )
    }
}

/// A model that fills gaps.
pub struct Filler<'a> {
    /// Samples as many dances as there are samples.
    pub model: &'a mut RunModel,
    /// Its tokenizer.
    pub tokenizer: &'a Tokenizer,
    /// Its conditions; every label is unknown.
    pub conditions: &'a Conditions,
    /// How tokens are sampled.
    pub draw: Sampling,
    /// The seed; every gap has one of its own, made from it.
    pub seed: u64,
    /// Whether feet are locked.
    pub lock_feet: bool,
    /// The unit of L2P, see [`position_scale`].
    pub scale: &'a PositionScale,
    /// Goal conditioning on the frame after the gap, and its guidance; `None`: without.
    pub ahead: Option<(GoalEncoder, f64)>,
    /// Passes over a window, if the model is masked.
    pub passes: Option<usize>,
}

/// Frames before and after a gap of `frames` frames that fit into the model's context. A causal model sees none after
/// it.
///
/// # Errors
/// [`kinelm_store::Error::Invalid`] where it has none before it.
pub fn frames_around(run: &LoadedRun, tokenizer: &Tokenizer, frames: usize) -> Result<(usize, usize)> {
    let (Some(word), 1) = (tokenizer.tokens_per_word(), tokenizer.frames_per_word()) else {
        let why = "the tokenizer's words are no frames; take one of uniform or quantile bins";
        return Err(Error::unsupported("filling gaps", why));
    };
    let room = room(&run.config, &run.tokens) / word;
    match room.saturating_sub(frames + 1).min(CONTEXT_FRAMES) {
        0 => Err(Error::invalid_parameter(
            "frames",
            frames,
            format!("at most {}: the model sees {room}", room.saturating_sub(2)),
        )),
        before => Ok((before, if run.config.kind == ModelKind::Masked { before } else { 0 })),
    }
}

impl Filler<'_> {
    /// Fills gaps and measures; `progress` gets the number of gaps done.
    ///
    /// # Errors
    /// What sampling and decoding fail with.
    pub fn measure(&mut self, gaps: &[Gap], progress: &mut dyn FnMut(usize)) -> Result<GapReport> {
        let mut found = Vec::with_capacity(gaps.len());
        for (i, gap) in gaps.iter().enumerate() {
            found.push(self.fill(gap, i)?);
            progress(i + 1);
        }
        Ok(summed(gaps, &found))
    }

    fn fill(&mut self, gap: &Gap, index: usize) -> Result<Filled> {
        let joints = self.tokenizer.channels().joints();
        let decode = |ids: &[u32]| decoded(self.tokenizer, ids);
        let truth = decode(&gap.ids)?;
        let (frames, true_gap) = (truth.frames(), TrueGap::new(&truth, &gap.frames, self.scale));
        let error = |clip: &Clip| error(clip, &truth, gap, joints, &true_gap);
        let mask = Mask::with_gap(frames, joints, self.tokenizer.fps(), gap.frames.clone());
        // the space is no character
        let characters = gap.ids.len() / frames - 1;
        let flags = |is_so: &dyn Fn(usize) -> bool| -> Vec<bool> {
            (0..frames).flat_map(|frame| std::iter::repeat_n(is_so(frame), characters)).collect()
        };
        let given = flags(&|frame| !gap.frames.contains(&frame));
        let front = self.conditions.requested(&[])?;
        // a causal model goes on into the frame after the gap, a masked one sees it
        let (words, lookahead) = match self.passes {
            None => (gap.frames.end + 1, flags(&|frame| frame == gap.frames.end)),
            Some(_) => (frames, Vec::new()),
        };
        let seed = variation_seed(self.seed, index);
        let goals = |ahead: &GoalEncoder| GoalTrack::new(ahead.clone(), ahead.codes(&gap.ids), given.clone(), 0);
        let plan = SamplingPlan {
            goals: self.ahead.as_ref().map(|(ahead, _)| Arc::new(goals(ahead))),
            goal_guidance: self.ahead.as_ref().map_or(0.0, |(_, scale)| *scale),
            given: given.clone(),
            lookahead,
            prompt: gap.ids.clone(),
            fronts: vec![(0, front)],
            passes: self.passes.unwrap_or(1),
            ..SamplingPlan::free(self.tokenizer.grammar(), words, self.draw, seed)
        };
        let sampled = self.model.sample(&plan, &mut unwatched)?;
        let mut samples = Vec::with_capacity(sampled.ids.len());
        for i in 0..sampled.ids.len() {
            let dance = extended(&decode(&sampled.with_lookahead(i))?, frames)?;
            let mut dance = aligned(&dance, &truth, &mask)?;
            if self.lock_feet {
                dance = feet::lock_gaps(&dance, &truth, &mask, 0.0)?.0;
            }
            let (clip, left) = close(&dance, &truth, &mask)?;
            let left = left.into_iter().next();
            samples.push((error(&clip), left));
        }
        let straight = between(&truth, &gap.frames, true)?;
        let held = between(&truth, &gap.frames, false)?;
        Ok(Filled {
            straight: error(&straight),
            held: error(&held),
            real_jerk: border_jerk(&truth.positions(), &truth, gap, joints),
            samples,
        })
    }
}

/// One gap, filled.
struct Filled {
    straight: GapError,
    held: GapError,
    real_jerk: f64,
    samples: Vec<(GapError, Option<ClosingError>)>,
}

impl Filled {
    fn one(&self) -> GapError {
        mean(self.samples.iter().map(|(error, _)| *error))
    }

    fn best(&self) -> GapError {
        let errors = self.samples.iter().map(|(error, _)| *error);
        errors.min_by(|a, b| a.global_cm.total_cmp(&b.global_cm)).unwrap_or_default()
    }

    fn nearest_end(&self) -> Option<&(GapError, Option<ClosingError>)> {
        let total = |left: &Option<ClosingError>| left.as_ref().map_or(0.0, ClosingError::total);
        self.samples.iter().min_by(|a, b| total(&a.1).total_cmp(&total(&b.1)))
    }
}

fn mean(errors: impl Iterator<Item = GapError>) -> GapError {
    let (mut sum, mut n) = (GapError::default(), 0.0);
    for error in errors {
        sum.global_cm += error.global_cm;
        sum.root_cm += error.root_cm;
        sum.border_jerk += error.border_jerk;
        sum.in_between.add(&error.in_between);
        n += 1.0;
    }
    // of no samples zeros, not NaN
    let n = f64::max(n, 1.0);
    GapError { global_cm: sum.global_cm / n, root_cm: sum.root_cm / n, border_jerk: sum.border_jerk / n, ..sum }
}

/// The gap by slerp along a straight root path, or with the frame before it held.
fn between(truth: &Clip, gap: &Range<usize>, moves: bool) -> Result<Clip> {
    let (mut root, mut rotations) = (truth.root().to_vec(), truth.rotations().to_vec());
    let (a, b, j) = (gap.start.saturating_sub(1), gap.end, truth.joints());
    for f in gap.clone() {
        let t = if moves { (f - a) as f64 / (b - a) as f64 } else { 0.0 };
        root[f] = truth.root()[a].lerp(truth.root()[b], t);
        for (k, rotation) in rotations[f * j..(f + 1) * j].iter_mut().enumerate() {
            *rotation = slerp(truth.pose(a)[k], truth.pose(b)[k], t);
        }
    }
    Ok(Clip::new(truth.skeleton().clone(), truth.fps(), root, rotations)?)
}

fn error(clip: &Clip, truth: &Clip, gap: &Gap, joints: &[usize], true_gap: &TrueGap) -> GapError {
    let (places, true_places) = (clip.positions(), truth.positions());
    let middle = (gap.frames.start + gap.frames.len() / 2) * truth.joints();
    let (p, q) = (&places[middle..], &true_places[middle..]);
    let n = joints.len().max(1) as f64;
    let global: f64 = joints.iter().map(|&k| (p[k] - q[k]).length()).sum();
    let root: f64 = joints.iter().map(|&k| (p[k] - p[0] - q[k] + q[0]).length()).sum();
    let border_jerk = border_jerk(&places, truth, gap, joints);
    let in_between = true_gap.measure(clip);
    GapError { global_cm: 100.0 * global / n, root_cm: 100.0 * root / n, border_jerk, in_between }
}

/// Mean size of the third differences that touch a border, of positions (F, J).
fn border_jerk(places: &[Vec3], clip: &Clip, gap: &Gap, joints: &[usize]) -> f64 {
    let j = clip.joints();
    let at = |frame: usize, joint: usize| places[frame * j + joint];
    let third = |f: usize, k: usize| (at(f + 3, k) - (at(f + 2, k) - at(f + 1, k)) * 3.0 - at(f, k)).length();
    // a difference from frame f reads f to f + 3: these are the ones with frames on both sides of a border
    let starts = [gap.frames.start, gap.frames.end].into_iter().flat_map(|border| border.saturating_sub(3)..border);
    let starts = starts.filter(|f| f + 3 < clip.frames());
    let sizes: Vec<f64> = starts.flat_map(|f| joints.iter().map(move |&k| third(f, k))).collect();
    clip.fps().powi(3) * sizes.iter().sum::<f64>() / sizes.len().max(1) as f64
}

fn summed(gaps: &[Gap], found: &[Filled]) -> GapReport {
    let row = |method: &str, of: &dyn Fn(&Filled) -> GapError| {
        let errors: Vec<GapError> = found.iter().map(of).collect();
        let (interval, mean) = (interval(gaps, &errors), mean(errors.into_iter()));
        let [l2p, l2q, npss] = [InBetween::l2p, InBetween::l2q, InBetween::npss].map(|of| of(&mean.in_between));
        Row { method: method.into(), mean, interval, l2p, l2q, npss }
    };
    let left: Vec<&ClosingError> =
        found.iter().flat_map(|f| f.samples.iter().filter_map(|(_, left)| left.as_ref())).collect();
    let nearest_end: Vec<&ClosingError> = found.iter().filter_map(|f| f.nearest_end()?.1.as_ref()).collect();
    let within = |left: &[&ClosingError]| {
        let near = left.iter().filter(|left| left.cm < 10.0 && left.heading_degrees < 10.0).count();
        near as f64 / left.len().max(1) as f64
    };
    let spread = |of: &dyn Fn(&ClosingError) -> f64| {
        let mut all: Vec<f64> = left.iter().map(|left| of(left)).collect();
        all.sort_by(f64::total_cmp);
        [0.5, 0.9].map(|share| all.get((share * all.len() as f64) as usize).copied().unwrap_or(0.0))
    };
    let mut takes: Vec<&str> = gaps.iter().map(|gap| gap.take.as_str()).collect();
    takes.sort_unstable();
    takes.dedup();
    GapReport {
        frames: gaps.first().map_or(0, |gap| gap.frames.len()),
        gaps: gaps.len(),
        takes: takes.len(),
        samples: found.first().map_or(0, |f| f.samples.len()),
        rows: vec![
            row("slerp, a straight path", &|f| f.straight),
            row("the last frame held", &|f| f.held),
            row("the model, one sample", &Filled::one),
            row("the sample that ends nearest", &|f| f.nearest_end().map(|(error, _)| *error).unwrap_or_default()),
            row("the best of the samples", &Filled::best),
        ],
        real_jerk: found.iter().map(|f| f.real_jerk).sum::<f64>() / found.len().max(1) as f64,
        closing_cm: spread(&|left| left.cm),
        closing_degrees: spread(&|left| left.heading_degrees),
        within: [within(&left), within(&nearest_end)],
    }
}

/// The interval of the mean over takes.
fn interval(gaps: &[Gap], errors: &[GapError]) -> [f64; 2] {
    bootstrap::interval(gaps.iter().zip(errors).map(|(gap, error)| (gap.take.as_str(), error.global_cm, 1.0)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_corpus::samples;
    use kinelm_motion::synth;

    fn truth() -> Clip {
        synth::corpus(4, 1, 3.0, 20.0).unwrap().remove(0).clip
    }

    fn gap(take: &str) -> Gap {
        Gap { take: take.into(), ids: Vec::new(), frames: 20..30 }
    }

    #[test]
    fn straight_ways_meet_both_ends_and_are_measured_in_the_middle() {
        let (truth, gap) = (truth(), gap("a"));
        let mut scale = PositionScale::of(&[0, 4, 18]);
        scale.add(&truth, &gap.frames);
        let [straight, held] = [true, false].map(|moves| between(&truth, &gap.frames, moves).unwrap());
        for clip in [&straight, &held] {
            for f in (0..20).chain(30..60) {
                assert_eq!((clip.root()[f], clip.pose(f)), (truth.root()[f], truth.pose(f)));
            }
        }
        assert_eq!((held.root()[29], held.pose(29)), (truth.root()[19], truth.pose(19)));
        let step = straight.root()[20] - truth.root()[19];
        assert!((0..10).all(|i| (straight.root()[20 + i] - straight.root()[19 + i] - step).length() < 1e-9));
        let true_gap = TrueGap::new(&truth, &gap.frames, &scale);
        let error = |clip: &Clip| error(clip, &truth, &gap, scale.joints(), &true_gap);
        let own = error(&truth);
        assert!(own.global_cm < 1e-9 && own.root_cm < 1e-9, "{own:?}");
        // moved by 3 cm in the middle frame alone: seen globally, not with the pelvises in one place
        let mut root = truth.root().to_vec();
        root[25] += Vec3::new(0.0, 0.03, 0.0);
        let moved = Clip::new(truth.skeleton().clone(), 20.0, root, truth.rotations().to_vec()).unwrap();
        let found = error(&moved);
        assert!((found.global_cm - 3.0).abs() < 1e-9 && found.root_cm < 1e-9, "{found:?}");
        assert_eq!(found.border_jerk, own.border_jerk);
        assert_eq!((own.in_between.l2p(), found.in_between.l2q()), (Some(0.0), Some(0.0)));
        assert!(error(&held).border_jerk > own.border_jerk);
    }

    #[test]
    fn figures_are_of_the_samples_they_name() {
        let gap_error =
            |cm: f64| GapError { global_cm: cm, root_cm: cm / 2.0, border_jerk: 1.0, ..GapError::default() };
        let left = |cm: f64, degrees: f64| {
            Some(ClosingError { frames: 20..30, cm, heading_degrees: degrees, joints_degrees: 1.0 })
        };
        let samples = vec![
            (gap_error(4.0), left(30.0, 2.0)),
            (gap_error(2.0), left(20.0, 40.0)),
            (gap_error(6.0), left(5.0, 5.0)),
        ];
        let filled = |samples| Filled { straight: gap_error(3.0), held: gap_error(9.0), real_jerk: 2.0, samples };
        let found = summed(&[gap("a"), gap("b")], &[filled(samples.clone()), filled(samples)]);
        let cm: Vec<f64> = found.rows.iter().map(|row| row.mean.global_cm).collect();
        // straight, held, the mean of the samples, the one that ends nearest, the best
        assert_eq!(cm, [3.0, 9.0, 4.0, 6.0, 2.0]);
        assert_eq!((found.gaps, found.takes, found.samples, found.real_jerk), (2, 2, 3, 2.0));
        // only the third sample ends within 10 cm and 10 degrees
        assert!((found.within[0] - 1.0 / 3.0).abs() < 1e-12 && found.within[1] == 1.0);
        assert_eq!((found.closing_cm, found.rows[2].interval), ([20.0, 30.0], [4.0, 4.0]));
    }

    #[test]
    fn gaps_are_spread_over_the_clips_that_are_long_enough() {
        let dir = tempfile::tempdir().unwrap();
        let mut writer = samples::begin(&dir.path().join("c"), false).unwrap();
        for (key, (name, frames)) in [("a", 12), ("b", 4), ("c", 9)].into_iter().enumerate() {
            writer.push(samples::clip(name, key, Split::Train, frames), &samples::words(frames)).unwrap();
        }
        writer.finish().unwrap();
        let corpus = Corpus::open(dir.path().join("c")).unwrap();
        let all = gaps(&corpus, Split::Train, 2, 1, 0, usize::MAX).unwrap();
        assert_eq!(all.len(), 7 + 4, "the second is too short");
        let few = gaps(&corpus, Split::Train, 2, 1, 0, 2).unwrap();
        assert!(few.len() == 2 && few.iter().all(|gap| all.contains(gap) && gap.frames == (2..3)));
        // the same gaps, with what the clip still has after them
        let wide = gaps(&corpus, Split::Train, 2, 1, 6, usize::MAX).unwrap();
        let pairs = || all.iter().zip(&wide);
        assert!(wide.len() == all.len() && pairs().all(|(a, b)| b.frames == a.frames && b.ids.starts_with(&a.ids)));
        let word = all[0].ids.len() / 6;
        let more: Vec<usize> = pairs().map(|(a, b)| (b.ids.len() - a.ids.len()) / word).collect();
        assert_eq!(more, [3, 3, 3, 3, 2, 1, 0, 3, 2, 1, 0]);
        let error = gaps(&corpus, Split::Train, 999, 1, 0, 2).unwrap_err().to_string();
        assert!(error.contains("no train clip of 1003 frames"), "{error}");
    }
}
