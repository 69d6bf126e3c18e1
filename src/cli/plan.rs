//! `kinelm plan`.

use super::{Say, print};
use crate::generate::request::Timeline;
use crate::generate::timeline::timeline;
use anyhow::Result;
use std::path::PathBuf;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Read a plan, lay its clips, and draw it as text: what is given by which, and what will be made anew
    Check(CheckArgs),
}

#[derive(Debug, clap::Args)]
pub struct CheckArgs {
    /// The plan, docs/plans.md
    #[arg(value_name = "PLAN.toml")]
    plan: PathBuf,
}

pub fn run(command: &Command, say: Say) -> Result<()> {
    let Command::Check(args) = command;
    let (_, laid) = Timeline::load(&args.plan)?;
    laid.notes.iter().for_each(|note| say.line(note));
    print(&timeline(&laid))
}
