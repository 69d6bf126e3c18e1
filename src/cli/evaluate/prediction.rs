//! `kinelm evaluate prediction`.

use crate::cli::data::DataArgs;
use crate::cli::draw::DrawArgs;
use crate::cli::read::ReadArgs;
use crate::cli::values::rate;
use crate::cli::{CheckpointArg, ComputeArgs, Odd, Say, print, wrong_call};
use crate::corpus::load::{ClipSpec, load_at_own_rate};
use crate::corpus::{Dataset, Split};
use crate::evaluate::prediction::{PROTOCOL_FPS, Predictor, Window, baselines, spread, table, windows_at};
use crate::generate::sampling::Sampling;
use crate::generate::{NextToken, reader};
use crate::model::{ReaderOptions, load_run};
use anyhow::Result;
use kinelm_motion::format::RestFrame;
use kinelm_motion::metric::short_term::MAJOR;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The run folder of a trained model [default: only zero and constant velocity are measured, on the protocol's 15
    /// joints]
    #[arg(long, value_name = "RUN", value_parser = crate::cli::values::run_folder())]
    run: Option<PathBuf>,
    #[command(flatten)]
    checkpoint: CheckpointArg,
    /// Frames per second without a model; slower clips are left out
    #[arg(long, value_name = "FPS", value_parser = rate, default_value_t = PROTOCOL_FPS, conflicts_with = "run")]
    fps: f64,
    #[command(flatten)]
    data: DataArgs,
    /// The split to measure
    #[arg(long, default_value = "test", value_name = "train|valid|test")]
    split: Split,
    /// Windows at most, spread evenly; 0: all
    #[arg(long, default_value_t = 0, value_name = "N")]
    windows: usize,
    /// Samples per window, up to 64; the best of them is a row of its own. 0: the greedy continuation alone
    #[arg(long, default_value_t = 10, value_name = "K", value_parser = clap::value_parser!(u8).range(..=64))]
    samples: u8,
    /// Random seed
    #[arg(long, default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    draw: DrawArgs,
    #[command(flatten)]
    compute: ComputeArgs,
    /// Print one JSON object instead of a table
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    read: ReadArgs,
}

pub fn run(args: &Args, say: Say) -> Result<()> {
    let draw = args.draw.get()?;
    if draw.greedy && args.samples > 0 {
        wrong_call!(
            "--greedy with samples: the greedy continuation is always a row; add --samples 0, or leave --greedy out"
        );
    }
    match &args.run {
        Some(run) => of_model(args, run, draw, say),
        None => without_model(args, say),
    }
}

/// Measures what needs no model: zero and constant velocity.
fn without_model(args: &Args, say: Say) -> Result<()> {
    let (_, windows) = measured(args, &args.data.find(say)?, None, say)?;
    let what = format!("no {} clip is as long as a window, 3 s, at {} fps or more; give --fps", args.split, args.fps);
    anyhow::ensure!(!windows.is_empty(), what);
    let rows = baselines(&windows, &MAJOR, "")?;
    if args.json {
        return print(&format!(
            "{}\n",
            serde_json::json!({"schema": 1, "split": args.split.to_string(), "rows": rows})
        ));
    }
    print(&table(&rows, args.fps))
}

/// Measures a model beside these.
fn of_model(args: &Args, run: &Path, draw: Sampling, say: Say) -> Result<()> {
    let run = load_run(run, args.checkpoint.get())?;
    run.notes.iter().for_each(|note| say.line(note));
    let tokenizer = run.load_tokenizer()?;
    let conditions = run.load_conditions()?;
    let dataset = args.data.find(say)?;
    let (own, protocol) = measured(args, &dataset, Some(tokenizer.config().into()), say)?;
    anyhow::ensure!(!own.is_empty(), "no {} clip is as long as a window, 3 s", args.split);
    let compute = args.compute.get();
    let of = |streams: usize| reader(&run, compute, ReaderOptions { streams, ..ReaderOptions::default() });
    let mut greedy = of(1)?;
    let mut samples = (args.samples > 0).then(|| of(args.samples.into())).transpose()?;
    let mut predictor = Predictor {
        greedy: &mut *greedy,
        samples: samples.as_mut().map(|samples| &mut **samples as &mut dyn NextToken),
        tokenizer: &tokenizer,
        conditions: &conditions,
        draw,
        seed: args.seed,
    };
    let seen = predictor.context_seconds();
    let bar = crate::cli::progress::bar(own.len() as u64, "windows", say);
    let rows = predictor.rows(&own, &mut |n| bar.set_position(n as u64));
    // the bar goes before an error of the rows is printed
    drop(bar);
    let joints = tokenizer.channels().joints();
    let mut all = baselines(&own, joints, "")?;
    all.extend(rows?);
    if !protocol.is_empty() {
        all.extend(baselines(&protocol, &MAJOR, ", 60 fps, 15 joints")?);
    }
    if args.json {
        let line = serde_json::json!({
            "schema": 1, "checkpoint": run.checkpoint.display().to_string(), "split": args.split.to_string(),
            "seen_s": seen, "seed": args.seed, "draw": draw, "rows": all,
        });
        return print(&format!("{line}\n"));
    }
    say.line(format_args!(
        "{}: the model sees the last {seen:.2} s of each seed of 2 s; windows of {} clips",
        run.checkpoint.display(),
        args.split
    ));
    print(&table(&all, tokenizer.fps()))
}

/// The windows of the split's clips at the model's rate, if there is one, and at [`Args::fps`] of the clips that have it.
fn measured(args: &Args, dataset: &Dataset, model: Option<ClipSpec>, say: Say) -> Result<(Vec<Window>, Vec<Window>)> {
    let options = args.read.options(RestFrame::Drop);
    // without a model nothing is coded, and heights stay as they are
    let above_floor = model.is_some_and(|model| model.above_floor);
    let (mut own, mut protocol, odd) = (Vec::new(), Vec::new(), Odd::new(say));
    for item in dataset.items.iter().filter(|item| item.split == args.split) {
        let (clip, rate) = match load_at_own_rate(item, &options, above_floor) {
            Err(e) if !args.data.strict => {
                say.left_out(e);
                continue;
            }
            other => other?,
        };
        odd.rate(&item.file_name(), rate);
        let [at_model, at_fps] = windows_at(&clip, model.map(|model| model.fps), args.fps)?;
        own.extend(at_model);
        protocol.extend(at_fps);
    }
    Ok((spread(own, args.windows), spread(protocol, args.windows)))
}
