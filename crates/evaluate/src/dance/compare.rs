//! Two sets of dances side by side: docs/referee.md, "Two sets side by side".

use super::coded::Dance;
use super::metrics::{DanceMetrics, Mean};
use super::print::shortened;
use super::prompt::PromptMetrics;
use super::reference::Reference;
use crate::{Result, bootstrap};
use kinelm_corpus::{Corpus, Split};
use kinelm_store::counted;
use kinelm_view::plot::{Chart, Look, Scale, Series};
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeSet;
use std::fmt;

/// Lengths that differ by more than this share are reported.
const LENGTHS: f64 = 0.1;
/// Of fewer takes an interval says little.
const FEW_TAKES: usize = 6;

/// A dance, and where it is from.
#[derive(Debug, Clone)]
pub struct MeasuredDance {
    /// The dance.
    pub dance: Dance,
    /// The recording that it, or its prompt, belongs to: dances of one are not independent.
    pub take: String,
    /// Whether it, or its prompt, is a train clip of the corpus.
    pub in_training: bool,
    /// How it follows its prompt.
    pub prompted: Option<PromptMetrics>,
}

/// One of two sets that are compared.
#[derive(Debug, Clone)]
pub struct Side {
    /// What they are called.
    pub name: String,
    /// The dances.
    pub dances: Vec<MeasuredDance>,
}

impl Side {
    fn takes(&self) -> BTreeSet<&str> {
        self.dances.iter().map(|d| &*d.take).collect()
    }

    fn seconds(&self) -> f64 {
        self.dances.iter().map(|d| d.dance.clip.frames() as f64 / d.dance.clip.fps()).sum::<f64>()
            / self.dances.len().max(1) as f64
    }
}

/// The recordings that files with these hashes belong to, as one name, and whether a train clip is among them; `None` of files
/// that the corpus wasn't made from.
pub fn take_of(corpus: &Corpus, sha256: &[String]) -> Option<(String, bool)> {
    let of = |hash: &String| corpus.clips().iter().find(|record| record.sha256 == *hash);
    let records: Vec<_> = sha256.iter().filter_map(of).collect();
    let takes: BTreeSet<&str> = records.iter().map(|record| &*record.take).collect();
    let in_training = records.iter().any(|record| record.split == Split::Train);
    (!takes.is_empty()).then(|| (takes.into_iter().collect::<Vec<_>>().join(" + "), in_training))
}

/// A mean over dances, and the middle 95 % of the means over resampled takes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Estimate {
    /// The mean.
    pub mean: f64,
    /// The middle 95 %.
    pub interval: [f64; 2],
}

/// One measure.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Row {
    /// What is measured, with its unit.
    pub what: &'static str,
    /// Digits after the point.
    #[serde(skip)]
    digits: usize,
    /// Mean of the real train clips.
    pub real: Option<f64>,
    /// Of the two sets; `None` where no dance has it.
    pub sides: [Option<Estimate>; 2],
    /// The second's less the first's.
    pub difference: Option<Estimate>,
}

/// All measures.
#[derive(Debug, Clone, Serialize)]
pub struct Comparison {
    /// The layout's version.
    pub schema: u32,
    /// What the two are called.
    pub names: [String; 2],
    /// Dances of each.
    pub dances: [usize; 2],
    /// Recordings of each.
    pub takes: [usize; 2],
    /// Whether both have the same recordings, which are then resampled together.
    pub paired: bool,
    /// What makes the two hard to compare.
    pub doubts: Vec<String>,
    /// The measures.
    pub rows: Vec<Row>,
}

/// A set of dances by its name.
pub type Set<'a> = (&'a str, Vec<(&'a Dance, Option<&'a PromptMetrics>)>);

/// A figure of one dance.
type Measure = fn(&DanceMetrics, Option<&PromptMetrics>) -> Option<f64>;

