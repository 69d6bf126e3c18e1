//! The program: parse the call, run one command, turn the outcome into an exit code.
//!
//! 0: done. 1: the work failed. 2: the call was wrong. 130: stopped by Ctrl-C, what is done is saved. A reader that closes the pipe early is no failure.
#![deny(unsafe_code)]

mod cli;

use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    let call = cli::Call::try_parse().unwrap_or_else(|e| cli::told_plain(e).exit());
    match cli::run(call) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) if cli::is_broken_pipe(&e) => ExitCode::SUCCESS,
        Err(e) => {
            eprintln!("kinelm: {}", cli::plain(&cli::chain(&e)));
            ExitCode::from(match () {
                _ if cli::is_wrong_call(&e) => 2,
                _ if cli::is_stopped(&e) => 130,
                _ => 1,
            })
        }
    }
}
