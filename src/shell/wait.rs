//! The wait of a call, and the times of lines about it.

use crate::train::progress::time;
use std::sync::{LazyLock, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// The wait of a call, and when it was last reported.
#[derive(Debug)]
pub struct Wait {
    pub what: String,
    pub done: u64,
    /// 0 if unknown.
    pub of: u64,
    pub since: Instant,
    pub said: Instant,
    pub gap: Duration,
    /// Whether something else shows it: a bar, or the lines of a training.
    pub shown: bool,
}

/// A wait is reported after this time.
const FIRST_GAP: Duration = Duration::from_secs(2);

/// Between lines at most.
pub const LAST_GAP: Duration = Duration::from_secs(60);

/// The process has one stderr, and so one wait.
static WAIT: LazyLock<Mutex<Wait>> = LazyLock::new(|| Mutex::new(Wait::new("at work", 0, Instant::now())));

pub fn wait() -> MutexGuard<'static, Wait> {
    WAIT.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Wait {
    pub fn new(what: &str, of: u64, now: Instant) -> Wait {
        Wait { what: what.into(), done: 0, of, since: now, said: now, gap: FIRST_GAP, shown: false }
    }

    /// The line that is due, if one is; the next comes after twice the time.
    pub fn due(&mut self, now: Instant) -> Option<String> {
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

/// Postpones the next line about the wait, after another line.
pub fn said() {
    wait().said = Instant::now();
}

/// Starts a stage of unknown length.
pub fn stage(what: &str) {
    *wait() = Wait::new(what, 0, Instant::now());
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
