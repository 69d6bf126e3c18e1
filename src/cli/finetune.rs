//! `kinelm finetune`.

use super::pretrain::{self, Resume, TrainArgs};
use super::{CheckpointArg, Say};
use crate::train::finetune;
use anyhow::Result;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct Args {
    #[command(subcommand)]
    resume: Option<Resume>,
    /// What to start from: a run, ready (kinelm's own model), or a folder that `kinelm export` or
    /// transformers wrote. The model's shape is its own, so [model] is left out or agrees with it (dropout may differ), and
    /// corpora have its tokenizer
    #[arg(long, value_name = "RUN|DIR", required = true, value_parser = super::values::run_folder())]
    from: Option<PathBuf>,
    #[command(flatten)]
    checkpoint: CheckpointArg,
    #[command(flatten)]
    train: TrainArgs,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    if let Some(Resume::Resume(args)) = args.resume {
        return pretrain::resume(args, "finetune", say);
    }
    let options = args.train.options(args.from, args.checkpoint)?;
    let summary = super::training::with_lines(say, |stop, progress| finetune(&options, stop, progress))?;
    pretrain::report(&summary, "finetune", say)
}
