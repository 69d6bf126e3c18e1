//! Weights in a quarter of their size: matrices as 8-bit integers with a scale for each row, an output of the matrix or a
//! row of a table; vectors, and the whole numbers of a forecast, as they are.
//!
//! Limits: f32 alone; a number of a matrix is off by up to half a step, about 1/254 of the largest of its row.
//!
//! A file: `KINELMW1`; for each tensor, by name: the name's length (u16) and bytes, the number of sides (u8) and each side
//! (u32), then of a vector or a forecast its numbers (f32), of anything else a scale (f32) for each row, and the rows (i8). Little-endian.

use kinelm_model::weights::{Array, Weights};
use kinelm_model::{Error, Result, forecast};
use std::path::Path;

const MAGIC: &[u8; 8] = b"KINELMW1";
/// The largest integer.
const MOST: f32 = 127.0;

/// The bytes of weights, packed.
///
/// # Errors
/// Names of more than 65,535 bytes.
pub fn pack(weights: &Weights) -> Result<Vec<u8>> {
    let mut out = MAGIC.to_vec();
    for (name, array) in weights {
        let length =
            u16::try_from(name.len()).map_err(|_| Error::Weights(format!("a name of {} bytes", name.len())))?;
        out.extend(length.to_le_bytes());
        out.extend(name.bytes());
        out.push(array.shape().len() as u8);
        out.extend(array.shape().iter().flat_map(|&side| (side as u32).to_le_bytes()));
        if is_exact(name, array.shape().len()) {
            out.extend(array.numbers().iter().flat_map(|x| x.to_le_bytes()));
            continue;
        }
        let scales: Vec<f32> = array.rows().map(scale_of).collect();
        out.extend(scales.iter().flat_map(|x| x.to_le_bytes()));
        for (row, &scale) in array.rows().zip(&scales) {
            // a row of zeros has no step
            let whole = |x: &f32| if scale > 0.0 { (x / scale).round() as i8 } else { 0 };
            out.extend(row.iter().map(|x| whole(x) as u8));
        }
    }
    Ok(out)
}

/// Whether a tensor is stored as it is.
fn is_exact(name: &str, sides: usize) -> bool {
    sides < 2 || forecast::is_tensor(name)
}

/// The step of a row's integers. Its last 8 bits are 0, so that 127 steps are exact, and packing again gives the same.
fn scale_of(row: &[f32]) -> f32 {
    let most = row.iter().fold(0.0f32, |most, x| most.max(x.abs()));
    // rounded up, so that no number is more than 127 steps
    f32::from_bits((most / MOST).to_bits().div_ceil(256) * 256)
}

/// The weights in f32.
///
/// # Errors
/// Bytes that [`pack`] did not make.
pub fn expand(bytes: &[u8]) -> Result<Weights> {
    let mut rest = Rest(bytes);
    if rest.take(MAGIC.len())? != MAGIC {
        return Err(wrong());
    }
    let mut weights = Weights::new();
    while !rest.0.is_empty() {
        let length = u16::from_le_bytes(rest.array()?);
        let name = String::from_utf8(rest.take(length.into())?.to_vec()).map_err(|_| wrong())?;
        let rank = rest.array::<1>()?[0];
        let sides = (0..rank).map(|_| Ok(u32::from_le_bytes(rest.array()?) as usize)).collect::<Result<Vec<_>>>()?;
        let count = sides.iter().try_fold(1usize, |n, &side| n.checked_mul(side)).ok_or_else(wrong)?;
        let numbers = if is_exact(&name, sides.len()) {
            rest.floats(count)?
        } else {
            let scales = rest.floats(sides[0])?;
            // at least 1: `chunks` of 0 panics, and empty tensors have no row
            let width = (count / sides[0].max(1)).max(1);
            let rows = rest.take(count)?.chunks(width).zip(&scales);
            rows.flat_map(|(row, &scale)| row.iter().map(move |&x| f32::from(x as i8) * scale)).collect()
        };
        weights.insert(name, Array::new(&sides, numbers));
    }
    Ok(weights)
}

fn wrong() -> Error {
    Error::file(Path::new("the ready model"), "damaged weights", "weights as they were packed", "install kinelm again")
}

/// What is left to read.
struct Rest<'a>(&'a [u8]);

impl<'a> Rest<'a> {
    fn take(&mut self, n: usize) -> Result<&'a [u8]> {
        let (taken, rest) = self.0.split_at_checked(n).ok_or_else(wrong)?;
        self.0 = rest;
        Ok(taken)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N]> {
        self.take(N)?.try_into().map_err(|_| wrong())
    }

    fn floats(&mut self, n: usize) -> Result<Vec<f32>> {
        let bytes = self.take(n.checked_mul(4).ok_or_else(wrong)?)?;
        Ok(bytes.chunks_exact(4).map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]])).collect())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn weights_come_back_within_half_a_step_of_their_row() {
        let matrix: Vec<f32> = (0..12).map(|i| (i as f32 - 5.0) * if i < 4 { 0.001 } else { 1.0 }).collect();
        let weights = Weights::from([
            ("a".to_string(), Array::new(&[3, 4], matrix.clone())),
            ("b".to_string(), Array::new(&[2], vec![0.1, -7.0])),
            ("zero".to_string(), Array::full(&[2, 2], 0.0)),
            ("forecast.own".to_string(), Array::new(&[1, 2], vec![65_537.0, -1.0])),
        ]);
        let bytes = pack(&weights).unwrap();
        let back = expand(&bytes).unwrap();
        assert_eq!(back["b"].numbers(), [0.1, -7.0]);
        assert_eq!(back["zero"].numbers(), [0.0; 4]);
        assert_eq!(back["forecast.own"].numbers(), [65_537.0, -1.0]);
        for (row, own) in back["a"].rows().zip(matrix.chunks(4)) {
            let step = own.iter().fold(0.0f32, |most, x| most.max(x.abs())) / MOST;
            assert!(row.iter().zip(own).all(|(a, b)| (a - b).abs() <= 0.51 * step), "{row:?} {own:?}");
        }
        // the same again: what was packed and expanded is packed without loss
        assert_eq!(pack(&back).unwrap(), bytes);
        for end in [0, 3, 9, 12, bytes.len() - 1] {
            assert!(expand(&bytes[..end]).is_err(), "{end}");
        }
    }
}
