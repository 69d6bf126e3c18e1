//! Arrays as numpy stores them. `.npy` files ([`npy`](super::npy)), entries of an `.npz` ([`npz`](super::npz)) and pickled
//! arrays ([`pickle`](super::pickle)) are all read to an [`Array`].
//!
//! Bytes are decoded to numbers or text on request only. Sizes are trusted only once the bytes are there.

mod dtype;

pub use dtype::{Dtype, Element};

use crate::error::{FaultKind, FileError};
use crate::{Error, Result};
use kinelm_store::SourcePos;
use std::borrow::Cow;
use std::path::{Path, PathBuf};

/// An array with any number of axes, from a file.
#[derive(Debug, Clone, PartialEq)]
pub struct Array<'a> {
    path: PathBuf,
    key: String,
    dtype: Dtype,
    shape: Vec<usize>,
    order: Order,
    bytes: Cow<'a, [u8]>,
}

/// The memory order of the elements.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Order {
    /// The last axis runs fastest.
    C,
    /// The first axis runs fastest.
    Fortran,
    /// Axis `i` of the array is axis `axes[i]` of the memory, whose last axis runs fastest (numpy's order K).
    Axes(Vec<usize>),
}

impl<'a> Array<'a> {
    /// An array over `bytes`, whose length must match shape and type. `path` and `key` are used in messages.
    ///
    /// # Errors
    /// [`FaultKind::Truncated`] when the length differs.
    pub fn new(
        path: &Path,
        key: &str,
        dtype: Dtype,
        shape: Vec<usize>,
        order: Order,
        bytes: Cow<'a, [u8]>,
    ) -> Result<Self> {
        let array = Array { path: path.to_owned(), key: key.to_owned(), dtype, shape, order, bytes };
        match byte_count(&array.shape, &array.dtype) {
            Some(n) if n == array.bytes.len() as u64 && array.order_fits() => Ok(array),
            expected => {
                let expected = expected.map_or("fewer than 2^63".into(), |n| n.to_string());
                let found = format!("{} bytes for {} {:?}", array.bytes.len(), array.dtype, array.shape);
                Err(array.fault(FaultKind::Truncated, found, format!("{expected} bytes")))
            }
        }
    }

