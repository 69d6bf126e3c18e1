//! What can go wrong from the model upwards.

use kinelm_store::Place;
use std::ops::Range;
use std::path::Path;

/// The result of this crate's functions.
pub type Result<T> = std::result::Result<T, Error>;

/// Everything that models, and what is done with them, can fail with.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file can't be read or written or is wrong, the call can't be done, or the user stopped the work.
    #[error(transparent)]
    Store(#[from] kinelm_store::Error),
    /// A motion file or clip is wrong.
    #[error(transparent)]
    Motion(#[from] kinelm_motion::Error),
    /// A music file is wrong, or is asked for what it can't give.
    #[error(transparent)]
    Music(#[from] kinelm_music::Error),
    /// The tokenizer refused.
    #[error(transparent)]
    Tokenizer(#[from] kinelm_tokenizer::Error),
    /// The tensor library refused.
    #[error("tensors: {0}")]
    Tensor(#[from] candle_core::Error),
    /// Numbers of a model that learns ran away: its loss, its gradients or its weights.
    #[error("{0}")]
    NotFinite(String),
    /// Tensors that don't make the model that is described.
    #[error("{0}")]
    Weights(String),
    /// Work on a clip failed otherwise.
    #[error(transparent)]
    Work(Box<dyn std::error::Error + Send + Sync>),
}

impl From<kinelm_corpus::Error> for Error {
    fn from(e: kinelm_corpus::Error) -> Error {
        use kinelm_corpus::Error as Corpus;
        match e {
            Corpus::Store(e) => Error::Store(e),
            Corpus::Motion(e) => Error::Motion(e),
            Corpus::Music(e) => Error::Music(e),
            Corpus::Tokenizer(e) => Error::Tokenizer(e),
            Corpus::Work(e) => e.downcast().map_or_else(Error::Work, |e| *e),
        }
    }
}

/// For work on the clips of a corpus ([`kinelm_corpus::build::each`]), which gives its errors back as they were.
impl From<Error> for kinelm_corpus::Error {
    fn from(e: Error) -> kinelm_corpus::Error {
        use kinelm_corpus::Error as Corpus;
        match e {
            Error::Store(e) => Corpus::Store(e),
            Error::Motion(e) => Corpus::Motion(e),
            Error::Music(e) => Corpus::Music(e),
            Error::Tokenizer(e) => Corpus::Tokenizer(e),
            e => Corpus::Work(Box::new(e)),
        }
    }
}

impl Error {
    /// Wraps an I/O error with the path it happened at.
    pub fn io(path: impl AsRef<Path>) -> impl FnOnce(std::io::Error) -> Error {
        let at = kinelm_store::Error::io(path);
        move |source| at(source).into()
    }

    /// A call that can't be done.
    pub fn call(what: impl Into<String>) -> Error {
        kinelm_store::Error::call(what).into()
    }

    /// An option of a call that can't be what it is, by its name, words joined by `-`.
    pub fn option(option: &'static str, what: impl Into<String>) -> Error {
        kinelm_store::Error::option(option, what).into()
    }

    /// Work that the user broke off.
    pub fn stopped(what: impl Into<String>) -> Error {
        kinelm_store::Error::stopped(what).into()
    }

    /// An output that must not be written: `what` goes on behind its name.
    pub fn taken(path: impl AsRef<Path>, what: impl Into<String>) -> Error {
        kinelm_store::Error::taken(path, what).into()
    }

    /// A fault of the file `path` as a whole.
    pub fn file(
        path: impl AsRef<Path>,
        found: impl Into<String>,
        expected: impl Into<String>,
        help: impl Into<String>,
    ) -> Error {
        kinelm_store::Error::file(path, found, expected, help).into()
    }

    /// A fault at a place of a file.
    pub fn at(at: Place, found: impl Into<String>, expected: impl Into<String>, help: impl Into<String>) -> Error {
        kinelm_store::Error::at(at, found, expected, help).into()
    }

    /// A fault at the bytes `span` of a file's text; of the file as a whole without one.
    pub fn in_text(
        file: (&Path, &str),
        span: Option<Range<usize>>,
        found: impl Into<String>,
        expected: &str,
        help: &str,
    ) -> Error {
        kinelm_store::Error::in_text(file, span, found, expected, help).into()
    }
}
