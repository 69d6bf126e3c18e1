//! `kinelm music beats`.

use super::TempoArgs;
use crate::cli::{ForceArgs, Say, print};
use crate::corpus::music::beats;
use anyhow::Result;
use kinelm_music::beat;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// A music file (.wav .flac .ogg .mp3 .m4a .aac)
    file: PathBuf,
    /// Where the beats go (.txt) [default: stdout]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    #[command(flatten)]
    tempo: TempoArgs,
    #[command(flatten)]
    force: ForceArgs,
}

pub fn run(args: &Args, say: Say) -> Result<()> {
    let outputs = args.force.outputs([args.file.clone()]);
    if let Some(out) = &args.out {
        if crate::cli::extension(out) != "txt" {
            let what = format!("{}: expected a name ending in .txt for beats", out.display());
            return Err(crate::cli::WrongCall(what).into());
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
