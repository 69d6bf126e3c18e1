//! `kinelm classify train`, `eval` and `predict`.

use super::{ForceArgs, Odd, Say, TrustArgs, print, read::ReadArgs};
use crate::classify::{Classifier, LabelFilter, TrainOptions, train};
use crate::corpus::{Corpus, Split};
use crate::model::exchange;
use anyhow::Result;
use kinelm_motion::format::RestFrame;
use std::path::PathBuf;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Train class tokens on a run, together with its language model
    Train(TrainArgs),
    /// Measure accuracy with confidence intervals, and simple classifiers trained on the same clips
    Eval(EvalArgs),
    /// Classify motion files, second by second too
    Predict(PredictArgs),
}

#[derive(Debug, clap::Args)]
pub struct TrainArgs {
    /// The run to start from (its best checkpoint), or a folder that `kinelm export` or transformers wrote
    #[arg(long, value_name = "RUN|DIR")]
    run: PathBuf,
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
    #[arg(long, value_name = "RATE", default_value_t = 2e-5, value_parser = super::read::positive)]
    rate: f64,
    /// Learning rate of the heads and class tokens, which start at zero
    #[arg(long, value_name = "RATE", default_value_t = 1e-3, value_parser = super::read::positive)]
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

#[derive(Debug, clap::Args)]
pub struct EvalArgs {
    /// The folder of `kinelm classify train`
    #[arg(long, value_name = "DIR")]
    classifier: PathBuf,
    /// The corpus; its train clips are those of the training
    #[arg(long, value_name = "CORPUS")]
    corpus: PathBuf,
    /// The split to measure
    #[arg(long, value_name = "train|valid|test", default_value = "test")]
    split: Split,
    /// Also measure simple classifiers: majority class, length and first pose, nearest spectra, LDA
    #[arg(long)]
    baselines: bool,
    /// With --baselines: also LDA on this run's embeddings
    #[arg(long, value_name = "RUN|DIR", requires = "baselines")]
    run: Option<PathBuf>,
    /// Also plot the confusion matrix of the clips
    #[arg(long, value_name = "FILE.png|FILE.svg")]
    plot: Option<PathBuf>,
    #[command(flatten)]
    force: ForceArgs,
    /// Print one JSON object instead of tables
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    trust: TrustArgs,
}

#[derive(Debug, clap::Args)]
pub struct PredictArgs {
    /// The folder of `kinelm classify train`
    #[arg(long, value_name = "DIR")]
    classifier: PathBuf,
    /// Motion files of any rig; one in the classifier's corpus is read as it was for that, unless the call says
    /// otherwise
    #[arg(value_name = "FILE", required = true)]
    files: Vec<PathBuf>,
    /// Print a JSON object per file instead of text
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    read: ReadArgs,
}

pub fn run(command: Command, say: Say) -> Result<()> {
    match command {
        Command::Train(args) => trained(args, say),
        Command::Eval(args) => measured(&args, say),
        Command::Predict(args) => named(&args, say),
    }
}

fn trained(args: TrainArgs, say: Say) -> Result<()> {
    let run = exchange::load(&args.run)?;
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
    let done = train(&run, &corpus, &options, (&args.out, args.resume), &stop, &mut |metrics| {
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

fn measured(args: &EvalArgs, say: Say) -> Result<()> {
    let outputs = args.force.outputs([&args.classifier, &args.corpus].into_iter().chain(&args.run));
    args.plot.as_deref().map_or(Ok(()), |out| super::picture(out, &outputs))?;
    let mut classifier = Classifier::load(&args.classifier)?;
    let corpus = args.trust.open(&args.corpus)?;
    let run = args.run.as_deref().map(exchange::load).transpose()?;
    run.iter().flat_map(|r| &r.notes).for_each(|note| say.line(note));
    super::progress::stage("naming clips");
    let found = classifier.evaluate(&corpus, args.split, run.as_ref(), args.baselines)?;
    if let Some(out) = &args.plot {
        super::draw_charts(out, &found.charts(), &outputs)?;
    }
    match args.json {
        true => print(&(serde_json::to_string(&found)? + "\n")),
        false => print(&found.to_string()),
    }
}

fn named(args: &PredictArgs, say: Say) -> Result<()> {
    let mut classifier = Classifier::load(&args.classifier)?;
    let corpus = std::slice::from_ref(&classifier.manifest.corpus);
    let (options, odd) = (args.read.of_files_known(&args.files, RestFrame::Drop, corpus, say), Odd::new(say));
    super::each_file(&args.files, say, |i, file| {
        let (motion, found) = classifier.predict(file, &options[i])?;
        odd.warn(&motion);
        match args.json {
            true => print(&(serde_json::to_string(&found)? + "\n")),
            false => print(&found.to_string()),
        }
    })?;
    Ok(())
}
