//! `kinelm export`.

use super::Say;
use crate::model::exchange::{Format, export};
use crate::model::{CheckpointChoice, load_run};
use anyhow::Result;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The run folder; its best checkpoint is exported, or its latest where none was validated
    #[arg(long, value_name = "RUN", value_parser = crate::cli::values::run_folder())]
    run: PathBuf,
    /// kinelm: our own names, any model; hf: what `transformers` loads as GPT2LMHeadModel, for models that GPT-2 can
    /// express
    #[arg(long, value_enum, default_value = "kinelm")]
    format: Format,
    /// The folder to write, which must not exist
    #[arg(long, value_name = "DIR")]
    out: PathBuf,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let run = load_run(&args.run, CheckpointChoice::Auto)?;
    run.notes.iter().for_each(|note| say.line(note));
    export(&run, args.format, &args.out)?;
    say.line(format_args!("{}: the model after {} steps", args.out.display(), run.state.step));
    Ok(())
}
