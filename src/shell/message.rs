//! Messages as a terminal gets them: parameters by their flags, of a length that can be read, without control characters.

use clap::{ArgMatches, Command};
use std::borrow::Cow;
use std::collections::BTreeMap;
use std::sync::OnceLock;

/// Long flags of the running command by the names that the library and the parser have for them: `top_p`, `labels`.
type Flags = BTreeMap<String, String>;

/// The flags of the process's one command. The library names parameters, and only the parser knows their flags.
static FLAGS: OnceLock<Flags> = OnceLock::new();

/// Remembers the flags of the subcommand that was called, for [`by_flags`].
pub fn remember(command: &Command, matches: &ArgMatches) {
    let _ = FLAGS.set(flags(command, matches));
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

/// A message in which parameters have the names of the call's flags.
pub fn by_flags(text: &str) -> String {
    FLAGS.get().map_or_else(|| text.to_owned(), |flags| with_flags(text, flags))
}

/// The most characters of a message: it may quote a file or a call, whose texts have any length.
const LONGEST: usize = 8000;

/// A message without its middle, where it is too long.
pub fn clipped(text: &str) -> Cow<'_, str> {
    let characters = text.chars().count();
    if characters <= LONGEST {
        return Cow::Borrowed(text);
    }
    // at characters: a slice inside one would panic
    let at = |n: usize| text.char_indices().nth(n).map_or(text.len(), |(at, _)| at);
    let (head, tail) = (&text[..at(LONGEST / 2)], &text[at(characters - LONGEST / 2)..]);
    Cow::Owned(format!("{head} .. ({} characters) .. {tail}", characters - LONGEST))
}

/// A text whose control characters are escaped: in names from files they would be orders to a terminal.
pub fn plain(text: &str) -> Cow<'_, str> {
    // also the C1 codes 80 to 9F, of which 9B begins an escape sequence alone
    let is_order = |c: char| c.is_control() && !matches!(c, '\n' | '\t');
    if !text.contains(is_order) {
        return Cow::Borrowed(text);
    }
    let one = |c: char| if is_order(c) { c.escape_default().to_string() } else { c.to_string() };
    Cow::Owned(text.chars().map(one).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use clap::CommandFactory;

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
}
