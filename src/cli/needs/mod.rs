//! Options that say something only beside another one, and are refused without it.
//!
//! clap's own `requires` lets them pass where the option they need conflicts with one that is given.

#[cfg(test)]
mod tests;

use clap::error::ErrorKind;
use clap::parser::ValueSource;
use clap::{ArgMatches, Command};

/// Options of the commands, and those of which one has to be given with them. `rig=prompt` is an option with this value.
struct Need {
    commands: &'static [&'static str],
    options: &'static [&'static str],
    any_of: &'static [&'static str],
}

/// How motion files are read.
const READING: &[&str] = &[
    "fps-source",
    "unit",
    "up",
    "mirror-axis",
    "map",
    "bvh-position",
    "root",
    "take",
    "lenient",
    "keep-rest",
    "drop-rest",
    "skip",
    "body-model",
    "floor",
];
/// How tokens are sampled.
const DRAWING: &[&str] = &["greedy", "temperature", "top-k", "top-p", "min-p", "repetition-penalty"];

const NEEDS: &[Need] = &[
    Need {
        commands: &["generate"],
        options: &["joints", "from-frame", "given", "free", "loop", "rig=prompt"],
        any_of: &["prompt"],
    },
    Need {
        commands: &["generate"],
        options: &[
            "uncoded-joints=follow",
            "uncoded-joints=prompt",
            "uncoded-joints=mean",
            "replace-animation",
            "embed",
        ],
        any_of: &["prompt", "onto"],
    },
    Need { commands: &["generate"], options: READING, any_of: &["prompt", "onto"] },
    Need { commands: &["generate"], options: &["loop-over"], any_of: &["loop"] },
    Need { commands: &["generate"], options: &["blend", "tries", "goal-guidance"], any_of: &["given", "free", "loop"] },
    Need { commands: &["generate", "generate timeline"], options: &["music-from"], any_of: &["music"] },
    Need { commands: &["generate", "generate timeline"], options: &["real", "keep-all"], any_of: &["best"] },
    Need {
        commands: &["generate", "generate timeline", "evaluate gaps", "evaluate prediction"],
        options: &["repetition-words"],
        any_of: &["repetition-penalty"],
    },
    Need {
        commands: &["convert"],
        options: &["onto-map", "onto-unit", "onto-root", "replace-animation", "embed"],
        any_of: &["onto"],
    },
    Need { commands: &["filter"], options: &["butterworth"], any_of: &["cutoff"] },
    Need { commands: &["filter"], options: &["compat"], any_of: &["butterworth"] },
    Need { commands: &["view"], options: &["music-from"], any_of: &["music"] },
    Need { commands: &["inspect"], options: &["force"], any_of: &["map-out"] },
    Need { commands: &["classify eval"], options: &["run"], any_of: &["baselines"] },
    Need { commands: &["classify eval"], options: &["force"], any_of: &["plot"] },
    Need { commands: &["music inspect"], options: &["at", "seconds", "force"], any_of: &["out"] },
    Need { commands: &["music beats"], options: &["force"], any_of: &["out"] },
    Need { commands: &["compare", "query find", "tokenizer text"], options: &["force"], any_of: &["page"] },
    Need { commands: &["query evaluate"], options: &["force"], any_of: &["save"] },
    Need { commands: &["aclstm evaluate"], options: &["force"], any_of: &["write-seeds"] },
    Need { commands: &["evaluate dance"], options: &["force"], any_of: &["plot", "page"] },
    Need { commands: &["evaluate dance"], options: &["music-from"], any_of: &["music", "beats"] },
    Need {
        commands: &["classify eval", "evaluate prediction", "query build", "query evaluate"],
        options: &["checkpoint"],
        any_of: &["run"],
    },
    Need { commands: &["pretrain"], options: &["checkpoint"], any_of: &["from"] },
    Need { commands: &["evaluate prediction"], options: DRAWING, any_of: &["run"] },
    Need { commands: &["evaluate prediction"], options: &["samples", "seed", "device", "form"], any_of: &["run"] },
];

/// Refuses an option of the subcommand that was called without one that it needs.
///
/// # Errors
/// The option, and what it needs.
pub fn check(mut command: &Command, mut matches: &ArgMatches) -> Result<(), clap::Error> {
    let mut names = Vec::new();
    while let Some((name, below)) = matches.subcommand()
        && let Some(found) = command.find_subcommand(name)
    {
        names.push(name);
        (command, matches) = (found, below);
    }
    let called = names.join(" ");
    let is_given = |option: &str| is_given(command, matches, option);
    for need in NEEDS.iter().filter(|need| need.commands.contains(&&*called)) {
        let alone = need.options.iter().find(|option| is_given(option));
        if let Some(option) = alone.filter(|_| !need.any_of.iter().any(|other| is_given(other))) {
            let wrong = format!("{} needs {}", flag(option), listed(need.any_of));
            return Err(command.clone().error(ErrorKind::MissingRequiredArgument, wrong));
        }
    }
    Ok(())
}

/// Whether a call has the option, with the value that may follow its name.
fn is_given(command: &Command, matches: &ArgMatches, option: &str) -> bool {
    let (name, value) = option.split_once('=').map_or((option, None), |(name, value)| (name, Some(value)));
    let Some(arg) = command.get_arguments().find(|arg| arg.get_long() == Some(name)) else { return false };
    let id = arg.get_id().as_str();
    let has = |value: &str| matches.get_raw(id).into_iter().flatten().any(|given| given == value);
    // a default is not of the call
    matches.value_source(id) == Some(ValueSource::CommandLine) && value.is_none_or(has)
}

/// An option as a call has it.
fn flag(option: &str) -> String {
    format!("--{}", option.replace('=', " "))
}

/// `--a`, `--a or --b`, `--a, --b or --c`.
fn listed(options: &[&str]) -> String {
    let flags: Vec<String> = options.iter().map(|option| flag(option)).collect();
    match flags.split_last() {
        Some((last, [])) => last.clone(),
        Some((last, others)) => format!("{} or {last}", others.join(", ")),
        None => String::new(),
    }
}
