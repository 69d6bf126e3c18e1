//! GPT-2's GELU, 0.5 x (1 + tanh u) with u = sqrt(2/pi) (x + 0.044715 x^3), by tanh.

use std::f64::consts::{FRAC_1_SQRT_2, FRAC_2_SQRT_PI};

/// tanh u and du/dx.
fn tanh(x: f64) -> (f64, f64) {
    let scale = FRAC_2_SQRT_PI * FRAC_1_SQRT_2;
    ((scale * (x + 0.044715 * x.powi(3))).tanh(), scale * (1.0 + 3.0 * 0.044715 * x * x))
}

/// The value.
pub fn gelu(x: f64) -> f64 {
    0.5 * x * (1.0 + tanh(x).0)
}

/// The derivative.
pub fn slope(x: f64) -> f64 {
    let (t, du) = tanh(x);
    0.5 * (1.0 + t) + 0.5 * x * (1.0 - t * t) * du
}
