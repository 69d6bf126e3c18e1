//! Dot products, number by number, summed in f64.

use half::f16;

/// Of each row of half floats with `query`, whose length is a row's.
pub fn dots(rows: &[u16], query: &[f32]) -> Vec<f64> {
    let number = |bits: u16| f16::from_bits(bits).to_f64();
    let dot = |row: &[u16]| row.iter().zip(query).map(|(&x, &y)| number(x) * f64::from(y)).sum();
    rows.chunks_exact(query.len()).map(dot).collect()
}
