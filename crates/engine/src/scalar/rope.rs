//! Turned queries and keys, in f64.

/// `qkv` (n, 3D) of `heads` heads of `width` numbers, its queries and keys turned by `words[row % words.len()]`.
pub fn turn<T: Copy + Into<f64>>(qkv: &[T], heads: usize, width: usize, words: &[u32]) -> Vec<f64> {
    let columns = 3 * heads * width;
    let number = |i: usize| {
        let (row, column) = (i / columns, i % columns);
        let (x, j): (f64, usize) = (qkv[i].into(), column % width);
        if column >= 2 * heads * width {
            return x;
        }
        let pair = j % (width / 2);
        let angle = words[row % words.len()] as f64 * 10000f64.powf(-2.0 * pair as f64 / width as f64);
        match j < width / 2 {
            true => x * angle.cos() - qkv[i + width / 2].into() * angle.sin(),
            false => x * angle.cos() + qkv[i - width / 2].into() * angle.sin(),
        }
    };
    (0..qkv.len()).map(number).collect()
}
