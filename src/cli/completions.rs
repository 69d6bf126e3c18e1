//! `kinelm completions`.

use super::{parser, print};
use anyhow::Result;
use clap_complete::{Shell, generate};

#[derive(Debug, clap::Args)]
#[command(after_help = "bash: kinelm completions bash > ~/.local/share/bash-completion/completions/kinelm")]
pub struct Args {
    /// The shell
    shell: Shell,
}

pub fn run(args: &Args) -> Result<()> {
    let mut script = Vec::new();
    generate(args.shell, &mut parser(), "kinelm", &mut script);
    print(&String::from_utf8(script)?)
}
