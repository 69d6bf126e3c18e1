//! `kinelm aclstm train`, `generate`, `evaluate` and `plot`.

mod evaluate;
mod generate;
mod plot;
mod train;

use super::Say;
use crate::baselines::aclstm::Form;
use anyhow::Result;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Train a network on motion files of one rig
    Train(train::Args),
    /// A dance that goes on from a clip
    Generate(generate::Args),
    /// How well a network foretells the next frames, and for how long it moves
    Evaluate(evaluate::Args),
    /// Curves of what `evaluate --json` printed: errors of the next frames, and who stands still at which second
    Plot(plot::Args),
}

pub fn run(command: Command, say: Say) -> Result<()> {
    match command {
        Command::Train(args) => train::run(args, say),
        Command::Generate(args) => generate::run(&args, say),
        Command::Evaluate(args) => evaluate::run(&args, say),
        Command::Plot(args) => plot::run(args, say),
    }
}

/// `--representation`.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum FormArg {
    /// Places of joints and end sites
    Positional,
    /// Angles in each joint's own order
    Euler,
    /// w, x, y, z of each joint
    Quaternion,
}

impl From<FormArg> for Form {
    fn from(form: FormArg) -> Form {
        match form {
            FormArg::Positional => Form::Positional,
            FormArg::Euler => Form::Euler,
            FormArg::Quaternion => Form::Quaternion,
        }
    }
}
