//! Errors and warnings: what is wrong, and where.

use kinelm_store::Kind;
use std::fmt;
use std::path::Path;

/// The result type of this crate.
pub type Result<T> = std::result::Result<T, Error>;

/// Errors of reading, changing and writing motion.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// A file can't be read or written, a parameter is wrong, or a limit is exceeded.
    #[error(transparent)]
    Store(#[from] kinelm_store::Error),
    /// The content of a motion file is wrong.
    #[error(transparent)]
    File(#[from] Box<FileError>),
    /// The clip can't be used this way.
    #[error("{clip}: {what}")]
    Clip {
        /// Name of the clip, usually its path.
        clip: String,
        /// What is wrong and where (frame, joint), and what to do.
        what: String,
    },
}

kinelm_store::constructors!(Error);

impl Error {
    /// The kind of the error, from which the program's exit code follows.
    pub fn kind(&self) -> Kind {
        match self {
            Error::Store(e) => e.kind(),
            Error::File(_) | Error::Clip { .. } => Kind::File,
        }
    }

    /// Adds the name of the clip to an error that names no file.
    pub fn in_clip(self, clip: impl AsRef<Path>) -> Self {
        use kinelm_store::Error as Store;
        match self {
            Error::Store(e @ (Store::Invalid { .. } | Store::Unsupported { .. } | Store::Limit { .. })) => {
                Error::Clip { clip: clip.as_ref().display().to_string(), what: e.to_string() }
            }
            other => other,
        }
    }

    /// Which fault of a motion file this is, if it is one.
    pub fn fault(&self) -> Option<FaultKind> {
        match self {
            Error::File(e) => Some(e.kind),
            _ => None,
        }
    }
}

/// A number for a message; very large and very small ones in scientific notation.
pub(crate) fn compact(x: f64) -> String {
    if x == 0.0 || (1e-6..1e15).contains(&x.abs()) { x.to_string() } else { format!("{x:e}") }
}

/// One fault of one file: where it is, its kind, what was found, what was expected, what to do.
pub type FileError = kinelm_store::Fault<FaultKind>;

impl From<FileError> for Error {
    fn from(e: FileError) -> Self {
        Error::File(Box::new(e))
    }
}

/// Something odd in a file that was read nevertheless.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Warning {
    /// A stable name, such as `missing_end_site`.
    pub kind: &'static str,
    /// What was odd, where, and how it was handled.
    pub what: String,
}

impl fmt::Display for Warning {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.kind, self.what)
    }
}

macro_rules! kinds {
    ($($(#[$doc:meta])* $variant:ident = $name:literal,)*) => {
        /// The faults of motion files. Each has a stable name, which is printed.
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
        #[non_exhaustive]
        pub enum FaultKind { $($(#[$doc])* $variant,)* }

        impl fmt::Display for FaultKind {
            fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(match self { $(FaultKind::$variant => $name,)* })
            }
        }
    };
}

kinds! {
    /// The first word is not HIERARCHY.
    NotBvh = "not_bvh",
    /// A word the grammar doesn't allow here, or unbalanced braces.
    UnexpectedWord = "unexpected_word",
    /// A node without OFFSET.
    OffsetMissing = "offset_missing",
    /// Fewer than three numbers after OFFSET.
    OffsetShort = "offset_short",
    /// A name that is no channel.
    ChannelUnknown = "channel_unknown",
    /// A channel count outside 0..=6, or fewer names than the count.
    ChannelCount = "channel_count",
    /// The same channel twice on one joint.
    ChannelRepeated = "channel_repeated",
    /// No `Frames:` line.
    FramesMissing = "frames_missing",
    /// No `Frame Time:` line.
    FrameTimeMissing = "frame_time_missing",
    /// A frame time that is zero, negative, not finite or above 1 s.
    FrameTimeBad = "frame_time_bad",
    /// Not a number, or one that is not finite.
    NumberBad = "number_bad",
    /// A row of the wrong width.
    RowWidth = "row_width",
    /// Fewer rows than declared.
    FramesShort = "frames_short",
    /// `Frames: 0` before rows.
    FramesZero = "frames_zero",
    /// Nesting above the limit.
    TooDeep = "too_deep",
    /// More joints or numbers than the limit.
    TooLarge = "too_large",
    /// The leg lengths of a BVH fit no unit.
    UnitUnknown = "unit_unknown",
    /// The requested root is no ROOT of the file.
    RootUnknown = "root_unknown",
    /// The content is not of the format that the file's name says.
    NotThisFormat = "not_this_format",
    /// A key is missing in an npz or pickle.
    KeyMissing = "npz_key_missing",
    /// An array of the wrong shape.
    Shape = "npz_shape",
    /// An array or archive that ends early or is damaged.
    Truncated = "npz_truncated",
    /// An array of Python objects.
    ObjectArray = "npz_object",
    /// An array of an unsupported element type (complex numbers, dates, records, text instead of numbers).
    Dtype = "npz_dtype",
    /// A scale that is not positive and finite.
    ScaleBad = "scale_bad",
    /// A body model that is not one of SMPL's family.
    BodyModelBad = "body_model_bad",
    /// A frame rate that is not positive and finite.
    RateBad = "rate_bad",
    /// NaN or infinity.
    NotFinite = "not_finite",
    /// A file of the right format that holds no motion.
    NoMotion = "no_motion",
    /// A pickle that names something outside the allow-list.
    PickleRefused = "pickle_refused",
    /// A damaged pickle.
    PickleBad = "pickle_bad",
    /// JSON that doesn't parse or says something impossible.
    JsonBad = "json_bad",
    /// A skeleton TOML with a fault.
    MapBad = "map_bad",
}
