//! `kinelm filter`.

use super::many::{self, Pair};
use super::{ForceArgs, Say, print, read::ReadArgs};
use anyhow::Result;
use kinelm::output::Outputs;
use kinelm::spectral::filter::{Filter, LOW_HZ, MIDDLE_HZ, butterworth, filter};
use kinelm_motion::Motion;
use kinelm_motion::format::{self, RestFrame};
use kinelm_motion::metric::jitter;
use std::path::{Path, PathBuf};

/// Less movement than this of one frame to the next isn't worth a word: a share of all rotations.
const LOST_SHARE: f64 = 1e-3;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Motion files (.bvh .npz .pkl .json), or folders of them
    #[arg(required = true, value_name = "CLIP")]
    clips: Vec<PathBuf>,
    /// The file to write (.bvh .npz .json), or a folder, which is made if it isn't there: files go by their names,
    /// those of a folder by their paths below it
    #[arg(long, value_name = "FILE|DIR")]
    out: PathBuf,
    /// The bands of a cosine transform that stay: low, up to 3.5 Hz; or middle, up to 7.3 Hz
    #[arg(long, value_enum, default_value = "low", conflicts_with_all = ["cutoff", "keep"])]
    level: Level,
    /// Movements faster than this go, Hz
    #[arg(long, value_name = "HZ", value_parser = super::read::positive)]
    cutoff: Option<f64>,
    /// Coefficients of the cosine transform over the whole clip that stay
    #[arg(long, value_name = "K", conflicts_with = "cutoff", value_parser = super::read::count)]
    keep: Option<usize>,
    /// A Butterworth filter of this order instead, forth and back, as scipy's butter and filtfilt
    #[arg(long, value_name = "ORDER", requires = "cutoff", conflicts_with = "keep",
        value_parser = super::read::within(1..=butterworth::MOST))]
    butterworth: Option<usize>,
    /// One JSON object a clip
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
    let pairs = pairs(&args.clips, &args.out)?;
    let clips: Vec<PathBuf> = pairs.iter().map(|p| p.input.clone()).collect();
    let outputs = args.force.outputs(clips.iter().cloned().chain(args.read.files()));
    outputs.check(pairs.iter().map(|p| &*p.output))?;
    let each = |i: usize, clip: &Path| one(clip, &pairs[i].output, &how, &args, (&outputs, say));
    super::each_file(&clips, "clips could not be filtered", say, each)
}

fn one(path: &Path, out: &Path, how: &Filter, args: &Args, (outputs, say): (&Outputs, Say)) -> Result<()> {
    let motion = format::read(path, &args.read.options(RestFrame::Drop))?;
    super::warn(&motion, say);
    let done = filter(&motion.clip, how)?;
    let before = jitter(&motion.clip);
    let total = done.clip.rotations().len();
    if done.lost.len() as f64 > LOST_SHARE * total as f64 {
        let (_, joint) = done.lost[0];
        let (n, name) = (done.lost.len(), &motion.clip.skeleton().names()[joint]);
        say.line(format_args!(
            "{}: {n} of {total} rotations (first: {name}) turn faster than the band; a higher --cutoff keeps them",
            path.display()
        ));
    }
    let after = jitter(&done.clip);
    let filtered = super::written_as(out, Motion { clip: done.clip, ..motion }, args.read.map.as_deref())?;
    outputs.write(out, &format::to_bytes(out, &filtered)?)?;
    let clip = &filtered.clip;
    if args.json {
        let line = serde_json::json!({
            "schema": 1, "clip": path, "out": out, "frames": clip.frames(), "fps": clip.fps(), "kept": done.kept,
            "jitter": [before, after], "too_fast": done.lost.len(),
        });
        return print(&format!("{line}\n"));
    }
    let kept = done.kept.map(|[k, n]| format!(", {k} of {n} coefficients")).unwrap_or_default();
    let jerk = before.zip(after).map(|(a, b)| format!(", jitter {a:.0} to {b:.0} m/s^3")).unwrap_or_default();
    let (out, frames, fps) = (out.display(), clip.frames(), (clip.fps() * 1e3).round() / 1e3);
    say.line(format_args!("{out}: {frames} frames at {fps} fps{kept}{jerk}"));
    Ok(())
}

impl Args {
    fn filter(&self) -> Filter {
        let level = match self.level {
            Level::Low => LOW_HZ,
            Level::Middle => MIDDLE_HZ,
        };
        let cutoff_hz = self.cutoff.unwrap_or(level);
        match (self.butterworth, self.keep) {
            (Some(order), _) => Filter::Butterworth { order, cutoff_hz },
            (None, Some(keep)) => Filter::Coefficients { keep },
            (None, None) => Filter::Band { cutoff_hz },
        }
    }
}

/// Where each clip goes: to `out` itself, or into it under its own path. A .pkl, which isn't written, becomes an .npz.
fn pairs(clips: &[PathBuf], out: &Path) -> Result<Vec<Pair>> {
    let pairs = match many::is_folder(clips, out) {
        true => many::into_folder(clips, out, |own| if own == "pkl" { "npz".into() } else { own.into() })?,
        false => vec![Pair { input: clips[0].clone(), output: out.to_owned() }],
    };
    for Pair { output, .. } in &pairs {
        super::writable(output)?;
    }
    Ok(pairs)
}
