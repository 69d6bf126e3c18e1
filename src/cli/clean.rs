//! `kinelm corpus clean`.

use super::{ForceArgs, Say, data::DataArgs, read::ReadArgs};
use crate::corpus::exclude::to_csv;
use crate::spectral::clean::clean;
use anyhow::Result;
use kinelm_motion::format::RestFrame;
use kinelm_tokenizer::{Tokenizer, TokenizerConfig};
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    data: DataArgs,
    /// Where the ranges go, as a CSV (clip, from_s, to_s, why)
    #[arg(long, value_name = "FILE.csv")]
    out: PathBuf,
    /// The tokenizer whose rate and joints are used [default: 20 frames per second, 18 joints]
    #[arg(long, value_name = "FILE")]
    tokenizer: Option<PathBuf>,
    #[command(flatten)]
    force: ForceArgs,
    #[command(flatten)]
    read: ReadArgs,
}

pub fn run(args: &Args, say: Say) -> Result<()> {
    let config = match &args.tokenizer {
        Some(path) => Tokenizer::load(path)?.config().clone(),
        None => TokenizerConfig::default(),
    };
    let dataset = args.data.find(say)?;
    let inputs = args.data.files(&dataset).chain(args.tokenizer.clone()).chain(args.read.files());
    let outputs = args.force.outputs(inputs);
    outputs.check([&*args.out])?;
    let options = args.data.build_options(args.read.options(RestFrame::Drop));
    let found = clean(&dataset, &config, &options, &mut *super::progress::watch(say, "looking at clips"))?;
    found.summary.lines().iter().for_each(|line| say.line(line));
    outputs.write(&args.out, to_csv(&found.ranges).as_bytes())?;
    found.to_string().lines().for_each(|line| say.line(line));
    Ok(())
}
