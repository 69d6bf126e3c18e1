//! Messages on stderr, and data on stdout.

use super::message::{by_flags, clipped, plain};
use super::wait;
use anyhow::Result;
use kinelm_motion::Motion;
use kinelm_motion::format::{FileRate, RateDoubt, RateDoubts, ReadOptions};
use std::borrow::Cow;
use std::cell::RefCell;
use std::io::{IsTerminal, Write};
use std::sync::atomic::{AtomicUsize, Ordering};

/// The number of files that the call has left out.
static LEFT_OUT: AtomicUsize = AtomicUsize::new(0);

/// The end of a call that has processed all usable files: a failure if files were left out.
pub fn all_read() -> Result<()> {
    let left_out = LEFT_OUT.load(Ordering::Relaxed);
    anyhow::ensure!(left_out == 0, "{} could not be used; the rest is done", kinelm_store::counted(left_out, "files"));
    Ok(())
}

/// Prints messages on stderr; data go to stdout ([`print()`]).
#[derive(Debug, Clone, Copy)]
pub struct Say {
    pub(crate) quiet: bool,
}

impl Say {
    /// One line, unless `--quiet`.
    pub fn line(self, text: impl std::fmt::Display) {
        if !self.quiet {
            self.error(text);
        }
    }

    /// One line, always.
    pub fn error(self, text: impl std::fmt::Display) {
        tell(text);
        wait::said();
    }

    /// Names a file that is left out; in the end the call has failed.
    pub fn left_out(self, text: impl std::fmt::Display) {
        LEFT_OUT.fetch_add(1, Ordering::Relaxed);
        self.error(text);
    }

    /// Whether `--quiet` was given.
    pub fn quiet(self) -> bool {
        self.quiet
    }
}

/// A line on stderr, of a length that can be read.
pub fn tell(text: impl std::fmt::Display) {
    let text = by_flags(&text.to_string());
    // a closed stderr is no reason to stop
    let _ = writeln!(std::io::stderr(), "kinelm: {}", plain(&clipped(&text)));
}

/// Reports the doubts of a file that was read all the same.
pub fn warn(motion: &Motion, say: Say) {
    Odd::new(say).warn(motion, &ReadOptions::default());
}

/// The doubts of the files of a call, reported file by file, but those of their rates in one line at the end.
pub struct Odd {
    say: Say,
    doubts: RefCell<RateDoubts>,
}

impl Odd {
    /// No file yet.
    pub fn new(say: Say) -> Odd {
        Odd { say, doubts: RefCell::default() }
    }

    /// Reports the doubts of a file as it was read with these options.
    pub fn warn(&self, motion: &Motion, options: &ReadOptions) {
        let path = motion.path.display();
        for warning in motion.warnings.iter().filter(|warning| !RateDoubt::is_warning(warning)) {
            self.say.line(format_args!("{path}: {warning}"));
        }
        self.rate(&path.to_string(), FileRate::of(motion, options));
    }

    /// Adds a file with its own statements about its rate.
    pub fn rate(&self, name: &str, rate: FileRate) {
        self.doubts.borrow_mut().add(name, rate);
    }
}

impl Drop for Odd {
    fn drop(&mut self) {
        self.doubts.borrow().line().iter().for_each(|line| self.say.line(line));
    }
}

/// Writes data to stdout; a terminal gets it [`plain`].
pub fn print(text: &str) -> Result<()> {
    let mut out = std::io::stdout().lock();
    // a file or a pipe gets the bytes as they are
    let text = if out.is_terminal() { plain(text) } else { Cow::Borrowed(text) };
    out.write_all(text.as_bytes())?;
    Ok(out.flush()?)
}
