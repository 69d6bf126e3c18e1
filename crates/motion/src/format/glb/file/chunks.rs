//! The chunks of a GLB (glTF 2.0, section 4.4).

use crate::{Error, FaultKind, FileError, Result};
use kinelm_store::SourcePos;
use std::path::Path;

/// The kind of a chunk, its name read as a number.
const JSON: u32 = u32::from_le_bytes(*b"JSON");
const BINARY: u32 = u32::from_le_bytes(*b"BIN\0");

/// The chunks of a file: its document, its buffer if it has one, and whatever else, by kind.
pub struct Chunks<'a> {
    pub json: &'a [u8],
    pub binary: Option<&'a [u8]>,
    pub others: Vec<(u32, &'a [u8])>,
}

impl<'a> Chunks<'a> {
    /// The chunks of these bytes.
    ///
    /// # Errors
    /// [`FaultKind::NotThisFormat`] for bytes that are no GLB of version 2, or are cut off.
    pub fn parse(path: &Path, bytes: &'a [u8]) -> Result<Self> {
        let bad = |found: String, expected: &str| not_this(path, found, expected);
        let word = |at: usize| Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?));
        if !bytes.starts_with(b"glTF") {
            return Err(bad(crate::format::sniff(bytes).to_owned(), "a GLB (binary glTF)"));
        }
        if word(4) != Some(2) {
            return Err(bad(format!("glTF of version {}", word(4).unwrap_or(0)), "version 2"));
        }
        // magic, version and length, 4 bytes each, are before the first chunk
        let (mut at, mut json, mut binary, mut others) = (12usize, None, None, Vec::new());
        while let (Some(length), Some(kind)) = (word(at), word(at + 4)) {
            let chunk = bytes.get(at + 8..(at + 8).saturating_add(length as usize));
            let Some(chunk) = chunk else {
                return Err(bad(format!("a chunk of {length} bytes at byte {at}"), "all of it; the file was cut off"));
            };
            match kind {
                JSON if json.is_none() => json = Some(chunk),
                BINARY if binary.is_none() => binary = Some(chunk),
                _ => others.push((kind, chunk)),
            }
            at += 8 + length as usize;
        }
        let json = json.ok_or_else(|| bad("no JSON chunk".into(), "a GLB with one"))?;
        Ok(Chunks { json, binary, others })
    }

    /// The file of these chunks; `what` names it in an error.
    ///
    /// # Errors
    /// [`Unsupported`](kinelm_store::Error::Unsupported) for more bytes than a GLB can have, 4 GiB.
    pub fn bytes(&self, what: &str) -> Result<Vec<u8>> {
        let own = [(JSON, Some(self.json), b' '), (BINARY, self.binary, 0)];
        let own = own.into_iter().filter_map(|(kind, chunk, pad)| Some((kind, chunk?, pad)));
        let all: Vec<_> = own.chain(self.others.iter().map(|&(kind, chunk)| (kind, chunk, 0))).collect();
        // chunks are aligned to 4 bytes, JSON with blanks and binary with zeros
        let whole = 12 + all.iter().map(|(_, chunk, _)| 8 + chunk.len().next_multiple_of(4)).sum::<usize>();
        let length = u32::try_from(whole)
            .map_err(|_| Error::unsupported(what.to_owned(), format!("{whole} bytes; a GLB has 4 GiB at most")))?;
        let mut out = Vec::with_capacity(whole);
        out.extend(b"glTF");
        out.extend([2, length].into_iter().flat_map(u32::to_le_bytes));
        for (kind, chunk, pad) in all {
            let padded = chunk.len().next_multiple_of(4);
            out.extend([padded as u32, kind].into_iter().flat_map(u32::to_le_bytes));
            out.extend_from_slice(chunk);
            out.resize(out.len() + padded - chunk.len(), pad);
        }
        Ok(out)
    }
}

pub fn not_this(path: &Path, found: String, expected: &str) -> Error {
    FileError::new(SourcePos::file(path), FaultKind::NotThisFormat, found, expected).into()
}
