//! `kinelm interpolate`.

use super::named::{named, pair};
use super::view::stem;
use super::{ForceArgs, Say, WrongCall, print, read::ReadArgs};
use crate::spectral::interpolate::{
    Alignment, Coordinates, Descent, InterpolateOptions, Interpolated, Method, Spectrum, align, interpolate,
};
use crate::view::{Figure, page};
use anyhow::Result;
use kinelm_motion::format;
use kinelm_motion::moment::Moment;
use std::ops::Range;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The dance to move: its path, its rig, its small movements. Reading options of one file follow its name,
    /// FILE:fps=60,skip=10 (also up, unit, map, root, rest, position)
    #[arg(value_name = "A")]
    a: PathBuf,
    /// The dance to move it towards
    #[arg(value_name = "B")]
    b: PathBuf,
    /// Where the blend goes, on A's rig (.bvh .npz .json)
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Also write a page with A, the blend and B (.html)
    #[arg(long, value_name = "FILE")]
    page: Option<PathBuf>,
    /// Also draw how far the coefficients of A and of the blend are from B's, by frequency (.png .svg)
    #[arg(long, value_name = "FILE")]
    plot: Option<PathBuf>,
    /// The spectrum to blend: low cosine coefficients, principal components of both clips, or STFT magnitudes, which
    /// shake
    #[arg(long, value_enum, default_value = "dct")]
    transform: Spectrum,
    /// Coefficients or components to blend: the first K, or a band from FROM up to but without TO, as 4..16; 16 is
    /// 0..16 [default: those up to 3.5 Hz (16 of 128 frames), or 16 components]
    #[arg(long, value_name = "K|FROM..TO", value_parser = super::values::band)]
    keep: Option<Range<usize>>,
    /// The numbers of a rotation to blend: turns and small rotations, or rotation vectors as in the thesis, where a
    /// dancer who turns flips
    #[arg(long, value_enum, default_value = "relative")]
    coordinates: Coordinates,
    #[command(flatten)]
    what: WindowArgs,
    #[command(flatten)]
    how: HowArgs,
    /// Print one JSON object instead of a table
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    force: ForceArgs,
    #[command(flatten)]
    read: ReadArgs,
}

/// What of the two clips.
#[derive(Debug, clap::Args)]
struct WindowArgs {
    /// Frames to blend
    #[arg(long, value_name = "FRAMES", default_value_t = 128,
        value_parser = super::values::within(align::MIN_FRAMES..=align::MAX_FRAMES))]
    window: usize,
    /// Blend as many frames as the shorter clip has
    #[arg(long, conflicts_with = "window")]
    whole: bool,
    /// Frames per second of the blend
    #[arg(long, default_value_t = 60.0, value_parser = super::values::rate)]
    fps: f64,
    /// Where A's window starts: 2.5s, 2.5 or 40f (frames of the file)
    #[arg(long, value_name = "SECONDS", default_value = "0s", allow_negative_numbers = true, value_parser = super::values::time)]
    at_a: Moment,
    /// Where B's window starts
    #[arg(long, value_name = "SECONDS", default_value = "0s", allow_negative_numbers = true, value_parser = super::values::time)]
    at_b: Moment,
    /// Keep B's heading, instead of turning B so that both start facing the same way
    #[arg(long)]
    keep_heading: bool,
}

