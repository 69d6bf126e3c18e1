//! Errors of files, parameters, limits and stopped work.

use std::fmt;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// The result of this crate's functions.
pub type Result<T> = std::result::Result<T, Error>;

/// Errors of reading and writing files, of parameters, of limits, and of stopped work.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The operating system refused.
    #[error("{path}: {source}")]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// The system's error.
        source: std::io::Error,
    },
    /// A file is wrong.
    #[error(transparent)]
    File(Box<Fault>),
    /// The user stopped the work; its output was not written.
    #[error("{0}")]
    Stopped(String),
    /// An output that must not be written.
    #[error("{path} {what}")]
    Taken {
        /// The output.
        path: PathBuf,
        /// The reason, and what to do.
        what: String,
    },
    /// The work needs more than is available or allowed.
    #[error("{what} takes {needs}, the limit is {limit}{}{help}", if help.is_empty() { "" } else { "; " })]
    Limit {
        /// The work, or the input that is too large.
        what: String,
        /// The need, with the unit.
        needs: String,
        /// The available or allowed amount, with the unit.
        limit: String,
        /// The user's way out; may be empty.
        help: String,
    },
    /// A parameter, a key of a file or an input has an invalid value.
    #[error("{name} is {found}; expected {expected}")]
    Invalid {
        /// The parameter, key or input.
        name: Subject,
        /// Its value.
        found: String,
        /// The allowed values.
        expected: String,
    },
    /// The inputs lack what the work needs.
    #[error("no {what}; {help}")]
    Missing {
        /// The missing input, or a part of one.
        what: String,
        /// Why it is needed, or what to do.
        help: String,
    },
    /// The request can't be met with this model, format or input.
    #[error("{what}: {why}")]
    Unsupported {
        /// The parameter, or the work that was requested.
        what: Subject,
        /// Why it can't be done, and what to do.
        why: String,
    },
}

/// The subject of an error: a parameter of the call, or something in a file or an input.
///
/// ```
/// # use kinelm_store::Subject;
/// assert_eq!(Subject::about("the number of `labels`", "labels").parameter(), Some("labels"));
/// assert_eq!(Subject::from("clip a`b`.bvh").parameter(), None);
/// let joints = Subject::of_parameter("joints").with("tail");
/// assert_eq!((joints.parameter(), joints.to_string().as_str()), (Some("joints"), "`joints` tail"));
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Subject {
    text: String,
    parameter: Option<String>,
}

impl Subject {
    /// The parameter with this library name.
    pub fn of_parameter(name: impl Into<String>) -> Subject {
        let name = name.into();
        Subject { text: format!("`{name}`"), parameter: Some(name) }
    }

    /// Something of the parameter with this library name, in words of its own.
    pub fn about(text: impl Into<String>, name: impl Into<String>) -> Subject {
        Subject { text: text.into(), parameter: Some(name.into()) }
    }

    /// With the value or the part that it is about, after a blank.
    pub fn with(self, detail: impl fmt::Display) -> Subject {
        Subject { text: format!("{} {detail}", self.text), ..self }
    }

    /// The same in a file, which is at fault then, not the call.
    pub fn in_file(self, path: &Path) -> Subject {
        Subject { text: format!("{}: {}", path.display(), self.text), parameter: None }
    }

    /// The library name of the parameter, if it is one.
    pub fn parameter(&self) -> Option<&str> {
        self.parameter.as_deref()
    }
}

// only text of the code has this lifetime, so no name of a file or joint gets here
impl From<&'static str> for Subject {
    fn from(text: &'static str) -> Subject {
        Subject { text: text.into(), parameter: None }
    }
}

impl From<String> for Subject {
    fn from(text: String) -> Subject {
        Subject { text, parameter: None }
    }
}

