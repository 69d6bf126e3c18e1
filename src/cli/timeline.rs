//! `kinelm timeline`.

use super::{Say, print};
use crate::generate::request::Timeline;
use crate::generate::timeline::chart;
use anyhow::Result;
use std::path::PathBuf;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Read a timeline and draw it as text: what each clip gives, and what will be generated
    Check {
        /// The timeline file, docs/timelines.md
        #[arg(value_name = "TIMELINE.toml")]
        timeline: PathBuf,
    },
}

pub fn run(command: &Command, say: Say) -> Result<()> {
    let Command::Check { timeline: file } = command;
    let (_, laid) = Timeline::load(file)?;
    laid.notes.iter().for_each(|note| say.line(note));
    print(&chart(&laid))
}
