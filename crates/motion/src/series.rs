//! Small statistics of measured series: quantiles, and steps that stand out.

use crate::Clip;

/// A root step is a jump if it is longer than this and stands out, metres. It stands out if it is more than three times as
/// long as the steps two frames before and after it: a fast movement has fast neighbours, a capture glitch has not.
pub const ROOT_JUMP_M: f64 = 0.05;

/// Root jumps of a clip: frame `f` and the length in metres of the step from `f - 1` to `f`.
pub(crate) fn root_jumps(clip: &Clip) -> Vec<(usize, f64)> {
    jumps(clip.root().windows(2).map(|w| w[0].distance(w[1])).collect(), ROOT_JUMP_M).collect()
}

/// Frames whose step from the frame before exceeds `limit` and three times the steps two frames away. `steps[0]` leads
/// to frame 1.
pub(crate) fn jumps(steps: Vec<f64>, limit: f64) -> impl Iterator<Item = (usize, f64)> {
    let around = steps.clone();
    let neighbours = move |i: usize| {
        // two frames away: a glitch of one frame makes two steps, there and back, which must not excuse each other
        let before = i.checked_sub(2).map_or(0.0, |k| around[k]);
        before.max(around.get(i + 2).copied().unwrap_or(0.0))
    };
    steps.into_iter().enumerate().filter(move |&(i, s)| s > limit && s > 3.0 * neighbours(i)).map(|(i, s)| (i + 1, s))
}

/// The `q` quantile as the nearest of the values; 0 if there are none.
pub(crate) fn nearest_quantile(mut values: Vec<f64>, q: f64) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let at = ((values.len() - 1) as f64 * q).round() as usize;
    *values.select_nth_unstable_by(at, f64::total_cmp).1
}

/// The `q` quantile, linear between neighbours as NumPy's default; 0 if there are no values.
pub(crate) fn linear_quantile(mut values: Vec<f64>, q: f64) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    values.sort_by(f64::total_cmp);
    let at = (values.len() - 1) as f64 * q;
    let below = values[at as usize];
    below + (values[at.ceil() as usize] - below) * at.fract()
}
