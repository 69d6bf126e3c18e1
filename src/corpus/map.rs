//! A file mapped into memory, read-only: the one place of this crate with unsafe code.
#![allow(unsafe_code)]

use crate::corpus::record::FileRecord;
use crate::{Error, Result};
use memmap2::Mmap;
use std::fs::File;
use std::ops::Deref;
use std::path::Path;

/// The bytes of a file whose length and hash were what its manifest says.
#[derive(Debug)]
pub struct MappedFile(Option<Mmap>);

impl MappedFile {
    /// Maps `path` after checking its length, then checks its SHA-256.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::File`] when length or hash differ from `expected`.
    pub fn open(path: &Path, expected: &FileRecord) -> Result<Self> {
        let help = "the file was cut or changed after it was written: make the corpus again";
        let mapped = MappedFile::map(path, expected.bytes, help)?;
        expected.check(path, &mapped)?;
        Ok(mapped)
    }

    /// Maps `path` after checking its length alone; `help` is for the message if it differs.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::File`] when the file hasn't `expected` bytes.
    pub fn map(path: &Path, expected: u64, help: &str) -> Result<Self> {
        let file = File::open(path).map_err(Error::io(path))?;
        let bytes = file.metadata().map_err(Error::io(path))?.len();
        if bytes != expected {
            return Err(Error::file(path, format!("{bytes} bytes"), format!("{expected} bytes"), help));
        }
        if bytes == 0 {
            return Ok(MappedFile(None)); // an empty file can't be mapped everywhere
        }
        // SAFETY: the mapping is read-only, and the file is never changed in place: what is mapped is written under
        // another name and renamed, so replacing one leaves this mapping on the old file. A program that cuts the
        // file under us would end the process (SIGBUS); nothing here can prevent that, and nothing of ours does it.
        Ok(MappedFile(Some(unsafe { Mmap::map(&file) }.map_err(Error::io(path))?)))
    }
}

impl Deref for MappedFile {
    type Target = [u8];

    fn deref(&self) -> &[u8] {
        self.0.as_deref().unwrap_or(&[])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn length_and_hash_are_checked() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("tokens.u16");
        for bytes in [b"".as_slice(), b"abcd"] {
            std::fs::write(&path, bytes).unwrap();
            let record = FileRecord::of(bytes);
            assert_eq!(&*MappedFile::open(&path, &record).unwrap(), bytes);
        }
        let cut = MappedFile::open(&path, &FileRecord::of(b"abcde")).unwrap_err().to_string();
        assert!(cut.contains("found 4 bytes, expected 5 bytes"), "{cut}");
        let other = MappedFile::open(&path, &FileRecord::of(b"abce")).unwrap_err().to_string();
        assert!(other.contains("SHA-256"), "{other}");
        assert!(MappedFile::open(&dir.path().join("none"), &FileRecord::of(b"")).is_err());
    }
}