/// How far, and in which way.
#[derive(Debug, clap::Args)]
struct HowArgs {
    /// How far from A's spectrum (0) to B's (1) the target of the descent is
    #[arg(long, value_name = "S", default_value_t = Descent::STRENGTH, conflicts_with = "amount", value_parser = super::values::share)]
    strength: f64,
    /// Blend in closed form by this much, 0 to 1, instead of by descent (dct and pca)
    #[arg(long, value_name = "ALPHA", conflicts_with_all = ["plain", "rate", "steps"], value_parser = super::values::share)]
    amount: Option<f64>,
    /// Plain gradient descent instead of Adam
    #[arg(long)]
    plain: bool,
    /// Step size [default: 0.01 for Adam; for plain descent what covers 99 % of the distance]
    #[arg(long, value_parser = super::values::positive)]
    rate: Option<f64>,
    /// Steps of the descent
    #[arg(long, default_value_t = Descent::STEPS)]
    steps: usize,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    check(&args)?;
    let files = [named(&args.a)?, named(&args.b)?];
    let paths = [&files[0].path, &files[1].path];
    let outputs = args.force.outputs(paths.into_iter().cloned().chain(args.read.files()));
    outputs.check(std::iter::once(&*args.out).chain(args.page.as_deref()).chain(args.plot.as_deref()))?;
    args.plot.as_deref().map_or(Ok(()), |path| super::picture(path, &outputs))?;
    let [a, b] = pair(&files, &args.read, say)?;
    super::progress::stage("blending the dances");
    let at_s = [args.what.at_a.seconds(a.clip.fps()), args.what.at_b.seconds(b.clip.fps())];
    let done = interpolate(&a, &b, &args.settings(at_s))?;
    done.notes.iter().for_each(|line| say.line(line));
    // the clips are A, B and the blend
    let between = super::written_as(&args.out, a.with_clip(done.clips[2].clone()))?;
    outputs.write(&args.out, &format::to_bytes(&args.out, &between)?)?;
    if let Some(path) = &args.page {
        outputs.write(path, page(&figures(paths, &args.out, at_s, &done))?.as_bytes())?;
    }
    if let Some(path) = &args.plot {
        super::draw_charts(path, &[done.chart()], &outputs)?;
    }
    let report = &done.report;
    say.line(format_args!("{}: {} frames at {} fps", args.out.display(), report.frames, report.fps));
    if !report.is_smooth && matches!(args.transform, Spectrum::Dct) && args.keep != Some(0..report.frames) {
        let n = report.frames;
        say.line(format_args!("it shakes more than either dance: --keep {n} moves A's fast movements too"));
    }
    if !args.json {
        return print(&format!("{report}\n"));
    }
    let mut line = serde_json::to_value(report)?;
    line["schema"] = 1.into();
    for (key, path) in [("a", paths[0]), ("b", paths[1]), ("out", &args.out)] {
        line[key] = path.display().to_string().into();
    }
    line["at_s"] = serde_json::json!(at_s);
    line["notes"] = done.notes.clone().into();
    print(&format!("{line}\n"))
}

/// Refuses what is wrong whatever the files contain.
fn check(args: &Args) -> Result<()> {
    super::writable(&args.out)?;
    args.page.as_deref().map_or(Ok(()), super::page)?;
    if args.keep.is_some() && matches!(args.transform, Spectrum::Stft) {
        return Err(
            WrongCall("--keep: magnitudes are moved all together; leave it out, or take dct or pca".into()).into()
        );
    }
    if args.how.amount.is_some() && matches!(args.transform, Spectrum::Stft) {
        let what =
            "--amount: magnitudes have no closed form, their phase is free; give --strength, or another --transform";
        return Err(WrongCall(what.into()).into());
    }
    Ok(())
}

impl Args {
    fn settings(&self, at_s: [f64; 2]) -> InterpolateOptions {
        let WindowArgs { window, whole, fps, keep_heading, .. } = self.what;
        let HowArgs { strength, amount, plain, rate, steps } = self.how;
        InterpolateOptions {
            alignment: Alignment { frames: (!whole).then_some(window), fps, at_s, keep_heading },
            coordinates: self.coordinates,
            spectrum: self.transform,
            keep: self.keep.clone(),
            method: match (amount, plain) {
                (Some(amount), _) => Method::Closed { amount },
                (None, true) => Method::Plain(Descent { strength, rate, steps }),
                (None, false) => Method::Adam(Descent { strength, rate, steps }),
            },
        }
    }
}

/// A, the dance between, B: from left to right.
fn figures<'a>(files: [&PathBuf; 2], out: &Path, at_s: [f64; 2], done: &'a Interpolated) -> [Figure<'a>; 3] {
    let at = |s: f64| format!("from {s} s on");
    let [a, b, c] = &done.clips;
    [
        Figure::new(stem(files[0]), a).note(at(at_s[0])),
        Figure::new(stem(out), c).note(done.report.transform.clone()),
        Figure::new(stem(files[1]), b).note(at(at_s[1])),
    ]
}
