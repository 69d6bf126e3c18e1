//! Parts of training clips that a corpus shouldn't have: glitches, hips that flip, bodies in the floor, copies. docs/training.md,
//! "Clips that are not clean".
//!
//! Clips are looked at as a tokenizer takes them: on SMPL-24, at its rate, their floors at y = 0. Times are seconds of the
//! clip as it is read, half-open, as `kinelm_corpus::segments` has them.

mod copies;
#[cfg(test)]
mod tests;

use crate::Result;
use crate::filter::hips::flips;
pub use kinelm_corpus::build::{BuildOptions, BuildProgress, Summary, for_each_clip};
use kinelm_corpus::load::{ClipSpec, ItemClip};
use kinelm_corpus::record::ExcludedRange;
use kinelm_corpus::stats::glitches;
use kinelm_corpus::{Dataset, Item, Split};
use kinelm_motion::Clip;
use kinelm_motion::rig::Humanoid;
use kinelm_store::counted;
use kinelm_tokenizer::TokenizerConfig;
use std::collections::BTreeSet;
use std::fmt;

pub use copies::{COPY_DEG, WINDOW_S};

/// A body is in the floor where its lower foot, less its height in stance, or another joint is deeper, metres.
pub const DEPTH_M: f64 = 0.10;
/// And for as long, seconds: rests of a step are no sinking.
const SINKS_S: f64 = 0.25;
/// Finds of one clip with a shorter gap between them are one range, seconds: the gap is of no use, and what
/// jumps away and back is wrong in between.
const MERGE_S: f64 = 0.5;

/// The kind of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Fault {
    /// A step that no body makes.
    Glitch,
    /// Hips turned by half a circle, and back.
    Flip,
    /// Deep in the floor.
    Sinks,
    /// As in another clip.
    Copy,
}

impl Fault {
    const ALL: [Fault; 4] = [Fault::Glitch, Fault::Flip, Fault::Sinks, Fault::Copy];

    fn name(self) -> &'static str {
        match self {
            Fault::Glitch => "glitches",
            Fault::Flip => "flips of the hips",
            Fault::Sinks => "sinking",
            Fault::Copy => "copies",
        }
    }
}

/// Frames of a clip, and what is wrong with them.
#[derive(Debug, Clone, PartialEq)]
struct Finding {
    first: usize,
    end: usize,
    why: Fault,
    description: String,
}

/// A clip as it is looked at.
struct LoadedClip {
    name: String,
    split: Split,
    clip: Clip,
    finds: Vec<Finding>,
}

/// The faults found, and their sums.
#[derive(Debug, Clone, PartialEq)]
pub struct CleaningReport {
    /// The ranges, by clip and time.
    pub ranges: Vec<ExcludedRange>,
    /// Of each kind the ranges, and their clips; one that has two kinds counts in both.
    pub kinds: Vec<(Fault, [usize; 2])>,
    /// Training clips, and their seconds.
    pub clips: usize,
    /// Seconds of them.
    pub seconds: f64,
    /// Seconds that the ranges take.
    pub left_out_s: f64,
    /// Of the files that were read.
    pub summary: Summary,
}

/// Looks through the training clips at the rate and by the joints of a tokenizer. Copies are looked for in the clips of all
/// splits: of two training clips the later one is listed, of a training clip and another split's the former.
///
/// # Errors
/// Those of reading; no clip could be taken, or any file is bad and `strict` is given.
pub fn clean(
    dataset: &Dataset,
    config: &TokenizerConfig,
    options: &BuildOptions,
    watch: &mut BuildProgress<'_>,
) -> Result<CleaningReport> {
    let items: Vec<&Item> = dataset.items.iter().collect();
    let wanted = ClipSpec { fps: config.fps, above_floor: true, keep_own: true };
    let mut held: Vec<LoadedClip> = Vec::new();
    let summary = for_each_clip(
        &items,
        options,
        wanted,
        watch,
        |item, loaded| match item.split {
            Split::Train => {
                let mut finds = of_clip(&item.name, &loaded.clip, &config.joints)?;
                finds.extend(flipped(item, loaded));
                Ok((loaded.clip.clone(), finds))
            }
            Split::Valid | Split::Test => Ok((loaded.clip.clone(), Vec::new())),
        },
        |item, _, (clip, finds), _| -> Result<_> {
            let frames = clip.frames();
            held.push(LoadedClip { name: item.name.clone(), split: item.split, clip, finds });
            Ok(frames)
        },
    )?;
    copies::find(&mut held, config.fps)?;
    Ok(merge(held, config.fps, summary))
}

/// Faults of a clip by itself.
fn of_clip(name: &str, clip: &Clip, joints: &[usize]) -> Result<Vec<Finding>> {
    let found = glitches(name, clip, joints).into_iter().map(|glitch| {
        let unit = if glitch.what == "root" { "cm" } else { "degrees" };
        let description = format!("{} {:.0} {unit} in one frame", glitch.what, glitch.step);
        // both frames of the step: which one is wrong is not known
        Finding { first: glitch.frame - 1, end: glitch.frame + 1, why: Fault::Glitch, description }
    });
    Ok(found.chain(sinking(clip)?).collect())
}

