//! `kinelm corpus stats` and `merge`.

use super::{Say, print};
use anyhow::Result;
use kinelm::corpus::{Corpus, merge::merge, stats::stats};
use std::path::PathBuf;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// What is in a corpus: clips, frames, hours, labels, splits, glitches, duplicates
    Stats {
        /// The corpus folder
        corpus: PathBuf,
        /// One JSON object instead of text
        #[arg(long)]
        json: bool,
    },
    /// Put the pieces of `tokenize --shard` together
    Merge {
        /// The pieces, in any order
        #[arg(required = true)]
        shards: Vec<PathBuf>,
        /// Where the whole corpus goes
        #[arg(long, value_name = "CORPUS")]
        out: PathBuf,
        /// Replace a corpus that stands at --out
        #[arg(long)]
        force: bool,
    },
}

pub fn run(command: Command, say: Say) -> Result<()> {
    match command {
        Command::Stats { corpus, json } => {
            let found = stats(&Corpus::open(&corpus)?)?;
            print(&if json { serde_json::to_string(&found)? + "\n" } else { format!("{found}\n") })
        }
        Command::Merge { shards, out, force } => {
            let manifest = merge(&shards, &out, force)?;
            let (n, f) = (manifest.count.clips, manifest.count.frames);
            say.line(format_args!("{}: {n} clips, {f} frames", out.display()));
            Ok(())
        }
    }
}
