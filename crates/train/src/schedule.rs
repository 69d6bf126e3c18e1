//! The learning rate over a run.

use super::config::{Schedule, TrainConfig};

/// The rate of the update that makes step `step` (from 0) of the run.
///
/// It rises linearly over the warm-up: update 0 has 1/warmup of the rate, update warmup - 1 all of it.
///
/// ```
/// # use kinelm_train::{Schedule, TrainConfig, schedule::rate};
/// let config =
///     TrainConfig { steps: 100, warmup: 10, learning_rate: 1e-3, schedule: Schedule::Constant, ..Default::default() };
/// assert_eq!([0, 9, 99].map(|step| rate(&config, step)), [1e-4, 1e-3, 1e-3]);
/// ```
pub fn rate(config: &TrainConfig, step: u64) -> f64 {
    let most = config.learning_rate;
    if step < config.warmup {
        return most * (step + 1) as f64 / config.warmup as f64;
    }
    match config.schedule {
        Schedule::Constant => most,
        Schedule::Cosine => {
            // from the first full rate, update `warmup`, to the last update: at both ends the cosine is exact
            let length = config.steps.saturating_sub(config.warmup + 1).max(1);
            let done = ((step - config.warmup) as f64 / length as f64).min(1.0);
            let share = 0.5 * (1.0 + (std::f64::consts::PI * done).cos());
            most * (config.final_share + (1.0 - config.final_share) * share)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_rate_rises_and_falls_where_it_should() {
        let config = TrainConfig { steps: 101, warmup: 10, learning_rate: 1.0, ..Default::default() };
        let close = |step, expected: f64| {
            let found = rate(&config, step);
            assert!((found - expected).abs() < 1e-12, "step {step}: {found}, expected {expected}");
        };
        close(0, 0.1);
        close(9, 1.0);
        close(10, 1.0);
        close(55, 0.55);
        close(100, 0.1);
        close(5000, 0.1);
        let constant = TrainConfig { schedule: Schedule::Constant, warmup: 0, ..config };
        assert_eq!([0, 50, 100].map(|s| rate(&constant, s)), [1.0; 3]);
    }

    #[test]
    fn a_run_shorter_than_its_warm_up_has_rates_too() {
        let config = TrainConfig { steps: 3, warmup: 100, learning_rate: 1.0, ..Default::default() };
        assert_eq!([0, 1, 2].map(|s| rate(&config, s)), [0.01, 0.02, 0.03]);
    }
}
