//! `kinelm evaluate baselines`.

use super::floors::FloorsArgs;
use crate::cli::{TrustArgs, WrongCall, print};
use crate::corpus::Split;
use crate::evaluate::floors::codes::frames;
use crate::evaluate::{ChannelFloors, CodeSplits, Floors};
use anyhow::Result;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// A corpus folder
    #[arg(long, value_name = "CORPUS", required_unless_present = "tokens")]
    corpus: Option<PathBuf>,
    /// Bare codes: train and test (F, C) uint16, train_len and test_len
    #[arg(long, value_name = "FILE.npz", conflicts_with_all = ["corpus", "floors_from"])]
    tokens: Option<PathBuf>,
    /// Bins of the codes in --tokens
    #[arg(long, default_value_t = 360, value_parser = clap::value_parser!(u32).range(2..=65_536))]
    bins: u32,
    /// The split to measure
    #[arg(long, default_value = "test", value_name = "train|valid|test")]
    split: Split,
    /// Print one JSON object instead of a table
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    floors: FloorsArgs,
    #[command(flatten)]
    trust: TrustArgs,
}

pub fn run(args: &Args) -> Result<()> {
    let Some(extent) = args.floors.extent() else {
        return Err(WrongCall("--floors none: nothing is left to measure".into()).into());
    };
    let found = match (&args.corpus, &args.tokens) {
        (Some(corpus), _) => {
            let opened = args.trust.open(corpus)?;
            let fitted = args.floors.fitted(&opened, args.trust)?;
            if frames(&opened, args.split) == 0 {
                let (corpus, split) = (corpus.display(), args.split);
                anyhow::bail!("{corpus}: no frame in the {split} split; try another --split");
            }
            fitted.measure(&opened, args.split)?.map_err(|why| anyhow::anyhow!(why))?
        }
        (_, Some(tokens)) => Floors::Channels(Box::new(ChannelFloors::measure(&CodeSplits::load_npz(
            tokens,
            args.bins as usize,
            extent,
        )?)?)),
        _ => return Err(WrongCall("give --corpus or --tokens".into()).into()),
    };
    print(&if args.json { format!("{}\n", found.to_json()) } else { format!("{found}\n") })
}
