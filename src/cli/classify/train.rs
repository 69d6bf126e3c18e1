//! `kinelm classify train`.

use crate::classify::{TrainOptions, train};
use crate::cli::{CheckpointArg, Say, TrustArgs};
use crate::corpus::Corpus;
use crate::corpus::labels::LabelFilter;
use crate::model::exchange;
use anyhow::Result;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The run to start from, or a folder that `kinelm export` or transformers wrote
    #[arg(long, value_name = "RUN|DIR", value_parser = crate::cli::values::run_folder())]
    run: PathBuf,
    #[command(flatten)]
    checkpoint: CheckpointArg,
    /// The labelled corpus, of the run's tokenizer
    #[arg(long, value_name = "CORPUS")]
    corpus: PathBuf,
    /// Label fields to classify, such as genre,dancer
    #[arg(long, value_name = "LIST", value_delimiter = ',', required = true, value_parser = clap::builder::NonEmptyStringValueParser::new())]
    fields: Vec<String>,
    /// The folder of the classifier, created when training is done
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
    /// Use only clips with this label; may be repeated
    #[arg(long, value_name = "FIELD=VALUE")]
    only: Vec<LabelFilter>,
    /// Start from random weights of the run's shape, instead of its own
    #[arg(long)]
    scratch: bool,
    /// Train on this fraction of the labelled clips, at least one of each class of the first field
    #[arg(long, value_name = "SHARE", default_value_t = 1.0)]
    share: f64,
    /// Let a class token attend to earlier ones, as the thesis's does
    #[arg(long)]
    compat: bool,
    /// Weight classes by their frequency instead of equally
    #[arg(long)]
    unbalanced: bool,
    /// Updates
    #[arg(long, value_name = "N", default_value_t = 1000, value_parser = clap::value_parser!(u64).range(1..))]
    steps: u64,
    /// Windows of an update
    #[arg(long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u16).range(1..))]
    batch: u16,
    /// Learning rate of the run's weights
    #[arg(long, value_name = "RATE", default_value_t = 2e-5, value_parser = crate::cli::values::positive)]
    rate: f64,
    /// Learning rate of the heads and class tokens, which are new
    #[arg(long, value_name = "RATE", default_value_t = 1e-3, value_parser = crate::cli::values::positive)]
    head_rate: f64,
    /// Updates between validations
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = clap::value_parser!(u64).range(1..))]
    eval_every: u64,
    /// Windows of a validation at most, spread evenly; 0: all
    #[arg(long, value_name = "N", default_value_t = 512)]
    eval_windows: usize,
    /// Stop after this many validations without improvement; 0: never
    #[arg(long, value_name = "N", default_value_t = 5)]
    patience: u64,
    /// Random seed
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
    /// Resume a training that was stopped or killed; all other options as at its start
    #[arg(long)]
    resume: bool,
    #[command(flatten)]
    trust: TrustArgs,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let run = exchange::load(&args.run, args.checkpoint.get())?;
    run.notes.iter().for_each(|note| say.line(note));
    let corpus = Corpus::open_with(&args.corpus, args.trust.opening())?;
    let options = TrainOptions {
        fields: args.fields,
        only: args.only,
        scratch: args.scratch,
        share: args.share,
        compat: args.compat,
        unbalanced: args.unbalanced,
        steps: args.steps,
        batch: args.batch.into(),
        rate: args.rate,
        head_rate: args.head_rate,
        eval_every: args.eval_every,
        eval_windows: args.eval_windows,
        patience: args.patience,
        seed: args.seed,
    };
    let stop = crate::shell::training::stop_on_ctrl_c()?;
    let done = train(&run, &corpus, &options, &args.out, args.resume, &stop, &mut |metrics| {
        let valid = match (metrics.valid_nats, metrics.valid_accuracy) {
            (Some(nats), Some(right)) => format!("; validation {nats:.3}, {:.1} % of windows right", 100.0 * right),
            _ => String::new(),
        };
        let (step, steps) = (metrics.step, options.steps);
        let (tokens, classes) = (metrics.token_nats, metrics.class_nats);
        say.line(format_args!(
            "step {step}/{steps}: motion {tokens:.3} nats a token, classes {classes:.3} nats{valid}"
        ));
    });
    let done = done?;
    for field in &done.fields.0 {
        let many: Vec<String> = field.classes.iter().zip(&field.clips).map(|(c, n)| format!("{c} {n}")).collect();
        say.line(format_args!("{}: training clips of {}", field.name, many.join(", ")));
    }
    if done.stopped {
        let what = format!("stopped after step {}; the same call with --resume goes on", done.step);
        return Err(kinelm_store::Error::stopped(what).into());
    }
    let (clips, windows, best) = (done.clips, done.windows, done.best);
    say.line(format_args!(
        "{}: learned from {windows} windows of {clips} clips, weights of step {best}",
        args.out.display()
    ));
    Ok(())
}
