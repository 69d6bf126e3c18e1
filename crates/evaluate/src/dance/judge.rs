//! Which of several dances is least unlike real ones: docs/generation.md, "The best of several".
//!
//! Limits: faults of the body's motion, freezes and copies; how well a dance suits its label or its music is not
//! judged.

use super::coded::Dance;
use super::copying::Track;
use super::freeze::{Freezing, Threshold, energy};
use super::percentile;
use super::positions::JointPositions;
use super::reference::Reference;
use crate::Result;
use crate::floors::codes::frames;
use kinelm_corpus::Split;
use kinelm_generate::best::{Best, Verdict};
use kinelm_generate::make;
use kinelm_generate::open::OpenRequest;
use kinelm_generate::output::FreeSpan;
use kinelm_generate::score::{Limits, Measures, Scorer};
use kinelm_motion::format::Format;
use kinelm_motion::{Clip, joints::LEGS};
use kinelm_tokenizer::Words;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::{Mutex, PoisonError};

/// A dance is a copy if more than this share of its windows is nearer to training than 99 of 100 windows of real dances
/// that nothing was trained on.
const COPIED: f64 = 0.1;

/// Compares dances of one request with real ones.
pub struct Judge<'a> {
    real: &'a Reference<'a>,
    invented: Vec<FreeSpan>,
    /// Of each stretch.
    scorers: Vec<Scorer>,
    /// Of the real train clips.
    usual: Limits,
    /// The span that is invented up to the end, and the threshold under which its joints stand still, cm/s.
    last: Option<(FreeSpan, f64)>,
    /// By joints: the least distance to training clips that is no copy; `None` without validation clips.
    limits_cm: Mutex<BTreeMap<Vec<usize>, Option<f64>>>,
}

