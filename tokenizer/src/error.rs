//! Errors: what is wrong, and where.

use kinelm_store::Kind;
use std::path::{Path, PathBuf};

/// The result of this crate's functions.
pub type Result<T> = std::result::Result<T, Error>;

/// Everything that fitting, encoding, decoding and reading a tokenizer can fail with.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file can't be read or written.
    #[error(transparent)]
    Store(#[from] kinelm_store::Error),
    /// A setting outside its limits.
    #[error("tokenizer setting {field}: found {found}, expected {expected}")]
    Setting {
        /// The setting's name.
        field: &'static str,
        /// Its value.
        found: String,
        /// The allowed values.
        expected: String,
    },
    /// A clip of another frame rate.
    #[error("a clip at {found} frames per second, the tokenizer has {expected}; resample it first (`fps`)")]
    Rate {
        /// The clip's.
        found: f64,
        /// The tokenizer's.
        expected: f64,
    },
    /// A clip on another rig than the 24 SMPL joints.
    #[error("a clip on another skeleton than the 24 SMPL joints: {found}; retarget it first (`map`)")]
    Skeleton {
        /// The difference.
        found: String,
    },
    /// A number of a clip that can't be encoded.
    #[error("frame {frame}, {joint}: {what}")]
    Frame {
        /// Counted from 0.
        frame: usize,
        /// The joint, or `translation`.
        joint: String,
        /// What is wrong.
        what: String,
    },
    /// Words of a wrong length, or codes that are too large.
    #[error("{0}")]
    Codes(String),
    /// Text that this tokenizer can't parse. Words and characters count from 1.
    #[error("word {word}, character {character}: found {found}, expected {expected}")]
    Text {
        /// The word, from 1.
        word: usize,
        /// The character in it, from 1.
        character: usize,
        /// What was found.
        found: String,
        /// What was expected.
        expected: String,
    },
    /// An invalid conditioning token.
    #[error("conditioning token <{field}:{value}>: {what}")]
    Conditioning {
        /// The part before the colon.
        field: String,
        /// The part after the colon.
        value: String,
        /// What is wrong.
        what: String,
    },
    /// A scheme whose characters don't belong to single joints.
    #[error("joints can't be given one by one: {0}")]
    Joints(String),
    /// Motion that nothing can be fitted to.
    #[error("nothing to fit: {0}")]
    Nothing(String),
    /// An invalid tokenizer file.
    #[error("{path}: {what}")]
    File {
        /// The file.
        path: PathBuf,
        /// What was found, what was expected, what to do.
        what: String,
    },
    /// A clip could not be built.
    #[error(transparent)]
    Motion(#[from] kinelm_motion::Error),
}

impl Error {
    /// The kind of the error, from which the program's exit code follows.
    pub fn kind(&self) -> Kind {
        match self {
            Error::Store(e) => e.kind(),
            Error::Motion(e) => e.kind(),
            Error::Setting { .. } => Kind::Call,
            _ => Kind::File,
        }
    }

    pub(crate) fn setting(field: &'static str, found: impl ToString, expected: impl Into<String>) -> Error {
        Error::Setting { field, found: found.to_string(), expected: expected.into() }
    }

    pub(crate) fn io(path: impl AsRef<Path>) -> impl FnOnce(std::io::Error) -> Error {
        let path = path.as_ref().to_owned();
        move |source| kinelm_store::Error::io(path)(source).into()
    }
}
