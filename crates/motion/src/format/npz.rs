//! `.npz`: a zip of `.npy` files, read entry by entry and written.
//!
//! Stored and deflated entries, zip64, and all of numpy's header versions are read. Declared sizes are not trusted: an entry
//! is read up to the size in its array's header, and the total stays within `MAX_BYTES` and, beyond 64 MiB, within 64
//! times the archive. Recorded motion compresses by 2 or 3, a zip bomb by 1,000.

use super::array::{Array, Element, byte_count, padded, tuple};
use super::{npy, sniff};
use crate::error::{FaultKind, FileError};
use crate::{Error, Result};
use kinelm_store::SourcePos;
use std::cell::{Cell, RefCell};
use std::io::{Cursor, Read, Write};
use std::path::{Path, PathBuf};
use zip::result::{ZipError, ZipResult};
use zip::write::SimpleFileOptions;
use zip::{CompressionMethod, ZipArchive, ZipWriter};

/// Most bytes read from one archive. An hour of AMASS at 120 frames per second takes half of it.
pub(crate) const MAX_BYTES: u64 = 1 << 30;

/// An archive in memory.
#[derive(Debug)]
pub struct Npz<'a> {
    path: PathBuf,
    zip: RefCell<ZipArchive<Cursor<&'a [u8]>>>,
    keys: Vec<String>,
    budget: u64,
    left: Cell<u64>,
}

impl<'a> Npz<'a> {
    /// Opens the archive in `bytes`; `path` is used in messages.
    ///
    /// # Errors
    /// [`FaultKind::NotThisFormat`] without a zip's first bytes, [`FaultKind::Truncated`] for a truncated or damaged archive.
    pub fn open(path: &Path, bytes: &'a [u8]) -> Result<Self> {
        let fault = |kind, found: String, expected: &str| FileError::new(SourcePos::file(path), kind, found, expected);
        if !bytes.starts_with(b"PK") {
            let found = sniff(bytes).into();
            return Err(fault(FaultKind::NotThisFormat, found, "an npz, which is a zip of arrays").into());
        }
        check_zip64(bytes).map_err(|found| fault(FaultKind::Truncated, found.into(), "a whole zip archive"))?;
        let zip = ZipArchive::new(Cursor::new(bytes))
            .map_err(|e| fault(FaultKind::Truncated, format!("a damaged zip archive ({e})"), "a whole one"))?;
        let mut keys: Vec<String> = zip
            .file_names_raw()
            .map(String::from_utf8_lossy)
            .filter_map(|n| n.strip_suffix(".npy").map(str::to_owned))
            .collect();
        keys.sort_unstable();
        let budget = budget(bytes.len());
        Ok(Npz { path: path.to_owned(), zip: RefCell::new(zip), keys, budget, left: Cell::new(budget) })
    }

    /// The names of the arrays, sorted.
    pub fn keys(&self) -> &[String] {
        &self.keys
    }

    /// Whether an array of this name exists.
    pub fn has(&self, key: &str) -> bool {
        self.keys.iter().any(|k| k == key)
    }

