//! `kinelm evaluate baselines` and `likelihood`.

use super::{Say, print};
use anyhow::Result;
use kinelm::corpus::{Corpus, Split};
use kinelm::evaluate::{CodeSplits, measure};
use std::path::PathBuf;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Bits a frame of static models, fitted on train and measured on test: what any model has to get below
    Baselines(BaselinesArgs),
}

#[derive(Debug, clap::Args)]
pub struct BaselinesArgs {
    /// A corpus folder
    #[arg(long, value_name = "CORPUS", required_unless_present = "tokens")]
    corpus: Option<PathBuf>,
    /// Bare codes: train and test (F, C) uint16, train_len and test_len
    #[arg(long, value_name = "FILE.npz", conflicts_with = "corpus")]
    tokens: Option<PathBuf>,
    /// Bins of the codes in --tokens
    #[arg(long, default_value_t = 360, value_parser = clap::value_parser!(u32).range(2..=65_536))]
    bins: u32,
    /// The split that is measured
    #[arg(long, default_value = "test", value_name = "valid|test")]
    split: Split,
    /// One JSON object instead of a table
    #[arg(long)]
    json: bool,
}

pub fn run(command: Command, say: Say) -> Result<()> {
    match command {
        Command::Baselines(args) => baselines(args, say),
    }
}

fn baselines(args: BaselinesArgs, _say: Say) -> Result<()> {
    let codes = match (&args.corpus, &args.tokens) {
        (Some(corpus), _) => CodeSplits::of_corpus(&Corpus::open(corpus)?, args.split)?,
        (_, Some(tokens)) => CodeSplits::load_npz(tokens, args.bins as usize)?,
        _ => return Err(super::WrongCall("give --corpus or --tokens".into()).into()),
    };
    let found = measure(&codes)?;
    print(&if args.json { format!("{}\n", found.to_json()) } else { format!("{found}\n") })
}
