//! The end of a call: its exit code, and its error as a line of text.

use super::say::{plain, tell};
use anyhow::Error;
use clap::{ArgMatches, Command, CommandFactory, FromArgMatches};
use kinelm_store::Kind;
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::error::Error as StdError;
use std::ffi::OsString;
use std::sync::OnceLock;

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

/// Long flags of the running command by the names that the library and the parser have for them: `top_p`, `labels`.
type Flags = BTreeMap<String, String>;

/// The flags of the process's one command. The library names parameters, and only the parser knows their flags.
static FLAGS: OnceLock<Flags> = OnceLock::new();

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
        let _ = FLAGS.set(flags(&command, &matches));
        Ok(call)
    };
    // the parser's colours are control characters too, so the words are escaped before they are parsed
    let is_odd = |word: &OsString| matches!(plain(&word.to_string_lossy()), Cow::Owned(_));
    parsed(args).map_err(|e| {
        let words: Vec<OsString> = args.iter().map(|word| plain(&word.to_string_lossy()).into_owned().into()).collect();
        if args.iter().any(is_odd) { parsed(&words).err().unwrap_or(e) } else { e }
    })
}

/// The flags of the subcommand that was called.
fn flags(mut command: &Command, mut matches: &ArgMatches) -> Flags {
    while let Some((name, below)) = matches.subcommand()
        && let Some(found) = command.find_subcommand(name)
    {
        (command, matches) = (found, below);
    }
    let names = |arg: &clap::Arg| {
        let long = arg.get_long()?.to_owned();
        // by both: `--top-p` is `top_p` in the library, and an argument's own id may differ
        Some([(long.replace('-', "_"), long.clone()), (arg.get_id().to_string(), long)])
    };
    command.get_arguments().filter_map(names).flatten().collect()
}

/// A message in which a parameter's name in backquotes is its flag, where there is one: `` `top_p` `` becomes `--top-p`. A
/// value that was found stays as it is, and so do all other backquotes: names of files have them too.
fn with_flags(text: &str, flags: &Flags) -> String {
    let (mut out, mut rest) = (String::new(), text);
    while let Some((before, after)) = rest.split_once('`') {
        out += before;
        let quoted = after.split_once('`').filter(|_| !before.ends_with("found "));
        match quoted.and_then(|(name, after)| Some((flags.get(&name.replace('-', "_"))?, after))) {
            Some((flag, after)) => {
                out += &format!("--{flag}");
                rest = after;
            }
            None => {
                out.push('`');
                rest = after;
            }
        }
    }
    out + rest
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

/// A message in which parameters have the names of the call's flags.
pub fn by_flags(text: &str) -> String {
    FLAGS.get().map_or_else(|| text.to_owned(), |flags| with_flags(text, flags))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(clap::Parser)]
    struct Call {
        #[command(subcommand)]
        command: Sub,
    }

    #[derive(clap::Subcommand)]
    enum Sub {
        Sample {
            #[arg(long)]
            top_p: Option<f64>,
            #[arg(long = "label")]
            labels: Vec<String>,
        },
        Other,
    }

    #[test]
    fn a_parameter_is_named_by_its_flag() {
        let of = |line: &str| {
            let command = Call::command();
            flags(&command, &command.clone().get_matches_from(line.split(' ')))
        };
        let flags = of("kinelm sample");
        let said = |text: &str| with_flags(text, &flags);
        assert_eq!(said("`top_p` is 3; expected 0 to 1"), "--top-p is 3; expected 0 to 1");
        assert_eq!(said("a: `labels`: none, `top_k` and `top_p"), "a: --label: none, `top_k` and `top_p");
        assert_eq!(said("l.csv:1:2: found `top_p`, expected `top-p`"), "l.csv:1:2: found `top_p`, expected --top-p");
        assert_eq!(said("a`b.bvh: `top_p` is 3, not `x`"), "a`b.bvh: --top-p is 3, not `x`");
        assert_eq!(with_flags("`top_p` is 3", &of("kinelm other")), "`top_p` is 3");
    }

    #[test]
    fn the_kind_of_an_error_decides_the_exit_code() {
        use kinelm_store::Error as Store;
        let code = |e: Error| exit_code(&e);
        assert_eq!(code(WrongCall("no".into()).into()), 2);
        assert_eq!(code(Error::from(Store::invalid("`fps`", 0, "more")).context("walk.bvh")), 2);
        assert_eq!(code(crate::Error::from(Store::stopped("half done")).into()), 130);
        assert_eq!(code(crate::corpus::Error::from(Store::taken("a", "is there")).into()), 2);
        assert_eq!(code(Store::missing("clip", "give one").into()), 1);
        assert_eq!(code(anyhow::anyhow!("else")), 1);
    }
}
