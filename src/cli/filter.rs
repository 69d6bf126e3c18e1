//! `kinelm filter`.

use super::many::InOut;
use super::{ForceArgs, Odd, Say, print, read::ReadArgs};
use crate::spectral::filter::{Filter, Filtered, LOW_HZ, MIDDLE_HZ, butterworth, compat, hips};
use anyhow::Result;
use kinelm_motion::feet::{FixedParts, lock};
use kinelm_motion::format::{self, ReadOptions, RestFrame, resolve_floor};
use kinelm_motion::metric::jitter;
use kinelm_store::output::Outputs;
use std::path::{Path, PathBuf};

/// Share of rotations that are faster than the band, up to which no note is printed.
const LOST_SHARE: f64 = 1e-3;

#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    files: InOut,
    /// The band of a cosine transform to keep: low, up to 3.5 Hz, or middle, up to 7.3 Hz [default: low]
    #[arg(long, value_enum, conflicts_with_all = ["cutoff", "keep"])]
    level: Option<Level>,
    /// Remove movements above this frequency, Hz
    #[arg(long, value_name = "HZ", value_parser = super::values::positive)]
    cutoff: Option<f64>,
    /// Keep this many coefficients of the cosine transform over the whole clip
    #[arg(long, value_name = "K", conflicts_with = "cutoff", value_parser = super::values::count)]
    keep: Option<usize>,
    /// Use a zero-phase Butterworth filter of this order instead, as scipy's butter and filtfilt
    #[arg(long, value_name = "ORDER", conflicts_with = "keep",
        value_parser = super::values::within(1..=butterworth::MAX_ORDER))]
    butterworth: Option<usize>,
    /// Apply the gain to the spectrum of the file's Euler angles instead, as the music-to-dance dissertation; BVH only
    #[arg(long, conflicts_with = "hips")]
    compat: bool,
    /// Turn hips back where they flip: where they turn by more than 120 degrees in one frame, and back later
    #[arg(long)]
    hips: bool,
    /// Lock feet that are in contact with the floor, and keep the body on it; with --feet or --hips and without --level,
    /// --cutoff or --keep nothing else changes
    #[arg(long)]
    feet: bool,
    /// Print one JSON object per clip
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    force: ForceArgs,
    #[command(flatten)]
    read: ReadArgs,
}

/// `--level`.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Level {
    /// Up to 3.5 Hz: 16 of 128 coefficients at 60 fps
    Low,
    /// Up to 7.3 Hz: 32 of 128
    Middle,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let how = args.filter();
    let pairs = args.files.pairs()?;
    let clips: Vec<PathBuf> = pairs.iter().map(|p| p.input.clone()).collect();
    let outputs = args.force.outputs(clips.iter().cloned().chain(args.read.files()));
    outputs.check(pairs.iter().map(|p| &*p.output))?;
    let (options, odd) = (args.read.of_files(&clips, RestFrame::Drop, say), Odd::new(say));
    let each =
        |i: usize, clip: &Path| one((clip, &options[i]), &pairs[i].output, how.as_ref(), &args, (&outputs, &odd, say));
    super::each_file(&clips, say, each)?;
    Ok(())
}

fn one(
    (path, options): (&Path, &ReadOptions),
    out: &Path,
    how: Option<&Filter>,
    args: &Args,
    (outputs, odd, say): (&Outputs, &Odd, Say),
) -> Result<()> {
    let mut motion = format::read(path, options)?;
    let floor_m = if args.feet { Some(resolve_floor(&mut motion, options)?) } else { None };
    odd.warn(&motion, options);
    let before = jitter(&motion.clip);
    let mut flips = Vec::new();
    if args.hips {
        let joint = motion.humanoid()?.pose()?.joints[0].unwrap_or(0);
        flips = hips::flips(&motion.clip, joint);
        motion.clip = hips::turned_back(&motion.clip, joint, &flips)?;
    }
    let mut done = match how {
        Some(Filter::Butterworth { order, cutoff_hz }) if args.compat => {
            let clip = compat(&motion, *order, *cutoff_hz)?;
            Filtered { clip, coefficients: None, too_fast: Vec::new() }
        }
        Some(how) => how.apply(&motion.clip)?,
        None => Filtered { clip: motion.clip.clone(), coefficients: None, too_fast: Vec::new() },
    };
    let mut locked = None;
    if let Some(floor_m) = floor_m {
        let (clip, found) = lock(&done.clip, motion.humanoid()?, floor_m, FixedParts::default())?;
        (done.clip, locked) = (clip, Some(found));
    }
    let total = done.clip.rotations().len();
    if done.too_fast.len() as f64 > LOST_SHARE * total as f64 {
        let (_, joint) = done.too_fast[0];
        let (n, name) = (done.too_fast.len(), &motion.clip.skeleton().names()[joint]);
        say.line(format_args!(
            "{}: {n} of {total} rotations (first: {name}) turn faster than the band; a higher --cutoff keeps them",
            path.display()
        ));
    }
    let after = jitter(&done.clip);
    let filtered = super::written_as(out, motion.with_clip(done.clip))?;
    outputs.write(out, &format::to_bytes(out, &filtered)?)?;
    let clip = &filtered.clip;
    if args.json {
        let line = serde_json::json!({
            "schema": 1, "clip": path, "out": out, "frames": clip.frames(), "fps": clip.fps(), "kept": done.coefficients,
            "jitter": [before, after], "too_fast": done.too_fast.len(),
            "hips": args.hips.then(|| flips.iter().map(|flip| [flip.frames.start, flip.frames.end]).collect::<Vec<_>>()),
            "feet": locked.map(|l| serde_json::json!({
                "held": l.locked.len(), "out_of_reach": l.out_of_reach.len(), "moved_cm": l.moved_cm,
                "settled_cm": l.settled_cm, "carried_cm": l.carried_cm,
            })),
        });
        return print(&format!("{line}\n"));
    }
    let kept = done.coefficients.map(|[k, n]| format!(", {k} of {n} coefficients")).unwrap_or_default();
    let jerk = before.zip(after).map(|(a, b)| format!(", jitter {a:.0} to {b:.0} m/s^3")).unwrap_or_default();
    let (out, frames, fps) = (out.display(), clip.frames(), (clip.fps() * 1e3).round() / 1e3);
    say.line(format_args!("{out}: {frames} frames at {fps} fps{kept}{jerk}"));
    for flip in &flips {
        let (first, last, degrees) = (flip.frames.start, flip.frames.end - 1, flip.degrees());
        say.line(format_args!("hips turned back by {degrees:.0} degrees in frames {first} to {last}"));
    }
    locked.iter().flat_map(|locked| locked.notes(clip.fps())).for_each(|note| say.line(note));
    Ok(())
}

impl Args {
    /// The filter; `None` where only hips or feet are mended.
    fn filter(&self) -> Option<Filter> {
        if (self.feet || self.hips) && self.level.is_none() && self.cutoff.is_none() && self.keep.is_none() {
            return None;
        }
        let level = match self.level {
            None | Some(Level::Low) => LOW_HZ,
            Some(Level::Middle) => MIDDLE_HZ,
        };
        let cutoff_hz = self.cutoff.unwrap_or(level);
        Some(match (self.butterworth, self.keep) {
            (Some(order), _) => Filter::Butterworth { order, cutoff_hz },
            (None, Some(keep)) => Filter::Coefficients { keep },
            (None, None) => Filter::Band { cutoff_hz },
        })
    }
}
