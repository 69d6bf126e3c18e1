//! A request carried out: the dances made and written.

use super::{best, dance::DanceArgs};
use crate::cli::{Say, convert, progress, warn};
use crate::generate::make::{BestOf, Making, Watch};
use crate::generate::open::OpenRequest;
use crate::generate::request::Request;
use crate::generate::timeline::TimelineLayout;
use anyhow::Result;
use kinelm_store::sidecar;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};

/// Makes the dances of a request and writes them to `outs`; `read`: a file that is in the request, which names it nowhere;
/// `layout`: of its timeline.
pub fn make(
    args: &DanceArgs,
    request: Request,
    outs: &[PathBuf],
    read: Option<&Path>,
    layout: Option<TimelineLayout>,
    say: Say,
) -> Result<()> {
    let outputs = args.force.outputs(request.files().chain(read.map(Path::to_owned)));
    // all names, before the first frame
    outputs.check(outs.iter().map(PathBuf::as_path))?;
    for out in outs {
        outputs.check_replaceable(out, None)?;
        outputs.check_replaceable(&sidecar::path_of(out), None)?;
    }
    if args.is_ready() {
        let card = request.run.join("CARD.md");
        say.line(format_args!("no --run: the ready model dances; what it is: {}", card.display()));
    }
    let open = OpenRequest::open_with(&request, layout)?;
    report(&open, say)?;
    open.surprise_note()?.iter().for_each(|note| say.line(note));
    let real = args.best.real(&open, say)?;
    let best = real.as_ref().zip(args.best.best);
    let best = best.map(|(judge, samples)| BestOf { samples: samples.into(), judge });
    let making = Making { outs, best, guesses: args.guesses.map(usize::from) };
    let dances = with_bar(say, |watch| open.make(&making, watch))?;
    if dances.guessed > 0 {
        say.line(format_args!("{} of {} guessed tokens were right", dances.right, dances.guessed));
    }
    if real.is_some() {
        best::report(&open, &dances.chosen, say);
    }
    for chosen in dances.chosen {
        let dance = chosen.decode(&open)?;
        dance.write(&outputs)?;
        convert::report_written(&dance.chosen.out, &dance.generated.motion, say);
        if let Some(from) = open.lead_in(dance.chosen.number).map(|lead_in| &lead_in.from) {
            let from_s = from.frame as f64 / open.tokenizer.fps();
            say.line(format_args!("continues from a second of {} (a lead-in of the run) at {from_s:.2} s", from.clip));
        }
        let notes = dance.generated.notes(&open).into_iter();
        notes.chain(open.read_back_note(&dance.chosen.words, &dance.chosen.out)?).for_each(|note| say.line(note));
    }
    Ok(())
}

/// Prints what was odd in the prompt's file, and the notes on the request.
pub fn report(open: &OpenRequest, say: Say) -> Result<()> {
    open.prompt.iter().for_each(|prompt| warn(&prompt.clip.motion, say));
    open.notes()?.iter().for_each(|note| say.line(note));
    Ok(())
}

/// Makes dances under a progress bar.
pub fn with_bar<T>(say: Say, making: impl FnOnce(&mut Watch<'_>) -> T) -> T {
    let mut bar = None;
    making(&mut |progress| {
        bar.get_or_insert_with(|| progress::bar(progress.of as u64, "frames", say))
            .set_position(progress.frames as u64);
        // the best are chosen after it
        bar = bar.take().filter(|_| progress.frames < progress.of);
        ControlFlow::Continue(())
    })
}