/// The flips of an item, found at the file's own rate, in frames of its clip: a lower rate cuts the step of a flip into
/// two.
fn flipped(item: &Item, ItemClip { clip, own, .. }: &ItemClip) -> Vec<Finding> {
    let own = own.as_deref().unwrap_or(clip);
    let from_s = item.segment.map_or(0.0, |segment| segment.from_s);
    let frame = |at: usize| (at as f64 / own.fps() - from_s) * clip.fps();
    let found = flips(own, 0).into_iter().filter_map(|flip| {
        let (first, end) = (frame(flip.frames.start).floor().max(0.0), frame(flip.frames.end).ceil());
        let (first, end) = (first as usize, (end.max(0.0) as usize).min(clip.frames()));
        let description = format!("hips flip by {:.0} degrees", flip.degrees());
        (first < end).then_some(Finding { first, end, why: Fault::Flip, description })
    });
    found.collect()
}

fn sinking(clip: &Clip) -> Result<Vec<Finding>> {
    let feet = Humanoid::neutral().feet()?;
    let low: Vec<f64> = feet.clearance(clip).into_iter().zip(feet.other_heights(clip)).map(|(a, b)| a.min(b)).collect();
    let mut found = Vec::new();
    let mut first = 0;
    for stretch in low.chunk_by(|a, b| (*a < -DEPTH_M) == (*b < -DEPTH_M)) {
        let end = first + stretch.len();
        if stretch[0] < -DEPTH_M && stretch.len() as f64 >= SINKS_S * clip.fps() {
            let deepest = -100.0 * stretch.iter().copied().fold(0.0, f64::min);
            found.push(Finding { first, end, why: Fault::Sinks, description: format!("{deepest:.0} cm in the floor") });
        }
        first = end;
    }
    Ok(found)
}

/// Finds of each clip put together.
fn merge(held: Vec<LoadedClip>, fps: f64, summary: Summary) -> CleaningReport {
    // to 0.1 ms, far below a frame
    let seconds = |frames: usize| (1e4 * frames as f64 / fps).round() / 1e4;
    let mut cleaned =
        CleaningReport { ranges: vec![], kinds: vec![], clips: 0, seconds: 0.0, left_out_s: 0.0, summary };
    let mut counts: Vec<(Fault, usize, BTreeSet<usize>)> = Fault::ALL.map(|why| (why, 0, BTreeSet::new())).into();
    for (number, one) in held.into_iter().enumerate().filter(|(_, one)| one.split == Split::Train) {
        cleaned.clips += 1;
        cleaned.seconds += seconds(one.clip.frames());
        for (first, end, finds) in merge_findings(one.finds, (MERGE_S * fps).round() as usize) {
            for (why, ranges, clips) in &mut counts {
                if finds.iter().any(|find| find.why == *why) {
                    *ranges += 1;
                    clips.insert(number);
                }
            }
            let last = one.clip.frames();
            cleaned.left_out_s += seconds(end.min(last) - first);
            // open at the clip's end: rounded seconds might leave its last frame in
            let to_s = (end < last).then(|| seconds(end));
            let mut why: Vec<&str> = finds.iter().map(|find| find.description.as_str()).collect();
            why.dedup();
            cleaned.ranges.push(ExcludedRange {
                clip: one.name.clone(),
                from_s: seconds(first),
                to_s,
                why: why.join("; "),
            });
        }
    }
    cleaned.kinds = counts.into_iter().map(|(why, ranges, clips)| (why, [ranges, clips.len()])).collect();
    cleaned
}

/// Finds with fewer than `gap` frames between them put together, in the order of time.
fn merge_findings(mut finds: Vec<Finding>, gap: usize) -> Vec<(usize, usize, Vec<Finding>)> {
    // by beginning, so that one look at the last range is enough
    finds.sort_by_key(|find| (find.first, find.end));
    let mut all: Vec<(usize, usize, Vec<Finding>)> = Vec::new();
    for find in finds {
        match all.last_mut().filter(|(_, end, _)| find.first < *end + gap) {
            Some((_, end, others)) => {
                *end = find.end.max(*end);
                others.push(find);
            }
            None => all.push((find.first, find.end, vec![find])),
        }
    }
    all
}

impl fmt::Display for CleaningReport {
    /// A line for each kind and one for all, without a line end after the last.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (why, [ranges, clips]) in &self.kinds {
            writeln!(f, "{}: {} of {}", why.name(), counted(*ranges, "ranges"), counted(*clips, "clips"))?;
        }
        let (ranges, clips) = (counted(self.ranges.len(), "ranges"), counted(self.clips, "training clips"));
        write!(f, "in all {ranges}, {:.1} s of the {:.1} s of {clips}", self.left_out_s, self.seconds)
    }
}
