//! Cross-entropy of rows of logits, in f64.

/// -ln p of `target` under the softmax of `row`.
pub fn nats(row: &[f32], target: u32) -> f64 {
    -probabilities(row)[target as usize].ln()
}

/// The softmax of a row.
pub fn probabilities(row: &[f32]) -> Vec<f64> {
    let most = row.iter().fold(f64::NEG_INFINITY, |m, &x| m.max(x as f64));
    let powers: Vec<f64> = row.iter().map(|&x| (x as f64 - most).exp()).collect();
    let sum: f64 = powers.iter().sum();
    powers.iter().map(|p| p / sum).collect()
}
