//! What a tuning is measured by: bits per frame of held-out clips, and dances that are given root and right arm of these.

use crate::corpus::{ClipRecord, Corpus, Dataset, Split};
use crate::evaluate::dance::{Dance, Reference, judge::Judge};
use crate::generate::best::Verdict;
use crate::generate::make::{BestOf, Making, unwatched};
use crate::generate::output::FreeSpan;
use crate::generate::{Length, OpenRequest, PromptRequest, Request};
use crate::model::{CheckpointChoice, Compute, load_run};
use anyhow::{Context, Result};
use kinelm_motion::joints;
use std::fmt;
use std::path::{Path, PathBuf};

/// The joints that are given of a clip.
const GIVEN: &str = "root,right_arm";
/// Clips that are danced to, and the longest dance, seconds.
const CLIPS: usize = 4;
const SECONDS: f64 = 10.0;

/// The held-out clips of a corpus.
pub struct HeldOut<'a> {
    split: Split,
    corpus: &'a Corpus,
    /// Those that are danced to.
    clips: Vec<Clip<'a>>,
    /// The metrics of these clips, over what the dances invent.
    real: Aims,
    compute: Compute,
}

/// A clip that is danced to.
struct Clip<'a> {
    record: &'a ClipRecord,
    file: PathBuf,
    frames: usize,
    judge: Judge<'a>,
}

/// The metrics of a run.
pub struct Measured {
    bits_per_frame: f64,
    made: Aims,
}

/// Means over dances.
#[derive(Default)]
struct Aims {
    skate_share: Option<f64>,
    penetration_cm: Option<f64>,
    shake: Option<f64>,
    outside_cm: Option<f64>,
}

/// Test, or valid if no clip is in that; `None` without either.
pub fn held_out_split(corpus: &Corpus) -> Option<Split> {
    [Split::Test, Split::Valid].into_iter().find(|split| corpus.split(*split).next().is_some())
}

impl<'a> HeldOut<'a> {
    /// The clips of a split of the corpus that dances are compared with.
    pub fn of(split: Split, real: &'a Reference<'a>, dataset: &Dataset, compute: Compute) -> Result<HeldOut<'a>> {
        let corpus = real.corpus();
        let given = joints::parse(GIVEN)?.joints;
        let coded = corpus.tokenizer().channels().joints().iter();
        let free: Vec<usize> = coded.copied().filter(|joint| !given.contains(joint)).collect();
        let most = (SECONDS * corpus.manifest().fps).round() as usize;
        let file = |record: &&ClipRecord| {
            // the file of a segment holds more than the clip
            let item = dataset.items.iter().find(|item| item.name == record.name && item.segment.is_none())?;
            Some(item.path.clone())
        };
        let files = corpus.split(split).filter_map(|record| Some((record, file(&record)?))).take(CLIPS);
        let clips = files.map(|(record, file)| {
            let frames = record.frames.min(most);
            let judge = Judge::new(real, vec![FreeSpan { frames: 0..frames, joints: free.clone() }])?;
            Ok(Clip { record, file, frames, judge })
        });
        let clips = clips.collect::<Result<Vec<_>>>()?;
        let verdict = |clip: &Clip| Ok(clip.judge.verdict(&Dance::of_corpus(corpus, clip.record)?));
        let real = Aims::of(&clips.iter().map(verdict).collect::<Result<Vec<_>>>()?);
        Ok(HeldOut { split, corpus, clips, real, compute })
    }

    /// Measures a run.
    pub fn measure(&self, run: &Path) -> Result<Measured> {
        let found = load_run(run, CheckpointChoice::Auto)?.likelihood(self.corpus, self.split, self.compute)?;
        let fps = self.corpus.manifest().fps;
        let bits_per_frame = found.context("no frame to measure")?.bits_per_frame;
        let made = self.clips.iter().map(|clip| clip.dance(run, fps)).collect::<Result<Vec<_>>>()?;
        Ok(Measured { bits_per_frame, made: Aims::of(&made) })
    }
}

impl Clip<'_> {
    /// The verdict on a dance of a run that is given a part of the clip.
    fn dance(&self, run: &Path, fps: f64) -> Result<Verdict> {
        let read = self.record.read.clone();
        let prompt = PromptRequest { read, joints: Some(GIVEN.into()), ..PromptRequest::of(&self.file) };
        let length = Some(Length::Frames(self.frames));
        // measured as it is sampled: a resampled dance is smoother
        let request = Request { prompt: Some(prompt), length, fps: Some(fps), ..Request::of(run) };
        let open = OpenRequest::open(&request)?;
        // of one sample: the judge measures, and has nothing to choose
        let (outs, best) = (["dance.bvh".into()], Some(BestOf { samples: 1, judge: &self.judge }));
        let dances = open.make(&Making { outs: &outs, best, guesses: None }, &mut unwatched)?;
        dances.chosen[0].best.map(|best| best.verdict).context("a judged dance")
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
        let (made, tuned, real) = (&before.made, &after.made, &held_out.real);
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
