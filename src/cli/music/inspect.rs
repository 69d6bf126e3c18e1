//! `kinelm music inspect`.

use super::TempoArgs;
use crate::cli::{ForceArgs, Say, each_file, print, reported};
use crate::evaluate::music::{picture, report};
use anyhow::{Error, Result};
use kinelm_music::feature;
use std::path::{Path, PathBuf};

/// Frames per second of what is drawn.
const PICTURE_FPS: f64 = 60.0;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Music files (.wav .flac .ogg .mp3 .m4a .aac)
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// Print one JSON object per file instead of text
    #[arg(long, conflicts_with = "out")]
    json: bool,
    /// Plot the one file (.png .svg): onset strength with the beats, pitch classes, tempo
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[command(flatten)]
    tempo: TempoArgs,
    /// Where the plotted part starts, seconds
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0, value_parser = crate::cli::values::seconds)]
    at: f64,
    /// How long it is
    #[arg(long, default_value_t = 10.0, value_parser = crate::cli::values::seconds_above_0)]
    seconds: f64,
    #[command(flatten)]
    force: ForceArgs,
}

pub fn run(args: &Args, say: Say) -> Result<()> {
    match &args.out {
        Some(out) => draw(args, out, say),
        None => inspect(args, say),
    }
}

fn inspect(args: &Args, say: Say) -> Result<()> {
    each_file(&args.files, say, |_, file| {
        let found = report::report(file, args.tempo.bpm_range).map_err(Error::from);
        let found = reported(found, file, args.json)?;
        print(&if args.json { found.json() + "\n" } else { found.text() })
    })?;
    Ok(())
}

fn draw(args: &Args, out: &Path, say: Say) -> Result<()> {
    let [file] = &args.files[..] else {
        let what = format!("--out draws one file, and {} are given", args.files.len());
        return Err(crate::cli::WrongCall(what).into());
    };
    let outputs = args.force.outputs(args.files.clone());
    crate::cli::picture(out, &outputs)?;
    let features = feature::features(file, PICTURE_FPS).map_err(crate::Error::from)?;
    let charts = picture::charts(&features, args.at..args.at + args.seconds)
        .map_err(|e| Error::new(e).context(file.display().to_string()))?;
    crate::cli::draw_charts(out, &charts, &outputs)?;
    say.line(format_args!("{}: {}, {} beats", out.display(), file.display(), features.beats.times_s.len()));
    Ok(())
}
