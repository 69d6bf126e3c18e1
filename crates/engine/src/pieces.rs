//! The division of work into pieces for threads.

use crate::op::matmul::{ROWS, TILES};

/// Rows of a piece, of `rows` in all: about 64, so that the weights are read once for 64 rows, and from four pieces
/// on a multiple of four, so that two or four threads end together. A function of the number of rows alone.
pub fn rows(rows: usize) -> usize {
    let pieces = match rows.div_ceil(64) {
        few @ 0..4 => few.max(1),
        many => many.next_multiple_of(4),
    };
    rows.div_ceil(pieces).max(1)
}

/// Rows of a weight's gradient that one piece computes: up to 144, whole tiles, in an even number of pieces. The more
/// rows, the less often the right factor is fetched.
pub fn gradient_rows(rows: usize) -> usize {
    let pieces = rows.div_ceil(ROWS).next_multiple_of(2);
    rows.div_ceil(pieces).next_multiple_of(TILES)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_are_many_alike_and_cover_all_rows() {
        for n in 1..5000 {
            let (r, g) = (rows(n), gradient_rows(n));
            assert!(r <= 64 && r * n.div_ceil(r) >= n, "{n}: {r}");
            assert!(g <= ROWS && g % TILES == 0, "{n}: {g}");
        }
        assert_eq!([rows(1), rows(64), rows(1024), rows(2048)], [1, 64, 64, 64]);
    }
}
