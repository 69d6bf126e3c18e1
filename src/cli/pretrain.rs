//! `kinelm pretrain`.

use super::{BranchArgs, CheckpointArg, ComputeArgs, Say, TrustArgs};
use crate::store::{self, presets};
use crate::train::train_file::TRAIN;
use crate::train::{CorpusPart, Precision, PretrainOptions, RESUMABLE, Summary, TrainFile};
use anyhow::Result;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
#[command(args_conflicts_with_subcommands = true, subcommand_negates_reqs = true)]
pub struct Args {
    #[command(subcommand)]
    resume: Option<Resume>,
    /// Start from the weights of this run or exported folder, with a new optimizer
    #[arg(long, value_name = "RUN|DIR")]
    from: Option<PathBuf>,
    #[command(flatten)]
    checkpoint: CheckpointArg,
    #[command(flatten)]
    train: TrainArgs,
}

/// A new run: what it learns from, and its settings.
#[derive(Debug, clap::Args)]
pub struct TrainArgs {
    #[arg(long, value_name = "NAME|FILE", required = true, help = config_help())]
    config: Option<PathBuf>,
    /// A corpus folder; may be repeated. The windows of each corpus come WEIGHT times an epoch [default weight: 1]
    #[arg(long, value_name = "CORPUS[=WEIGHT]")]
    corpus: Vec<CorpusPart>,
    /// The run folder to create
    #[arg(long, value_name = "RUN")]
    run: Option<PathBuf>,
    /// Total steps. The learning-rate schedule ends there, so resuming later with more steps isn't the same as having
    /// given them at the start
    #[arg(long, value_name = "N")]
    steps: Option<u64>,
    /// Seed of new weights, the order of windows, dropout and augmentation
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Label fields that the model is conditioned on (fine-tuned: besides its own), such as genre,dancer; overrides the
    /// file
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

impl TrainArgs {
    /// As the library has them, for a run that starts `from` other weights or from none.
    pub fn options(self, from: Option<PathBuf>, checkpoint: CheckpointArg) -> Result<PretrainOptions> {
        Ok(PretrainOptions {
            file: self.config.as_deref().map(TrainFile::find).transpose()?,
            set: self.set,
            corpora: self.corpus,
            run: self.run,
            steps: self.steps,
            seed: self.seed,
            conditions: self.conditions,
            from,
            checkpoint: checkpoint.get(),
            resume: false,
            branch: None,
            precision: self.precision,
            compute: self.compute.get(),
            opening: self.trust.opening(),
        })
    }
}

#[derive(Debug, clap::Subcommand)]
pub enum Resume {
    /// Resume a run from its last whole checkpoint, or go on from an earlier one as a new run
    Resume(ResumeArgs),
}

#[derive(Debug, clap::Args)]
pub struct ResumeArgs {
    /// The run folder
    run: PathBuf,
    #[command(flatten)]
    branch: BranchArgs,
    /// Where the run's corpora are now, if they were moved, with the weights they had
    #[arg(long, value_name = "CORPUS[=WEIGHT]")]
    corpus: Vec<CorpusPart>,
    /// Total steps, instead of the run's
    #[arg(long, value_name = "N")]
    steps: Option<u64>,
    /// Number format of matrix products, instead of the run's
    #[arg(long, value_name = "f32|bf16|auto")]
    precision: Option<Precision>,
    #[arg(long = "set", value_name = "KEY=VALUE", help = resumable_help())]
    set: Vec<String>,
    #[command(flatten)]
    compute: ComputeArgs,
    #[command(flatten)]
    trust: TrustArgs,
}

/// The help of `--config`.
pub fn config_help() -> String {
    let names = presets::listed(TRAIN);
    format!("Training settings: {names}, or a TOML file, whose paths are relative to it")
}

fn resumable_help() -> String {
    format!("A key of the run's settings that changes from here on: {}; may be repeated", RESUMABLE.join(", "))
}

pub fn run(args: Args, say: Say) -> Result<()> {
    if let Some(Resume::Resume(args)) = args.resume {
        return resume(args, "pretrain", say);
    }
    let options = args.train.options(args.from, args.checkpoint)?;
    report(&super::training::watched(&options, say)?, "pretrain", say)
}

/// Resumes a run that `command` started.
pub fn resume(args: ResumeArgs, command: &str, say: Say) -> Result<()> {
    let options = PretrainOptions {
        set: args.set,
        corpora: args.corpus,
        run: Some(args.run),
        steps: args.steps,
        resume: true,
        branch: args.branch.get(),
        precision: args.precision,
        compute: args.compute.get(),
        opening: args.trust.opening(),
        ..PretrainOptions::default()
    };
    report(&super::training::watched(&options, say)?, command, say)
}

/// Reports how a run of `command` ended.
///
/// # Errors
/// The user stopped it.
pub fn report(summary: &Summary, command: &str, say: Say) -> Result<()> {
    let (run, checkpoint) = (summary.run.display(), summary.checkpoint.display());
    let (step, tokens, seconds) = (summary.step, summary.tokens, summary.seconds);
    say.line(format_args!("{checkpoint}: {step} steps and {tokens} tokens in all, {seconds:.0} s now"));
    if let Some(valid) = &summary.valid {
        let (bits, n, of) = (valid.bits_per_frame, valid.windows, valid.all_windows);
        let pseudo = if valid.pseudo { "pseudo " } else { "" };
        say.line(format_args!("validation: {bits:.2} {pseudo}bits/frame over {n} of {of} windows"));
    }
    if summary.early {
        let best = summary.best.map_or(0, |b| b.step);
        say.line(format_args!("ended early, after step {step}: no measurement since step {best} was better"));
    }
    if summary.stopped {
        let what = format!("stopped after step {step}; to go on: kinelm {command} resume {run}");
        return Err(store::Error::stopped(what).into());
    }
    Ok(())
}
