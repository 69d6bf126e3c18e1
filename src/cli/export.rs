//! `kinelm export`.

use super::{CheckpointArg, Say};
use crate::model::exchange::{Format, export};
use crate::model::load_run;
use anyhow::Result;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The run folder
    #[arg(long, value_name = "RUN", value_parser = crate::cli::values::run_folder())]
    run: PathBuf,
    #[command(flatten)]
    checkpoint: CheckpointArg,
    /// kinelm: our own names, any model; hf: what `transformers` loads as GPT2LMHeadModel, for models that GPT-2 can
    /// express
    #[arg(long, value_enum, default_value = "kinelm")]
    format: Format,
    /// The folder to write, which must not exist
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let run = load_run(&args.run, args.checkpoint.get())?;
    run.notes.iter().for_each(|note| say.line(note));
    export(&run, args.format, &args.out)?;
    say.line(format_args!("{}: the model after {} steps", args.out.display(), run.state.step));
    Ok(())
}
