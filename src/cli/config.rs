//! `kinelm config`.

use super::print;
use crate::presets;
use anyhow::Result;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Print built-in settings, to start a file of your own from: kinelm config show tiny > my.toml
    #[command(after_help = after_help())]
    Show {
        /// A name that --config takes. Where several commands have settings of that name, the training file is printed;
        /// prefix the kind for others: music-lstm/small
        name: String,
    },
}

fn after_help() -> String {
    format!("Names: {}", presets::names().join(", "))
}

pub fn run(command: &Command) -> Result<()> {
    let Command::Show { name } = command;
    print(presets::text_of(name)?)
}
