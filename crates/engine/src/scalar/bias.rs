//! Rows and a bias of their width, in f64.

use crate::op::dropout::{Mask, growth, kept, threshold};

/// The sum of each column.
pub fn column_sums(x: &[f32], width: usize) -> Vec<f64> {
    let mut sums = vec![0.0; width];
    x.iter().enumerate().for_each(|(i, &x)| sums[i % width] += x as f64);
    sums
}

/// x + dropout(y + bias).
pub fn residual(x: &[f32], y: &[f32], bias: &[f32], mask: Mask) -> Vec<f64> {
    let sums: Vec<f64> = y.iter().enumerate().map(|(i, &y)| y as f64 + bias[i % bias.len()] as f64).collect();
    x.iter().zip(masked(&sums, bias.len(), mask)).map(|(&x, y)| x as f64 + y).collect()
}

/// Rows of `width` numbers after a mask.
pub fn masked(x: &[f64], width: usize, mask: Mask) -> Vec<f64> {
    let (threshold, growth) = (threshold(mask.share), growth(mask.share) as f64);
    let factor = |i: usize| match kept(mask.key, mask.first_row + (i / width) as u64, (i % width) as u32, threshold) {
        true => growth,
        false => 0.0,
    };
    x.iter().enumerate().map(|(i, x)| x * factor(i)).collect()
}
