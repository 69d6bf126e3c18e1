//! The end of a call: its exit code, and its error as a line of text.

use super::message::{by_flags, plain, remember};
use super::say::tell;
use anyhow::Error;
use clap::{ArgMatches, Command, CommandFactory, FromArgMatches};
use kinelm_store::Kind;
use std::borrow::Cow;
use std::error::Error as StdError;
use std::ffi::OsString;

/// A call that is wrong in a way that the parser can't see.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct WrongCall(pub String);

/// Returns with a [`WrongCall`], whose message is formatted as by `format!`.
macro_rules! wrong_call {
    ($($message:tt)*) => {
        return Err($crate::shell::WrongCall(format!($($message)*)).into())
    };
}
pub(crate) use wrong_call;

/// Parses a call, which `check` may refuse, and remembers its command's flags for [`chain`].
///
/// # Errors
/// The parser's and those of `check`, without control characters out of the call's own words.
pub fn parse<Call: CommandFactory + FromArgMatches>(
    args: &[OsString],
    check: impl Fn(&Command, &ArgMatches) -> Result<(), clap::Error>,
) -> Result<Call, clap::Error> {
    // a fresh command each time: clap builds it while it parses
    let parsed = |args: &[OsString]| {
        let mut command = Call::command();
        let matches = command.try_get_matches_from_mut(args)?;
        check(&command, &matches)?;
        let call = Call::from_arg_matches(&matches).map_err(|e| e.format(&mut command))?;
        remember(&command, &matches);
        Ok(call)
    };
    // the parser's colours are control characters too, so the words are escaped before they are parsed
    let is_odd = |word: &OsString| matches!(plain(&word.to_string_lossy()), Cow::Owned(_));
    parsed(args).map_err(|e| {
        let words: Vec<OsString> = args.iter().map(|word| plain(&word.to_string_lossy()).into_owned().into()).collect();
        if args.iter().any(is_odd) { parsed(&words).err().unwrap_or(e) } else { e }
    })
}

/// Prints the parser's message, help included. Returns the exit code: 0 after help that was requested and printed, 2
/// for a wrong call.
pub fn refused(e: clap::Error) -> u8 {
    match e.print() {
        _ if e.use_stderr() => 2,
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            tell(format_args!("help can't be written: {e}"));
            1
        }
        _ => 0,
    }
}

/// The exit code of an error: 2 for a wrong call, 130 for stopped work, as a shell has it after Ctrl-C, else 1.
pub fn exit_code(e: &Error) -> u8 {
    match e.chain().find_map(kind) {
        Some(Kind::Call) => 2,
        Some(Kind::Stopped) => 130,
        _ => 1,
    }
}

/// The kind of an error, if it is one of ours.
fn kind(e: &(dyn StdError + 'static)) -> Option<Kind> {
    let wrong = e.downcast_ref::<WrongCall>().map(|_| Kind::Call);
    wrong
        // each crate's type, from the top: an error crosses anyhow as the type of the crate that returned it
        .or_else(|| e.downcast_ref().map(crate::Error::kind))
        .or_else(|| e.downcast_ref().map(crate::corpus::Error::kind))
        .or_else(|| e.downcast_ref().map(kinelm_motion::Error::kind))
        .or_else(|| e.downcast_ref().map(kinelm_store::Error::kind))
}

/// Whether the reader of stdout closed it.
pub fn is_broken_pipe(e: &Error) -> bool {
    e.downcast_ref::<std::io::Error>().is_some_and(|e| e.kind() == std::io::ErrorKind::BrokenPipe)
}

/// An error with its causes in one line, each once, and parameters by their flags.
pub fn chain(e: &Error) -> String {
    let mut text = String::new();
    for cause in e.chain().map(|c| c.to_string()) {
        if text.is_empty() {
            text = cause;
        // a transparent error has its source's own text
        } else if !text.ends_with(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    by_flags(&text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_kind_of_an_error_decides_the_exit_code() {
        use kinelm_store::Error as Store;
        let code = |e: Error| exit_code(&e);
        assert_eq!(code(WrongCall("no".into()).into()), 2);
        assert_eq!(code(Error::from(Store::invalid_parameter("fps", 0, "more")).context("walk.bvh")), 2);
        assert_eq!(code(crate::Error::from(Store::stopped("half done")).into()), 130);
        assert_eq!(code(crate::corpus::Error::from(Store::taken("a", "is there")).into()), 2);
        assert_eq!(code(Store::missing("clip", "give one").into()), 1);
        assert_eq!(code(anyhow::anyhow!("else")), 1);
    }
}
