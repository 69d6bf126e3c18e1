//! The header of an `.npy` file: magic, version, and a Python dict of three keys.
//!
//! Parsed by hand, because a parser of arbitrary Python literals recurses as deeply as a hostile file wants.
//! Source: numpy's `numpy.lib.format`, versions 1.0, 2.0 and 3.0.

use crate::error::{FaultKind, FileError};
use crate::format::array::{Dtype, Element, Order};
use crate::{Error, Result};
use kinelm_store::SourcePos;
use std::path::Path;

/// Longest accepted header, bytes. numpy's own limit is 10,000.
pub(crate) const MAX_HEADER: usize = 1 << 16;

/// The header of an `.npy` file.
#[derive(Debug, Clone, PartialEq)]
pub struct Header {
    /// The element type.
    pub dtype: Dtype,
    /// Lengths of the axes.
    pub shape: Vec<usize>,
    /// The memory order.
    pub order: Order,
    /// Length of the header, bytes.
    pub length: usize,
}

/// Length of magic, version and length field, and of the whole header; `None` if `bytes` are too few to tell.
pub(in crate::format) fn extent(bytes: &[u8]) -> Option<(usize, usize)> {
    let v1 = *bytes.get(6)? == 1;
    let n = if v1 {
        u32::from(u16::from_le_bytes(bytes.get(8..10)?.try_into().ok()?))
    } else {
        u32::from_le_bytes(bytes.get(8..12)?.try_into().ok()?)
    };
    let before = if v1 { 10 } else { 12 };
    Some((before, before + n as usize))
}

/// Parses the header of the `.npy` in `bytes`; `path` and `key` are used in messages.
///
/// # Errors
/// [`FaultKind::NotThisFormat`] without numpy's magic or for versions other than 1.0, 2.0, 3.0; [`FaultKind::Truncated`] for
/// a header that is truncated, longer than `MAX_HEADER` or no dict of `descr`, `fortran_order`, `shape`;
/// [`FaultKind::Dtype`] for a type that [`Dtype::parse`] doesn't know.
pub fn parse(path: &Path, key: &str, bytes: &[u8]) -> Result<Header> {
    let fault = |kind, found: String, expected: &str| -> Error {
        FileError::new(SourcePos::file(path), kind, format!("{key}: {found}"), expected).into()
    };
    if !bytes.starts_with(b"\x93NUMPY") {
        let kind = if bytes.len() < 6 { FaultKind::Truncated } else { FaultKind::NotThisFormat };
        return Err(fault(kind, "no array".into(), "the magic of a numpy array"));
    }
    if let Some(&[major, minor]) = bytes.get(6..8)
        && (!(1..=3).contains(&major) || minor != 0)
    {
        return Err(fault(FaultKind::NotThisFormat, format!("version {major}.{minor}"), "version 1.0, 2.0 or 3.0"));
    }
    let cut = |n: &str| fault(FaultKind::Truncated, format!("a header cut at {} bytes", bytes.len()), n);
    let (before, length) = extent(bytes).ok_or_else(|| cut("its length"))?;
    if length > MAX_HEADER {
        return Err(fault(FaultKind::Truncated, format!("a header of {length} bytes"), "at most 65536"));
    }
    let text = bytes.get(before..length).ok_or_else(|| cut(&format!("{length} bytes")))?;
    let Some(fields) = Cursor(text).dict() else {
        let shown = String::from_utf8_lossy(&text[..text.len().min(80)]).trim().to_owned();
        return Err(fault(
            FaultKind::Truncated,
            format!("header {shown:?}"),
            "a dict of descr, fortran_order and shape",
        ));
    };
    let (Some(descr), Some(fortran), Some(shape)) = fields else {
        return Err(fault(FaultKind::Truncated, "a header that lacks a key".into(), "descr, fortran_order and shape"));
    };
    let Some(dtype) = Dtype::parse(&descr) else {
        return Err(fault(FaultKind::Dtype, format!("elements of type {descr}"), "numbers or text"));
    };
    // an array of objects contains a pickle instead of elements
    let order = if fortran && dtype.element != Element::Object { Order::Fortran } else { Order::C };
    Ok(Header { dtype, shape, order, length })
}

type Fields = (Option<String>, Option<bool>, Option<Vec<usize>>);

/// The unparsed rest of a header's text.
struct Cursor<'a>(&'a [u8]);

