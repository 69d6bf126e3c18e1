//! The errors of this crate.

/// The result of this crate's functions.
pub type Result<T, E = Error> = std::result::Result<T, E>;

/// The errors of making and reading corpora.
#[derive(Debug, thiserror::Error)]
pub enum Error {
    /// A file, a parameter or an input is wrong, or the user stopped the work.
    #[error(transparent)]
    Store(#[from] kinelm_store::Error),
    /// A motion file or clip is wrong.
    #[error(transparent)]
    Motion(#[from] kinelm_motion::Error),
    /// A music file is wrong, or the features it should give don't exist at the requested rate.
    #[error(transparent)]
    Music(#[from] kinelm_music::Error),
    /// The tokenizer refused.
    #[error(transparent)]
    Tokenizer(#[from] kinelm_tokenizer::Error),
    /// A clip can't be used.
    #[error("{clip}: {source}")]
    Clip {
        /// The clip's name or file.
        clip: String,
        /// The reason.
        source: Box<Error>,
    },
    /// A caller's model failed, which reads windows of the clips.
    #[error("{0}")]
    Failed(String),
}

kinelm_store::constructors!(Error);

impl Error {
    /// Wraps an error with the clip that it is about.
    pub(crate) fn in_clip(clip: impl ToString) -> impl FnOnce(Error) -> Error {
        let clip = clip.to_string();
        move |source| Error::Clip { clip, source: Box::new(source) }
    }

    /// Which kind of error this is; the program's exit code follows from it.
    pub fn kind(&self) -> kinelm_store::Kind {
        match self {
            Error::Store(e) => e.kind(),
            Error::Motion(e) => e.kind(),
            Error::Music(e) => e.kind(),
            Error::Tokenizer(e) => e.kind(),
            Error::Clip { source, .. } => source.kind(),
            Error::Failed(_) => kinelm_store::Kind::Failed,
        }
    }
}
