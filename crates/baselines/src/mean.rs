//! Means over takes, with intervals.

use kinelm_evaluate::bootstrap::interval;
use serde::Serialize;

/// A mean over seeds or dances, with its 95 % interval by bootstrap over takes.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Mean {
    /// The mean.
    pub mean: f64,
    /// Its interval over takes.
    pub over_takes: [f64; 2],
}

impl Mean {
    /// Of parts (take, sum, count).
    pub(crate) fn of<'a>(all: impl Iterator<Item = (&'a str, f64, f64)> + Clone) -> Mean {
        let (sum, count) = all.clone().fold((0.0, 0.0), |(s, n), (_, sum, count)| (s + sum, n + count));
        Mean { mean: sum / count, over_takes: interval(all) }
    }

    /// `0.25 (0.20 to 0.31)`.
    pub(crate) fn text(&self, digits: usize) -> String {
        let [low, high] = self.over_takes;
        format!("{:.digits$} ({low:.digits$} to {high:.digits$})", self.mean)
    }

    /// The same as percentages.
    pub(crate) fn percent(&self, digits: usize) -> String {
        let mean = Mean { mean: 100.0 * self.mean, over_takes: self.over_takes.map(|x| 100.0 * x) };
        format!("{} %", mean.text(digits))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_is_over_counts() {
        let parts = [("a", 3.0, 1.0), ("b", 1.0, 1.0)];
        assert_eq!(Mean::of(parts.iter().copied()).mean, 2.0);
    }
}
