//! Rotary embedding: queries and keys rotated by angles that grow with the number of their word.
//!
//! Source: Su et al., "RoFormer" (2021), in the layout that pairs the two halves of a head.

use candle_core::{D, DType, Device, Result, Tensor};

/// The angles of pair j of a head of `width` numbers grow by base^(-2j/width) a word.
const BASE: f64 = 10000.0;

/// The rotation of each pair (j, j + d/2) in these `words`: cosines and sines, `[word][pair]`.
pub fn angles(words: impl IntoIterator<Item = u32>, width: usize) -> (Vec<f64>, Vec<f64>) {
    let pair = |word: u32, j: usize| (word as f64 * BASE.powf(-2.0 * j as f64 / width as f64)).sin_cos();
    let all = words.into_iter().flat_map(|word| (0..width / 2).map(move |j| pair(word, j)));
    let (sines, cosines) = all.unzip();
    (cosines, sines)
}

/// The rotations of windows: (b, 1, T, d/2) each, b being B or, for all windows alike, 1.
pub(super) struct Rotary {
    cosines: Tensor,
    sines: Tensor,
}

impl Rotary {
    /// For tokens of these `words` (b T) and heads of `width` numbers.
    pub fn new(words: &[u32], windows: usize, width: usize, dtype: DType, device: &Device) -> Result<Rotary> {
        let (cosines, sines) = angles(words.iter().copied(), width);
        let shape = (windows, 1, words.len() / windows, width / 2);
        // in f64 up to here: an f32 angle near 1000 is off by up to 3e-5
        let tensor = |numbers| Tensor::from_vec(numbers, shape, &Device::Cpu)?.to_dtype(dtype)?.to_device(device);
        Ok(Rotary { cosines: tensor(cosines)?, sines: tensor(sines)? })
    }

    /// `x` (B, H, T, d), rotated.
    pub fn apply(&self, x: &Tensor) -> Result<Tensor> {
        let half = x.dim(D::Minus1)? / 2;
        let (a, b) = (x.narrow(D::Minus1, 0, half)?, x.narrow(D::Minus1, half, half)?);
        let times = |x: &Tensor, y: &Tensor| x.broadcast_mul(y);
        let left = (times(&a, &self.cosines)? - times(&b, &self.sines)?)?;
        let right = (times(&b, &self.cosines)? + times(&a, &self.sines)?)?;
        Tensor::cat(&[left, right], D::Minus1)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pairs_turn_by_the_word_and_products_see_the_difference() {
        let device = Device::Cpu;
        let x = Tensor::new(&[1.0, 2.0, 3.0, 4.0], &device).unwrap().reshape((1, 1, 1, 4)).unwrap();
        let turned = |x: &Tensor, word: u32| {
            Rotary::new(&[word], 1, 4, DType::F64, &device)
                .unwrap()
                .apply(x)
                .unwrap()
                .flatten_all()
                .unwrap()
                .to_vec1::<f64>()
                .unwrap()
        };
        // pairs (1, 3) by 2 radians and (2, 4) by 2/100
        let expected = [
            2f64.cos() - 3.0 * 2f64.sin(),
            2.0 * 0.02f64.cos() - 4.0 * 0.02f64.sin(),
            3.0 * 2f64.cos() + 2f64.sin(),
            4.0 * 0.02f64.cos() + 2.0 * 0.02f64.sin(),
        ];
        assert!(turned(&x, 2).iter().zip(expected).all(|(a, b)| (a - b).abs() < 1e-14));
        assert_eq!(turned(&x, 0), [1.0, 2.0, 3.0, 4.0]);
        let y = Tensor::new(&[0.5, -1.0, 2.0, 0.3], &device).unwrap().reshape((1, 1, 1, 4)).unwrap();
        let dot = |a: u32, b: u32| turned(&x, a).iter().zip(turned(&y, b)).map(|(a, b)| a * b).sum::<f64>();
        assert!((dot(3, 7) - dot(11, 15)).abs() < 1e-12);
        assert!((dot(3, 7) - dot(3, 8)).abs() > 1e-3);
    }
}
