//! Every option of every command stands alone or needs another one, and then is refused without it.

use super::*;
use crate::cli::parser;
use std::collections::BTreeSet;

/// Options that say something by themselves, of every command that has options: its own, and those it shares.
const ALONE: &[(&str, &str, &[&[&str]])] = &[
    ("aclstm evaluate", "checkpoint run split seeds seed-frames frames write-seeds dances json", &[]),
    ("again", "out run prompt timeline music guesses force", &[]),
    ("aclstm generate", "checkpoint run seed-clip seed-frames seed-from frames with-seed out feet force", &[READING]),
    ("aclstm plot", "over out force", &[]),
    ("aclstm resume", "run from-step steps set", &[]),
    ("aclstm train", "run labels only config set", &[READING]),
    ("classify eval", "classifier corpus split baselines plot json trust", &[]),
    ("classify predict", "classifier json", &[READING]),
    (
        "classify train",
        "checkpoint run corpus fields out only scratch share compat unbalanced steps batch rate head-rate eval-every \
         eval-windows patience seed resume trust",
        &[],
    ),
    ("compare", "joints band json page", &[READING]),
    ("convert", "format fps onto joints from to in-place at-origin for write-unit positions force", &[READING]),
    ("corpus clean", "labels strict out tokenizer force", &[READING]),
    ("corpus merge", "out force", &[]),
    ("corpus order", "corpus config steps seed out force trust", &[]),
    ("corpus stats", "json trust", &[]),
    ("demo", "out force seed train steps music device form", &[]),
    ("evaluate baselines", "corpus split json floors floors-from trust", &[]),
    ("evaluate blind count", "json", &[]),
    ("evaluate blind make", "ask pairs seconds seed out force", &[READING]),
    ("evaluate dance", "compare real copying features fidelity beats music plot page json trust", &[READING]),
    (
        "evaluate gaps",
        "checkpoint run corpus split frames gaps samples goal-guidance passes feet seed weights kv device form json \
         trust",
        &[DRAWING],
    ),
    (
        "evaluate likelihood",
        "checkpoint run corpus split windows conditions per-joint gaps weights kv device form floors floors-from json \
         trust",
        &[],
    ),
    ("evaluate prediction", "run fps labels strict split windows json", &[READING]),
    ("export", "checkpoint run format out", &[]),
    ("filter", "out level cutoff keep hips feet json force", &[READING]),
    ("finetune resume", "run from-step corpus steps precision device form trust set", &[]),
    ("finetune", "checkpoint from config corpus run steps seed conditions precision device form trust set", &[]),
    (
        "generate timeline",
        "checkpoint run out label music guidance goal-guidance frames seconds fps variations seed first-frames look-ahead lead-in \
         rig uncoded-joints feet blend tries passes guesses best force weights kv device form check",
        &[DRAWING],
    ),
    (
        "generate",
        "checkpoint path prompt onto run out label music guidance frames seconds fps variations seed first-frames look-ahead lead-in feet \
         passes guesses best force weights kv device form",
        &[DRAWING],
    ),
    ("import", "run", &[]),
    ("inspect", "json map-out", &[READING]),
    (
        "interpolate",
        "out page plot coordinates transform keep window whole fps at-a at-b keep-heading strength amount plain rate \
         steps json force",
        &[READING],
    ),
    ("lr-find", "config corpus out steps from to json force device form trust", &[]),
    ("mirror", "out force", &[READING]),
    ("music beats", "out bpm-range", &[]),
    ("music inspect", "json out bpm-range", &[]),
    ("music render", "bpm seconds style seed out force", &[]),
    ("music-lstm evaluate", "checkpoint run split frames cutoff json", &[]),
    ("music-lstm generate", "checkpoint run music music-from frames out force", &[]),
    ("music-lstm resume", "run from-step steps set", &[]),
    ("music-lstm train", "music run labels only config set", &[READING]),
    ("pretrain resume", "run from-step corpus steps precision device form trust set", &[]),
    ("pretrain", "config corpus run steps seed conditions from precision device form trust set", &[]),
    ("query build", "labels strict out transform run no-dc keep joints window hop fps raw", &[READING]),
    (
        "query evaluate",
        "labels strict fields only transform run no-dc distance exclude joints window hop fps raw markdown \
         json save k",
        &[READING],
    ),
    ("query find", "index at distance exclude one-per-clip page json k lowest", &[READING]),
    ("runs list", "json", &[]),
    ("runs plot", "out metric over force", &[]),
    ("spectrum", "out page joint at seconds fps no-dc force", &[READING]),
    #[cfg(feature = "studio")]
    ("studio", "checkpoint run real port bind no-open empty assets", &[]),
    ("tokenize", "labels strict out tokenizer shard music motion-beats exclude force", &[READING]),
    ("tokenizer decode", "tokenizer force floor", &[]),
    (
        "tokenizer fit",
        "labels strict out force config joints fps root-rotation merges scheme bins form translation \
         height set",
        &[READING],
    ),
    ("tokenizer study", "labels strict out schemes joints fps show channels force", &[READING]),
    ("tokenizer text", "tokenizer page", &[READING]),
    ("tune", "labels strict run steps seed device form trust", &[READING]),
    ("view", "out forced paths together music lag force", &[READING]),
];

