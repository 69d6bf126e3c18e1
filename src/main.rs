//! The program: [`kinelm::cli::run`].
#![deny(unsafe_code)]

use std::process::ExitCode;

#[global_allocator]
static MEMORY: mimalloc::MiMalloc = mimalloc::MiMalloc;

fn main() -> ExitCode {
    #[cfg(unix)]
    hear_signals();
    if let Some(commit) = option_env!("KINELM_COMMIT") {
        kinelm::train::provenance::built_from(commit);
    }
    ExitCode::from(kinelm::cli::run(std::env::args_os()))
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
