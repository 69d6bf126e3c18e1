//! `kinelm music-lstm`.

mod evaluate;
mod generate;
mod train;

use super::{Say, updates};
use anyhow::Result;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Train a network on motion files of one rig and their music
    Train(Box<train::Args>),
    /// Resume a training from its last whole checkpoint, on the same files
    Resume(updates::ResumeArgs),
    /// Dance to a piece of music
    Generate(generate::Args),
    /// Measure dances to music from the training, to unheard music and to other pieces, and for how long one keeps moving
    Evaluate(evaluate::Args),
}

pub fn run(command: Command, say: Say) -> Result<()> {
    match command {
        Command::Train(args) => train::run(&args, say),
        Command::Resume(args) => train::resume(&args, say),
        Command::Generate(args) => generate::run(&args, say),
        Command::Evaluate(args) => evaluate::run(&args, say),
    }
}
