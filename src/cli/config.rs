//! `kinelm config`.

use super::print;
use crate::presets;
use anyhow::Result;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Print settings that are built in, to begin a file of your own with: kinelm config show tiny > my.toml
    #[command(after_help = after_help())]
    Show {
        /// A name that --config takes; of the same name in several commands, the training file's unless its kind stands in
        /// front: music-lstm/small
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
