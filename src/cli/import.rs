//! `kinelm import`.

use super::Say;
use crate::train::import::import;
use anyhow::Result;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// A folder that `kinelm export`, scripts/cluster or `transformers` wrote, with our tokenizer.json in it
    #[arg(value_name = "DIR")]
    folder: PathBuf,
    /// The run folder to create, which must not exist
    #[arg(long, value_name = "RUN")]
    run: PathBuf,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let found = import(&args.folder, &args.run)?;
    found.notes.iter().for_each(|note| say.line(note));
    say.line(format_args!("{}: the model after {} steps", args.run.display(), found.state.step));
    Ok(())
}