impl fmt::Display for Subject {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

/// The kinds of errors of all crates.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[non_exhaustive]
pub enum Kind {
    /// The operating system refused.
    Io,
    /// A file is wrong, or the files lack what the work needs.
    File,
    /// The call is wrong: a parameter, their combination, or an output that must not be written.
    Call,
    /// The work takes more memory, time or size than there is or is allowed.
    Limit,
    /// The user stopped the work.
    Stopped,
    /// The work failed otherwise: numbers that run away, a tensor library that refuses.
    Failed,
}

/// A fault of a file. `K`: its kind, which is printed where a crate names the kinds of its files' faults.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Fault<K = Unnamed> {
    /// Where.
    pub at: SourcePos,
    /// Its kind.
    pub kind: K,
    /// What was found.
    pub found: String,
    /// What was expected.
    pub expected: String,
    /// What the user can do; may be empty.
    pub help: String,
}

/// A fault of no named kind.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Unnamed;

impl fmt::Display for Unnamed {
    fn fmt(&self, _: &mut fmt::Formatter<'_>) -> fmt::Result {
        Ok(())
    }
}

impl<K> Fault<K> {
    /// A fault at a position in a file.
    pub fn new(at: SourcePos, kind: K, found: impl Into<String>, expected: impl Into<String>) -> Self {
        Fault { at, kind, found: found.into(), expected: expected.into(), help: String::new() }
    }

    /// Adds what the user can do.
    #[must_use]
    pub fn help(mut self, help: impl Into<String>) -> Self {
        self.help = help.into();
        self
    }
}

impl<K: fmt::Display> fmt::Display for Fault<K> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let kind = self.kind.to_string();
        let between = if kind.is_empty() { "" } else { ": " };
        write!(f, "{}{between}{kind}: found {}, expected {}", self.at, self.found, self.expected)?;
        if self.help.is_empty() { Ok(()) } else { write!(f, "; {}", self.help) }
    }
}

impl<K: fmt::Debug + fmt::Display> std::error::Error for Fault<K> {}

impl Error {
    /// Wraps an I/O error with the path it happened at.
    pub fn io(path: impl AsRef<Path>) -> impl FnOnce(std::io::Error) -> Error {
        let path = path.as_ref().to_owned();
        move |source| Error::Io { path, source }
    }

    /// A parameter, key or input with an invalid value: "`name` is `found`; expected `expected`".
    pub fn invalid(name: impl Into<Subject>, found: impl fmt::Display, expected: impl Into<String>) -> Error {
        Error::Invalid { name: name.into(), found: found.to_string(), expected: expected.into() }
    }

    /// A parameter of the call, by its library name, with an invalid value.
    pub fn invalid_parameter(name: &str, found: impl fmt::Display, expected: impl Into<String>) -> Error {
        Error::invalid(Subject::of_parameter(name), found, expected)
    }

    /// Inputs that lack what the work needs: "no `what`; `help`".
    pub fn missing(what: impl Into<String>, help: impl Into<String>) -> Error {
        Error::Missing { what: what.into(), help: help.into() }
    }

    /// A request that this model, format or input doesn't allow: "`what`: `why`".
    pub fn unsupported(what: impl Into<Subject>, why: impl Into<String>) -> Error {
        Error::Unsupported { what: what.into(), why: why.into() }
    }

    /// A parameter of the call, by its library name, that this model, format or input doesn't allow.
    pub fn unsupported_parameter(name: &str, why: impl Into<String>) -> Error {
        Error::unsupported(Subject::of_parameter(name), why)
    }

    /// Work that takes more than the limit: "`what` takes `needs`, the limit is `limit`; `help`".
    pub fn limit(
        what: impl Into<String>,
        needs: impl fmt::Display,
        limit: impl fmt::Display,
        help: impl Into<String>,
    ) -> Error {
        Error::Limit { what: what.into(), needs: needs.to_string(), limit: limit.to_string(), help: help.into() }
    }

    /// The kind of the error, from which the program's exit code follows.
    pub fn kind(&self) -> Kind {
        match self {
            Error::Io { .. } => Kind::Io,
            Error::File(_) | Error::Missing { .. } => Kind::File,
            // a parameter is the caller's; everything else is what a file holds
            Error::Invalid { name: what, .. } | Error::Unsupported { what, .. } => match what.parameter {
                Some(_) => Kind::Call,
                None => Kind::File,
            },
            Error::Stopped(_) => Kind::Stopped,
            Error::Limit { .. } => Kind::Limit,
            Error::Taken { .. } => Kind::Call,
        }
    }

