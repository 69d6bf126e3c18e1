//! `kinelm evaluate baselines`.

use super::floors::FloorsArgs;
use crate::cli::{TrustArgs, WrongCall, print};
use crate::corpus::Split;
use crate::evaluate::floors::codes::frames;
use anyhow::Result;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// A corpus folder
    #[arg(long, value_name = "CORPUS")]
    corpus: PathBuf,
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
    if args.floors.extent().is_none() {
        return Err(WrongCall("--floors none: nothing is left to measure".into()).into());
    }
    let opened = args.trust.open(&args.corpus)?;
    let fitted = args.floors.fitted(&opened, args.trust)?;
    if frames(&opened, args.split) == 0 {
        let (corpus, split) = (args.corpus.display(), args.split);
        anyhow::bail!("{corpus}: no frame in the {split} split; try another --split");
    }
    let found = fitted.measure(&opened, args.split, false)?.map_err(|why| anyhow::anyhow!(why))?;
    print(&if args.json { format!("{}\n", found.to_json()) } else { format!("{found}\n") })
}