/// The commands that can be called, with their names. Built, so that they have the global options too.
fn commands() -> Vec<(String, Command)> {
    fn below(name: &str, command: &Command, all: &mut Vec<(String, Command)>) {
        for sub in command.get_subcommands().filter(|sub| sub.get_name() != "help") {
            let name = format!("{name} {}", sub.get_name()).trim().to_string();
            below(&name, sub, all);
            all.push((name, sub.clone()));
        }
    }
    let mut all = Vec::new();
    let mut program = parser();
    program.build();
    below("", &program, &mut all);
    all
}

/// Options of a command by their names, or letters where they have none.
fn options(command: &Command) -> Vec<String> {
    let everywhere = ["help", "version", "threads", "quiet"];
    let name = |arg: &clap::Arg| arg.get_long().map(String::from).or(arg.get_short().map(String::from));
    command.get_arguments().filter_map(name).filter(|name| !everywhere.contains(&&**name)).collect()
}

#[test]
fn every_option_stands_alone_or_needs_another() {
    let mut unknown = Vec::new();
    for (name, command) in commands() {
        let options = options(&command);
        let own = ALONE.iter().filter(|(of, ..)| *of == name);
        let alone: BTreeSet<&str> =
            own.flat_map(|(_, own, shared)| own.split(' ').chain(shared.iter().copied().flatten().copied())).collect();
        let needs: BTreeSet<&str> = NEEDS
            .iter()
            .filter(|need| need.commands.contains(&&*name))
            .flat_map(|need| need.options)
            .copied()
            .collect();
        // of one with a value, other values stand alone
        let needs: BTreeSet<&str> =
            needs.into_iter().map(|option| option.split('=').next().unwrap_or(option)).collect();
        let missing: Vec<&str> =
            options.iter().map(|o| &**o).filter(|o| !alone.contains(o) && !needs.contains(o)).collect();
        if !missing.is_empty() {
            unknown.push(format!("{name}: {}", missing.join(" ")));
        }
        for option in alone.iter().chain(&needs) {
            assert!(options.iter().any(|of| of == option), "{name} has no --{option}");
        }
        let both: Vec<_> = alone.intersection(&needs).collect();
        assert!(both.is_empty(), "{name}: {both:?} both stand alone and need another");
    }
    let help = "list each in ALONE, or in NEEDS with what it needs";
    assert!(unknown.is_empty(), "options that are in neither table; {help}:\n{}", unknown.join("\n"));
    let names: BTreeSet<String> = commands().into_iter().map(|(name, _)| name).collect();
    let listed =
        NEEDS.iter().flat_map(|need| need.commands.iter().copied()).chain(ALONE.iter().map(|(name, ..)| *name));
    listed.for_each(|name| assert!(names.contains(name), "there is no command {name}"));
}