impl<'a> Judge<'a> {
    /// Of dances of which these stretches are invented.
    ///
    /// # Errors
    /// Words that can't be decoded.
    pub fn new(real: &'a Reference<'a>, invented: Vec<FreeSpan>) -> Result<Judge<'a>> {
        let mut joints: Vec<usize> = invented.iter().flat_map(|stretch| stretch.joints.iter().copied()).collect();
        joints.sort_unstable();
        joints.dedup();
        let of_all = scorer(real, &joints)?;
        let scorers = invented.iter().map(|stretch| scorer(real, &stretch.joints)).collect::<Result<Vec<_>>>()?;
        let windows = real.each(Split::Train, |_, dance: &Dance| Ok(of_all.windows(&dance.clip)))?;
        let windows: Vec<(Measures, f64)> = windows.into_iter().flatten().map(|found| (found, 1.0)).collect();
        let usual = Limits::of(&windows);
        let mut judge = Judge { real, invented, scorers, usual, last: None, limits_cm: Mutex::default() };
        if let Some(last) = judge.invented.last() {
            let mut threshold = Threshold::of(frames(real.corpus(), Split::Train));
            let of = |_, dance: &Dance| Ok(energy(&judge.places(&dance.clip, &last.joints)));
            real.fold(Split::Train, of, |energies| threshold.add(&energies))?;
            judge.last = threshold.get().map(|x| (last.clone(), x));
        }
        Ok(judge)
    }

    /// Where joints are: in the world if they are all, else from the pelvis.
    fn places(&self, clip: &Clip, joints: &[usize]) -> JointPositions {
        let all = joints.len() == self.real.joints.len();
        if all { JointPositions::of(clip, joints) } else { JointPositions::of_pose(clip, joints) }
    }

    /// The verdict on one dance, before the search for copies: the mean over windows of what was invented.
    pub fn verdict(&self, dance: &Dance) -> Verdict {
        let verdict = measured(&self.scorers, &self.invented, &dance.clip, &self.usual);
        Verdict { freezes_s: self.freezes_s(&dance.clip), ..verdict }
    }

    /// The dances from the best to the worst with their verdicts. Those that freeze or copy come after
    /// all others; the search for copies ends with the `count`-th dance that is none.
    ///
    /// # Errors
    /// Clips that can't be mirrored.
    pub(crate) fn ranked(&self, dances: &[Dance], count: usize) -> Result<Vec<(usize, Verdict)>> {
        let mut all: Vec<(usize, Verdict)> = dances.iter().map(|dance| self.verdict(dance)).enumerate().collect();
        let order = |a: &(usize, Verdict), b: &(usize, Verdict)| {
            let key = |v: &Verdict| (v.doubt().is_some(), v.score);
            let ((a_out, a_score), (b_out, b_score)) = (key(&a.1), key(&b.1));
            a_out.cmp(&b_out).then(a_score.total_cmp(&b_score)).then(a.0.cmp(&b.0))
        };
        all.sort_by(order);
        let mut fine = 0;
        for (i, verdict) in &mut all {
            // sorted: every dance after the first doubtful one is doubtful too
            if fine == count || verdict.doubt().is_some() {
                break;
            }
            verdict.copied = self.is_copy(&dances[*i])?;
            fine += usize::from(!verdict.copied);
        }
        all.sort_by(order);
        Ok(all)
    }

    /// Whether the invented joints of a dance are those of a training clip, in more than [`COPIED`] of its windows.
    fn is_copy(&self, dance: &Dance) -> Result<bool> {
        let (mut all, mut copied) = (0, 0);
        for stretch in &self.invented {
            let Some(limit) = self.limit_cm(&stretch.joints)? else { continue };
            let track = Track::of(&slice(&dance.clip, stretch), &stretch.joints);
            let found = self.real.nearest(&stretch.joints, &[track])?.concat();
            all += found.len();
            copied += found.iter().filter(|cm| **cm < limit).count();
        }
        Ok(copied as f64 > COPIED * all as f64)
    }

    /// The least distance to training clips that is no copy, for these joints.
    fn limit_cm(&self, joints: &[usize]) -> Result<Option<f64>> {
        let mut known = self.limits_cm.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(limit) = known.get(joints) {
            return Ok(*limit);
        }
        let tracks: Vec<Track> =
            self.real.validation_sample()?.iter().map(|dance| Track::of(&dance.clip, joints)).collect();
        let mut valid = self.real.nearest(joints, &tracks)?.concat();
        valid.sort_by(f64::total_cmp);
        let limit = percentile(&valid, 0.01);
        known.insert(joints.to_vec(), limit);
        Ok(limit)
    }

    /// From when on the span that is invented up to the end stands still, seconds.
    fn freezes_s(&self, clip: &Clip) -> Option<f64> {
        let (last, threshold) = self.last.as_ref()?;
        // a frame more or less is the coding's
        if last.frames.end + 1 < clip.frames() {
            return None;
        }
        let energies = energy(&self.places(&slice(clip, last), &last.joints));
        let still = Freezing::of(&energies, clip.fps(), *threshold).time_to_freeze_s?;
        Some(still + last.frames.start as f64 / clip.fps())
    }
}

impl make::Judge for Judge<'_> {
    fn best(&self, open: &OpenRequest, sampled: &[Words], out: &Path, count: usize) -> Result<Vec<(usize, Best)>> {
        Ok(first(self.ranked(&read_back(open, sampled, out)?, count)?, count))
    }
}

/// The best dances by a run's own limits: whether a dance is a copy, or freezes, isn't known. All coded joints are measured, as
/// the limits were, while any is invented.
///
/// # Errors
/// As [`make::Judge::best`].
pub(super) fn best_by(
    limits: &Limits,
    open: &OpenRequest,
    sampled: &[Words],
    out: &Path,
    count: usize,
) -> Result<Vec<(usize, Best)>> {
    let coded = open.tokenizer.channels().joints();
    let spans = open.free_spans();
    let scorer = |span: &FreeSpan| {
        let all = Scorer::new(coded)?;
        Ok(if has_legs(coded, &span.joints) { all } else { all.without_feet() })
    };
    let scorers = spans.iter().map(scorer).collect::<Result<Vec<_>>>()?;
    let dances = read_back(open, sampled, out)?.into_iter();
    let verdicts = dances.map(|dance| measured(&scorers, &spans, &dance.clip, limits));
    let mut ranked: Vec<(usize, Verdict)> = verdicts.enumerate().collect();
    // stable: of equals the first
    ranked.sort_by(|a, b| a.1.score.total_cmp(&b.1.score));
    Ok(first(ranked, count))
}

