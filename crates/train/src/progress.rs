//! How a run reports its progress.

use super::metrics::StepMetrics;
use kinelm_model::scored_windows::Likelihood;
use std::time::Duration;

/// Receives the progress of a run.
pub trait Progress {
    /// A step of `steps` is done; `left` is the time that the others take at the present speed.
    fn step(&mut self, metrics: &StepMetrics, steps: u64, left: Duration);
    /// The validation clips were measured; `best`: never better.
    fn valid(&mut self, step: u64, found: &Likelihood, best: bool);
    /// Something that the user should know.
    fn note(&mut self, text: &str);
}

/// Ignores all progress.
pub struct NoProgress;

impl Progress for NoProgress {
    fn step(&mut self, _: &StepMetrics, _: u64, _: Duration) {}
    fn valid(&mut self, _: u64, _: &Likelihood, _: bool) {}
    fn note(&mut self, _: &str) {}
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
    fn times_are_short() {
        let times = [0.4, 59.6, 61.0, 3600.0, 90061.0].map(|s| time(Duration::from_secs_f64(s)));
        assert_eq!(times, ["0 s", "1 min 00 s", "1 min 01 s", "1 h 00 min", "25 h 01 min"]);
    }
}