/// What a command needs besides the option that is tried.
fn base(command: &str, option: &str) -> &'static str {
    match (command, option) {
        ("generate", "joints" | "from-frame" | "given" | "free") => "--out a.bvh --frames 5",
        ("generate", "loop") => "--out a.bvh --music b.wav",
        // --loop, which one of these needs, conflicts with --seconds
        ("generate", _) => "--out a.bvh --seconds 5",
        ("generate timeline", _) => "a.toml --out a.bvh",
        ("filter" | "view", _) => "a.bvh --out a",
        ("inspect", _) => "a.bvh",
        ("tokenizer text", _) => "a.bvh --tokenizer a",
        ("compare" | "convert", _) => "a.bvh b.bvh",
        ("classify eval", _) => "--classifier a --corpus a",
        ("music inspect" | "music beats", _) => "a.wav",
        ("query find", _) => "a.bvh --index a",
        ("query evaluate", _) => "a",
        ("query build", _) => "a --out b",
        ("pretrain", _) => "--config tiny",
        ("aclstm evaluate", _) => "--run a",
        ("aclstm train", _) => "a --run a",
        ("music-lstm train", _) => "a --music a --run a",
        ("evaluate dance", _) => "a.bvh --real a",
        ("evaluate baselines", _) => "--corpus a",
        ("evaluate prediction", _) => "a",
        ("evaluate gaps", _) => "--run a --corpus a",
        _ => panic!("no call of {command}"),
    }
}

/// The words of an option with the first of some values that it takes.
fn words_of(command: &Command, option: &str) -> Vec<String> {
    let (name, value) = option.split_once('=').map_or((option, None), |(name, value)| (name, Some(value)));
    let arg = command.get_arguments().find(|arg| arg.get_long() == Some(name)).unwrap_or_else(|| panic!("no --{name}"));
    let takes_value = arg.get_action().takes_values() && arg.get_num_args().is_none_or(|n| n.min_values() > 0);
    let own = arg.get_possible_values().first().map(|value| value.get_name().to_string());
    let fitting = match name {
        "seconds" | "music-from" => "1s",
        "split" => "valid",
        "loop-over" | "blend" => "5s",
        "given" | "free" => "left_arm",
        "device" => "cpu",
        "form" => "auto",
        _ => "1",
    };
    let value = value.map(String::from).or(own).unwrap_or(fitting.into());
    let flag = format!("--{name}");
    if takes_value { vec![flag, value] } else { vec![flag] }
}

/// What a call is refused for by [`check`]; `None` if it isn't.
fn refused(words: &[String]) -> Option<String> {
    let mut program = parser();
    let matches = program.try_get_matches_from_mut(words).unwrap_or_else(|e| panic!("{words:?}: {e}"));
    let error = check(&program, &matches).err()?;
    assert_eq!(error.exit_code(), 2);
    Some(error.to_string())
}

#[test]
fn what_needs_another_option_is_refused_without_it() {
    let all = commands();
    for Need { commands, options, any_of } in NEEDS {
        for (name, option) in commands.iter().flat_map(|name| options.iter().map(move |option| (*name, *option))) {
            let (_, command) = all.iter().find(|(of, _)| of == name).unwrap();
            let words = ["kinelm"].into_iter().chain(name.split(' ')).chain(base(name, option).split(' '));
            let mut words: Vec<String> = words.map(String::from).collect();
            words.extend(words_of(command, option));
            let said = refused(&words).unwrap_or_default();
            let expected = format!("{} needs {}", flag(option), listed(any_of));
            assert!(said.contains(&expected), "{words:?}: no {expected:?} in {said:?}");
        }
    }
}

#[test]
fn with_what_it_needs_an_option_is_taken() {
    for line in [
        "generate --out a.bvh --prompt b.bvh --loop --loop-over 3s --blend 1s --tries 9 --fps-source 60",
        "generate --out a.bvh --prompt b.bvh --free left_arm@1s:2s --blend 1s --goal-guidance 2 --rig prompt",
        "generate --out a.bvh --seconds 5 --rig model --uncoded-joints training",
        "generate --out a.glb --onto b.glb --seconds 5 --uncoded-joints mean --replace-animation idle --unit cm",
        "generate --out a.vrm --onto b.vrm --seconds 5 --embed",
        "convert a.bvh b.vrm --onto c.vrm --embed",
        "generate --out a.bvh --frames 5 --best 4 --keep-all --real corpus --music a.wav --music-from 2s",
        "generate timeline a.toml --out a.bvh --blend 1s --tries 9 --goal-guidance 2",
        "filter a.bvh --out b.bvh --butterworth 2 --cutoff 5 --compat",
        "evaluate dance a.bvh --real corpus --beats a.txt --music-from 2s --plot a.svg --force",
        "evaluate baselines --corpus corpus --split valid --trust --floors-from other",
        "aclstm train a --run run --set form=euler --set root_order=YXZ",
    ] {
        let words: Vec<String> = ["kinelm"].into_iter().chain(line.split(' ')).map(String::from).collect();
        assert_eq!(refused(&words), None, "{line}");
    }
}
