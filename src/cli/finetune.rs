//! `kinelm finetune`.

use super::pretrain::{self, Resume};
use super::{ComputeArgs, Say, TrustArgs};
use crate::train::{CorpusPart, Precision, PretrainOptions, TrainFile, finetune};
use anyhow::Result;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct Args {
    #[command(subcommand)]
    resume: Option<Resume>,
    /// What to start from: a run (its best checkpoint), ready (kinelm's own model), or a folder that `kinelm export` or transformers wrote
    #[arg(long, value_name = "RUN|DIR", required = true, value_parser = super::values::run_folder())]
    from: Option<PathBuf>,
    /// Training settings: finetune, goal, or a TOML file. The model's shape is that of --from, so [model] is left out or
    /// agrees with it (dropout may differ)
    #[arg(long, value_name = "NAME|FILE", required = true)]
    config: Option<PathBuf>,
    /// A corpus of the same tokenizer; may be repeated. The windows of each corpus come WEIGHT times an epoch
    /// [default weight: 1]
    #[arg(long, value_name = "CORPUS[=WEIGHT]")]
    corpus: Vec<CorpusPart>,
    /// The run folder to create
    #[arg(long, value_name = "RUN")]
    run: Option<PathBuf>,
    /// Total steps
    #[arg(long, value_name = "N")]
    steps: Option<u64>,
    /// Seed of new rows of weights, the order of windows, dropout and augmentation
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Label fields that the model is conditioned on besides those of --from, such as genre,dancer; overrides the file
    #[arg(long, value_name = "FIELDS", value_delimiter = ',')]
    conditions: Option<Vec<String>>,
    /// Number format of matrix products: f32, bf16, or auto, the quicker one here; overrides the file
    #[arg(long, value_name = "f32|bf16|auto")]
    precision: Option<Precision>,
    /// Any other key, as in the file: train.batch=4, model.dropout=0, augment.mirror=0.5; may be repeated. The other options
    /// win over it
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    #[command(flatten)]
    compute: ComputeArgs,
    #[command(flatten)]
    trust: TrustArgs,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    if let Some(Resume::Resume(args)) = args.resume {
        return pretrain::resume(args, "finetune", say);
    }
    let options = PretrainOptions {
        from: args.from,
        file: args.config.as_deref().map(TrainFile::find).transpose()?,
        set: args.set,
        corpora: args.corpus,
        run: args.run,
        steps: args.steps,
        seed: args.seed,
        conditions: args.conditions,
        precision: args.precision,
        compute: args.compute.get(),
        opening: args.trust.opening(),
        resume: false,
    };
    let summary = super::training::with_lines(say, |stop, progress| finetune(&options, stop, progress))?;
    pretrain::report(&summary, "finetune", say)
}
