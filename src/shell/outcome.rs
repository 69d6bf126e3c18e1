//! What became of a call: whether it was wrong, was stopped or failed, and the exit code that follows.

use super::say::{plain, tell};
use anyhow::Error;
use clap::Parser;
use std::borrow::Cow;
use std::ffi::OsString;
use std::process::ExitCode;

/// The call was wrong in a way that the parser can't see: exit code 2.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct WrongCall(pub String);

/// What the library refuses in the words of a call is a wrong call.
pub fn asked(e: impl Into<crate::Error>) -> Error {
    match e.into() {
        crate::Error::Store(kinelm_store::Error::Call(what)) => WrongCall(what).into(),
        crate::Error::Motion(e) if e.kind() == kinelm_store::Kind::Call => WrongCall(e.to_string()).into(),
        crate::Error::Store(kinelm_store::Error::Option { option, what }) => {
            WrongCall(format!("--{option}: {what}")).into()
        }
        e => e.into(),
    }
}

/// The user stopped the work with Ctrl-C; what is done is saved: exit code 130, as a shell has it. Work that can't be saved
/// half done ends in [`kinelm_store::Error::Stopped`].
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct Stopped(pub String);

/// Whether the user broke the work off.
pub fn is_stopped(e: &anyhow::Error) -> bool {
    e.is::<Stopped>() || matches!(of_store(e.as_ref()), Some(kinelm_store::Error::Stopped(_)))
}

/// Says what the parser says, help among it: done where help was asked for and could be written, else a wrong call.
pub fn refused(e: clap::Error) -> ExitCode {
    match e.print() {
        _ if e.use_stderr() => ExitCode::from(2),
        Err(e) if e.kind() != std::io::ErrorKind::BrokenPipe => {
            tell(format_args!("help can't be written: {e}"));
            ExitCode::FAILURE
        }
        _ => ExitCode::SUCCESS,
    }
}

/// The error of a call that the parser refused, which shows words of the call: of the same call with its control
/// characters written out, as the error's own colours are control characters too.
pub fn told_plain<Call: Parser>(e: clap::Error, args: &[OsString]) -> clap::Error {
    let words = args.iter().map(|word| plain(&word.to_string_lossy()).into_owned());
    let is_odd = |word: &OsString| matches!(plain(&word.to_string_lossy()), Cow::Owned(_));
    match args.iter().any(is_odd) {
        true => Call::try_parse_from(words).err().unwrap_or(e),
        false => e,
    }
}

/// Whether the call was wrong, not the work: what it asks for, or where it would write.
pub fn is_wrong_call(e: &Error) -> bool {
    let is_call = |e: &kinelm_motion::Error| e.kind() == kinelm_store::Kind::Call;
    let is_motion = |e: &(dyn std::error::Error + 'static)| match (e.downcast_ref(), e.downcast_ref()) {
        (Some(crate::Error::Motion(e)), _) | (_, Some(crate::corpus::Error::Motion(e))) => is_call(e),
        _ => e.downcast_ref().is_some_and(is_call),
    };
    let is_taken = |e| matches!(of_store(e), Some(kinelm_store::Error::Taken { .. }));
    e.is::<WrongCall>() || e.chain().any(|e| is_motion(e) || is_taken(e))
}

/// The error of the files that an error of the library is.
fn of_store<'a>(e: &'a (dyn std::error::Error + 'static)) -> Option<&'a kinelm_store::Error> {
    match e.downcast_ref::<crate::Error>() {
        Some(crate::Error::Store(e)) => Some(e),
        _ => match e.downcast_ref() {
            Some(crate::corpus::Error::Store(e)) => Some(e),
            _ => e.downcast_ref(),
        },
    }
}

/// Whether the reader of stdout closed it.
pub fn is_broken_pipe(e: &Error) -> bool {
    e.downcast_ref::<std::io::Error>().is_some_and(|e| e.kind() == std::io::ErrorKind::BrokenPipe)
}

/// An error with its causes in one line, each said once.
pub fn chain(e: &Error) -> String {
    let mut text = String::new();
    for cause in e.chain().map(|c| c.to_string()) {
        if text.is_empty() {
            text = cause;
        } else if !text.ends_with(&cause) {
            text = format!("{text}: {cause}");
        }
    }
    text
}