/// Dances as they are written to `out`, read back and coded.
fn read_back(open: &OpenRequest, sampled: &[Words], out: &Path) -> Result<Vec<Dance>> {
    // a .glb is written but never read
    let is_read = Format::of_name(out).is_some_and(|format| format != Format::Glb);
    let name = if is_read { out.to_owned() } else { out.with_extension("json") };
    let options = open.read_back(&name);
    let dance = |words: &Words| {
        let bytes = open.motion(words, &name)?.bytes(&name)?;
        Dance::of_bytes(&name, &bytes, &options, &open.tokenizer)
    };
    sampled.iter().map(dance).collect()
}

/// The first `count` of ranked dances, with their ranks.
fn first(ranked: Vec<(usize, Verdict)>, count: usize) -> Vec<(usize, Best)> {
    let of = ranked.len();
    let best = ranked.into_iter().enumerate().map(|(better, (i, verdict))| (i, Best { of, better, verdict }));
    best.take(count).collect()
}

/// The mean over windows of stretches of a dance, each as its scorer measures it. Freezes and copies are not looked for.
fn measured(scorers: &[Scorer], stretches: &[FreeSpan], dance: &Clip, limits: &Limits) -> Verdict {
    let (mut found, mut on_feet, mut score) = (Vec::new(), 0, 0.0);
    for (scorer, stretch) in scorers.iter().zip(stretches) {
        let part = slice(dance, stretch);
        let mut windows = scorer.windows(&part);
        if windows.is_empty() && part.frames() > 1 {
            windows.push(scorer.measures(&part, 0..part.frames()));
        }
        score += windows.iter().map(|found| scorer.score(found, limits)).sum::<f64>();
        on_feet += if scorer.has_feet() { windows.len() } else { 0 };
        found.extend(windows);
    }
    let mean =
        |of: fn(&Measures) -> f64, count: usize| (count > 0).then(|| found.iter().map(of).sum::<f64>() / count as f64);
    Verdict {
        score: score / found.len().max(1) as f64,
        // measures of feet are 0 where a leg was given
        skate_share: mean(|found| found.slide_share, on_feet),
        penetration_cm: mean(|found| found.penetration_cm, on_feet),
        shake: mean(|found| found.shake, found.len()),
        outside_cm: mean(|found| found.outside_cm, on_feet),
        freezes_s: None,
        copied: false,
    }
}

/// The frames of a stretch, as far as the clip has them.
fn slice(clip: &Clip, stretch: &FreeSpan) -> Clip {
    let end = stretch.frames.end.min(clip.frames());
    clip.slice(stretch.frames.start.min(end)..end)
}

/// The scorer of dances of which some joints were invented: of feet where both legs were.
fn scorer(real: &Reference<'_>, invented: &[usize]) -> Result<Scorer> {
    let scorer = Scorer::new(invented)?;
    Ok(if has_legs(&real.joints, invented) { scorer } else { scorer.without_feet() })
}

