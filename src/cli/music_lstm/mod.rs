//! `kinelm music-lstm train`, `generate` and `evaluate`.

mod evaluate;
mod generate;
mod train;

use super::Say;
use anyhow::Result;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Train a network on motion files of one rig and the music laid beside them
    Train(Box<train::Args>),
    /// A dance to a piece of music
    Generate(generate::Args),
    /// What dances to heard, unheard and other music are like, and for how long one moves
    Evaluate(evaluate::Args),
}

pub fn run(command: Command, say: Say) -> Result<()> {
    match command {
        Command::Train(args) => train::run(*args, say),
        Command::Generate(args) => generate::run(&args, say),
        Command::Evaluate(args) => evaluate::run(&args, say),
    }
}
