//! What a run tells while it goes.

use super::metrics::StepFigures;
use kinelm_model::likelihood::Likelihood;
use std::io::Write;
use std::time::{Duration, Instant};

/// Hears how a run goes.
pub trait Progress {
    /// A step of `steps` is done; `left` is the time that the rest takes at the present speed.
    fn step(&mut self, figures: &StepFigures, steps: u64, left: Duration);
    /// The validation clips were measured; `best` if never better.
    fn valid(&mut self, step: u64, found: &Likelihood, best: bool);
    /// Something that the user should know.
    fn note(&mut self, text: &str);
}

/// Hears nothing.
pub struct Silent;

impl Progress for Silent {
    fn step(&mut self, _: &StepFigures, _: u64, _: Duration) {}
    fn valid(&mut self, _: u64, _: &Likelihood, _: bool) {}
    fn note(&mut self, _: &str) {}
}

/// Lines for people: one that is rewritten in place where `live` (a terminal), else one every few seconds.
pub struct Lines<W: Write> {
    out: W,
    live: bool,
    width: usize,
    last: Option<Instant>,
}

/// Between plain lines.
const PLAIN_EVERY: Duration = Duration::from_secs(15);
/// Between rewritings of the live line.
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
    fn step(&mut self, f: &StepFigures, steps: u64, left: Duration) {
        let every = if self.live { LIVE_EVERY } else { PLAIN_EVERY };
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
            // blanks over what is left of a longer line
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

/// As `1 h 02 min`, `3 min 04 s` or `5 s`.
pub fn time(duration: Duration) -> String {
    let s = duration.as_secs_f64().round() as u64;
    match (s / 3600, s / 60 % 60, s % 60) {
        (0, 0, s) => format!("{s} s"),
        (0, m, s) => format!("{m} min {s:02} s"),
        (h, m, _) => format!("{h} h {m:02} min"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_terminal_has_one_line_and_a_file_plain_ones() {
        let figures = |step, loss| StepFigures {
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
            lines.step(&figures(1, 10.5), 2, Duration::from_secs(3725));
            lines.step(&figures(2, 1.5), 2, Duration::ZERO);
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

    #[test]
    fn times_are_short() {
        let times = [0.4, 59.6, 61.0, 3600.0, 90061.0].map(|s| time(Duration::from_secs_f64(s)));
        assert_eq!(times, ["0 s", "1 min 00 s", "1 min 01 s", "1 h 00 min", "25 h 01 min"]);
    }
}
