//! Errors, with their place.

use kinelm_store::Kind;
use std::fmt;
use std::path::PathBuf;

/// The result of this crate's functions.
pub type Result<T> = std::result::Result<T, Error>;

/// Everything that reading, analysing and rendering music can fail with.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file can't be read, or a parameter is out of range.
    #[error(transparent)]
    Store(#[from] kinelm_store::Error),
    /// The file is wrong, or of a kind that isn't supported.
    #[error(transparent)]
    File(#[from] Box<FileError>),
}

kinelm_store::constructors!(Error);

impl Error {
    /// The kind of the error, from which the program's exit code follows.
    pub fn kind(&self) -> Kind {
        match self {
            Error::Store(e) => e.kind(),
            Error::File(_) => Kind::File,
        }
    }

    /// The fault of a music file, if this is one.
    pub fn fault(&self) -> Option<FaultKind> {
        match self {
            Error::File(e) => Some(e.kind),
            Error::Store(_) => None,
        }
    }
}

/// One fault of one file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FileError {
    /// The file as the user named it.
    pub path: PathBuf,
    /// The kind of fault; its name is printed.
    pub kind: FaultKind,
    /// The found value and the expected one.
    pub what: String,
    /// The user's way out.
    pub help: String,
}

impl fmt::Display for FileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}: {}; {}", self.path.display(), self.kind, self.what, self.help)
    }
}

impl std::error::Error for FileError {}

/// The faults that a music file can have, with their printed names.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, thiserror::Error)]
#[non_exhaustive]
pub enum FaultKind {
    /// An empty file, or a track without samples.
    #[error("empty")]
    Empty,
    /// No sound file of a supported kind.
    #[error("unknown kind of file")]
    Unknown,
    /// A container without sound.
    #[error("no audio track")]
    NoAudioTrack,
    /// Opus in Ogg or another container.
    #[error("Opus")]
    Opus,
    /// An m4a with copy protection.
    #[error("protected")]
    Protected,
    /// Sound in another codec that isn't supported.
    #[error("unknown coding")]
    Codec,
    /// The file ends before its track does.
    #[error("cut")]
    Cut,
    /// The contents can't be decoded.
    #[error("damaged")]
    Damaged,
    /// A sampling rate out of range.
    #[error("out of range")]
    Range,
}