    /// An array of texts.
    ///
    /// # Errors
    /// [`FaultKind::Truncated`] when the number of texts doesn't match the shape, [`FaultKind::TooLarge`] above a million
    /// characters, counting each text as long as the longest.
    pub(crate) fn from_texts(
        path: &Path,
        key: &str,
        shape: Vec<usize>,
        texts: &[impl AsRef<str>],
    ) -> Result<Array<'static>> {
        let size = texts.iter().map(|t| t.as_ref().chars().count()).max().unwrap_or(0).max(1);
        let dtype = Dtype { element: Element::Text, size, big: false };
        let fits = size.checked_mul(texts.len()).is_some_and(|n| n <= 1 << 20);
        let bytes: Vec<u8> = if fits { texts.iter().flat_map(|t| padded(t.as_ref(), size)).collect() } else { vec![] };
        let array = Array::new(path, key, dtype, shape, Order::C, Cow::Owned(bytes));
        if fits {
            return array;
        }
        let found = format!("{key}: {} texts of up to {size} characters", texts.len());
        Err(FileError::new(SourcePos::file(path), FaultKind::TooLarge, found, "at most 2^20 characters").into())
    }

    /// The same array with owned bytes.
    pub fn into_owned(self) -> Array<'static> {
        let Array { path, key, dtype, shape, order, bytes } = self;
        Array { path, key, dtype, shape, order, bytes: Cow::Owned(bytes.into_owned()) }
    }

    /// The array's name in the file.
    pub fn key(&self) -> &str {
        &self.key
    }

    /// Lengths of the axes; empty for a 0-d array of one element.
    pub fn shape(&self) -> &[usize] {
        &self.shape
    }

    /// The element type.
    pub fn dtype(&self) -> &Dtype {
        &self.dtype
    }

    /// The number of elements.
    pub fn count(&self) -> usize {
        // the bytes exist, so the product fits
        self.shape.iter().product()
    }

    /// The elements as f64, last axis fastest: f2, f4, f8, all integers, bool.
    ///
    /// # Errors
    /// [`FaultKind::Dtype`] for other types.
    pub fn reals(&self) -> Result<Vec<f64>> {
        self.numeric(true, "numbers")?;
        if self.dtype == (Dtype { element: Element::Float, size: 8, big: false }) && self.order == Order::C {
            // nearly all files hold f8; this is twice as fast as element by element
            let double = |b: &[u8]| f64::from_le_bytes(b.try_into().expect("8 bytes"));
            return Ok(self.bytes.chunks_exact(8).map(double).collect());
        }
        Ok(self.elements().map(|b| self.dtype.real(b)).collect())
    }

    /// The elements as i64, last axis fastest: integers and bool. Unsigned values above 2^63 - 1 wrap as in numpy, where the
    /// root's parent is the largest u32 or u64.
    ///
    /// # Errors
    /// [`FaultKind::Dtype`] for other types.
    pub fn integers(&self) -> Result<Vec<i64>> {
        self.numeric(false, "integers")?;
        Ok(self.elements().map(|b| self.dtype.integer(b)).collect())
    }

    /// The elements as text, last axis fastest: `<U` and `|S`, the latter as UTF-8 or else Latin-1.
    ///
    /// # Errors
    /// [`FaultKind::Dtype`] for other types.
    pub fn texts(&self) -> Result<Vec<String>> {
        match self.dtype.element {
            Element::Text | Element::Bytes => Ok(self.elements().map(|b| self.dtype.text(b)).collect()),
            _ => Err(self.fault(FaultKind::Dtype, self.dtype.to_string(), "text")),
        }
    }

    /// The only element as f64; the array may have any number of axes.
    ///
    /// # Errors
    /// [`FaultKind::Shape`] when there is not exactly one element, and those of [`Array::reals`].
    pub fn real(&self) -> Result<f64> {
        self.one()?;
        Ok(self.reals()?[0])
    }

    /// The only element as text.
    ///
    /// # Errors
    /// [`FaultKind::Shape`] when there is not exactly one element, and those of [`Array::texts`].
    pub fn text(&self) -> Result<String> {
        self.one()?;
        Ok(self.texts()?.swap_remove(0))
    }

    /// A fault of this array, with its file and key.
    pub fn fault(&self, kind: FaultKind, found: impl AsRef<str>, expected: impl Into<String>) -> Error {
        FileError::new(SourcePos::file(&self.path), kind, format!("{}: {}", self.key, found.as_ref()), expected).into()
    }

    /// [`FaultKind::Shape`] with the expected shape.
    pub(crate) fn shape_fault(&self, expected: &str) -> Error {
        self.fault(FaultKind::Shape, format!("shape {}", tuple(&self.shape)), format!("{expected} for {}", self.key))
    }

    fn one(&self) -> Result<()> {
        if self.count() == 1 { Ok(()) } else { Err(self.shape_fault("one element")) }
    }

    fn numeric(&self, floats: bool, expected: &str) -> Result<()> {
        match self.dtype.element {
            Element::Bool | Element::Int | Element::Uint => Ok(()),
            Element::Float if floats => Ok(()),
            _ => Err(self.fault(FaultKind::Dtype, self.dtype.to_string(), expected)),
        }
    }

    fn order_fits(&self) -> bool {
        let Order::Axes(axes) = &self.order else { return true };
        let mut seen = vec![false; self.shape.len()];
        axes.len() == seen.len() && axes.iter().all(|&a| a < seen.len() && !std::mem::replace(&mut seen[a], true))
    }

    /// Strides of the axes, in elements.
    fn strides(&self) -> Vec<usize> {
        let mut strides = vec![1; self.shape.len()];
        let mut step = 1;
        let mut axis_of_memory: Vec<usize> = (0..self.shape.len()).collect();
        match &self.order {
            Order::C => {}
            Order::Fortran => axis_of_memory.reverse(),
            Order::Axes(axes) => axes.iter().enumerate().for_each(|(i, &a)| axis_of_memory[a] = i),
        }
        for &axis in axis_of_memory.iter().rev() {
            strides[axis] = step;
            step *= self.shape[axis];
        }
        strides
    }

    /// The bytes of each element, last axis fastest.
    fn elements(&self) -> Box<dyn Iterator<Item = &[u8]> + '_> {
        let size = self.dtype.bytes();
        let count = self.count();
        if size == 0 {
            // only for empty text, of which `byte_count` allows one element
            return Box::new(std::iter::repeat_n(&[][..], count));
        }
        if self.order == Order::C || self.shape.len() < 2 {
            return Box::new(self.bytes.chunks_exact(size));
        }
        let strides = self.strides();
        let mut index = vec![0; self.shape.len()];
        let mut at = 0;
        Box::new((0..count).map(move |_| {
            let element = &self.bytes[at * size..(at + 1) * size];
            for axis in (0..index.len()).rev() {
                index[axis] += 1;
                at += strides[axis];
                if index[axis] < self.shape[axis] {
                    break;
                }
                at -= strides[axis] * index[axis];
                index[axis] = 0;
            }
            element
        }))
    }
}

