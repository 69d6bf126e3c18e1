//! What can go wrong above the motion files.

use kinelm_motion::Place;
use std::path::{Path, PathBuf};

/// The result of this crate's functions.
pub type Result<T> = std::result::Result<T, Error>;

/// Everything that corpora, models and runs can fail with.
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
    /// A file is wrong.
    #[error("{at}: found {found}, expected {expected}{}{help}", if help.is_empty() { "" } else { "; " })]
    File {
        /// Where.
        at: Place,
        /// What stands there.
        found: String,
        /// What should.
        expected: String,
        /// What the user can do; may be empty.
        help: String,
    },
    /// A motion file or clip is wrong.
    #[error(transparent)]
    Motion(#[from] kinelm_motion::Error),
    /// The tokenizer refused.
    #[error(transparent)]
    Tokenizer(#[from] kinelm_tokenizer::Error),
    /// The tensor library refused.
    #[error("tensors: {0}")]
    Tensor(#[from] candle_core::Error),
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

    /// A fault of the file `path` as a whole.
    pub fn file(
        path: impl AsRef<Path>,
        found: impl Into<String>,
        expected: impl Into<String>,
        help: impl Into<String>,
    ) -> Error {
        Error::at(Place::file(path), found, expected, help)
    }

    /// A fault at a place of a file.
    pub fn at(at: Place, found: impl Into<String>, expected: impl Into<String>, help: impl Into<String>) -> Error {
        Error::File { at, found: found.into(), expected: expected.into(), help: help.into() }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_fault_says_where_what_and_what_to_do() {
        let e = Error::file("c/corpus.json", "version 2", "version 1", "");
        assert_eq!(e.to_string(), "c/corpus.json: found version 2, expected version 1");
        let e =
            Error::at(Place { path: "l.csv".into(), line: 3, column: 7 }, "`tarin`", "train, valid or test", "fix it");
        assert_eq!(e.to_string(), "l.csv:3:7: found `tarin`, expected train, valid or test; fix it");
    }
}
