//! AdamW, number by number, in f32: the fast form has the same order of operations, bit for bit.

use crate::op::adamw::Step;

/// Moves the parameters `x`; `m` and `v` are the moments.
pub fn update(x: &mut [f32], m: &mut [f32], v: &mut [f32], gradients: &[f32], step: &Step) {
    let [b1, b2] = step.betas;
    for (((x, m), v), &g) in x.iter_mut().zip(m).zip(v).zip(gradients) {
        let g = g * step.share;
        *m = b1 * *m + (1.0 - b1) * g;
        *v = b2 * *v + (1.0 - b2) * g * g;
        *x = *x * step.keep - step.step * *m / (v.sqrt() * step.root + step.epsilon);
    }
}

/// The sum of all squares.
pub fn norm_squared(gradients: &[f32]) -> f64 {
    gradients.iter().map(|&g| g as f64 * g as f64).sum()
}
