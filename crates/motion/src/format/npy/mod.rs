//! `.npy` files: a [header](Header), then the elements of one [`Array`].

mod header;

pub(crate) use header::MAX_HEADER;
pub use header::{Header, parse as parse_header};

use super::array::{Array, Element, byte_count};
use super::pickle::Pickle;
use crate::Result;
use crate::error::{FaultKind, FileError};
use kinelm_store::SourcePos;
use std::borrow::Cow;
use std::path::Path;

impl<'a> Array<'a> {
    /// Parses an `.npy` file: header and elements. Bytes after the elements are ignored.
    ///
    /// An array of Python objects is accepted if all are plain text.
    ///
    /// # Errors
    /// [`FaultKind::NotThisFormat`], [`FaultKind::Dtype`], [`FaultKind::Truncated`] (see [`parse_header`]);
    /// [`FaultKind::ObjectArray`] for Python objects other than text.
    pub fn parse(path: &Path, key: &str, bytes: &'a [u8]) -> Result<Self> {
        let header = parse_header(path, key, bytes)?;
        let data = bytes.get(header.length..).unwrap_or_default();
        if header.dtype.element == Element::Object {
            return objects(path, key, &header, data);
        }
        let expected = byte_count(&header.shape, &header.dtype).and_then(|n| usize::try_from(n).ok());
        let data = expected.and_then(|n| data.get(..n)).unwrap_or(data);
        Array::new(path, key, header.dtype, header.shape, header.order, Cow::Borrowed(data))
    }
}

/// An array of Python objects, which is a pickle; only text is accepted.
fn objects(path: &Path, key: &str, header: &Header, data: &[u8]) -> Result<Array<'static>> {
    let refused = |found: String| {
        let found = format!("{key}: {found}");
        let e = FileError::new(SourcePos::file(path), FaultKind::ObjectArray, found, "numbers or text");
        e.help("save it again without Python objects; they are never run")
    };
    let pickle = Pickle::parse(path, data).map_err(|e| refused(format!("an array of Python objects ({e})")))?;
    match pickle.top().texts() {
        Some(texts) => Array::from_texts(path, key, header.shape.clone(), &texts),
        None => Err(refused("an array of Python objects".into()).into()),
    }
}
