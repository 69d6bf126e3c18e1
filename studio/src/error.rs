//! Errors of the studio, and what of them a page may read.

use kinelm_store::Kind;
use std::any::Any;

/// The result of the studio's functions.
pub type Result<T> = std::result::Result<T, Error>;

/// Errors of the studio.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// What a library call fails with.
    #[error(transparent)]
    Library(#[from] kinelm_model::Error),
    /// An id that nothing has.
    #[error("{0}")]
    Unknown(String),
    /// A request that doesn't fit the state of the project.
    #[error("{0}")]
    Conflict(String),
    /// A request that is refused for who sends it.
    #[error("{0}")]
    Refused(String),
    /// A client that is too slow.
    #[error("{0}")]
    Slow(String),
    /// Work that failed otherwise.
    #[error("{0}")]
    Failed(String),
}

kinelm_store::constructors!(Error);

impl From<kinelm_store::Error> for Error {
    fn from(e: kinelm_store::Error) -> Error {
        Error::Library(e.into())
    }
}

impl From<kinelm_motion::Error> for Error {
    fn from(e: kinelm_motion::Error) -> Error {
        Error::Library(e.into())
    }
}

impl From<kinelm_music::Error> for Error {
    fn from(e: kinelm_music::Error) -> Error {
        Error::Library(e.into())
    }
}

impl From<kinelm_corpus::Error> for Error {
    fn from(e: kinelm_corpus::Error) -> Error {
        Error::Library(e.into())
    }
}

impl Error {
    /// The kind of the error.
    pub fn kind(&self) -> Kind {
        match self {
            Error::Library(e) => e.kind(),
            Error::Unknown(_) | Error::Conflict(_) | Error::Refused(_) => Kind::Call,
            Error::Slow(_) => Kind::Limit,
            Error::Failed(_) => Kind::Failed,
        }
    }

    /// Work that failed otherwise.
    pub fn failed(e: impl ToString) -> Error {
        Error::Failed(e.to_string())
    }

    /// An id of `what` that nothing has.
    pub fn unknown(what: &str, id: &str) -> Error {
        let id: String = id.chars().filter(|c| c.is_ascii_alphanumeric()).take(16).collect();
        Error::Unknown(format!("there is no {what} {id}; load the state again"))
    }

    /// Work that ended in a panic: a fault of the program, or memory that ran out.
    pub fn of_panic(payload: &(dyn Any + Send)) -> Error {
        if payload.is::<kinelm_engine::arena::NoMemory>() {
            let help = "close other programs, or ask for fewer variations";
            return Error::limit("the work", "more memory", "what this machine has", help);
        }
        let text = payload.downcast_ref::<String>().map(String::as_str).or(payload.downcast_ref().copied());
        let what = format!("a fault of kinelm itself: {}", text.unwrap_or("no more is known"));
        Error::failed(what)
    }

    /// Does work, and makes an error of a panic.
    ///
    /// # Errors
    /// Those of the work.
    pub fn of_panics<T>(work: impl FnOnce() -> Result<T>) -> Result<T> {
        // what was half done is the work's own, and gone with it
        let work = std::panic::AssertUnwindSafe(work);
        std::panic::catch_unwind(work).unwrap_or_else(|payload| Err(Error::of_panic(&*payload)))
    }

    /// The status of the answer.
    pub fn status(&self) -> u16 {
        match self {
            Error::Unknown(_) => 404,
            Error::Conflict(_) => 409,
            Error::Refused(_) => 403,
            Error::Slow(_) => 408,
            Error::Failed(_) => 500,
            Error::Library(e) => match e.kind() {
                Kind::Call => 400,
                Kind::File => 422,
                Kind::Limit => 413,
                Kind::Stopped => 409,
                _ => 500,
            },
        }
    }
}

/// The name of a kind in an answer.
pub fn kind_name(kind: Kind) -> &'static str {
    match kind {
        Kind::Io => "io",
        Kind::File => "file",
        Kind::Call => "call",
        Kind::Limit => "limit",
        Kind::Stopped => "stopped",
        _ => "failed",
    }
}

/// A text without the folders of paths: of each only the last part stays. `roots` are folders that may have blanks in
/// their names.
pub fn without_folders(text: &str, roots: &[String]) -> String {
    let mut text = text.to_owned();
    for root in roots.iter().filter(|root| root.len() > 1) {
        text = text.replace(&format!("{root}/"), "").replace(&format!("{root}\\"), "");
    }
    let ends = |c: char| c.is_whitespace() || "\"'`,;()<>|".contains(c);
    let mut out = String::with_capacity(text.len());
    let mut rest = text.as_str();
    while let Some(at) = rest.find(|c| !ends(c)) {
        out.push_str(&rest[..at]);
        let end = rest[at..].find(ends).map_or(rest.len(), |n| at + n);
        out.push_str(last_part(&rest[at..end]));
        rest = &rest[end..];
    }
    out + rest
}

/// The last part of a word that is an absolute path, or one that leads up; else the word.
fn last_part(word: &str) -> &str {
    let is_drive = word.as_bytes().get(1..3).is_some_and(|c| c == b":\\" || c == b":/");
    let is_path = word.starts_with('/') || word.starts_with("\\\\") || word.starts_with("../") || is_drive;
    match word.rfind(['/', '\\']) {
        // a lone slash is no path, and a unit such as m/s none either
        Some(at) if is_path && at + 1 < word.len() => &word[at + 1..],
        _ => word,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn texts_name_files_by_their_last_part() {
        let roots = ["/home/some one/dances".to_owned()];
        let of = |text: &str| without_folders(text, &roots);
        assert_eq!(of("/home/some one/dances/clips/a.bvh:3:7: found x"), "clips/a.bvh:3:7: found x");
        assert_eq!(of("/etc/passwd: No such file (os error 2)"), "passwd: No such file (os error 2)");
        assert_eq!(of("found \"/var/lib/x.bvh\", expected y"), "found \"x.bvh\", expected y");
        assert_eq!(of("../../other/b.bvh: no; C:\\Users\\me\\c.bvh"), "b.bvh: no; c.bvh");
        assert_eq!(of("12.5 m/s and 3 / 4 of clips/a.bvh"), "12.5 m/s and 3 / 4 of clips/a.bvh");
    }

    #[test]
    fn a_panic_is_an_error() {
        let panic = std::panic::catch_unwind(|| panic!("of {}", 3)).unwrap_err();
        assert_eq!(Error::of_panic(&*panic).to_string(), "a fault of kinelm itself: of 3");
        assert_eq!((Error::of_panic(&*panic).status(), Error::unknown("clip", "../c1").status()), (500, 404));
        assert_eq!(Error::unknown("clip", "../c1<").to_string(), "there is no clip c1; load the state again");
    }
}
