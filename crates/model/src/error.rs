//! The errors of models and of the crates above.

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
    /// A music file is wrong, or can't give what is requested.
    #[error(transparent)]
    Music(#[from] kinelm_music::Error),
    /// The tokenizer refused.
    #[error(transparent)]
    Tokenizer(#[from] kinelm_tokenizer::Error),
    /// The tensor library refused.
    #[error("tensors: {0}")]
    Tensor(#[from] candle_core::Error),
    /// Training diverged: a loss, a gradient or a weight isn't finite.
    #[error("{0}")]
    NotFinite(String),
    /// Tensors that don't make the model that is described.
    #[error("{0}")]
    Weights(String),
    /// A clip of a dataset or corpus can't be used.
    #[error(transparent)]
    Clip(Box<kinelm_corpus::Error>),
    /// Work failed otherwise, such as a dance that is made again and comes out different.
    #[error("{0}")]
    Failed(String),
}

impl From<kinelm_corpus::Error> for Error {
    fn from(e: kinelm_corpus::Error) -> Error {
        use kinelm_corpus::Error as Corpus;
        match e {
            Corpus::Store(e) => Error::Store(e),
            Corpus::Motion(e) => Error::Motion(e),
            Corpus::Music(e) => Error::Music(e),
            Corpus::Tokenizer(e) => Error::Tokenizer(e),
            e @ Corpus::Clip { .. } => Error::Clip(Box::new(e)),
            Corpus::Failed(what) => Error::Failed(what),
        }
    }
}

/// For a model that reads windows of clips in a crate that knows none.
impl From<Error> for kinelm_corpus::Error {
    fn from(e: Error) -> kinelm_corpus::Error {
        use kinelm_corpus::Error as Corpus;
        match e {
            Error::Store(e) => Corpus::Store(e),
            Error::Motion(e) => Corpus::Motion(e),
            Error::Music(e) => Corpus::Music(e),
            Error::Tokenizer(e) => Corpus::Tokenizer(e),
            Error::Clip(e) => *e,
            e => Corpus::Failed(e.to_string()),
        }
    }
}

kinelm_store::constructors!(Error);

impl Error {
    /// Which kind of error this is; the program's exit code follows from it.
    pub fn kind(&self) -> kinelm_store::Kind {
        match self {
            Error::Store(e) => e.kind(),
            Error::Motion(e) => e.kind(),
            Error::Music(e) => e.kind(),
            Error::Tokenizer(e) => e.kind(),
            Error::Clip(e) => e.kind(),
            Error::Tensor(_) | Error::NotFinite(_) | Error::Weights(_) | Error::Failed(_) => kinelm_store::Kind::Failed,
        }
    }
}
