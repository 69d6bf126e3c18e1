//! Dot products, number by number.

/// The product of each row of bytes with `query`, which is as long as a row.
pub fn dots(rows: &[i8], query: &[i16]) -> Vec<i64> {
    let dot = |row: &[i8]| row.iter().zip(query).map(|(&x, &y)| i64::from(x) * i64::from(y)).sum();
    rows.chunks_exact(query.len()).map(dot).collect()
}
