//! `kinelm tokenize`.

use super::{Say, data::DataArgs, read::ReadArgs};
use anyhow::Result;
use kinelm::corpus::Shard;
use kinelm::corpus::build::{BuildOptions, tokenize};
use kinelm::corpus::writer::LAYOUT;
use kinelm::counted;
use kinelm::output::Outputs;
use kinelm_motion::format::RestFrame;
use kinelm_tokenizer::Tokenizer;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    data: DataArgs,
    /// Where the corpus folder goes
    #[arg(long, value_name = "CORPUS")]
    out: PathBuf,
    /// The tokenizer
    #[arg(long, value_name = "FILE")]
    tokenizer: PathBuf,
    /// Only piece I of N, counted from 0; `corpus merge` puts the pieces together
    #[arg(long, value_name = "I/N")]
    shard: Option<Shard>,
    /// Replace the files of a corpus that stands at --out
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    read: ReadArgs,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let tokenizer = Tokenizer::load(&args.tokenizer)?;
    let gathered = args.data.gather(say)?;
    let inputs = args.data.files(&gathered).chain([args.tokenizer.clone()]).chain(args.read.files());
    Outputs::new(inputs, args.force).check_folder(&args.out, &LAYOUT)?;
    let options = BuildOptions {
        shard: args.shard,
        force: args.force,
        ..args.data.build_options(args.read.options(RestFrame::Drop))
    };
    let (manifest, summary) =
        tokenize(&gathered, &tokenizer, &args.out, &options, &mut *super::progress::watch(say, "writing the corpus"))?;
    for line in summary.lines() {
        say.line(line);
    }
    let (n, f) = (manifest.count.clips, manifest.count.frames);
    let tokens = manifest.token_count();
    let (clips, frames) = (counted(n, "clips"), counted(f, "frames"));
    say.line(format_args!("{}: {clips}, {frames}, {tokens} tokens", args.out.display()));
    Ok(())
}
