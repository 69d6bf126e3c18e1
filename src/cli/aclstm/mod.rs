//! `kinelm aclstm train`, `generate` and `evaluate`.

mod train;

use super::Say;
use anyhow::Result;
use kinelm::aclstm::Form;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Train a network on motion files of one rig
    Train(train::Args),
}

pub fn run(command: Command, say: Say) -> Result<()> {
    match command {
        Command::Train(args) => train::run(args, say),
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
