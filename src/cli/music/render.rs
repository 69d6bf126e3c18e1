//! `kinelm music render`.

use super::bpm;
use crate::cli::{ForceArgs, Say};
use anyhow::Result;
use kinelm_music::synth::{LONGEST_S, Score, Style, render};
use kinelm_music::{beat, wav};
use std::path::PathBuf;

/// When the first beat of a piece is, seconds.
const FIRST_S: f64 = 0.3;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Beats per minute, 20 to 400
    #[arg(long, default_value_t = 110.0, value_parser = bpm)]
    bpm: f64,
    /// Length in seconds, up to an hour
    #[arg(long, default_value_t = 30.0, value_parser = length)]
    seconds: f64,
    /// The style
    #[arg(long, default_value = "pop", value_enum)]
    style: Style,
    /// Seed of key, chords and accents
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// Where the piece goes (.wav)
    #[arg(long, value_name = "FILE.wav")]
    out: PathBuf,
    #[command(flatten)]
    force: ForceArgs,
}

/// Seconds of a piece.
fn length(text: &str) -> std::result::Result<f64, String> {
    let found = crate::cli::values::seconds(text).ok().filter(|seconds| (1.0..=LONGEST_S).contains(seconds));
    found.ok_or_else(|| format!("found `{text}`, expected 1 to {LONGEST_S} seconds"))
}

pub fn run(args: &Args, say: Say) -> Result<()> {
    if crate::cli::extension(&args.out) != "wav" {
        return Err(crate::cli::WrongCall(format!("{}: expected a name ending in .wav", args.out.display())).into());
    }
    let outputs = args.force.outputs(Vec::<PathBuf>::new());
    outputs.check([&*args.out])?;
    // late enough for a tracker, and a dancer, to expect the first beat
    let beats_s = (0..).map(|i| FIRST_S + 60.0 / args.bpm * f64::from(i)).take_while(|beat| *beat < args.seconds);
    let score =
        Score { style: args.style, beats_s: beats_s.collect(), downbeat: 0, seconds: args.seconds, seed: args.seed };
    let sound = render(&score, beat::RATE).map_err(crate::Error::from)?;
    outputs.write(&args.out, &wav::bytes(&sound, beat::RATE))?;
    let (style, beats) = (args.style.name(), kinelm_store::counted(score.beats_s.len(), "beats"));
    say.line(format_args!("{}: {style}, {beats}, {} a minute", args.out.display(), args.bpm));
    Ok(())
}
