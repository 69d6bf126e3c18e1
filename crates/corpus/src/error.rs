//! What can go wrong with corpora.

/// The result of this crate's functions.
pub type Result<T> = std::result::Result<T, Error>;

/// Everything that making and reading corpora can fail with.
#[derive(Debug, thiserror::Error)]
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
    /// What a caller does with each clip failed.
    #[error(transparent)]
    Work(Box<dyn std::error::Error + Send + Sync>),
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
            Error::Work(_) => kinelm_store::Kind::Failed,
        }
    }
}
