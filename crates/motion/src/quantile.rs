//! Quantiles of numbers that were measured.

/// The `q` quantile: the number that stands nearest to it; 0 of nothing.
pub(crate) fn nearest(mut values: Vec<f64>, q: f64) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    let at = ((values.len() - 1) as f64 * q).round() as usize;
    *values.select_nth_unstable_by(at, f64::total_cmp).1
}

/// The `q` quantile, linear between neighbours as NumPy's; 0 of nothing.
pub(crate) fn linear(mut values: Vec<f64>, q: f64) -> f64 {
    if values.is_empty() {
        return 0.0;
    }
    values.sort_by(f64::total_cmp);
    let at = (values.len() - 1) as f64 * q;
    let below = values[at as usize];
    below + (values[at.ceil() as usize] - below) * at.fract()
}