    /// Reads the array of this name.
    ///
    /// # Errors
    /// [`FaultKind::KeyMissing`], which lists the existing keys; [`FaultKind::Truncated`] for a damaged entry; those of
    /// [`Array::parse`]; [`FaultKind::TooLarge`] beyond `MAX_BYTES`.
    pub fn array(&self, key: &str) -> Result<Array<'static>> {
        self.optional(key)?.ok_or_else(|| self.missing(key))
    }

    /// Reads the array of this name, if it exists.
    ///
    /// # Errors
    /// Those of [`Npz::array`], except for the missing key.
    pub fn optional(&self, key: &str) -> Result<Option<Array<'static>>> {
        if !self.has(key) {
            return Ok(None);
        }
        let bytes = self.entry(key)?;
        Ok(Some(Array::parse(&self.path, key, &bytes)?.into_owned()))
    }

    /// [`FaultKind::KeyMissing`] for `key`, with the existing keys.
    pub fn missing(&self, key: &str) -> Error {
        FileError::new(SourcePos::file(&self.path), FaultKind::KeyMissing, list(&self.keys), key).into()
    }

    /// Reads an entry: its header, then as many bytes as its array needs.
    fn entry(&self, key: &str) -> Result<Vec<u8>> {
        let cut = |e: &dyn std::fmt::Display| self.fault(FaultKind::Truncated, format!("{key}: {e}"), "a whole array");
        let mut zip = self.zip.borrow_mut();
        let mut entry = zip.by_name(&format!("{key}.npy")).map_err(|e| cut(&e))?;
        let mut bytes = Vec::new();
        entry.by_ref().take(npy::MAX_HEADER as u64).read_to_end(&mut bytes).map_err(|e| cut(&e))?;
        let header = npy::parse_header(&self.path, key, &bytes)?;
        let expected = match byte_count(&header.shape, &header.dtype) {
            // the entry contains a pickle; texts are short
            _ if header.dtype.element == Element::Object => 1 << 20,
            Some(n) => n + header.length as u64,
            None => {
                let found = format!("{key}: shape {} of {}", tuple(&header.shape), header.dtype);
                return Err(self.fault(FaultKind::Truncated, found, "a shape that fits its bytes"));
            }
        };
        if expected.max(bytes.len() as u64) > self.left.get() {
            let found = format!("{key}: an array of {expected} bytes");
            let expected = format!("at most {} in all, by the size of the archive", self.budget);
            return Err(self.fault(FaultKind::TooLarge, found, expected));
        }
        let more = expected.saturating_sub(bytes.len() as u64);
        entry.by_ref().take(more).read_to_end(&mut bytes).map_err(|e| cut(&e))?;
        // the checksum is compared at the end of the entry
        entry.read(&mut [0]).map_err(|e| cut(&e))?;
        // never below 0: no more was read than was compared with it above
        self.left.set(self.left.get() - bytes.len() as u64);
        Ok(bytes)
    }

    fn fault(&self, kind: FaultKind, found: String, expected: impl Into<String>) -> Error {
        FileError::new(SourcePos::file(&self.path), kind, found, expected).into()
    }
}

/// Most bytes that the arrays of an archive of this size may take.
fn budget(archive: usize) -> u64 {
    (archive as u64).saturating_mul(64).saturating_add(1 << 26).min(MAX_BYTES)
}

/// A list of keys for a message.
pub(super) fn list(keys: &[String]) -> String {
    let short = |k: &String| k.chars().take(60).collect::<String>();
    let shown: Vec<String> = keys.iter().take(30).map(short).collect();
    match keys.len() {
        0 => "no keys".into(),
        n if n > 30 => format!("the keys {} and {} more", shown.join(" "), n - 30),
        _ => format!("the keys {}", shown.join(" ")),
    }
}

/// Refuses zip64 directories that claim more entries than the file has room for, because the zip crate reserves memory for
/// them. Checks wherever a locator (20 bytes) precedes an end record.
fn check_zip64(bytes: &[u8]) -> std::result::Result<(), &'static str> {
    let number = |at: usize| bytes.get(at..at + 8).map(|b| u64::from_le_bytes(b.try_into().expect("8 bytes")));
    for at in memory_find(bytes, b"PK\x06\x07").filter(|at| bytes[at + 4..].get(16..20) == Some(b"PK\x05\x06")) {
        // the end record without extensible data is 56 bytes and precedes its locator; its number of entries is at 32
        let end = number(at + 8).and_then(|n| usize::try_from(n).ok()).filter(|&end| end.checked_add(56) == Some(at));
        let Some(end) = end else { return Err("a zip64 directory that is not where it is said to be") };
        // an entry of a central directory takes 46 bytes or more
        if number(end + 32).is_none_or(|entries| entries > bytes.len() as u64 / 46) {
            return Err("a zip64 directory of more entries than the file has room for");
        }
    }
    Ok(())
}

fn memory_find<'a>(bytes: &'a [u8], pattern: &'a [u8; 4]) -> impl Iterator<Item = usize> + 'a {
    bytes.windows(4).enumerate().filter(move |(_, w)| w == pattern).map(|(i, _)| i)
}

