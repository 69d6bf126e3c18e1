//! `kinelm music`.

use super::{ForceArgs, Say, chain, each_file, print};
use crate::corpus::music::beats;
use crate::evaluate::music::{picture, report};
use anyhow::{Error, Result};
use kinelm_music::synth::{LONGEST_S, Score, Style, render};
use kinelm_music::{beat, feature, wav};
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Report length, loudness, beats and tempo of music files, or plot one
    Inspect(InspectArgs),
    /// Find the beats of a music file: a time in seconds per line
    Beats(BeatsArgs),
    /// Render a piece at a given tempo, played by a small synthetic band
    Render(RenderArgs),
}

#[derive(Debug, clap::Args)]
pub struct InspectArgs {
    /// Music files (.wav .flac .ogg .mp3 .m4a)
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
    #[arg(long, value_name = "SECONDS", default_value_t = 0.0, value_parser = super::read::seconds, requires = "out")]
    at: f64,
    /// How long it is
    #[arg(long, default_value_t = 10.0, value_parser = super::read::seconds_above_0, requires = "out")]
    seconds: f64,
    #[command(flatten)]
    force: ForceArgs,
}

#[derive(Debug, clap::Args)]
pub struct BeatsArgs {
    /// A music file (.wav .flac .ogg .mp3 .m4a)
    file: PathBuf,
    /// Where the beats go (.txt) [default: stdout]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[command(flatten)]
    tempo: TempoArgs,
    #[command(flatten)]
    force: ForceArgs,
}

/// How a pulse is counted.
#[derive(Debug, Clone, Copy, clap::Args)]
struct TempoArgs {
    /// Look for a tempo in this range of beats per minute, where it is found at half or double: 120:200
    #[arg(long, value_name = "LOW:HIGH", value_parser = bpm_range)]
    bpm_range: Option<beat::TempoRange>,
}

#[derive(Debug, clap::Args)]
pub struct RenderArgs {
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

/// A tempo that can be danced to.
fn bpm(text: &str) -> std::result::Result<f64, String> {
    let found = text.parse().ok().filter(|bpm| (20.0..=400.0).contains(bpm));
    found.ok_or_else(|| format!("found `{text}`, expected 20 to 400 beats a minute"))
}

/// Tempi from a slow one to a fast one.
fn bpm_range(text: &str) -> std::result::Result<beat::TempoRange, String> {
    let wrong = || format!("found `{text}`, expected LOW:HIGH, 20 to 400 beats a minute, such as 120:200");
    let (low, high) = text.split_once(':').ok_or_else(wrong)?;
    let (least, most) = (bpm(low).map_err(|_| wrong())?, bpm(high).map_err(|_| wrong())?);
    (least <= most).then_some(beat::TempoRange { least, most }).ok_or_else(wrong)
}

/// Seconds of a piece.
fn length(text: &str) -> std::result::Result<f64, String> {
    let found = super::read::seconds(text).ok().filter(|seconds| (1.0..=LONGEST_S).contains(seconds));
    found.ok_or_else(|| format!("found `{text}`, expected 1 to {LONGEST_S} seconds"))
}

/// When the first beat of a piece is, seconds.
const FIRST_S: f64 = 0.3;
/// Frames per second of what is drawn.
const PICTURE_FPS: f64 = 60.0;

pub fn run(command: Command, say: Say) -> Result<()> {
    match command {
        Command::Inspect(args) => match &args.out {
            Some(out) => draw(&args, out, say),
            None => inspect(&args, say),
        },
        Command::Beats(args) => beats_of(&args, say),
        Command::Render(args) => play(&args, say),
    }
}

fn inspect(args: &InspectArgs, say: Say) -> Result<()> {
    each_file(&args.files, say, |_, file| {
        let found = report::report(file, args.tempo.bpm_range).map_err(Error::from);
        match found {
            Ok(found) => print(&if args.json { found.json() + "\n" } else { found.text() }),
            Err(e) => {
                if args.json {
                    let line = serde_json::json!({"schema": 1, "file": file, "error": chain(&e)});
                    print(&format!("{line}\n"))?;
                }
                Err(e)
            }
        }
    })?;
    Ok(())
}

fn draw(args: &InspectArgs, out: &Path, say: Say) -> Result<()> {
    let [file] = &args.files[..] else {
        let what = format!("--out draws one file, and {} are given", args.files.len());
        return Err(super::WrongCall(what).into());
    };
    let outputs = args.force.outputs(args.files.clone());
    super::picture(out, &outputs)?;
    let features = feature::features(file, PICTURE_FPS).map_err(crate::Error::from)?;
    let charts = picture::charts(&features, args.at..args.at + args.seconds)
        .map_err(|e| Error::new(e).context(file.display().to_string()))?;
    super::draw_charts(out, &charts, &outputs)?;
    say.line(format_args!("{}: {}, {} beats", out.display(), file.display(), features.beats.times_s.len()));
    Ok(())
}

fn play(args: &RenderArgs, say: Say) -> Result<()> {
    if super::extension(&args.out) != "wav" {
        return Err(super::WrongCall(format!("{}: expected a name ending in .wav", args.out.display())).into());
    }
    let outputs = args.force.outputs(Vec::<PathBuf>::new());
    outputs.check([&*args.out])?;
    // the first beat stands where a tracker, and a dancer, can hear it coming
    let beats_s = (0..).map(|i| FIRST_S + 60.0 / args.bpm * f64::from(i)).take_while(|beat| *beat < args.seconds);
    let score =
        Score { style: args.style, beats_s: beats_s.collect(), downbeat: 0, seconds: args.seconds, seed: args.seed };
    let sound = render(&score, beat::RATE).map_err(crate::Error::from)?;
    outputs.write(&args.out, &wav::bytes(&sound, beat::RATE))?;
    let (style, beats) = (args.style.name(), kinelm_store::counted(score.beats_s.len(), "beats"));
    say.line(format_args!("{}: {style}, {beats}, {} a minute", args.out.display(), args.bpm));
    Ok(())
}

fn beats_of(args: &BeatsArgs, say: Say) -> Result<()> {
    let outputs = args.force.outputs([args.file.clone()]);
    if let Some(out) = &args.out {
        if super::extension(out) != "txt" {
            let what = format!("{}: expected a name ending in .txt for beats", out.display());
            return Err(super::WrongCall(what).into());
        }
        outputs.check([&**out])?;
    }
    let found = beat::beats_within(&args.file, args.tempo.bpm_range).map_err(crate::Error::from)?;
    let text = beats::text(&found.times_s, &args.file);
    let Some(out) = &args.out else { return print(&text) };
    outputs.write(out, text.as_bytes())?;
    let pace = found.bpm().map(|bpm| format!(", {bpm:.1} a minute")).unwrap_or_default();
    say.line(format_args!("{}: {}{pace}", out.display(), kinelm_store::counted(found.times_s.len(), "beats")));
    Ok(())
}
