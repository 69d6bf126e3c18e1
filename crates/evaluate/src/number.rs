//! Figures in tables.

/// `x` with `digits` digits after the point; `n/a` for `None`.
pub(crate) fn number(x: Option<f64>, digits: usize) -> String {
    x.map_or("n/a".into(), |x| format!("{x:.digits$}"))
}

/// A share in percent, with two digits.
pub(crate) fn percent(share: Option<f64>) -> String {
    number(share.map(|share| 100.0 * share), 2)
}