    /// Work that the user stopped.
    pub fn stopped(what: impl Into<String>) -> Error {
        Error::Stopped(what.into())
    }

    /// An output that must not be written: "`path` `what`".
    pub fn taken(path: impl AsRef<Path>, what: impl Into<String>) -> Error {
        Error::Taken { path: path.as_ref().to_owned(), what: what.into() }
    }

    /// A fault of the file `path` as a whole.
    pub fn file(
        path: impl AsRef<Path>,
        found: impl Into<String>,
        expected: impl Into<String>,
        help: impl Into<String>,
    ) -> Error {
        Error::at(SourcePos::file(path), found, expected, help)
    }

    /// A fault at a position in a file.
    pub fn at(at: SourcePos, found: impl Into<String>, expected: impl Into<String>, help: impl Into<String>) -> Error {
        Error::File(Box::new(Fault::new(at, Unnamed, found, expected).help(help)))
    }

    /// A fault at the byte range `span` of a file's text; of the whole file without one.
    pub fn in_text(
        path: &Path,
        text: &str,
        span: Option<Range<usize>>,
        found: impl Into<String>,
        expected: &str,
        help: &str,
    ) -> Error {
        let at = span.map_or_else(|| SourcePos::file(path), |span| position(path, text, span.start));
        Error::at(at, found, expected, help)
    }
}

/// Gives an error type above this crate, which is made from an [`Error`] by `From`, the constructors of [`Error`].
#[macro_export]
macro_rules! constructors {
    ($error:ident) => {
        impl $error {
            /// Wraps an I/O error with the path it happened at.
            pub fn io(path: impl AsRef<::std::path::Path>) -> impl FnOnce(::std::io::Error) -> $error {
                let at = $crate::Error::io(path);
                move |source| at(source).into()
            }

            /// A parameter, key or input with an invalid value: "`name` is `found`; expected `expected`".
            pub fn invalid(
                name: impl Into<$crate::Subject>,
                found: impl ::std::fmt::Display,
                expected: impl Into<String>,
            ) -> $error {
                $crate::Error::invalid(name, found, expected).into()
            }

            /// A parameter of the call, by its library name, with an invalid value.
            pub fn invalid_parameter(
                name: &str,
                found: impl ::std::fmt::Display,
                expected: impl Into<String>,
            ) -> $error {
                $crate::Error::invalid_parameter(name, found, expected).into()
            }

            /// Inputs that lack what the work needs: "no `what`; `help`".
            pub fn missing(what: impl Into<String>, help: impl Into<String>) -> $error {
                $crate::Error::missing(what, help).into()
            }

            /// A request that this model, format or input doesn't allow: "`what`: `why`".
            pub fn unsupported(what: impl Into<$crate::Subject>, why: impl Into<String>) -> $error {
                $crate::Error::unsupported(what, why).into()
            }

            /// A parameter of the call, by its library name, that this model, format or input doesn't allow.
            pub fn unsupported_parameter(name: &str, why: impl Into<String>) -> $error {
                $crate::Error::unsupported_parameter(name, why).into()
            }

            /// Work that takes more than the limit: "`what` takes `needs`, the limit is `limit`; `help`".
            pub fn limit(
                what: impl Into<String>,
                needs: impl ::std::fmt::Display,
                limit: impl ::std::fmt::Display,
                help: impl Into<String>,
            ) -> $error {
                $crate::Error::limit(what, needs, limit, help).into()
            }

            /// Work that the user stopped.
            pub fn stopped(what: impl Into<String>) -> $error {
                $crate::Error::stopped(what).into()
            }

            /// An output that must not be written: "`path` `what`".
            pub fn taken(path: impl AsRef<::std::path::Path>, what: impl Into<String>) -> $error {
                $crate::Error::taken(path, what).into()
            }

            /// A fault of the file `path` as a whole.
            pub fn file(
                path: impl AsRef<::std::path::Path>,
                found: impl Into<String>,
                expected: impl Into<String>,
                help: impl Into<String>,
            ) -> $error {
                $crate::Error::file(path, found, expected, help).into()
            }

            /// A fault at a position in a file.
            pub fn at(
                at: $crate::SourcePos,
                found: impl Into<String>,
                expected: impl Into<String>,
                help: impl Into<String>,
            ) -> $error {
                $crate::Error::at(at, found, expected, help).into()
            }

            /// A fault at the byte range `span` of a file's text; of the whole file without one.
            pub fn in_text(
                path: &::std::path::Path,
                text: &str,
                span: Option<::std::ops::Range<usize>>,
                found: impl Into<String>,
                expected: &str,
                help: &str,
            ) -> $error {
                $crate::Error::in_text(path, text, span, found, expected, help).into()
            }
        }
    };
}

