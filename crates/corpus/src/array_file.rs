//! A large file of numbers: in memory, or read on demand. A file that is cut or changed while it is in use is an
//! error at worst.

use crate::{Error, Result};
use bytemuck::Pod;
use kinelm_store::hash::hex;
use kinelm_store::{FileRecord, input, memory};
use rayon::prelude::*;
use sha2::{Digest, Sha256};
use std::borrow::Cow;
use std::fs::File;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Bytes that a thread reads at a time.
const BLOCK: usize = 4 << 20;
/// The share of the free memory that a file may take.
const SHARE: u64 = 4;

/// The numbers of a file whose length was what its manifest says.
#[derive(Debug)]
pub struct ArrayFile<T> {
    path: PathBuf,
    numbers: usize,
    held: Held<T>,
    help: &'static str,
}

#[derive(Debug)]
enum Held<T> {
    Memory(Vec<T>),
    File(File),
}

impl<T: Pod + Send + Sync> ArrayFile<T> {
    /// Opens `path` after checking its length: a file of up to a quarter of the free memory is read, a larger one stays where
    /// it is. `help` is for messages about a file that is not as it was written.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`]; [`kinelm_store::Error::File`] when the file hasn't `expected` bytes.
    pub fn open(path: &Path, expected: u64, help: &'static str) -> Result<ArrayFile<T>> {
        ArrayFile::open_within(path, expected, help, memory::free().map_or(u64::MAX, |free| free / SHARE))
    }

    /// As [`ArrayFile::open`], in memory if it has at most `room` bytes.
    ///
    /// # Errors
    /// As [`ArrayFile::open`].
    pub(crate) fn open_within(path: &Path, expected: u64, help: &'static str, room: u64) -> Result<ArrayFile<T>> {
        let file = input::open(path).map_err(Error::io(path))?;
        let found = file.metadata().map_err(Error::io(path))?.len();
        if found != expected {
            return Err(Error::file(path, format!("{found} bytes"), format!("{expected} bytes"), help));
        }
        let numbers = (expected / size_of::<T>() as u64) as usize;
        let mut stored = ArrayFile { path: path.to_owned(), numbers, held: Held::File(file), help };
        if expected <= room {
            let mut all = vec![T::zeroed(); numbers];
            let block = stored.block();
            let blocks = all.par_chunks_mut(block).enumerate();
            // positional reads need no shared cursor, so threads read one file at once
            blocks.try_for_each(|(i, numbers)| stored.fill(i * block, numbers))?;
            stored.held = Held::Memory(all);
        }
        Ok(stored)
    }

    /// Checks the SHA-256.
    ///
    /// # Errors
    /// [`kinelm_store::Error::File`] when it differs from the record's; what reading fails with.
    pub fn check(&self, record: &FileRecord) -> Result<()> {
        let mut hash = Sha256::new();
        for block in self.blocks() {
            hash.update(bytemuck::cast_slice(&self.read(block)?));
        }
        match hex(hash) {
            found if found == record.sha256 => Ok(()),
            found => {
                let say = |hash: &str| format!("{} bytes with SHA-256 {hash}", record.bytes);
                Err(Error::file(&self.path, say(&found), say(&record.sha256), self.help))
            }
        }
    }

    /// How many numbers there are.
    pub fn len(&self) -> usize {
        self.numbers
    }

    /// Whether there are none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// Stretches of the numbers, of some megabytes each, which make up all.
    pub fn blocks(&self) -> impl Iterator<Item = Range<usize>> + use<T> {
        let (numbers, block) = (self.numbers, self.block());
        (0..numbers).step_by(block).map(move |first| first..(first + block).min(numbers))
    }

