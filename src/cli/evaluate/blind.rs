//! `kinelm evaluate blind`.

use crate::cli::read::ReadArgs;
use crate::cli::values::{count, seconds_above_0};
use crate::cli::{ForceArgs, Say, each_file, page, print, progress};
use crate::evaluate::blind::{Ask, Count, Key, Study, StudyOptions, Votes};
use anyhow::Result;
use kinelm_motion::format::RestFrame;
use kinelm_store::{counted, hash};
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Write a page that asks people about clips without saying where they are from, and its key, which stays with you
    Make(MakeArgs),
    /// Count the votes that people saved, by the key: shares with intervals, and how far people agree
    Count(CountArgs),
}

#[derive(Debug, clap::Args)]
pub struct MakeArgs {
    /// A and B, and C for alike and blend: folders of motion files of any rig; clips of one name belong together
    #[arg(value_name = "FOLDER", num_args = 2..=3, required = true)]
    folders: Vec<PathBuf>,
    /// The question
    #[arg(long, value_enum)]
    ask: Ask,
    /// The most pairs, or triplets, that the page asks about
    #[arg(long, value_name = "N", default_value_t = 20, value_parser = count)]
    pairs: usize,
    /// The most seconds of each clip; all are cut to one length
    #[arg(long, value_name = "SECONDS", default_value = "10s", value_parser = seconds_above_0)]
    seconds: f64,
    /// The seed of the pairs, their order and their sides
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// The page (.html); its key goes beside it, as .key.json
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    #[command(flatten)]
    force: ForceArgs,
    #[command(flatten)]
    read: ReadArgs,
}

#[derive(Debug, clap::Args)]
pub struct CountArgs {
    /// The key of the study (.key.json)
    #[arg(value_name = "KEY")]
    key: PathBuf,
    /// The files of votes
    #[arg(value_name = "VOTES", required = true)]
    votes: Vec<PathBuf>,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

pub fn run(command: Command, say: Say) -> Result<()> {
    match command {
        Command::Make(args) => make(args, say),
        Command::Count(args) => counted_votes(&args, say),
    }
}

fn make(args: MakeArgs, say: Say) -> Result<()> {
    page(&args.out)?;
    let key_path = args.out.with_extension("key.json");
    let outputs = args.force.outputs(args.folders.iter().cloned().chain(args.read.files()));
    outputs.check([&*args.out, &*key_path])?;
    progress::stage("reading the clips");
    let MakeArgs { folders, ask, pairs, seconds, seed, out, read, .. } = args;
    let read = read.options(RestFrame::Drop);
    let study = Study::make(&StudyOptions { ask, folders, pairs, seconds, seed, read })?;
    // neither without the other: a key that is there belongs to another page, whose votes it alone can count
    outputs.check_replaceable(&out, Some(&hash::of(study.page.as_bytes())))?;
    outputs.write(&key_path, (serde_json::to_string_pretty(&study.key)? + "\n").as_bytes())?;
    outputs.write(&out, study.page.as_bytes())?;
    let key = &study.key;
    let kb = study.page.len() / 1000;
    let (trials, seconds) = (counted(key.trials.len(), "trials"), key.seconds);
    say.line(format_args!("{}: {trials} of {seconds:.1} s, {kb} KB; give it to people", out.display()));
    say.line(format_args!("{}: what is where; keep it", key_path.display()));
    Ok(())
}

fn counted_votes(args: &CountArgs, say: Say) -> Result<()> {
    let key = Key::load(&args.key)?;
    let read = each_file(&args.votes, say, |_, path| Ok(Votes::load(path, &key)?))?;
    let files: Vec<(&Path, Votes)> = read.into_iter().map(|(i, votes)| (&*args.votes[i], votes)).collect();
    let count = Count::of(&key, &files)?;
    if !args.json {
        return print(&format!("{count}\n"));
    }
    let mut line = serde_json::to_value(&count)?;
    line["schema"] = 1.into();
    print(&format!("{line}\n"))
}
