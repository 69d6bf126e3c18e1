//! `kinelm classify train`, `eval` and `predict`.

mod eval;
mod predict;
mod train;

use super::Say;
use anyhow::Result;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Train class tokens on a run, together with its language model
    Train(train::Args),
    /// Measure accuracy with confidence intervals, and simple classifiers trained on the same clips
    Eval(eval::Args),
    /// Classify motion files, second by second too
    Predict(predict::Args),
}

pub fn run(command: Command, say: Say) -> Result<()> {
    match command {
        Command::Train(args) => train::run(args, say),
        Command::Eval(args) => eval::run(&args, say),
        Command::Predict(args) => predict::run(&args, say),
    }
}