/// The values of an array to be written.
#[derive(Debug, Clone, Copy)]
pub enum Values<'a> {
    /// `<f8`.
    F64(&'a [f64]),
    /// `<f4`.
    F32(&'a [f32]),
    /// `<i4`.
    I32(&'a [i32]),
    /// `<i8`.
    I64(&'a [i64]),
    /// `<U`, as wide as the longest text.
    Text(&'a [String]),
}

/// Writes an archive: deflated, or stored if it would compress so well that the reader took it for a zip bomb.
#[derive(Default)]
pub struct Writer {
    entries: Vec<(String, Vec<u8>)>,
}

impl Writer {
    /// An empty archive.
    pub fn new() -> Self {
        Writer::default()
    }

    /// Adds an array; an empty shape is a 0-d array of one element. The same arrays give the same bytes.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) when the shape doesn't fit the values, a value isn't finite, or a key occurs
    /// twice.
    pub fn add(&mut self, key: &str, shape: &[usize], values: Values) -> Result<()> {
        let not_finite = match values {
            Values::F64(v) => v.iter().position(|x| !x.is_finite()),
            Values::F32(v) => v.iter().position(|x| !x.is_finite()),
            Values::I32(_) | Values::I64(_) | Values::Text(_) => None,
        };
        if let Some(at) = not_finite {
            let what = format!("value {at} of {key}");
            return Err(Error::invalid(what, "not finite", "a finite number, as of a body of some metres"));
        }
        if self.entries.iter().any(|(there, _)| there == key) {
            return Err(Error::invalid("a second array", key, "a name that no other array has"));
        }
        self.entries.push((key.to_owned(), npy(key, shape, values)?));
        Ok(())
    }

    /// The archive's bytes.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`] when the zip library fails.
    pub fn finish(self) -> Result<Vec<u8>> {
        let small = self.zipped(CompressionMethod::Deflated).map_err(unwritten)?;
        let whole: u64 = self.entries.iter().map(|(_, bytes)| bytes.len() as u64).sum();
        if whole > budget(small.len()) { self.zipped(CompressionMethod::Stored).map_err(unwritten) } else { Ok(small) }
    }

    fn zipped(&self, method: CompressionMethod) -> ZipResult<Vec<u8>> {
        let mut zip = ZipWriter::new(Cursor::new(Vec::new()));
        for (key, bytes) in &self.entries {
            // a fixed date for reproducible bytes; sizes above 4 GiB need zip64 from the start
            let options = SimpleFileOptions::default()
                .compression_method(method)
                .last_modified_time(zip::DateTime::default())
                .large_file(bytes.len() >= 1 << 30);
            zip.start_file(format!("{key}.npy"), options)?;
            zip.write_all(bytes)?;
        }
        Ok(zip.finish()?.into_inner())
    }
}

/// A `.npy` file of an array; `key` names it in messages.
///
/// # Errors
/// [`Invalid`](kinelm_store::Error::Invalid) when the shape doesn't fit the values.
pub fn npy(key: &str, shape: &[usize], values: Values) -> Result<Vec<u8>> {
    let (descr, count) = match values {
        Values::F64(v) => ("<f8".into(), v.len()),
        Values::F32(v) => ("<f4".into(), v.len()),
        Values::I32(v) => ("<i4".into(), v.len()),
        Values::I64(v) => ("<i8".into(), v.len()),
        Values::Text(v) => (format!("<U{}", width(v)), v.len()),
    };
    if shape.iter().try_fold(1usize, |p, &n| p.checked_mul(n)) != Some(count) {
        return Err(Error::invalid(format!("the shape of {key}"), tuple(shape), format!("one of {count} values")));
    }
    let mut bytes = header(&descr, shape);
    match values {
        Values::F64(v) => v.iter().for_each(|x| bytes.extend(x.to_le_bytes())),
        Values::F32(v) => v.iter().for_each(|x| bytes.extend(x.to_le_bytes())),
        Values::I32(v) => v.iter().for_each(|x| bytes.extend(x.to_le_bytes())),
        Values::I64(v) => v.iter().for_each(|x| bytes.extend(x.to_le_bytes())),
        Values::Text(v) => v.iter().for_each(|t| bytes.extend(padded(t, width(v)))),
    }
    Ok(bytes)
}

/// The error of the zip library.
fn unwritten(e: ZipError) -> Error {
    Error::io("the npz in memory")(e.into())
}

/// Characters of the longest text, at least 1.
fn width(texts: &[String]) -> usize {
    texts.iter().map(|t| t.chars().count()).max().unwrap_or(0).max(1)
}

/// An `.npy` header of version 1.0, padded to a multiple of 64 bytes.
fn header(descr: &str, shape: &[usize]) -> Vec<u8> {
    let mut text = format!("{{'descr': '{descr}', 'fortran_order': False, 'shape': {}, }}", tuple(shape));
    while (10 + text.len() + 1) % 64 != 0 {
        text.push(' ');
    }
    text.push('\n');
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((text.len() as u16).to_le_bytes());
    bytes.extend(text.bytes());
    bytes
}
