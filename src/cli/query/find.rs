//! `kinelm query find`.

use crate::classify::embedding::MODELS;
use crate::cli::read::ReadArgs;
use crate::cli::values::{count, time};
use crate::cli::{ForceArgs, Say, print};
use crate::spectral::query::{Distance, Exclude, Index, Query};
use anyhow::Result;
use kinelm_motion::format::{self, ReadOptions, RestFrame};
use kinelm_motion::moment::Moment;
use serde_json::json;
use std::path::PathBuf;
use std::time::Instant;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// A motion file, indexed or not; an indexed one is read as it was for the index, unless reading options are given
    #[arg(value_name = "CLIP")]
    clip: PathBuf,
    /// The index
    #[arg(long, value_name = "INDEX")]
    index: PathBuf,
    /// Matches to print
    #[arg(short, default_value_t = 10, value_parser = count)]
    k: usize,
    /// Also find the N windows that are least similar to the query, of those that aren't excluded or among the matches
    #[arg(long, value_name = "N", value_parser = count)]
    lowest: Option<usize>,
    /// Where the query window starts in the clip: 2.5s, 2.5 or 40f (frames of the file) [default: the clip's middle]
    #[arg(long, value_name = "SECONDS", allow_negative_numbers = true, value_parser = time)]
    at: Option<Moment>,
    /// The distance measure
    #[arg(long, default_value = "cosine", value_enum)]
    distance: Distance,
    /// What to exclude: the window itself, windows that share a frame with it, its clip, its take (the same recording,
    /// a partner's too), its choreography; each excludes what the earlier ones do
    #[arg(long, default_value = "take", value_enum)]
    exclude: Exclude,
    /// Of each clip only one window, its nearest, or for --lowest its least similar
    #[arg(long)]
    one_per_clip: bool,
    /// Also write a page that plays the query and the matches (.html)
    #[arg(long, value_name = "FILE")]
    page: Option<PathBuf>,
    /// Print one JSON object instead of a table
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    force: ForceArgs,
    #[command(flatten)]
    read: ReadArgs,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    args.page.as_deref().map_or(Ok(()), crate::cli::page)?;
    let outputs = args.force.outputs([args.clip.clone(), args.index.clone()].into_iter().chain(args.read.files()));
    outputs.check(args.page.as_deref())?;
    let begun = Instant::now();
    let index = Index::open(&args.index)?;
    let opened = begun.elapsed().as_secs_f64();
    let read = args.read.of_file(&args.clip, RestFrame::Drop, say);
    let as_indexed = read == ReadOptions { rest: RestFrame::Drop, ..ReadOptions::default() };
    let Args { clip, at, k, lowest, distance, exclude, one_per_clip, page, json, .. } = args;
    let at_s = match at {
        // a time in frames needs the rate of the file, which is read for it
        Some(at @ Moment::Frames(_)) => Some(at.seconds(format::read(&clip, &read)?.clip.fps())),
        at => at.map(Moment::number),
    };
    let lowest = lowest.unwrap_or(0);
    let question = Query { lowest, clip, read, as_indexed, at_s, k, distance, exclude, one_per_clip, models: MODELS };
    let answer = index.find(&question)?;
    for line in &answer.notes {
        say.line(line);
    }
    if let Some(path) = page {
        let (page, lost) = answer.page()?;
        outputs.write(&path, page.as_bytes())?;
        for line in lost {
            say.line(format_args!("{line}; left out of the page"));
        }
        say.line(format_args!("{}: {} KB; open it in a browser", path.display(), page.len() / 1000));
    }
    let what = index.options().transform.name();
    if json {
        let line = json!({
            "schema": 1, "query": answer.query, "windows": answer.windows, "measured": answer.measured,
            "transform": what,
            "distance": distance.name(), "exclude": exclude.name(), "matches": answer.matches, "lowest": answer.lowest,
        });
        return print(&format!("{line}\n"));
    }
    let (query, ms) = (&answer.query, 1e3 * answer.seconds);
    say.line(format_args!(
        "{} from {:.2} to {:.2} s among {} windows by {what}, exclude {}; index read in {opened:.1} s, \
         searched in {ms:.1} ms, {} measured",
        query.clip,
        query.start_s,
        query.end_s,
        answer.windows,
        exclude.name(),
        answer.measured
    ));
    print(&answer.table(distance))
}
