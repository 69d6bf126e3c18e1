//! Products of bytes against plain loops, on every way of multiplying.

use super::*;
use crate::decode::kernel::Left;
use crate::op::check::numbers;
#[cfg(target_arch = "x86_64")]
use pulp::x86::V3;
use round::MOST;

/// The ways that this processor has, whatever the kernels may use.
fn ways() -> Vec<Way> {
    let mut ways = vec![Way::Plain];
    if quads::are_there() {
        ways.push(Way::Quads);
    }
    #[cfg(target_arch = "x86_64")]
    ways.extend(V3::try_new().map(Way::Pairs));
    ways
}

/// A matrix of bytes, packed.
struct Bytes {
    way: Way,
    k: usize,
    columns: usize,
    /// (columns, k).
    numbers: Vec<i8>,
    panels: Vec<i8>,
    excess: Vec<i32>,
    scale: Vec<f32>,
    bias: Vec<f32>,
}

/// Columns of a panel: those of AVX-512, which [`Way::Quads`] needs.
const PANEL: usize = 32;

impl Bytes {
    fn new(way: Way, k: usize, panels: usize) -> Bytes {
        let (columns, word) = (panels * PANEL, way.word());
        let bytes: Vec<i8> = numbers(2, columns * k, 127.0).iter().map(|x| x.round() as i8).collect();
        let mut packed = vec![0i8; columns * way.words(k) * word];
        for (j, column) in bytes.chunks(k).enumerate() {
            for (i, byte) in column.iter().enumerate() {
                let at = (j / PANEL * way.words(k) + i / word) * PANEL + j % PANEL;
                packed[at * word + i % word] = *byte;
            }
        }
        let excess = bytes.chunks(k).map(|column| way.excess(column.iter().copied())).collect();
        let (scale, bias) = (numbers(3, columns, 0.1), numbers(4, columns, 1.0));
        Bytes { way, k, columns, numbers: bytes, panels: packed, excess, scale, bias }
    }

    fn product(&self, c: &mut [f32], ldc: usize, rows: &Rows, m: usize) {
        let Bytes { k, panels, excess, scale, bias, .. } = self;
        Product { c, ldc, rows, m, k: *k, panels, panel: PANEL, scale, excess, bias }.run(self.way);
    }
}

#[test]
fn products_are_those_of_plain_loops_over_rounded_rows() {
    for (m, way) in [1, 2, 3, 4, 5, 7, 8, 9, 17].into_iter().flat_map(|m| ways().into_iter().map(move |way| (m, way))) {
        for (k, width, panels) in [(1usize, 1, 1), (7, 3, 2), (64, 64, 3), (130, 64, 1), (515, 515, 2)] {
            let stride = width + 3;
            let data = numbers(1, k.div_ceil(width) * m * stride, 2.0);
            let at = |row: usize, i: usize| data[(i / width * m + row) * stride + i % width];
            let matrix = Bytes::new(way, k, panels);
            let mut rows = Rows::default();
            rows.round(Left { data: &data, rows: m, width, stride }, k, way);
            let ldc = matrix.columns + 5;
            let mut c = vec![7.0; m * ldc];
            matrix.product(&mut c, ldc, &rows, m);
            for row in 0..m {
                let most = (0..k).map(|i| at(row, i).abs()).fold(0.0, f32::max);
                let rounded = |i: usize| (at(row, i) * (MOST / most)).round_ties_even() as i64;
                for (j, column) in matrix.numbers.chunks(k).enumerate() {
                    let sum: i64 = column.iter().enumerate().map(|(i, byte)| rounded(i) * i64::from(*byte)).sum();
                    // to the last bit: this is how every processor scales a sum
                    let expected = sum as f32 * (most / MOST * matrix.scale[j]) + matrix.bias[j];
                    assert_eq!(c[row * ldc + j], expected, "{way:?} ({m}, {k}), row {row}, column {j}");
                }
                assert!(c[row * ldc + matrix.columns..(row + 1) * ldc].iter().all(|x| *x == 7.0));
            }
        }
    }
}

#[test]
fn rows_of_zeros_are_biases_and_what_is_no_number_stays_none() {
    for way in ways() {
        let matrix = Bytes { bias: vec![0.5; PANEL], ..Bytes::new(way, 8, 1) };
        // 1e-42 is subnormal: its scale vanishes
        for (x, expected) in [(0.0, 0.5), (f32::NAN, f32::NAN), (f32::INFINITY, f32::NAN), (1e-42, 0.5)] {
            let mut rows = Rows::default();
            rows.round(Left::whole(&[0.0, x, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0], 1, 8, 8), 8, way);
            let mut c = vec![0.0; PANEL];
            matrix.product(&mut c, PANEL, &rows, 1);
            assert!(c.iter().all(|c| (c - expected).abs() < 1e-6 || (c.is_nan() && expected.is_nan())), "{x}: {c:?}");
        }
    }
}
