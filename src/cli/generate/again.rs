//! `generate --again`: a dance made once more from what is told beside it.

use super::{Args, danced, outputs, say as said};
use crate::cli::{Say, WrongCall, asked, convert, extension, writable};
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

/// Makes a dance again and holds it to the hash of the first.
pub fn again(args: &Args, file: &Path, say: Say) -> Result<()> {
    let first = Provenance::load(file)?;
    let out = out(args.out.as_ref(), file, &first.output.file)?;
    let mut recipe = first.recipe.clone();
    recipe.seed = variation_seed(recipe.seed, first.variation.saturating_sub(1));
    if let Some(run) = &args.run {
        recipe.run.clone_from(run);
    }
    moved(args, &mut recipe)?;
    let outputs = outputs(args, &recipe.run, recipe.prompt.as_ref(), recipe.music.as_ref());
    outputs.check([&*out])?;
    outputs.check_replaceable(&out, Some(&first.output.sha256))?;
    let ready = OpenRequest::load(recipe, CheckpointChoice::Step(first.step)).map_err(asked)?;
    said::opened(&ready, say)?;
    first.check(&ready)?;
    let words = danced(&ready, 1, args.guesses, say)?.remove(0);
    let made = ready.motion(&words, &out)?;
    let bytes = made.bytes(&out)?;
    check_same(&first, &bytes)?;
    if is_same(&sidecar::path_of(&out), file) {
        outputs.write(&out, &bytes)?; // and it tells of the dance already
    } else {
        let read = ReadOptions { fps_source: Some(made.motion.clip.fps()), ..ready.read_back(&out) };
        let recipe = Resolved { seed: first.recipe.seed, ..ready.recipe };
        let output = sidecar::FileHash { file: sidecar::name_of(&out), ..first.output };
        let told = Provenance { output, read, recipe, kinelm: env!("CARGO_PKG_VERSION").into(), ..first };
        told.write(&out, &bytes, &outputs)?;
    }
    convert::told(&out, &made.motion, say);
    Ok(())
}

/// Where a dance goes that is made again: beside `file`, which tells of it, under the name that it has there, or to `asked`.
pub fn out(asked: Option<&PathBuf>, file: &Path, name: &str) -> Result<PathBuf> {
    let out = asked.cloned().unwrap_or_else(|| file.with_file_name(name));
    writable(&out)?;
    if extension(&out) != extension(Path::new(name)) {
        let what = format!("{}: the dance was {name}; other formats hold other bytes", out.display());
        return Err(WrongCall(what).into());
    }
    Ok(out)
}

/// Where the files of a dance are now, if they are elsewhere.
fn moved(args: &Args, recipe: &mut Resolved) -> Result<()> {
    let none =
        |option: &str, what: &str| Err(WrongCall(format!("{option}: the dance has no {what}; leave it out")).into());
    let prompt = recipe.prompt.as_mut();
    match (&args.prompt, &args.plan, prompt) {
        (None, None, _) => {}
        (Some(path), None, Some(prompt)) if prompt.plan.is_none() => prompt.path.clone_from(path),
        (None, Some(path), Some(prompt)) if prompt.plan.is_some() => {
            let (plan, laid) = Timeline::load(path)?;
            if let Some(other) = laid.labels.iter().find(|label| !recipe.timed_labels.contains(label)) {
                let what = format!("--plan {}: it tells {other}, which the dance wasn't told", path.display());
                return Err(WrongCall(what).into());
            }
            prompt.path = laid.path().to_owned();
            prompt.plan = Some(plan);
        }
        (Some(_), _, Some(_)) => {
            return none("--prompt", "prompt but a plan; name a plan of the same clips with --plan");
        }
        (Some(_), _, None) => return none("--prompt", "prompt"),
        (None, Some(_), _) => return none("--plan", "plan"),
    }
    match (&args.music, &mut recipe.music) {
        (Some(path), Some(music)) => music.path.clone_from(path),
        (Some(_), None) => return none("--music", "music"),
        (None, _) => {}
    }
    Ok(())
}

/// Refuses a dance that came out different.
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
