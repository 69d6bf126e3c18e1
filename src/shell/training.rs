//! A training with lines on stderr, until it is done or Ctrl-C comes.

use super::Say;
use super::lines::Lines;
use super::progress::ProgressStderr;
use crate::train::{NoProgress, PretrainOptions, Progress, Summary, pretrain};
use anyhow::Result;
use std::io::IsTerminal;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};

/// Trains with lines on stderr, until it is done or Ctrl-C comes.
pub fn watched(options: &PretrainOptions, say: Say) -> Result<Summary> {
    with_lines(say, |stop, progress| pretrain(options, stop, progress))
}

/// Runs a training with lines on stderr and a flag that Ctrl-C sets.
pub fn with_lines(
    say: Say,
    train: impl FnOnce(&AtomicBool, &mut dyn Progress) -> crate::Result<Summary>,
) -> Result<Summary> {
    let stop = stop_on_ctrl_c()?;
    let mut lines = Lines::new(ProgressStderr::of("training"), std::io::stderr().is_terminal());
    let progress: &mut dyn Progress = if say.quiet() { &mut NoProgress } else { &mut lines };
    Ok(train(&stop, progress)?)
}

/// A flag that the first Ctrl-C sets; the second ends the program at once.
pub fn stop_on_ctrl_c() -> Result<Arc<AtomicBool>> {
    let stop = Arc::new(AtomicBool::new(false));
    let flag = stop.clone();
    ctrlc::set_handler(move || {
        // the second time: 130 as a shell has it, 128 and the signal's number
        if flag.swap(true, Ordering::SeqCst) {
            std::process::exit(130);
        }
    })?;
    Ok(stop)
}