/// What is measured, with the digits that are printed. Effort's flow follows its time (0.97 over salsas) and isn't.
const MEASURES: [(&str, usize, Measure); 26] = [
    ("stands still, %", 1, |f, _| share(f.world.still, f.world.frames)),
    ("stands still, pose alone, %", 1, |f, _| share(f.pose.still, f.pose.frames)),
    ("frozen in the end, %", 0, |f, _| Some(100.0 * f64::from(f.world.time_to_freeze_s.is_some()))),
    ("repeats itself, %", 1, |f, _| share(f.repeats[0], f.repeats[1])),
    ("speed, cm/s", 1, |f, _| Some(100.0 * Mean::over([&f.speed].into_iter())?)),
    ("jerk, m/s3", 0, |f, _| Mean::over([&f.jitter].into_iter())),
    ("skating, cm/s", 1, |f, _| f.skate.cm_s()),
    ("skating, % of steps", 1, |f, _| f.skate.share().map(|x| 100.0 * x)),
    ("in the floor, cm", 2, |f, _| f.ground.penetration_cm()),
    ("in the floor, % of frames", 1, |f, _| f.ground.penetration_share().map(|x| 100.0 * x)),
    ("floating, % of frames", 1, |f, _| f.ground.floating_share().map(|x| 100.0 * x)),
    ("PFC", 2, |f, _| f.contact.mean()),
    ("outside the support, %", 1, |f, _| f.balance.outside_share().map(|x| 100.0 * x)),
    ("kicks, %", 1, |f, _| f.balance.kick_share().map(|x| 100.0 * x)),
    ("snaps, per minute", 1, |f, _| f.most.snaps_per_min()),
    ("fastest joint, m/s", 1, |f, _| f.most.fastest()),
    ("hands above shoulders, %", 1, |f, _| f.balance.raised_share().map(|x| 100.0 * x)),
    ("effort: weight, m2/s2", 2, |f, _| Some(f.laban?.weight)),
    ("effort: time, m/s2", 2, |f, _| Some(f.laban?.time)),
    ("effort: space, 0 to 1", 3, |f, _| f.laban?.space),
    ("effort: angular, rad/s", 1, |f, _| Some(f.laban?.angular)),
    ("shape: volume, litres", 0, |f, _| Some(1e3 * f.laban?.volume)),
    ("shape: box, litres", 0, |f, _| Some(1e3 * f.laban?.box_volume)),
    ("jerk of free joints / prompt's", 2, |_, p| p?.free_jitter),
    ("skating / prompt's", 2, |_, p| p?.free_skate),
    ("coordination, effect", 3, |_, p| Some(p?.coordination?.effect)),
];

fn share(some: usize, all: usize) -> Option<f64> {
    (all > 0).then(|| 100.0 * some as f64 / all as f64)
}

impl Reference<'_> {
    /// A chart a measure: of the real train clips and of each set, the share of clips at or below each value.
    ///
    /// # Errors
    /// Words that can't be decoded.
    pub fn charts(&self, sets: &[Set]) -> Result<Vec<Chart>> {
        type Metrics<'a> = (DanceMetrics, Option<&'a PromptMetrics>);
        let train = self.all_metrics(Split::Train)?.into_iter().map(|f| (f, None)).collect();
        let mut all: Vec<(&str, Vec<Metrics>)> = vec![("train", train)];
        all.extend(sets.iter().map(|(name, dances)| {
            (*name, dances.par_iter().map(|(d, prompted)| (self.metrics(d), *prompted)).collect())
        }));
        let chart = |(what, _, of): (&'static str, usize, Measure)| {
            let series = all.iter().enumerate().map(|(colour, (name, dances))| {
                let mut found: Vec<f64> = dances.iter().filter_map(|(f, prompted)| of(f, *prompted)).collect();
                found.sort_by(f64::total_cmp);
                let share = |i: usize| 100.0 * i as f64 / found.len() as f64;
                // two points at each value: the empirical distribution jumps there
                let points = found.iter().enumerate().flat_map(|(i, x)| [(*x, share(i)), (*x, share(i + 1))]);
                Series { name: (*name).into(), points: points.collect(), look: Look::Line, colour: Some(colour) }
            });
            let series = series.collect();
            let (title, y) = (what.into(), "% of clips with so much or less".into());
            Chart { title, y, scales: (Scale::Linear, Scale::Linear), series, ..Chart::default() }
        };
        Ok(MEASURES.map(chart).into_iter().filter(|chart| !chart.is_empty()).collect())
    }

    /// Compares two sets of dances with each other, beside the real train clips.
    ///
    /// # Errors
    /// Words that can't be decoded.
    pub fn compare(&self, sides: &[Side; 2]) -> Result<Comparison> {
        let metrics = sides.each_ref().map(|side| {
            let of = |d: &MeasuredDance| self.metrics(&d.dance);
            side.dances.par_iter().map(of).collect::<Vec<_>>()
        });
        let real = self.all_metrics(Split::Train)?;
        let row = |(what, digits, of): (&'static str, usize, Measure)| {
            let parts = [0, 1].map(|side| {
                let dances = sides[side].dances.iter().zip(&metrics[side]);
                let value = |(d, f): (_, _)| of_dance(d, f, of);
                dances.filter_map(value).collect::<Vec<(&str, f64, f64)>>()
            });
            let mean = |parts: &[(&str, f64, f64)]| parts.iter().map(|p| p.1).sum::<f64>() / parts.len() as f64;
            let there = parts.iter().all(|parts| !parts.is_empty());
            Row {
                what,
                digits,
                real: {
                    let all: Vec<f64> = real.iter().filter_map(|f| of(f, None)).collect();
                    (!all.is_empty()).then(|| all.iter().sum::<f64>() / all.len() as f64)
                },
                sides: parts.each_ref().map(|parts| {
                    let estimate =
                        || Estimate { mean: mean(parts), interval: bootstrap::interval(parts.iter().copied()) };
                    (!parts.is_empty()).then(estimate)
                }),
                difference: there.then(|| Estimate {
                    mean: mean(&parts[1]) - mean(&parts[0]),
                    interval: bootstrap::difference(parts.each_ref().map(|parts| parts.iter().copied())),
                }),
            }
        };
        let takes = sides.each_ref().map(Side::takes);
        Ok(Comparison {
            schema: 1,
            names: sides.each_ref().map(|side| side.name.clone()),
            dances: sides.each_ref().map(|side| side.dances.len()),
            takes: takes.each_ref().map(BTreeSet::len),
            paired: takes[0] == takes[1],
            doubts: doubts(sides, self.fps),
            rows: MEASURES.map(row).into_iter().filter(|row| row.sides.iter().any(Option::is_some)).collect(),
        })
    }
}

