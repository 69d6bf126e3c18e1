//! A dance of a GPT, made again.

use super::make;
use crate::cli::again::Args;
use crate::cli::{Say, convert};
use crate::generate::provenance::{Moved, Provenance};
use anyhow::Result;

pub fn again(args: &Args, say: Say) -> Result<()> {
    let first = Provenance::load(&args.sidecar)?;
    let out = args.out(&first.output.file)?;
    let (run, prompt) = (args.run.clone(), args.prompt.clone());
    let (timeline, music) = (args.timeline.clone(), args.music.clone());
    let request = first.request_at(&Moved { run, prompt, timeline, music })?;
    let inputs = (&*request.run, request.prompt.as_ref(), request.music.as_ref());
    let outputs = make::outputs(args.force, inputs, [args.sidecar.clone()].into_iter().chain(args.timeline.clone()));
    outputs.check([&*out])?;
    outputs.check_replaceable(&out, Some(&first.output.sha256))?;
    args.check_finished(&out)?;
    let open = first.open(request)?;
    make::report(&open, say)?;
    let guesses = args.guesses.map(usize::from);
    let (generated, bytes) = make::with_bar(&open, say, |progress| first.regenerate(&open, &out, guesses, progress))?;
    match args.has_sidecar(&out) {
        true => outputs.write(&out, &bytes).map(|_| ())?,
        false => first.copied_to(&out, &open, generated.motion.clip.fps()).write(&out, &bytes, &outputs)?,
    }
    convert::report_written(&out, &generated.motion, say);
    Ok(())
}
