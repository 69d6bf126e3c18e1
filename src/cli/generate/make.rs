//! A request carried out: the dances sampled and written.

use super::{best, dance::DanceArgs};
use crate::cli::{ForceArgs, Say, convert, progress, warn};
use crate::generate::SamplingProgress;
use crate::generate::best::Best;
use crate::generate::open::OpenRequest;
use crate::generate::provenance::Provenance;
use crate::generate::request::{MusicRequest, PromptRequest, Request};
use crate::generate::timeline::TimelineLayout;
use anyhow::Result;
use kinelm_store::output::Outputs;
use kinelm_store::sidecar;
use kinelm_tokenizer::Words;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

/// Generates the dances of a request into `outs`; `timeline` is the file and the layout of its timeline.
pub fn make(
    args: &DanceArgs,
    request: Request,
    outs: &[PathBuf],
    timeline: Option<(&Path, TimelineLayout)>,
    say: Say,
) -> Result<()> {
    let (file, layout) = timeline.map(|(file, layout)| (file.to_owned(), layout)).unzip();
    let inputs = (&*request.run, request.prompt.as_ref(), request.music.as_ref());
    let outputs = outputs(args.force, inputs, file);
    // all names, before the first frame
    outputs.check(outs.iter().map(PathBuf::as_path))?;
    for out in outs {
        outputs.check_replaceable(out, None)?;
        outputs.check_replaceable(&sidecar::path_of(out), None)?;
    }
    if args.is_ready() {
        say.line(format_args!(
            "no --run: the ready model dances; what it is: {}",
            request.run.join("CARD.md").display()
        ));
    }
    let open = OpenRequest::open_with(&request, layout)?;
    report(&open, say)?;
    open.surprise_note()?.iter().for_each(|note| say.line(note));
    let reference = args.best.reference(&open, say)?;
    let samples = args.best.best.map_or(outs.len(), usize::from);
    let sampled = sample(&open, samples, args.guesses, say)?;
    let chosen: Vec<(usize, Option<Best>)> = match reference {
        Some(corpus) => {
            let best = best::choose(&corpus, &open, &sampled, outs, say)?;
            best.into_iter().map(|(i, best)| (i, Some(best))).collect()
        }
        None => (0..samples).map(|i| (i, None)).collect(),
    };
    for ((i, best), out) in chosen.into_iter().zip(outs) {
        let generated = open.motion(&sampled[i], out)?;
        let bytes = generated.bytes(out)?;
        let fps = generated.motion.clip.fps();
        Provenance { best, ..Provenance::of(&open, i + 1, (out, fps), &bytes) }.write(out, &bytes, &outputs)?;
        convert::report_written(out, &generated.motion, say);
        if let Some(from) = open.lead_in(i).map(|lead_in| &lead_in.from) {
            let from_s = from.frame as f64 / open.tokenizer.fps();
            say.line(format_args!("continues from a second of {} (a lead-in of the run) at {from_s:.2} s", from.clip));
        }
        generated
            .notes(&open)
            .into_iter()
            .chain(open.read_back_note(&sampled[i], out)?)
            .for_each(|note| say.line(note));
    }
    Ok(())
}

/// Prints what was odd in the prompt's file, and the notes on the request.
pub fn report(open: &OpenRequest, say: Say) -> Result<()> {
    open.prompt.iter().for_each(|prompt| warn(&prompt.clip.motion, say));
    open.notes()?.iter().for_each(|note| say.line(note));
    Ok(())
}

/// The outputs of a call that reads a run, a prompt, music and other files.
pub fn outputs(
    force: ForceArgs,
    (run, prompt, music): (&Path, Option<&PromptRequest>, Option<&MusicRequest>),
    files: impl IntoIterator<Item = PathBuf>,
) -> Outputs {
    let prompt = prompt.into_iter().flat_map(|prompt| {
        let map = prompt.read.map.iter().map(PathBuf::from);
        map.chain(prompt.read.body_model.clone()).chain(prompt.files())
    });
    let music = music.map(|music| music.path.clone());
    force.outputs(prompt.chain(music).chain([run.to_owned()]).chain(files))
}

/// Runs a sampling under a progress bar.
pub fn with_bar<T>(open: &OpenRequest, say: Say, sampling: impl FnOnce(&mut SamplingProgress<'_>) -> T) -> T {
    let (bar, each) = (progress::bar(open.frames as u64, "frames", say), open.tokenizer.frames_per_word());
    sampling(&mut |words, _| {
        bar.set_position((words * each).min(open.frames) as u64);
        ControlFlow::Continue(())
    })
}

/// Samples dances side by side, with a progress bar; returns the words of each.
pub fn sample(open: &OpenRequest, dances: usize, guesses: Option<u8>, say: Say) -> Result<Vec<Words>> {
    let sampled = with_bar(open, say, |progress| open.sample(dances, guesses.map(usize::from), progress))?;
    if sampled.guessed > 0 {
        say.line(format_args!("{} of {} guessed tokens were right", sampled.right, sampled.guessed));
    }
    Ok((0..sampled.ids.len()).map(|dance| open.words(&sampled, dance)).collect())
}
