//! The program: parse the call, run one command, turn the outcome into an exit code.
//!
//! 0: done. 1: the work failed. 2: the call was wrong. 130: stopped by Ctrl-C, what is done is saved. A reader that closes the pipe early is no failure.
#![deny(unsafe_code)]

mod cli;

use clap::Parser;
use std::process::ExitCode;

fn main() -> ExitCode {
    #[cfg(unix)]
    hear_signals();
    if let Some(commit) = option_env!("KINELM_COMMIT") {
        kinelm::train::provenance::built_from(commit);
    }
    let call = match cli::Call::try_parse() {
        Ok(call) => call,
        Err(e) => return cli::refused(cli::told_plain(e)),
    };
    match cli::run(call) {
        Ok(()) => ExitCode::SUCCESS,
        Err(e) if cli::is_broken_pipe(&e) => ExitCode::SUCCESS,
        Err(e) => {
            cli::tell(cli::chain(&e));
            ExitCode::from(match () {
                _ if cli::is_wrong_call(&e) => 2,
                _ if cli::is_stopped(&e) => 130,
                _ => 1,
            })
        }
    }
}

/// What would end the program by a signal is failed work.
#[cfg(unix)]
fn hear_signals() {
    use signal_hook::{consts, flag};
    use std::sync::Arc;
    use std::sync::atomic::AtomicBool;
    // a write beyond the largest file that a shell allows is then an error
    let _ = flag::register(consts::SIGXFSZ, Arc::new(AtomicBool::new(false)));
    // where memory ends outside of what asks for it before, Rust says so and aborts: SECURITY.md
    let _ = flag::register_conditional_shutdown(consts::SIGABRT, 1, Arc::new(AtomicBool::new(true)));
}
