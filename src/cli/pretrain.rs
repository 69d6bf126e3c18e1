//! `kinelm pretrain`.

use super::{ComputeArgs, Say, Stopped, TrustArgs};
use crate::store::presets;
use crate::train::config::TRAIN;
use crate::train::{CorpusPart, Precision, PretrainOptions, Summary, TrainFile};
use anyhow::Result;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    #[arg(long, value_name = "NAME|FILE", required_unless_present = "resume", help = config_help())]
    config: Option<PathBuf>,
    /// The corpus folder; given several times, all of them, each of whose windows comes WEIGHT times a pass (1 if not given)
    #[arg(long, value_name = "CORPUS[=WEIGHT]")]
    corpus: Vec<CorpusPart>,
    /// The run folder
    #[arg(long, value_name = "RUN")]
    run: Option<PathBuf>,
    /// Steps in all; the cosine of the rate ends there, so a run that is given more later is not one that had them from
    /// the start
    #[arg(long, value_name = "N")]
    steps: Option<u64>,
    /// The seed of the first weights, the order of windows and dropout
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Label fields that the model is conditioned on, over the file's: genre,dancer
    #[arg(long, value_name = "FIELDS", value_delimiter = ',', conflicts_with = "resume")]
    conditions: Option<Vec<String>>,
    /// Begin with the weights of this run, or of a folder that was exported; the optimizer begins anew
    #[arg(long, value_name = "RUN|DIR", conflicts_with = "resume")]
    from: Option<PathBuf>,
    /// Go on with the run from its last whole checkpoint
    #[arg(long)]
    resume: bool,
    /// In which numbers products are computed: f32, bf16 (on the tiles of AMX, rounded alike elsewhere), or auto; over the
    /// file's. A run that goes on keeps its own
    #[arg(long, value_name = "f32|bf16|auto")]
    precision: Option<Precision>,
    #[command(flatten)]
    compute: ComputeArgs,
    #[command(flatten)]
    trust: TrustArgs,
}

fn config_help() -> String {
    let names = presets::listed(TRAIN);
    format!("The training settings: {names}, or a TOML; paths inside it are relative to it")
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let options = PretrainOptions {
        file: args.config.as_deref().map(TrainFile::find).transpose().map_err(super::asked)?,
        corpora: args.corpus,
        run: args.run,
        steps: args.steps,
        seed: args.seed,
        conditions: args.conditions,
        from: args.from,
        resume: args.resume,
        precision: args.precision,
        compute: args.compute.get(),
        opening: args.trust.opening(),
    };
    told(&super::training::watched(&options, say)?, "pretrain", say)
}

/// Says how a run ended.
pub fn told(summary: &Summary, command: &str, say: Say) -> Result<()> {
    let (run, checkpoint) = (summary.run.display(), summary.checkpoint.display());
    let (steps, tokens, seconds) = (summary.step, summary.tokens, summary.seconds);
    say.line(format_args!("{checkpoint}: {steps} steps and {tokens} tokens in all, {seconds:.0} s now"));
    if let Some(valid) = &summary.valid {
        let (bits, n, of) = (valid.bits_per_frame, valid.windows, valid.all_windows);
        let pseudo = if valid.pseudo { "pseudo " } else { "" };
        say.line(format_args!("validation: {bits:.2} {pseudo}bits/frame over {n} of {of} windows"));
    }
    if summary.early {
        let best = summary.best.map_or(0, |b| b.step);
        say.line(format_args!("ended early, after step {}: no measurement since step {best} was better", summary.step));
    }
    if summary.stopped {
        let step = summary.step;
        return Err(
            Stopped(format!("stopped after step {step}; go on with: kinelm {command} --run {run} --resume")).into()
        );
    }
    Ok(())
}
