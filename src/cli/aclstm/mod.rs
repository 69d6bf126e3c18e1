//! `kinelm aclstm`.

mod evaluate;
mod generate;
mod plot;
mod train;

use super::{Say, updates};
use anyhow::Result;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Train a network on motion files of one rig
    Train(updates::TrainArgs),
    /// Resume a training from its last whole checkpoint, on the same files
    Resume(updates::ResumeArgs),
    /// Continue a clip
    Generate(generate::Args),
    /// Measure how well a network predicts the next frames, and for how long its dances keep moving
    Evaluate(evaluate::Args),
    /// Plot what `evaluate --json` printed: prediction errors, and the share of dances that stand still by second
    Plot(plot::Args),
}

pub fn run(command: Command, say: Say) -> Result<()> {
    match command {
        Command::Train(args) => train::run(&args, say),
        Command::Resume(args) => train::resume(&args, say),
        Command::Generate(args) => generate::run(&args, say),
        Command::Evaluate(args) => evaluate::run(&args, say),
        Command::Plot(args) => plot::run(args, say),
    }
}