/// A text as numpy's UTF-32, little-endian, padded with zeros.
pub(in crate::format) fn padded(text: &str, size: usize) -> impl Iterator<Item = u8> + '_ {
    let codes = text.chars().map(u32::from).chain(std::iter::repeat(0)).take(size);
    codes.flat_map(u32::to_le_bytes)
}

/// The size of an array in bytes; `None` for impossible sizes: overflow, or many elements of no bytes.
pub(crate) fn byte_count(shape: &[usize], dtype: &Dtype) -> Option<u64> {
    if shape.len() > 32 {
        return None;
    }
    // lengths of 0 are skipped, so that no later product of lengths overflows
    let count = shape.iter().filter(|&&n| n > 0).try_fold(1u64, |p, &n| p.checked_mul(n as u64))?;
    let bytes = count.checked_mul(dtype.bytes() as u64).filter(|&n| n < 1 << 62)?;
    if dtype.bytes() == 0 && count > 1 {
        return None;
    }
    Some(if shape.contains(&0) { 0 } else { bytes })
}

/// A shape in Python's notation.
pub fn tuple(shape: &[usize]) -> String {
    match shape {
        [n] => format!("({n},)"),
        _ => format!("({})", shape.iter().map(|n| n.to_string()).collect::<Vec<_>>().join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn array(order: Order, shape: &[usize], values: &[u8]) -> Result<Array<'static>> {
        let dtype = Dtype::parse("|u1").unwrap();
        Array::new(Path::new("x.npz"), "k", dtype, shape.to_vec(), order, Cow::Owned(values.to_vec()))
    }

    #[test]
    fn orders() {
        // [[0, 1, 2], [3, 4, 5]] in the three orders
        let want = [0., 1., 2., 3., 4., 5.];
        assert_eq!(array(Order::C, &[2, 3], &[0, 1, 2, 3, 4, 5]).unwrap().reals().unwrap(), want);
        assert_eq!(array(Order::Fortran, &[2, 3], &[0, 3, 1, 4, 2, 5]).unwrap().reals().unwrap(), want);
        assert_eq!(array(Order::Axes(vec![1, 0]), &[2, 3], &[0, 3, 1, 4, 2, 5]).unwrap().reals().unwrap(), want);
        assert!(array(Order::Axes(vec![1, 1]), &[2, 3], &[0; 6]).is_err());
        assert!(array(Order::Axes(vec![0, 2]), &[2, 3], &[0; 6]).is_err());
    }

    #[test]
    fn sizes_are_not_believed() {
        assert_eq!(array(Order::C, &[3], &[1, 2]).unwrap_err().fault(), Some(FaultKind::Truncated));
        assert_eq!(array(Order::C, &[usize::MAX, 2], &[]).unwrap_err().fault(), Some(FaultKind::Truncated));
        assert!(array(Order::C, &[1 << 50, 0, 1 << 50], &[]).is_err(), "products of lengths stay small");
        let empty = Dtype::parse("<U0").unwrap();
        assert_eq!(byte_count(&[1 << 60], &empty), None);
        assert_eq!(byte_count(&[], &empty), Some(0));
        assert_eq!(byte_count(&[0, 156], &Dtype::parse("<f8").unwrap()), Some(0));
    }

    #[test]
    fn one_element_of_any_shape() {
        assert_eq!(array(Order::C, &[], &[7]).unwrap().real().unwrap(), 7.0);
        assert_eq!(array(Order::C, &[1, 1], &[7]).unwrap().real().unwrap(), 7.0);
        let e = array(Order::C, &[2], &[7, 8]).unwrap().real().unwrap_err();
        assert_eq!(e.to_string(), "x.npz: npz_shape: found k: shape (2,), expected one element for k");
        assert_eq!(array(Order::C, &[1], &[7]).unwrap().texts().unwrap_err().fault(), Some(FaultKind::Dtype));
    }
}
