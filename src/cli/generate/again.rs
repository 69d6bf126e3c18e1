//! `kinelm generate again`.

use super::make;
use crate::cli::{ForceArgs, Say, convert, extension, writable, wrong_call};
use crate::generate::provenance::{Moved, Provenance};
use anyhow::Result;
use kinelm_store::output::is_same;
use kinelm_store::sidecar;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The sidecar of the dance
    #[arg(value_name = "FILE.bvh.kinelm.json")]
    sidecar: PathBuf,
    /// Where the dance goes, in the format that it had [default: beside the sidecar, under its name]
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Where the run is now, if it was moved
    #[arg(long, value_name = "RUN")]
    run: Option<PathBuf>,
    /// Where the prompt is now, if it was moved
    #[arg(long, value_name = "CLIP")]
    prompt: Option<PathBuf>,
    /// A timeline that names the same clips where they are now, if they were moved
    #[arg(long, value_name = "TIMELINE.toml", conflicts_with = "prompt")]
    timeline: Option<PathBuf>,
    /// Where the music is now, if it was moved
    #[arg(long, value_name = "FILE")]
    music: Option<PathBuf>,
    /// Tokens that are guessed from the previous word and verified in one pass, which changes no token
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(..=64), hide_short_help = true)]
    guesses: Option<u8>,
    #[command(flatten)]
    force: ForceArgs,
}

pub fn run(args: &Args, say: Say) -> Result<()> {
    let file = &args.sidecar;
    let first = Provenance::load(file)?;
    let out = out(args.out.as_ref(), file, &first.output.file)?;
    let (run, prompt) = (args.run.clone(), args.prompt.clone());
    let (timeline, music) = (args.timeline.clone(), args.music.clone());
    let request = first.request_at(&Moved { run, prompt, timeline, music })?;
    let inputs = (&*request.run, request.prompt.as_ref(), request.music.as_ref());
    let outputs = make::outputs(args.force, inputs, [file.clone()].into_iter().chain(args.timeline.clone()));
    outputs.check([&*out])?;
    outputs.check_replaceable(&out, Some(&first.output.sha256))?;
    check_finished(&out, args.force)?;
    let open = first.open(request)?;
    make::report(&open, say)?;
    let guesses = args.guesses.map(usize::from);
    let (generated, bytes) = make::with_bar(&open, say, |progress| first.regenerate(&open, &out, guesses, progress))?;
    if is_same(&sidecar::path_of(&out), file) {
        outputs.write(&out, &bytes)?; // its sidecar is there already
    } else {
        first.copied_to(&out, &open, generated.motion.clip.fps()).write(&out, &bytes, &outputs)?;
    }
    convert::report_written(&out, &generated.motion, say);
    Ok(())
}

/// Refuses an output that its sidecar was to replace, unless it is to be written over.
pub fn check_finished(out: &Path, force: ForceArgs) -> Result<()> {
    Ok(if force.force { () } else { sidecar::check_finished(out)? })
}

/// Where a dance is written again: to `requested`, or beside its sidecar `file` under its own `name`.
pub fn out(requested: Option<&PathBuf>, file: &Path, name: &str) -> Result<PathBuf> {
    let out = requested.cloned().unwrap_or_else(|| file.with_file_name(name));
    writable(&out)?;
    if extension(&out) != extension(Path::new(name)) {
        wrong_call!("{}: the dance was {name}; other formats hold other bytes", out.display());
    }
    Ok(out)
}
