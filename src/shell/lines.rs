//! The progress of a training as lines for people.

use crate::model::scored_windows::Likelihood;
use crate::train::Progress;
use crate::train::metrics::StepMetrics;
use crate::train::progress::time;
use std::io::Write;
use std::time::{Duration, Instant};

/// Progress as one line that is rewritten in place if `live` (a terminal), else as a line every few seconds.
pub struct Lines<W: Write> {
    out: W,
    live: bool,
    width: usize,
    last: Option<Instant>,
}

/// Time between plain lines.
const PLAIN_EVERY: Duration = Duration::from_secs(15);
/// Time between updates of the live line.
const LIVE_EVERY: Duration = Duration::from_millis(100);

impl<W: Write> Lines<W> {
    /// Lines on `out`, usually stderr.
    pub fn new(out: W, live: bool) -> Lines<W> {
        Lines { out, live, width: 0, last: None }
    }

    /// Ends the live line, if there is one.
    fn end(&mut self) {
        if self.width > 0 {
            let _ = writeln!(self.out);
            self.width = 0;
        }
    }
}

impl<W: Write> Progress for Lines<W> {
    fn step(&mut self, f: &StepMetrics, steps: u64, left: Duration) {
        let every = if self.live { LIVE_EVERY } else { PLAIN_EVERY };
        // the last step is always shown
        if f.step < steps && self.last.is_some_and(|l| l.elapsed() < every) {
            return;
        }
        self.last = Some(Instant::now());
        let line = format!(
            "step {}/{steps}  loss {:.4}  {:.2} bits/frame  {:.0} tokens/s  {} left",
            f.step,
            f.loss,
            f.bits_per_frame,
            f.tokens_per_second,
            time(left)
        );
        if self.live {
            // blanks overwrite the rest of a longer line
            let _ = write!(self.out, "\r{line:<0$}", self.width);
            self.width = line.len();
            if f.step == steps {
                self.end();
            }
        } else {
            let _ = writeln!(self.out, "{line}");
        }
        let _ = self.out.flush();
    }

    fn valid(&mut self, step: u64, found: &Likelihood, best: bool) {
        self.end();
        let share = match found.windows < found.all_windows {
            true => format!(" ({} of {} windows)", found.windows, found.all_windows),
            false => String::new(),
        };
        let mark = if best { ", the best so far" } else { "" };
        let (bits, pseudo) = (found.bits_per_frame, if found.pseudo { "pseudo " } else { "" });
        let _ = writeln!(self.out, "step {step}: validation {bits:.2} {pseudo}bits/frame{share}{mark}");
    }

    fn note(&mut self, text: &str) {
        self.end();
        let _ = writeln!(self.out, "{text}");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_terminal_has_one_line_and_a_file_plain_ones() {
        let metrics = |step, loss| StepMetrics {
            step,
            loss,
            bits_per_frame: 3.0,
            rate: 0.1,
            gradient_norm: 1.0,
            tokens: 7,
            tokens_per_second: 912.3,
        };
        let found = Likelihood {
            bits_per_frame: 80.126,
            nats_per_token: 1.3,
            tokens: 9,
            frames: 3,
            windows: 3,
            all_windows: 9,
            pseudo: false,
        };
        let run = |live| {
            let mut out = Vec::new();
            let mut lines = Lines::new(&mut out, live);
            lines.step(&metrics(1, 10.5), 2, Duration::from_secs(3725));
            lines.step(&metrics(2, 1.5), 2, Duration::ZERO);
            lines.valid(2, &found, true);
            String::from_utf8(out).unwrap()
        };
        let last = "step 2: validation 80.13 bits/frame (3 of 9 windows), the best so far\n";
        let (a, b) = (
            "step 1/2  loss 10.5000  3.00 bits/frame  912 tokens/s  1 h 02 min left",
            "step 2/2  loss 1.5000  3.00 bits/frame  912 tokens/s  0 s left",
        );
        assert_eq!(run(false), format!("{a}\n{b}\n{last}"));
        assert_eq!(run(true), format!("\r{a}\r{b:<0$}\n{last}", a.len()));
    }
}
