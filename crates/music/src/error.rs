//! What can go wrong, and where.

use std::fmt;
use std::path::{Path, PathBuf};

/// The result of this crate's functions.
pub type Result<T> = std::result::Result<T, Error>;

/// Everything that hearing and rendering music can fail with.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused.
    #[error("{path}: {source}")]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The file is wrong, or of a kind that isn't read.
    #[error(transparent)]
    File(#[from] Box<FileError>),
    /// The caller asked for something that can't be done.
    #[error("{0}")]
    Call(String),
}

impl Error {
    /// Wraps an I/O error with the path it happened at.
    pub fn io(path: impl AsRef<Path>) -> impl FnOnce(std::io::Error) -> Error {
        let path = path.as_ref().to_owned();
        move |source| Error::Io { path, source }
    }

    /// The fault of a file, if it is one.
    pub fn kind(&self) -> Option<FaultKind> {
        match self {
            Error::File(e) => Some(e.kind),
            _ => None,
        }
    }
}

/// One fault of one file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FileError {
    /// The file as the user named it.
    pub path: PathBuf,
    /// Which fault; its name is printed.
    pub kind: FaultKind,
    /// What was found and what was expected.
    pub what: String,
    /// What the user can do.
    pub help: String,
}

impl fmt::Display for FileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}: {}; {}", self.path.display(), self.kind, self.what, self.help)
    }
}

impl std::error::Error for FileError {}

/// The faults a music file can have, by the names that are printed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum FaultKind {
    /// Nothing in it, or no sample in its track.
    Empty,
    /// No sound file of a kind that is read.
    Unknown,
    /// A container without sound.
    NoAudioTrack,
    /// Ogg Opus and its like.
    Opus,
    /// An m4a that only its shop's players open.
    Protected,
    /// Sound of another coding that isn't read.
    Codec,
    /// The file ends before its track does.
    Cut,
    /// What stands in it is no sound of its kind.
    Damaged,
    /// More channels, or another rate, than anything has.
    Range,
}

impl fmt::Display for FaultKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            FaultKind::Empty => "empty",
            FaultKind::Unknown => "unknown kind of file",
            FaultKind::NoAudioTrack => "no audio track",
            FaultKind::Opus => "Opus",
            FaultKind::Protected => "protected",
            FaultKind::Codec => "unknown coding",
            FaultKind::Cut => "cut",
            FaultKind::Damaged => "damaged",
            FaultKind::Range => "out of range",
        })
    }
}
