//! SHA-256 of files and bytes, in hexadecimal.

use crate::{Error, Result, input};
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::path::Path;

/// Length and hash of a file.
///
/// ```
/// let record = kinelm_store::FileRecord::of(b"abc");
/// assert_eq!((record.bytes, &record.sha256[..8]), (3, "ba7816bf"));
/// assert!(record.check("a.txt".as_ref(), b"abd").is_err());
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileRecord {
    /// Length in bytes.
    pub bytes: u64,
    /// SHA-256, hexadecimal.
    pub sha256: String,
}

impl FileRecord {
    /// The record of a file with these bytes.
    pub fn of(bytes: &[u8]) -> Self {
        FileRecord { bytes: bytes.len() as u64, sha256: of(bytes) }
    }

    /// Refuses other bytes than the file's.
    ///
    /// # Errors
    /// [`Error::File`] with both records.
    pub fn check(&self, path: &Path, bytes: &[u8]) -> Result<()> {
        let found = FileRecord::of(bytes);
        if found == *self {
            return Ok(());
        }
        let text = |r: &FileRecord| format!("{} bytes with SHA-256 {}", r.bytes, r.sha256);
        let help = "the file was changed after it was written: make the corpus again";
        Err(Error::file(path, text(&found), text(self), help))
    }
}

/// SHA-256 of bytes as 64 hexadecimal digits.
pub fn of(bytes: &[u8]) -> String {
    hex(Sha256::new_with_prefix(bytes))
}

/// A finished hash as 64 hexadecimal digits.
pub fn hex(hash: Sha256) -> String {
    // lower case: hashes are compared as text
    hash.finalize().iter().map(|b| format!("{b:02x}")).collect()
}

/// SHA-256 of a file, read in pieces.
///
/// # Errors
/// [`Error::Io`].
pub fn of_file(path: &Path) -> Result<String> {
    let mut hash = Sha256::new();
    let mut file = input::peek(path).map_err(Error::io(path))?;
    std::io::copy(&mut file, &mut hash).map_err(Error::io(path))?;
    Ok(hex(hash))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_hash_is_sha256() {
        // FIPS 180-2, appendix B.1
        let expected = "ba7816bf8f01cfea414140de5dae2223b00361a396177a9cb410ff61f20015ad";
        assert_eq!(FileRecord::of(b"abc"), FileRecord { bytes: 3, sha256: expected.into() });
    }
}
