//! What a tuning is measured by: bits per frame of held-out clips, and dances that are given root and right arm of these.

use crate::corpus::{ClipRecord, Corpus, Dataset, Split};
use crate::evaluate::dance::{Dance, Reference, judge::Judge};
use crate::generate::best::Verdict;
use crate::generate::{Length, OpenRequest, PromptRequest, Request, unwatched};
use crate::model::likelihood::likelihood;
use crate::model::{CheckpointChoice, Compute, load_run};
use anyhow::{Context, Result};
use std::fmt;
use std::path::{Path, PathBuf};

/// What is given of a clip.
const GIVEN: &str = "root,right_arm";
/// So many clips are danced to, for so long at most, seconds.
const CLIPS: usize = 4;
const SECONDS: f64 = 10.0;

/// The held-out clips of a corpus, and their files.
pub struct HeldOut<'a> {
    pub split: Split,
    corpus: &'a Corpus,
    clips: Vec<(&'a ClipRecord, PathBuf)>,
    compute: Compute,
}

/// What was measured under a run.
pub struct Measured {
    pub bits_per_frame: f64,
    /// Of the clips' own joints, and of what the model made of them.
    aims: [Aims; 2],
}

/// Means over dances.
#[derive(Default)]
struct Aims {
    skate_share: Option<f64>,
    penetration_cm: Option<f64>,
    shake: Option<f64>,
    outside_cm: Option<f64>,
}

impl<'a> HeldOut<'a> {
    /// The test clips, or if there are none the validation clips; `None` without either.
    pub fn of(corpus: &'a Corpus, dataset: &Dataset, compute: Compute) -> Option<HeldOut<'a>> {
        let split = [Split::Test, Split::Valid].into_iter().find(|split| corpus.split(*split).next().is_some())?;
        let file = |clip: &&ClipRecord| {
            let item = dataset.items.iter().find(|item| item.name == clip.name && item.segment.is_none())?;
            Some(item.path.clone())
        };
        let clips = corpus.split(split).filter_map(|clip| Some((clip, file(&clip)?))).take(CLIPS).collect();
        Some(HeldOut { split, corpus, clips, compute })
    }

    /// Measures a run.
    pub fn measure(&self, run: &Path) -> Result<Measured> {
        let loaded = load_run(run, CheckpointChoice::Auto)?;
        let clips: Vec<_> = self.corpus.split(self.split).collect();
        let conditions = loaded.load_conditions()?;
        let found = likelihood(&mut *loaded.scores(self.compute)?, self.corpus, &clips, 0, &conditions)?;
        let bits_per_frame = found.context("no frame to measure")?.bits_per_frame;
        let reference = Reference::load(self.corpus)?;
        let both = self.clips.iter().map(|(clip, path)| self.dance(run, clip, path, &reference));
        let (real, made): (Vec<Verdict>, Vec<Verdict>) = both.collect::<Result<Vec<_>>>()?.into_iter().unzip();
        Ok(Measured { bits_per_frame, aims: [Aims::of(&real), Aims::of(&made)] })
    }

    /// What is to be said of a clip, and of a dance that was given a part of it.
    fn dance(&self, run: &Path, clip: &ClipRecord, path: &Path, real: &Reference<'_>) -> Result<(Verdict, Verdict)> {
        let seconds = SECONDS.min(clip.frames as f64 / self.corpus.manifest().fps);
        let read = clip.read.clone();
        let prompt = PromptRequest { read, joints: Some(GIVEN.into()), ..PromptRequest::of(path) };
        let request =
            Request { prompt: Some(prompt), length: Some(Length::Seconds(seconds)), seed: 1, ..Request::of(run) };
        let open = OpenRequest::open(&request)?;
        let judge = Judge::new(real, open.free_spans())?;
        let words = open.words(&open.sample(1, None, &mut unwatched)?, 0);
        let (_, best) = judge.best(&open, &[words], Path::new("dance.bvh"), 1)?.remove(0);
        Ok((judge.verdict(&Dance::of_corpus(self.corpus, clip)?), best.verdict))
    }
}

impl Aims {
    fn of(all: &[Verdict]) -> Aims {
        let mean = |of: fn(&Verdict) -> Option<f64>| {
            let known: Vec<f64> = all.iter().filter_map(of).collect();
            (!known.is_empty()).then(|| known.iter().sum::<f64>() / known.len() as f64)
        };
        Aims {
            skate_share: mean(|v| v.skate_share),
            penetration_cm: mean(|v| v.penetration_cm),
            shake: mean(|v| v.shake),
            outside_cm: mean(|v| v.outside_cm),
        }
    }
}

/// The table of before and after.
pub struct Comparison<'a>(pub &'a HeldOut<'a>, pub [Measured; 2]);

impl fmt::Display for Comparison<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Comparison(held_out, [before, after]) = self;
        let (n, split) = (held_out.corpus.split(held_out.split).count(), held_out.split);
        writeln!(f, "{n} {split} clips                       before   after   real")?;
        writeln!(f, "bits/frame                      {:>9.2} {:>7.2}", before.bits_per_frame, after.bits_per_frame)?;
        writeln!(f, "given {GIVEN}, {} of them:", held_out.clips.len())?;
        let [real, made] = &before.aims;
        let tuned = &after.aims[1];
        type Row = (&'static str, f64, fn(&Aims) -> Option<f64>);
        let rows: [Row; 4] = [
            ("  steps that slide, %", 100.0, |a| a.skate_share),
            ("  in the floor, cm", 1.0, |a| a.penetration_cm),
            ("  jerk over speed, 1/s^2", 1.0, |a| a.shake),
            ("  off balance, cm", 1.0, |a| a.outside_cm),
        ];
        for (name, scale, of) in rows {
            let number = |aims: &Aims| of(aims).map_or("-".into(), |x| format!("{:.1}", scale * x));
            writeln!(f, "{name:<32}{:>9} {:>7} {:>6}", number(made), number(tuned), number(real))?;
        }
        Ok(())
    }
}
