//! `kinelm music`.

mod beats;
mod inspect;
mod render;

use super::Say;
use anyhow::Result;
use kinelm_music::beat;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Report length, loudness, beats and tempo of music files, or plot one
    Inspect(inspect::Args),
    /// Find the beats of a music file: a time in seconds per line
    Beats(beats::Args),
    /// Render a piece at a given tempo, played by a small synthetic band
    Render(render::Args),
}

/// How a pulse is counted.
#[derive(Debug, Clone, Copy, clap::Args)]
struct TempoArgs {
    /// Look for a tempo in this range of beats per minute, where it is found at half or double: 120:200
    #[arg(long, value_name = "LOW:HIGH", value_parser = bpm_range)]
    bpm_range: Option<beat::TempoRange>,
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

pub fn run(command: Command, say: Say) -> Result<()> {
    match command {
        Command::Inspect(args) => inspect::run(&args, say),
        Command::Beats(args) => beats::run(&args, say),
        Command::Render(args) => render::run(&args, say),
    }
}
