//! `kinelm evaluate`.

mod compare;
pub mod dance;
mod gaps;
mod likelihood;
mod prediction;

use super::{Say, WrongCall, print};
use anyhow::Result;
use kinelm::corpus::{Corpus, Split};
use kinelm::evaluate::{CodeSplits, Floors, measure};
use std::path::PathBuf;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Bits a frame of static models, fitted on train and measured on test: what any model has to get below
    Baselines(BaselinesArgs),
    /// Bits a frame of a trained model, with the static floors of the same tokens beside it
    Likelihood(likelihood::Args),
    /// Whether dances freeze, repeat themselves, answer to their prompts, copy, with real ones beside them
    Dance(dance::Args),
    /// How well a model fills gaps, with straight ways through them beside it
    Gaps(gaps::Args),
    /// What a model foretells of the next 400 ms, with standing still and going on beside it
    Prediction(prediction::Args),
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
    #[arg(long, default_value = "test", value_name = "train|valid|test")]
    split: Split,
    /// One JSON object instead of a table
    #[arg(long)]
    json: bool,
}

pub fn run(command: Command, say: Say) -> Result<()> {
    match command {
        Command::Baselines(args) => baselines(args),
        Command::Likelihood(args) => likelihood::run(&args, say),
        Command::Dance(args) => dance::run(&args, say),
        Command::Gaps(args) => gaps::run(&args, say),
        Command::Prediction(args) => prediction::run(&args, say),
    }
}

fn baselines(args: BaselinesArgs) -> Result<()> {
    let found = match (&args.corpus, &args.tokens) {
        (Some(corpus), _) => {
            let (opened, split) = (Corpus::open(corpus)?, args.split);
            for needed in [Split::Train, split] {
                let frames: usize = opened.split(needed).map(|c| c.frames).sum();
                anyhow::ensure!(
                    frames > 0,
                    "{}: no frame in the {needed} split; try another --split",
                    corpus.display()
                );
            }
            super::progress::stage("fitting and measuring static models");
            Floors::of_corpus(&opened, split)?
        }
        (_, Some(tokens)) => Floors::Channels(Box::new(measure(&CodeSplits::load_npz(tokens, args.bins as usize)?)?)),
        _ => return Err(WrongCall("give --corpus or --tokens".into()).into()),
    };
    print(&if args.json { format!("{}\n", found.to_json()) } else { format!("{found}\n") })
}
