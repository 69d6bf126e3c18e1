//! Progress: a bar on a terminal, else plain lines at growing intervals.

use super::Say;
use crate::corpus::build::{BuildEvent, BuildProgress};
use crate::train::progress::time;
use indicatif::{ProgressBar, ProgressDrawTarget, ProgressStyle};
use std::io::{IsTerminal, Write};
use std::ops::ControlFlow;
use std::sync::{LazyLock, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// The wait of a call, and when it was last reported.
#[derive(Debug)]
struct Wait {
    what: String,
    done: u64,
    /// 0 if unknown.
    of: u64,
    since: Instant,
    said: Instant,
    gap: Duration,
    /// Whether something else shows it: a bar, or the lines of a training.
    shown: bool,
}

/// A wait is reported after this time.
const FIRST_GAP: Duration = Duration::from_secs(2);
/// Between lines at most.
const LAST_GAP: Duration = Duration::from_secs(60);

/// The process has one stderr, and so one wait.
static WAIT: LazyLock<Mutex<Wait>> = LazyLock::new(|| Mutex::new(Wait::new("at work", 0, Instant::now())));

fn wait() -> MutexGuard<'static, Wait> {
    WAIT.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Wait {
    fn new(what: &str, of: u64, now: Instant) -> Wait {
        Wait { what: what.into(), done: 0, of, since: now, said: now, gap: FIRST_GAP, shown: false }
    }

    /// The line that is due, if one is; the next comes after twice the time.
    fn due(&mut self, now: Instant) -> Option<String> {
        if self.shown || now.saturating_duration_since(self.said) < self.gap {
            return None;
        }
        self.said = now;
        // 2, 4, 8 .. 60 s: a short wait is quiet, a long one doesn't fill the log
        self.gap = (2 * self.gap).min(LAST_GAP);
        let (what, done, of, gone) = (&self.what, self.done, self.of, now.saturating_duration_since(self.since));
        Some(match (done, of) {
            (_, 0) => format!("{what}, {} so far", time(gone)),
            (0, _) => format!("0 of {of} {what}, {} so far", time(gone)),
            _ => {
                let left = gone.as_secs_f64() * of.saturating_sub(done) as f64 / done as f64;
                format!("{done} of {of} {what}, {} left", time(Duration::from_secs_f64(left)))
            }
        })
    }
}

/// Starts a thread that reports waits.
pub fn report_waits(say: Say) {
    if say.quiet() {
        return;
    }
    std::thread::spawn(|| {
        loop {
            std::thread::sleep(Duration::from_millis(200));
            // the lock is free again before stderr, which may block
            let line = wait().due(Instant::now());
            if let Some(line) = line {
                // a closed stderr is no reason to stop
                let _ = std::io::stderr().write_all(format!("kinelm: {line}\n").as_bytes());
            }
        }
    });
}

/// Postpones the next line about the wait, after another line.
pub fn said() {
    wait().said = Instant::now();
}

/// Starts a stage of unknown length.
pub fn stage(what: &str) {
    *wait() = Wait::new(what, 0, Instant::now());
}

/// Stderr for work that prints its own progress: waits are not reported on a terminal, and elsewhere only after a long
/// silence.
pub struct ProgressStderr(std::io::Stderr);

impl ProgressStderr {
    /// Stderr for the progress of `what`.
    pub fn of(what: &str) -> ProgressStderr {
        stage(what);
        ProgressStderr(std::io::stderr())
    }
}

impl Write for ProgressStderr {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        let mut wait = wait();
        // on a terminal its own line is progress enough; elsewhere a line after half a minute of silence
        (wait.shown, wait.said, wait.gap) = (self.0.is_terminal(), Instant::now(), LAST_GAP / 2);
        drop(wait);
        self.0.write(bytes)
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.0.flush()
    }
}

impl Drop for ProgressStderr {
    fn drop(&mut self) {
        stage("at work");
    }
}

/// A count of steps: a bar on a terminal, lines elsewhere.
pub struct Bar(ProgressBar);

/// A count of `total` steps on stderr; hidden with `--quiet`.
pub fn bar(total: u64, what: &str, say: Say) -> Bar {
    let target = if say.quiet() { ProgressDrawTarget::hidden() } else { ProgressDrawTarget::stderr() };
    let bar = ProgressBar::with_draw_target(Some(total), target);
    let template = format!("{{bar:30}} {{pos}}/{{len}} {what}, {{eta}} left {{msg}}");
    if let Ok(style) = ProgressStyle::with_template(&template) {
        bar.set_style(style);
    }
    bar.tick();
    *wait() = Wait { shown: !bar.is_hidden(), ..Wait::new(what, total, Instant::now()) };
    Bar(bar)
}

impl Bar {
    /// Sets the number of steps done.
    pub fn set_position(&self, done: u64) {
        self.0.set_position(done);
        wait().done = done;
    }

    /// Sets the text next to the bar.
    pub fn set_message(&self, message: String) {
        self.0.set_message(message);
    }

    /// Prints something above the bar.
    pub fn suspend(&self, say: impl FnOnce()) {
        self.0.suspend(say);
    }
}

impl Drop for Bar {
    fn drop(&mut self) {
        self.0.finish_and_clear();
        stage("at work");
    }
}

/// A bar over files, followed by the stage `then`; bad files are reported as they turn up.
pub fn watch(say: Say, then: &'static str) -> Box<BuildProgress<'static>> {
    let mut shown: Option<Bar> = None;
    Box::new(move |event| {
        match event {
            BuildEvent::Done { done, of, .. } => {
                shown.get_or_insert_with(|| bar(of as u64, "files", say)).set_position(done as u64);
                // the bar goes when it is full, as the next stage has none
                if done == of {
                    shown = None;
                    stage(then);
                }
            }
            BuildEvent::Failed { item, why } => {
                let text = format!("{}: left out: {why}", item.name);
                match &shown {
                    Some(bar) => bar.suspend(|| say.left_out(text)),
                    None => say.left_out(text),
                }
            }
        }
        ControlFlow::Continue(())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lines_come_after_two_seconds_and_then_ever_more_seldom() {
        let start = Instant::now();
        let lines_of = |wait: &mut Wait| -> Vec<(u64, String)> {
            let at = |s| start + Duration::from_secs(s);
            (0..=200).filter_map(|s| Some((s, wait.due(at(s))?))).collect()
        };
        let lines = lines_of(&mut Wait { done: 30, ..Wait::new("steps", 300, start) });
        assert_eq!(lines.iter().map(|(s, _)| *s).collect::<Vec<_>>(), [2, 6, 14, 30, 62, 122, 182]);
        assert_eq!(lines[2].1, "30 of 300 steps, 2 min 06 s left");
        assert_eq!(lines_of(&mut Wait::new("steps", 300, start))[0].1, "0 of 300 steps, 2 s so far");
        assert_eq!(lines_of(&mut Wait::new("at work", 0, start))[3].1, "at work, 30 s so far");
        assert_eq!(lines_of(&mut Wait { shown: true, ..Wait::new("steps", 300, start) }), []);
        // a message in between postpones the next line
        let said = start + Duration::from_secs(50);
        assert_eq!(lines_of(&mut Wait { said, ..Wait::new("steps", 300, start) })[0].0, 52);
    }
}