fn of_dance<'a>(dance: &'a MeasuredDance, metrics: &DanceMetrics, of: Measure) -> Option<(&'a str, f64, f64)> {
    Some((&*dance.take, of(metrics, dance.prompted.as_ref())?, 1.0))
}

/// What makes two sets hard to compare; they are measured at `fps`.
fn doubts(sides: &[Side; 2], fps: f64) -> Vec<String> {
    let mut doubts = Vec::new();
    for side in sides {
        let in_training = side.dances.iter().filter(|d| d.in_training).count();
        if in_training > 0 {
            let (name, of) = (&side.name, counted(side.dances.len(), "dances"));
            doubts.push(format!(
                "{name}: {in_training} of {of} are train clips, or follow one: what was learned is seen again"
            ));
        }
    }
    for side in sides {
        // a row for each dance would hide that the model made one
        let of: BTreeSet<&[u32]> = side.dances.iter().map(|d| &*d.dance.ids).collect();
        if of.len() < side.dances.len() {
            let (name, all, of) = (&side.name, side.dances.len(), of.len());
            doubts.push(format!(
                "{name}: only {of} of its {all} dances differ: the others repeat one of them to the word"
            ));
        }
    }
    let takes = sides.each_ref().map(|side| side.takes().len());
    if takes.iter().any(|takes| *takes < FEW_TAKES) {
        let takes = takes.map(|takes| counted(takes, "takes"));
        doubts.push(format!("{} of A, {} of B: their intervals say little of others", takes[0], takes[1]));
    }
    let rates = sides.each_ref().map(|side| {
        let mut all: Vec<f64> = side.dances.iter().filter_map(|d| d.dance.file_fps).collect();
        all.sort_by(f64::total_cmp);
        all.dedup();
        all
    });
    if rates.iter().all(|rates| !rates.is_empty()) && rates[0] != rates[1] {
        let rates = rates.map(|rates| rates.iter().map(ToString::to_string).collect::<Vec<_>>().join(", "));
        doubts.push(format!(
            "files of {} and of {} frames a second, measured at {fps}: jerk depends on how they were drawn",
            rates[0], rates[1]
        ));
    }
    let [a, b] = sides.each_ref().map(Side::seconds);
    if (a - b).abs() > LENGTHS * a.max(b) {
        doubts.push(format!("dances of {a:.1} and of {b:.1} s in the mean: longer ones freeze and repeat more"));
    }
    doubts
}

impl fmt::Display for Comparison {
    /// A table, without a line end after the last line.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (letter, side) in ["A", "B"].iter().zip(0..2) {
            let (dances, takes) = (counted(self.dances[side], "dances"), counted(self.takes[side], "takes"));
            writeln!(f, "{letter}: {}, {dances} of {takes}", self.names[side])?;
        }
        self.doubts.iter().try_for_each(|doubt| writeln!(f, "doubt: {doubt}"))?;
        let way = if self.paired { "takes drawn for both at once" } else { "takes drawn for each" };
        writeln!(f, "means over dances, in brackets the middle 95 % ({way}); *: the same sign in all of it")?;
        write!(f, "{:<32} {:>9} {:>28} {:>28} {:>29}", "", "real", "A", "B", "B - A")?;
        for row in &self.rows {
            let digits = row.digits;
            let number = |x: f64| {
                let text = format!("{x:.digits$}");
                // -0.0 and what rounds to it lose their sign
                if text.chars().all(|c| matches!(c, '-' | '0' | '.')) { text.replace('-', "") } else { text }
            };
            let estimate = |estimate: Option<Estimate>| {
                let text = |s: Estimate| {
                    format!("{} ({} to {})", number(s.mean), number(s.interval[0]), number(s.interval[1]))
                };
                estimate.map_or("n/a".into(), text)
            };
            let real = row.real.map_or("n/a".into(), number);
            // one take has no spread: all its resamples are equal
            let star = self.takes.iter().all(|takes| *takes > 1)
                && row.difference.is_some_and(|d| d.interval[0] > 0.0 || d.interval[1] < 0.0);
            let [a, b] = row.sides.map(estimate);
            write!(f, "\n{:<32} {real:>9} {a:>28} {b:>28} {:>28}", shortened(row.what), estimate(row.difference))?;
            f.write_str(if star { "*" } else { " " })?;
        }
        Ok(())
    }
}