/// A position in a file. Lines and columns count from 1; 0 means the file as a whole (binary formats).
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct SourcePos {
    /// The file as the user named it.
    pub path: PathBuf,
    /// Line, from 1; 0 for the whole file.
    pub line: usize,
    /// Column in characters, from 1; 0 for the whole file.
    pub column: usize,
}

impl SourcePos {
    /// The file as a whole.
    pub fn file(path: impl AsRef<Path>) -> Self {
        SourcePos { path: path.as_ref().to_owned(), line: 0, column: 0 }
    }
}

impl fmt::Display for SourcePos {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.path.display())?;
        if self.line > 0 {
            write!(f, ":{}:{}", self.line, self.column.max(1))?;
        }
        Ok(())
    }
}

/// The position of a byte of a text.
fn position(path: &Path, text: &str, byte: usize) -> SourcePos {
    let before = &text[..byte.min(text.len())];
    SourcePos {
        path: path.to_owned(),
        line: before.matches('\n').count() + 1,
        column: before.chars().rev().take_while(|&c| c != '\n').count() + 1,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_a_parameter_makes_a_wrong_call_whatever_files_are_called() {
        for name in ["a.bvh", "a`b.bvh", "`fps`.bvh", "a\"b'.bvh"] {
            let of_file = Error::invalid(format!("{name}: a joint"), 0, "more");
            assert_eq!(
                (of_file.kind(), of_file.to_string()),
                (Kind::File, format!("{name}: a joint is 0; expected more"))
            );
            assert_eq!(Error::unsupported(name.to_string(), "no").kind(), Kind::File);
            let of_call = Error::unsupported(Subject::of_parameter("music").with(name), "no");
            assert_eq!((of_call.kind(), of_call.to_string()), (Kind::Call, format!("`music` {name}: no")));
            let key = Subject::of_parameter("pose").in_file(Path::new(name));
            assert_eq!(Error::invalid(key, 1, "none").kind(), Kind::File);
        }
        assert_eq!(Error::invalid_parameter("fps", 0, "more").kind(), Kind::Call);
        assert_eq!(Error::invalid("the rate of a clip", 0, "more").kind(), Kind::File);
    }

    #[test]
    fn a_fault_says_where_what_and_what_to_do() {
        let e = Error::file("c/corpus.json", "version 2", "version 1", "");
        assert_eq!(e.to_string(), "c/corpus.json: found version 2, expected version 1");
        let e = Error::at(
            SourcePos { path: "l.csv".into(), line: 3, column: 7 },
            "`tarin`",
            "train, valid or test",
            "fix it",
        );
        assert_eq!(e.to_string(), "l.csv:3:7: found `tarin`, expected train, valid or test; fix it");
        let (path, text) = (Path::new("t.toml"), "a = 1\né = =\n");
        let of = |span| Error::in_text(path, text, span, "`=`", "a value", "").to_string();
        assert_eq!(of(Some(11..12)), "t.toml:2:5: found `=`, expected a value");
        assert_eq!(of(Some(99..99)), "t.toml:3:1: found `=`, expected a value");
        assert_eq!(of(None), "t.toml: found `=`, expected a value");
    }
}