/// Whether both legs are invented, as far as they are coded.
fn has_legs(coded: &[usize], invented: &[usize]) -> bool {
    LEGS.iter().flatten().all(|joint| invented.contains(joint) || !coded.contains(joint))
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_corpus::{Corpus, Split};
    use kinelm_motion::Vec3;
    use kinelm_tokenizer::TokenizerConfig;
    use kinelm_train::fixture;

    const JOINTS: [usize; 9] = [0, 1, 2, 4, 5, 7, 8, 18, 19];

    fn corpus() -> (tempfile::TempDir, Corpus) {
        let dir = tempfile::tempdir().unwrap();
        let split = [Split::Train, Split::Train, Split::Valid, Split::Train, Split::Test];
        let clips = split.map(|split| (200, split));
        let corpus = fixture::danced(&dir.path().join("c"), TokenizerConfig::uniform(&JOINTS, 20.0, 180), &clips);
        (dir, corpus)
    }

    fn all(frames: usize) -> Vec<FreeSpan> {
        vec![FreeSpan { frames: 0..frames, joints: JOINTS.to_vec() }]
    }

    /// The same dance at other places.
    fn moved(dance: &Dance, by: impl Fn(usize) -> Vec3) -> Dance {
        let root = dance.clip.root().iter().enumerate().map(|(f, p)| *p + by(f)).collect();
        let (rig, rotations) = (dance.clip.skeleton().clone(), dance.clip.rotations().to_vec());
        let mut other = dance.clone();
        other.clip = Clip::new(rig, dance.clip.fps(), root, rotations).unwrap();
        other
    }

    #[test]
    fn what_slides_sinks_shakes_freezes_or_copies_is_worse_than_a_real_dance() {
        let (_dir, corpus) = corpus();
        let real = Reference::load(&corpus).unwrap();
        let judge = Judge::new(&real, all(150)).unwrap();
        // dances of this kind come to rest in their last seconds
        let mut test = Dance::of_corpus(&corpus, &corpus.clips()[2]).unwrap();
        test.clip = test.clip.slice(0..150);
        let copy = Dance::of_corpus(&corpus, &corpus.clips()[0]).unwrap();
        let slides = moved(&test, |f| Vec3::X * 0.03 * f as f64);
        let sunk = moved(&test, |_| Vec3::Y * -0.5);
        let shakes = moved(&test, |f| Vec3::Y * if f.is_multiple_of(2) { 0.03 } else { -0.03 });
        let mut still = test.clone();
        let at = |f: usize| f.min(75);
        let root = (0..150).map(|f| test.clip.root()[at(f)]).collect();
        let rotations = (0..150).flat_map(|f| test.clip.pose(at(f)).to_vec()).collect();
        still.clip = Clip::new(test.clip.skeleton().clone(), 20.0, root, rotations).unwrap();
        let verdict = |dance: &Dance| judge.verdict(dance);
        let own = verdict(&test);
        assert!(own.score < 3.0 && own.doubt().is_none(), "{own}");
        assert!(verdict(&slides).skate_share > own.skate_share, "{} beside {own}", verdict(&slides));
        for (worse, by) in [(&sunk, 5.0), (&shakes, 2.0)] {
            assert!(verdict(worse).score > own.score + by, "{} beside {own}", verdict(worse));
        }
        let stands = verdict(&still).freezes_s.unwrap();
        // at rest from frame 75 on, 3.75 s, seen through the half second of E
        assert!((3.2..4.4).contains(&stands), "{stands}");

        let ranked = judge.ranked(&[copy.clone(), still.clone(), sunk, test], 2).unwrap();
        let order: Vec<usize> = ranked.iter().map(|(i, _)| *i).collect();
        assert_eq!(order[..2], [3, 2], "{ranked:?}");
        assert!(ranked[2..].iter().all(|(_, verdict)| verdict.doubt().is_some()), "{ranked:?}");
        // where all are out the least bad one is first, and the doubt is reported
        let ranked = judge.ranked(&[still, copy], 1).unwrap();
        assert!(ranked[0].1.doubt().is_some() && ranked[0].1.score <= ranked[1].1.score, "{ranked:?}");
    }

    #[test]
    fn only_what_was_invented_is_judged() {
        let (_dir, corpus) = corpus();
        let real = Reference::load(&corpus).unwrap();
        let test = Dance::of_corpus(&corpus, &corpus.clips()[2]).unwrap();
        // in the floor, and shaking, while the body is given
        let wrong =
            |f: usize| if f < 100 { Vec3::Y * if f.is_multiple_of(2) { -0.5 } else { -0.6 } } else { Vec3::ZERO };
        let dance = moved(&test, wrong);
        let of = |invented: Vec<FreeSpan>| Judge::new(&real, invented).unwrap().verdict(&dance);
        let (whole, later) = (of(all(200)), of(vec![FreeSpan { frames: 100..200, joints: JOINTS.to_vec() }]));
        assert!(whole.penetration_cm.unwrap() > 10.0 && later.penetration_cm.unwrap() < 1.0, "{whole}; {later}");
        assert!(whole.shake > later.shake.map(|x| 1.2 * x), "{whole}; {later}");
        let arms = of(vec![FreeSpan { frames: 0..200, joints: vec![18, 19] }]);
        assert_eq!((arms.skate_share, arms.penetration_cm), (None, None), "feet that are given aren't judged");
        assert_eq!(of(Vec::new()).score, 0.0);
    }
}
