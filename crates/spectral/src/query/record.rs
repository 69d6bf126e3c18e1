//! The description of an index: `index.json`, and the lines of `clips.jsonl`.

use super::options::IndexOptions;
use crate::{Error, Result, WindowSpec};
use bytemuck::Pod;
pub use kinelm_corpus::array_file::ArrayFile;
use kinelm_motion::format::ReadOptions;
use kinelm_store::{FileRecord, SourcePos, input};
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// The version of the folder's layout that this program writes and reads.
pub const VERSION: u32 = 5;

pub(super) const DAMAGED: &str = "the file was cut or changed after it was written: build the index again";

/// `index.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// [`VERSION`].
    pub version: u32,
    /// The program that wrote it.
    pub program: String,
    /// How windows are cut and what is held of them.
    pub options: IndexOptions,
    /// D, numbers of a feature.
    pub numbers: usize,
    /// `basis.json`, where the transform is fitted.
    pub basis: Option<FileRecord>,
    /// The parts, in the order in which they were added.
    pub parts: Vec<PartRecord>,
}

/// A folder of windows that were added in one go.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PartRecord {
    /// The folder's name.
    pub name: String,
    /// N.
    pub windows: usize,
    /// (N, D) f32.
    pub features: FileChecksum,
    /// (N, 128 at most) and (N, the rest), both rounded up to 64: signed bytes of the features over their lengths, on the
    /// part's scales.
    pub bytes: [FileChecksum; 2],
    /// (D) u32: the coefficient at each place of a row.
    pub order: FileChecksum,
    /// (D, 2) f32: centre and step of each coefficient.
    pub scales: FileChecksum,
    /// (N, 5) f64: length, the bytes' error, the squares of the lengths of what head and rest stand for from the centre, and
    /// the bytes' own length.
    pub sizes: FileChecksum,
    /// A clip a line.
    pub clips: FileRecord,
}

/// Length and checksum of a large file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FileChecksum {
    /// Its length.
    pub bytes: u64,
    /// CRC-32C of its bytes.
    pub crc32c: u32,
}

impl FileChecksum {
    /// Opens the file and checks it, on all threads.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`]; [`kinelm_store::Error::File`] for another length or checksum.
    pub fn open<T: Pod + Send + Sync>(&self, path: &Path) -> Result<ArrayFile<T>> {
        let stored = ArrayFile::open(path, self.bytes, DAMAGED)?;
        let blocks: Vec<_> = stored.blocks().collect();
        let of = |block: &Range<usize>| {
            let numbers = stored.read(block.clone())?;
            let bytes: &[u8] = bytemuck::cast_slice(&numbers);
            Ok((crc32c::crc32c(bytes), bytes.len()))
        };
        let blocks: Vec<(u32, usize)> = blocks.par_iter().map(of).collect::<Result<_>>()?;
        // a CRC of the whole from those of blocks, which threads compute side by side
        let found = blocks.iter().fold(0, |all, &(crc, bytes)| crc32c::crc32c_combine(all, crc, bytes));
        if found != self.crc32c {
            let say = |crc: u32| format!("CRC-32C {crc:08x}");
            return Err(Error::file(path, say(found), say(self.crc32c), DAMAGED));
        }
        Ok(stored)
    }
}

/// A clip of an index: a line of `clips.jsonl`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClipEntry {
    /// Path below the data it was found in, without extension.
    pub name: String,
    /// The file.
    pub path: PathBuf,
    /// SHA-256 of the file.
    pub sha256: String,
    /// How it was read.
    pub read: ReadOptions,
    /// The recording.
    pub take: String,
    /// Field to value.
    pub labels: BTreeMap<String, String>,
    /// Frames at the index's rate.
    pub frames: usize,
    /// First frames of its windows.
    pub starts: Vec<usize>,
}

impl ClipEntry {
    /// The entry of a clip in memory, with all of its windows: no file, no labels, a recording of its own.
    pub fn in_memory(name: &str, frames: usize, windows: &WindowSpec) -> ClipEntry {
        ClipEntry {
            name: name.into(),
            path: PathBuf::new(),
            sha256: String::new(),
            read: ReadOptions::default(),
            take: name.into(),
            labels: BTreeMap::new(),
            frames,
            starts: windows.starts(frames, 0).collect(),
        }
    }

    /// Reads the lines of a file after checking it.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`]; [`kinelm_store::Error::File`] for a file that is not as it was written.
    pub fn load(path: &Path, record: &FileRecord) -> Result<Vec<ClipEntry>> {
        let bytes = input::bytes(path).map_err(Error::io(path))?;
        if FileRecord::of(&bytes) != *record {
            let found = format!("{} bytes of another hash", bytes.len());
            return Err(Error::file(
                path,
                found,
                format!("{} bytes with SHA-256 {}", record.bytes, record.sha256),
                DAMAGED,
            ));
        }
        let lines = bytes.split(|&b| b == b'\n').filter(|line| !line.is_empty()).enumerate();
        let read = |(i, line): (usize, &[u8])| {
            serde_json::from_slice(line).map_err(|e| {
                let at = SourcePos { path: path.to_owned(), line: i + 1, column: e.column() };
                Error::at(at, e.to_string(), "a clip of an index", DAMAGED)
            })
        };
        lines.map(read).collect()
    }

    /// Whether it is the same motion: the same file, read alike, `frames` long at the index's rate. A rate that is stated
    /// where the file says the same makes no other motion.
    pub fn is_of(&self, sha256: &str, read: &ReadOptions, frames: usize) -> bool {
        // `frames` compares the rates: another one gives another number of frames
        let here = ReadOptions { fps_source: read.fps_source, ..self.read.clone() };
        self.sha256 == sha256 && here == *read && self.frames == frames
    }
}
