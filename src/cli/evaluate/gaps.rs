//! `kinelm evaluate gaps`.

use crate::cli::draw::DrawArgs;
use crate::cli::{CheckpointArg, ComputeArgs, ReadingArgs, Say, TrustArgs, WrongCall, print, progress};
use crate::corpus::Split;
use crate::evaluate::gaps::{Filler, frames_around, gaps, position_scale};
use crate::generate::RunModel;
use crate::generate::masked::PASSES;
use crate::generate::open::{GAP_TOP_P, GOAL_GUIDANCE, check_goal_guidance, check_passes};
use crate::generate::sampling::default_top_p;
use crate::model::goal::GoalEncoder;
use crate::model::{LoadedRun, ModelKind, load_run};
use anyhow::Result;
use kinelm_tokenizer::Tokenizer;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The run folder of a trained model
    #[arg(long, value_name = "RUN", value_parser = crate::cli::values::run_folder())]
    run: PathBuf,
    #[command(flatten)]
    checkpoint: CheckpointArg,
    /// A corpus folder of the same tokenizer
    #[arg(long, value_name = "CORPUS")]
    corpus: PathBuf,
    /// The split whose clips get gaps
    #[arg(long, default_value = "test", value_name = "train|valid|test")]
    split: Split,
    /// Frames of a gap, 1 to 512
    #[arg(long, default_value_t = 20, value_name = "N", value_parser = clap::value_parser!(u16).range(1..=512))]
    frames: u16,
    /// Gaps at most, spread evenly
    #[arg(long, default_value_t = 200, value_name = "N", value_parser = clap::value_parser!(u16).range(1..))]
    gaps: u16,
    /// Samples of each gap; the best of them and the one that ends nearest are rows of their own
    #[arg(long, default_value_t = 10, value_name = "K", value_parser = clap::value_parser!(u8).range(1..=64))]
    samples: u8,
    /// Guidance towards the frame after the gap, as in generate: 0 none, 1 as trained [default: 1.5 for a goal-conditioned
    /// model (model.goal)]
    #[arg(long, value_name = "G")]
    goal_guidance: Option<f64>,
    /// Passes of a masked model over the gap, as in generate, 1 to 255 [default: 8]
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(1..))]
    passes: Option<u8>,
    /// Lock the feet, as `generate --feet lock` does
    #[arg(long)]
    feet: bool,
    /// Random seed
    #[arg(long, default_value_t = 1)]
    seed: u64,
    #[command(flatten)]
    draw: DrawArgs,
    #[command(flatten)]
    reading: ReadingArgs,
    #[command(flatten)]
    compute: ComputeArgs,
    /// Print one JSON object instead of a table
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    trust: TrustArgs,
}

pub fn run(args: &Args, say: Say) -> Result<()> {
    let run = load_run(&args.run, args.checkpoint.get())?;
    run.notes.iter().for_each(|note| say.line(note));
    let (tokenizer, corpus) = (run.load_tokenizer()?, args.trust.open(&args.corpus)?);
    let (ours, theirs) = (tokenizer.base_hash(), corpus.tokenizer().base_hash());
    if ours != theirs {
        let what = format!(
            "the run's tokenizer is {ours} without labels, the corpus's {theirs}; tokenize the data with the run's"
        );
        return Err(WrongCall(what).into());
    }
    let conditions = run.load_conditions()?;
    let goal = goal(args.goal_guidance, &run, &tokenizer)?;
    let draw = args.draw.requested()?.truncated_at(if goal.is_some() { GAP_TOP_P } else { default_top_p(&run.config) });
    // guidance reads a second, unconditioned stream per sample
    let streams = if goal.as_ref().is_some_and(|(_, scale)| *scale != 1.0) { 2 } else { 1 };
    let passes = args.passes.map(usize::from);
    check_passes(passes, &run)?;
    let passes = passes.or((run.config.kind == ModelKind::Masked).then_some(PASSES));
    let reading = args.reading.get(streams * usize::from(args.samples));
    let mut model = RunModel::open(&run, args.compute.get(), reading, streams)?;
    let (before, after) = frames_around(&run, &tokenizer, args.frames.into())?;
    let gaps = gaps(&corpus, args.split, before, args.frames.into(), after, args.gaps.into())?;
    let scale = position_scale(&corpus, before, args.frames.into(), &gaps)?;
    let bar = progress::bar(gaps.len() as u64, "gaps", say);
    let mut filler = Filler {
        model: &mut model,
        tokenizer: &tokenizer,
        conditions: &conditions,
        draw,
        seed: args.seed,
        lock_feet: args.feet,
        scale: &scale,
        ahead: goal,
        passes,
    };
    let found = filler.measure(&gaps, &mut |done| bar.set_position(done as u64))?;
    drop(bar);
    if args.json {
        return print(&format!("{}\n", serde_json::to_value(&found)?));
    }
    print(&found.table())?;
    let (frames, seconds) = (found.frames, found.frames as f64 / tokenizer.fps());
    say.line(format_args!(
        "{} gaps of {frames} frames ({seconds:.1} s) of {} recordings, {before} frames before each, {} samples",
        found.gaps, found.takes, found.samples
    ));
    Ok(())
}

/// The goal conditioning and its guidance, unless the guidance is 0.
fn goal(requested: Option<f64>, run: &LoadedRun, tokenizer: &Tokenizer) -> Result<Option<(GoalEncoder, f64)>> {
    let scale = requested.unwrap_or(if run.config.goal { GOAL_GUIDANCE } else { 0.0 });
    check_goal_guidance(scale, run)?;
    Ok(if scale == 0.0 { None } else { Some((GoalEncoder::of(tokenizer)?, scale)) })
}
