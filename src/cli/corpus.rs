//! `kinelm corpus stats`, `clean`, `order` and `merge`.

use super::{ForceArgs, Say, TrustArgs, print};
use crate::corpus::{merge::merge, stats::stats, writer::LAYOUT};
use crate::train::order::order;
use crate::train::run::RunFile;
use crate::train::{CorpusPart, Data, TrainConfig, TrainFile};
use anyhow::Result;
use kinelm_store::counted;
use std::path::PathBuf;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Report what a corpus contains: clips, frames, hours, labels, splits, glitches, duplicates
    Stats {
        /// The corpus folder
        corpus: PathBuf,
        /// Print one JSON object instead of text
        #[arg(long)]
        json: bool,
        #[command(flatten)]
        trust: TrustArgs,
    },
    /// Find ranges of train clips to exclude: impossible steps, bodies in the floor, copies of other clips
    Clean(super::clean::Args),
    /// Write the windows of a training in order, for other training programs: clip, first token and token count,
    /// (steps, rows, 3) int64
    Order {
        /// A corpus folder; may be repeated, as for `pretrain`
        #[arg(long, value_name = "CORPUS[=WEIGHT]")]
        corpus: Vec<CorpusPart>,
        /// Training settings: a name that `pretrain --config` takes, or a TOML file
        #[arg(long, value_name = "NAME|FILE")]
        config: PathBuf,
        /// Steps [default: the file's]
        #[arg(long, value_name = "N")]
        steps: Option<u64>,
        /// Random seed; overrides the file
        #[arg(long, value_name = "N")]
        seed: Option<u64>,
        /// Where the windows go: an archive FILE.npz, or a folder for windows.npy
        #[arg(long, value_name = "FILE.npz|DIR")]
        out: PathBuf,
        #[command(flatten)]
        force: ForceArgs,
        #[command(flatten)]
        trust: TrustArgs,
    },
    /// Merge the shards of `tokenize --shard`
    Merge {
        /// The shards, in any order
        #[arg(required = true)]
        shards: Vec<PathBuf>,
        /// The corpus folder to write
        #[arg(long, value_name = "CORPUS")]
        out: PathBuf,
        /// Overwrite the files of a corpus in --out
        #[arg(long)]
        force: bool,
    },
}

pub fn run(command: Command, say: Say) -> Result<()> {
    match command {
        Command::Stats { corpus, json, trust } => {
            let found = stats(&trust.open(&corpus)?)?;
            print(&if json { serde_json::to_string(&found)? + "\n" } else { format!("{found}\n") })
        }
        Command::Clean(args) => super::clean::run(&args, say),
        Command::Order { corpus, config, steps, seed, out, force, trust } => {
            let file = TrainFile::find(&config)?;
            let corpora = if corpus.is_empty() { file.corpora()? } else { corpus };
            let outputs = force.outputs(corpora.iter().map(|part| part.path.clone()).chain([config]));
            let data = Data::open(&corpora, None, &file.train.conditions, trust.opening())?;
            let train = TrainConfig { seed: seed.unwrap_or(file.train.seed), ..file.train };
            let steps = steps.unwrap_or(train.steps);
            let found = order(&RunFile::new(&file.model, &train, &data)?, &data, steps)?;
            let (path, bytes) = found.to_file(&out)?;
            outputs.write(&path, &bytes)?;
            say.line(format_args!("{}: {steps} steps of {} windows", out.display(), found.rows));
            Ok(())
        }
        Command::Merge { shards, out, force } => {
            ForceArgs { force }.outputs(&shards).check_folder(&out, &LAYOUT)?;
            let manifest = merge(&shards, &out, force)?;
            let (n, f) = (manifest.count.clips, manifest.count.frames);
            say.line(format_args!("{}: {}, {}", out.display(), counted(n, "clips"), counted(f, "frames")));
            Ok(())
        }
    }
}