impl Cursor<'_> {
    fn dict(&mut self) -> Option<Fields> {
        let mut fields = (None, None, None);
        self.expect(b'{')?;
        while !self.take(b'}') {
            let key = self.string()?;
            self.expect(b':')?;
            match key.as_str() {
                "descr" => fields.0 = Some(self.descr()?),
                "fortran_order" => fields.1 = Some(self.boolean()?),
                "shape" => fields.2 = Some(self.shape()?),
                _ => return None,
            }
            if !self.take(b',') {
                self.expect(b'}')?;
                break;
            }
        }
        self.spaces();
        self.0.is_empty().then_some(fields)
    }

    fn spaces(&mut self) {
        self.0 = self.0.trim_ascii_start();
    }

    fn take(&mut self, byte: u8) -> bool {
        self.spaces();
        let there = self.0.first() == Some(&byte);
        if there {
            self.0 = &self.0[1..];
        }
        there
    }

    fn expect(&mut self, byte: u8) -> Option<()> {
        self.take(byte).then_some(())
    }

    fn string(&mut self) -> Option<String> {
        let quote = if self.take(b'\'') { b'\'' } else { self.expect(b'"').map(|()| b'"')? };
        let end = self.0.iter().position(|&b| b == quote)?;
        let text = std::str::from_utf8(&self.0[..end]).ok()?.to_owned();
        self.0 = &self.0[end + 1..];
        // no name or type has an escape, and the search for the end didn't respect any
        (!text.contains('\\')).then_some(text)
    }

    /// The text of a type; for a record the list as written, which no type matches.
    fn descr(&mut self) -> Option<String> {
        self.spaces();
        if self.0.first() != Some(&b'[') {
            return self.string();
        }
        let mut depth = 0usize;
        for (i, b) in self.0.iter().enumerate() {
            match b {
                b'[' => depth += 1,
                b']' => depth -= 1,
                _ => {}
            }
            if depth == 0 {
                let text = String::from_utf8_lossy(&self.0[..=i]).into_owned();
                self.0 = &self.0[i + 1..];
                return Some(text);
            }
        }
        None
    }

    fn boolean(&mut self) -> Option<bool> {
        self.spaces();
        for (word, value) in [(&b"True"[..], true), (b"False", false)] {
            if let Some(rest) = self.0.strip_prefix(word) {
                self.0 = rest;
                return Some(value);
            }
        }
        None
    }

    fn shape(&mut self) -> Option<Vec<usize>> {
        let mut shape = Vec::new();
        self.expect(b'(')?;
        while !self.take(b')') {
            self.spaces();
            let digits = self.0.iter().take_while(|b| b.is_ascii_digit()).count();
            shape.push(std::str::from_utf8(&self.0[..digits]).ok()?.parse().ok()?);
            // Python 2 wrote long integers with an L
            self.0 = &self.0[digits..];
            self.0 = self.0.strip_prefix(b"L").unwrap_or(self.0);
            if !self.take(b',') {
                self.expect(b')')?;
                break;
            }
        }
        Some(shape)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn npy(version: u8, text: &str) -> Vec<u8> {
        let mut b = b"\x93NUMPY".to_vec();
        b.extend([version, 0]);
        match version {
            1 => b.extend((text.len() as u16).to_le_bytes()),
            _ => b.extend((text.len() as u32).to_le_bytes()),
        }
        b.extend(text.bytes());
        b
    }

    fn read(bytes: &[u8]) -> Result<Header> {
        parse(Path::new("x.npy"), "k", bytes)
    }

    #[test]
    fn headers_of_all_versions() {
        let text = "{'descr': '<f8', 'fortran_order': True, 'shape': (3, 156), }      \n";
        for version in 1..=3 {
            let h = read(&npy(version, text)).unwrap();
            assert_eq!((h.shape, h.order, h.dtype.to_string()), (vec![3, 156], Order::Fortran, "<f8".into()));
            assert_eq!(h.length, npy(version, text).len());
        }
        let h = read(&npy(1, "{\"shape\": (7L,),\"fortran_order\":False,\"descr\":\"|S4\"}")).unwrap();
        assert_eq!((h.shape, h.order), (vec![7], Order::C));
        assert_eq!(read(&npy(1, "{'descr':'<f8','fortran_order':False,'shape':()}")).unwrap().shape, [0usize; 0]);
    }

    #[test]
    fn nonsense_is_named() {
        let kind = |b: &[u8]| read(b).unwrap_err().fault().unwrap();
        assert_eq!(kind(b"hello world"), FaultKind::NotThisFormat);
        assert_eq!(kind(b""), FaultKind::Truncated);
        assert_eq!(kind(&npy(4, "")), FaultKind::NotThisFormat);
        assert_eq!(kind(&npy(1, "{'descr': '<c16', 'fortran_order': False, 'shape': ()}")), FaultKind::Dtype);
        assert_eq!(kind(&npy(1, "{'descr': [('a', '<f8')], 'fortran_order': False, 'shape': ()}")), FaultKind::Dtype);
        for text in [
            "",
            "{",
            "{}",
            "{'descr': '<f8'}",
            "{'shape': (-1,)}",
            "{'shape': (99999999999999999999999,)}",
            "{'other': 1}",
            "{'shape': ((((((1,)))))}",
            "{'descr': [[[[[",
        ] {
            assert_eq!(kind(&npy(1, text)), FaultKind::Truncated, "{text}");
        }
        let mut long = npy(2, "{}");
        long[8..12].copy_from_slice(&u32::MAX.to_le_bytes());
        assert_eq!(kind(&long), FaultKind::Truncated);
        let whole = npy(1, "{'descr': '<f8', 'fortran_order': False, 'shape': (1,)}");
        for n in 0..whole.len() {
            assert!(read(&whole[..n]).is_err());
        }
    }
}
