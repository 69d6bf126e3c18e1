//! `kinelm generate again`.

use super::{make, say as said};
use crate::cli::{ForceArgs, Say, convert, extension, writable, wrong_call};
use crate::generate::open::OpenRequest;
use crate::generate::provenance::Provenance;
use crate::generate::request::{Resolved, Timeline};
use crate::generate::variation_seed;
use crate::model::CheckpointChoice;
use anyhow::Result;
use kinelm_motion::format::ReadOptions;
use kinelm_store::output::is_same;
use kinelm_store::{FileRecord, sidecar};
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
    let mut recipe = first.recipe.clone();
    recipe.seed = variation_seed(recipe.seed, first.variation.saturating_sub(1));
    if let Some(run) = &args.run {
        recipe.run.clone_from(run);
    }
    relocate(args, &mut recipe)?;
    let inputs = (&*recipe.run, recipe.prompt.as_ref(), recipe.music.as_ref());
    let outputs = make::outputs(args.force, inputs, [file.clone()].into_iter().chain(args.timeline.clone()));
    outputs.check([&*out])?;
    outputs.check_replaceable(&out, Some(&first.output.sha256))?;
    let open = OpenRequest::load(recipe, CheckpointChoice::Step(first.step))?;
    said::opened(&open, say)?;
    first.check(&open)?;
    let words = make::sample(&open, 1, args.guesses, say)?.remove(0);
    let generated = open.motion(&words, &out)?;
    let bytes = generated.bytes(&out)?;
    check_same(&first, &bytes)?;
    if is_same(&sidecar::path_of(&out), file) {
        outputs.write(&out, &bytes)?; // its sidecar is there already
    } else {
        let read = ReadOptions { fps_source: Some(generated.motion.clip.fps()), ..open.read_back(&out) };
        let recipe = Resolved { seed: first.recipe.seed, ..open.recipe };
        let output = sidecar::FileHash { file: sidecar::name_of(&out), ..first.output };
        let provenance = Provenance { output, read, recipe, kinelm: env!("CARGO_PKG_VERSION").into(), ..first };
        provenance.write(&out, &bytes, &outputs)?;
    }
    convert::told(&out, &generated.motion, say);
    Ok(())
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

/// Replaces the paths of inputs that were moved.
fn relocate(args: &Args, recipe: &mut Resolved) -> Result<()> {
    match (&args.prompt, &args.timeline, recipe.prompt.as_mut()) {
        (None, None, _) => {}
        (Some(path), None, Some(prompt)) if prompt.plan.is_none() => prompt.path.clone_from(path),
        (None, Some(path), Some(prompt)) if prompt.plan.is_some() => {
            let (timeline, layout) = Timeline::load(path)?;
            if let Some(other) = layout.labels.iter().find(|label| !recipe.timed_labels.contains(label)) {
                wrong_call!("--timeline {}: the dance was generated without the label {other}", path.display());
            }
            prompt.path = layout.path().to_owned();
            prompt.plan = Some(timeline);
        }
        (Some(_), _, Some(_)) => wrong_call!(
            "--prompt: the dance has a timeline and no prompt; name a timeline of the same clips with --timeline"
        ),
        (Some(_), _, None) => wrong_call!("--prompt: the dance has no prompt; leave it out"),
        (None, Some(_), _) => wrong_call!("--timeline: the dance has no timeline; leave it out"),
    }
    match (&args.music, &mut recipe.music) {
        (Some(path), Some(music)) => music.path.clone_from(path),
        (Some(_), None) => wrong_call!("--music: the dance has no music; leave it out"),
        (None, _) => {}
    }
    Ok(())
}

/// Refuses a dance that differs from the first.
fn check_same(first: &Provenance, bytes: &[u8]) -> Result<()> {
    let found = FileRecord::of(bytes).sha256;
    let (then, now) = (&first.recipe.computing, kinelm_engine::dispatch::name());
    anyhow::ensure!(
        found == first.output.sha256,
        "the dance came out different: SHA-256 {found}, then {}; it was made by kinelm {} with the kernels {}, this is {} \
         with {now}. Nothing was written",
        first.output.sha256,
        first.kinelm,
        then.kernels,
        env!("CARGO_PKG_VERSION"),
    );
    Ok(())
}
