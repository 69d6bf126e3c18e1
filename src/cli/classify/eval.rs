//! `kinelm classify eval`.

use crate::classify::Classifier;
use crate::cli::{CheckpointArg, ForceArgs, Say, TrustArgs, print};
use crate::corpus::Split;
use crate::model::exchange;
use anyhow::Result;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
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
    #[arg(long, value_name = "RUN|DIR")]
    run: Option<PathBuf>,
    #[command(flatten)]
    checkpoint: CheckpointArg,
    /// Also plot the confusion of the clips: a matrix for class tokens and one for class tokens and LDA
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

pub fn run(args: &Args, say: Say) -> Result<()> {
    let outputs = args.force.outputs([&args.classifier, &args.corpus].into_iter().chain(&args.run));
    args.plot.as_deref().map_or(Ok(()), |out| crate::cli::picture(out, &outputs))?;
    let mut classifier = Classifier::load(&args.classifier)?;
    let corpus = args.trust.open(&args.corpus)?;
    let run = args.run.as_deref().map(|run| exchange::load(run, args.checkpoint.get())).transpose()?;
    run.iter().flat_map(|r| &r.notes).for_each(|note| say.line(note));
    crate::cli::progress::stage("naming clips");
    let found = classifier.evaluate(&corpus, args.split, run.as_ref(), args.baselines)?;
    if let Some(out) = &args.plot {
        crate::cli::draw_charts(out, &found.charts(), &outputs)?;
    }
    match args.json {
        true => print(&(serde_json::to_string(&found)? + "\n")),
        false => print(&found.to_string()),
    }
}
