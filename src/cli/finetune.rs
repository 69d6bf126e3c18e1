//! `kinelm finetune`.

use super::{ComputeArgs, Say, TrustArgs, WrongCall};
use crate::train::finetune::{FinetuneOptions, finetune};
use crate::train::{CorpusPart, Precision, PretrainOptions, pretrain};
use anyhow::Result;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// What to begin with: a run, whose best checkpoint counts, or a folder that `kinelm export` or transformers wrote
    #[arg(long, value_name = "RUN|DIR", required_unless_present = "resume", conflicts_with = "resume")]
    from: Option<PathBuf>,
    /// The training settings: finetune, goal, or a TOML; the model's shape is that of --from, so [model] is left out or says the
    /// same (but dropout)
    #[arg(long, value_name = "NAME|FILE", required_unless_present = "resume", conflicts_with = "resume")]
    config: Option<PathBuf>,
    /// A corpus of the same tokenizer; given several times, all of them, each of whose windows comes WEIGHT times a pass
    #[arg(long, value_name = "CORPUS[=WEIGHT]")]
    corpus: Vec<CorpusPart>,
    /// The new run's folder
    #[arg(long, value_name = "RUN")]
    run: Option<PathBuf>,
    /// Steps in all
    #[arg(long, value_name = "N")]
    steps: Option<u64>,
    /// The seed of new rows, the order of windows, dropout and augmentation
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Label fields that the model is conditioned on beside those of --from, over the file's: genre,dancer
    #[arg(long, value_name = "FIELDS", value_delimiter = ',', conflicts_with = "resume")]
    conditions: Option<Vec<String>>,
    /// Go on with the run from its last whole checkpoint
    #[arg(long, requires = "run")]
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

pub fn run(args: Args, say: Say) -> Result<()> {
    let (compute, precision, opening) = (args.compute.get(), args.precision, args.trust.opening());
    let summary = match (args.from, args.config) {
        _ if args.resume => {
            let (corpora, run, steps, seed) = (args.corpus, args.run, args.steps, args.seed);
            let resume = true;
            let of_run = PretrainOptions { corpora, run, steps, seed, resume, ..Default::default() };
            let options = PretrainOptions { precision, compute, opening, ..of_run };
            crate::shell::training::with_lines(say, |stop, progress| pretrain(&options, stop, progress))?
        }
        (Some(from), Some(config)) => {
            let (corpora, run, steps, seed) = (args.corpus, args.run, args.steps, args.seed);
            let conditions = args.conditions;
            let options =
                FinetuneOptions { from, config, corpora, run, steps, seed, conditions, precision, compute, opening };
            crate::shell::training::with_lines(say, |stop, progress| finetune(&options, stop, progress))?
        }
        _ => return Err(WrongCall("give --from and --config, or --resume".into()).into()),
    };
    super::pretrain::told(&summary, "finetune", say)
}