    /// Some of the numbers.
    ///
    /// # Errors
    /// [`kinelm_store::Error::File`] when the file has become shorter, [`kinelm_store::Error::Io`] when it can't be read any more.
    ///
    /// # Panics
    /// If the range leaves the file.
    pub fn read(&self, range: Range<usize>) -> Result<Cow<'_, [T]>> {
        if let Held::Memory(all) = &self.held {
            return Ok(Cow::Borrowed(&all[range]));
        }
        assert!(range.end <= self.numbers, "numbers {range:?} of {}", self.numbers);
        let mut numbers = vec![T::zeroed(); range.len()];
        self.fill(range.start, &mut numbers)?;
        Ok(Cow::Owned(numbers))
    }

    fn block(&self) -> usize {
        BLOCK / size_of::<T>()
    }

    /// Reads the numbers from the `first` on out of the file.
    fn fill(&self, first: usize, numbers: &mut [T]) -> Result<()> {
        let Held::File(file) = &self.held else { return Ok(()) };
        let at = (first * size_of::<T>()) as u64;
        read_at(file, bytemuck::cast_slice_mut(numbers), at).map_err(|e| {
            let expected = (self.numbers * size_of::<T>()) as u64;
            match (e.kind(), file.metadata()) {
                // the length was right when it was opened: the file was cut since
                (std::io::ErrorKind::UnexpectedEof, Ok(now)) => {
                    Error::file(&self.path, format!("{} bytes", now.len()), format!("{expected} bytes"), self.help)
                }
                _ => Error::io(&self.path)(e),
            }
        })
    }
}

#[cfg(unix)]
fn read_at(file: &File, bytes: &mut [u8], at: u64) -> std::io::Result<()> {
    std::os::unix::fs::FileExt::read_exact_at(file, bytes, at)
}

#[cfg(windows)]
fn read_at(file: &File, mut bytes: &mut [u8], mut at: u64) -> std::io::Result<()> {
    while !bytes.is_empty() {
        match std::os::windows::fs::FileExt::seek_read(file, bytes, at)? {
            0 => return Err(std::io::ErrorKind::UnexpectedEof.into()),
            read => {
                bytes = &mut bytes[read..];
                at += read as u64;
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    const HELP: &str = "make the corpus again";

    #[test]
    fn length_and_hash_are_checked() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("tokens.u16");
        for bytes in [b"".as_slice(), b"abcd"] {
            std::fs::write(&path, bytes).unwrap();
            let stored = ArrayFile::<u8>::open(&path, bytes.len() as u64, HELP).unwrap();
            stored.check(&FileRecord::of(bytes)).unwrap();
            assert_eq!(&*stored.read(0..stored.len()).unwrap(), bytes);
        }
        let cut = ArrayFile::<u8>::open(&path, 5, HELP).unwrap_err().to_string();
        assert!(cut.contains("found 4 bytes, expected 5 bytes"), "{cut}");
        let stored = ArrayFile::<u8>::open(&path, 4, HELP).unwrap();
        assert!(stored.check(&FileRecord::of(b"abce")).unwrap_err().to_string().contains("SHA-256"));
        assert!(ArrayFile::<u8>::open(&dir.path().join("none"), 0, HELP).is_err());
    }

    #[test]
    fn a_file_that_is_cut_while_in_use_is_whole_in_memory_and_an_error_where_it_is_read() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("features.f32");
        let numbers: Vec<f32> = (0..3 << 20).map(|i| i as f32).collect();
        std::fs::write(&path, bytemuck::cast_slice(&numbers)).unwrap();
        let bytes = size_of_val(numbers.as_slice()) as u64;
        let [memory, file] =
            [bytes, bytes - 1].map(|room| ArrayFile::<f32>::open_within(&path, bytes, HELP, room).unwrap());
        assert!(matches!((&memory.held, &file.held), (Held::Memory(..), Held::File(_))));
        assert_eq!(memory.blocks().map(|b| b.len()).collect::<Vec<_>>(), [1 << 20; 3]);
        for block in memory.blocks().chain([5..5, 7..(1 << 20) + 9]) {
            assert!(memory.read(block.clone()).unwrap() == file.read(block.clone()).unwrap());
            assert!(*memory.read(block.clone()).unwrap() == numbers[block]);
        }
        File::options().write(true).open(&path).unwrap().set_len(bytes / 2).unwrap();
        assert!(*memory.read(0..numbers.len()).unwrap() == numbers);
        assert!(*file.read(0..9).unwrap() == numbers[..9]);
        let message = file.read(0..numbers.len()).unwrap_err().to_string();
        let expected = format!("features.f32: found {} bytes, expected {bytes} bytes; {HELP}", bytes / 2);
        assert!(message.ends_with(&expected), "{message}");
    }
}
