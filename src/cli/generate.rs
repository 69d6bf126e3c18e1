//! `kinelm generate`.

use super::{ComputeArgs, ReadingArgs, Say, WrongCall, draw::DrawArgs, read::ReadArgs};
use anyhow::Result;
use kinelm::generate::prompt::{self, Prompt, RestJoints};
use kinelm::generate::{NextToken, Plan, dances, reader};
use kinelm::model::{Which, load_run};
use kinelm_motion::format::{self, RestFrame};
use kinelm_motion::joints;
use kinelm_tokenizer::{Rest, Tokenizer, Words};
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The run folder of a trained model
    #[arg(long, value_name = "RUN")]
    run: PathBuf,
    /// A clip to follow: its joints (--joints), its beginning (--beginning), or both; without one, the dance is free
    #[arg(long, value_name = "CLIP")]
    prompt: Option<PathBuf>,
    /// The joints that are followed: groups (root, right_arm, legs, ...), names and ids; root brings the translation
    #[arg(long, value_name = "LIST", requires = "prompt")]
    joints: Option<String>,
    /// Frames of the prompt that the dance begins with, as far as they fill whole words
    #[arg(long, value_name = "N", requires = "prompt", value_parser = clap::value_parser!(u32).range(1..))]
    beginning: Option<u32>,
    /// Frames to make, at the model's rate; the prompt's length if not given
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..), required_unless_present = "prompt")]
    frames: Option<u32>,
    /// Where the dance goes (.bvh .npz .json); with --variations, the dances go to FILE-1, FILE-2, ... before the extension
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Dances to make side by side, which costs less than one after the other; the first is the one made without this
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = clap::value_parser!(u8).range(1..=16))]
    variations: u8,
    /// The seed of the draws; the same gives the same dance
    #[arg(long, default_value_t = 1)]
    seed: u64,
    /// The rig the dance is written on: the model's (SMPL-24), or the prompt's own
    #[arg(long, value_enum, default_value = "model", requires_if("prompt", "prompt"))]
    rig: RigArg,
    /// What the joints do that the model doesn't know
    #[arg(long, value_enum, default_value = "identity", requires_ifs([("prompt", "prompt"), ("mean", "prompt")]))]
    rest_joints: RestArg,
    /// Free tokens that are guessed to be those of the word before, and verified in one read; changes no token.
    /// If not given, 8 with --greedy and none without: drawn tokens are too rarely those of the word before
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(..=64), hide_short_help = true)]
    guesses: Option<u8>,
    #[command(flatten)]
    draw: DrawArgs,
    #[command(flatten)]
    reading: ReadingArgs,
    #[command(flatten)]
    compute: ComputeArgs,
    #[command(flatten)]
    read: ReadArgs,
}

#[derive(Debug, Clone, Copy, PartialEq, clap::ValueEnum)]
enum RigArg {
    Model,
    Prompt,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum RestArg {
    /// They stand at rest
    Identity,
    /// They move as in the prompt
    Prompt,
    /// They hold their mean over the prompt
    Mean,
}

impl From<RestArg> for RestJoints {
    fn from(rest: RestArg) -> RestJoints {
        match rest {
            RestArg::Identity => RestJoints::Identity,
            RestArg::Prompt => RestJoints::Prompt,
            RestArg::Mean => RestJoints::Mean,
        }
    }
}

pub fn run(args: Args, say: Say) -> Result<()> {
    check_out(&args)?;
    check_prompt(&args)?;
    let run = load_run(&args.run, Which::Auto)?;
    run.notes.iter().for_each(|note| say.line(note));
    let tokenizer = &Tokenizer::load(&run.tokenizer)?;
    let prompt = args.prompt.as_deref().map(|path| load_prompt(&args, path, tokenizer, say)).transpose()?;
    let frames = args.frames.map(|n| n as usize).or(prompt.as_ref().map(|p| p.clip.frames())).unwrap_or(0);
    if let Some(p) = prompt.as_ref().filter(|p| !p.given.is_empty() && p.clip.frames() < frames) {
        let (p, free) = (p.clip.frames(), frames - p.clip.frames());
        say.line(format_args!("the prompt ends after {p} frames; the {free} that follow are generated free"));
    }
    let mut model = reader(&run, args.compute.get(), args.reading.get(args.variations.into()))?;
    let danced = words(&args, &mut *model, tokenizer, prompt.as_ref(), frames, say)?;
    for (words, out) in danced.iter().zip(outs(&args)) {
        let clip = match &prompt {
            Some(prompt) => prompt.clip.decode(tokenizer, words, args.rest_joints.into())?,
            None => tokenizer.decode(words, Rest::Identity)?,
        };
        let clip = clip.slice(0..frames);
        let own_rig = prompt.as_ref().filter(|_| args.rig == RigArg::Prompt);
        let motion = match own_rig {
            None => prompt::on_model_rig(&out, clip),
            Some(prompt) => prompt.clip.on_own_rig(&clip, args.read.map.as_deref())?,
        };
        format::write(&out, &motion)?;
        super::convert::told(&out, &motion, say);
        if let Some(prompt) = own_rig {
            say_share_changed(&args, &out, tokenizer, words, prompt, say)?;
        }
    }
    Ok(())
}

/// What is followed of a clip.
struct Followed {
    clip: Prompt,
    /// (C) places of a word; none if no joints are followed.
    given: Vec<bool>,
    /// Ids of the first words.
    beginning: Vec<u32>,
}

fn load_prompt(args: &Args, path: &Path, tokenizer: &Tokenizer, say: Say) -> Result<Followed> {
    let selection = args.joints.as_deref().map(|list| joints::parse(list).map_err(|e| WrongCall(e.to_string())));
    let selection = selection.transpose()?;
    let clip = Prompt::load(path, &args.read.options(RestFrame::Drop), tokenizer)?;
    super::warn(&clip.motion, say);
    let mut given = Vec::new();
    if let (Some(selection), Some(list)) = (selection, &args.joints) {
        given = prompt::given_places(tokenizer, &selection).map_err(|e| WrongCall(format!("--joints {list}: {e}")))?;
        say_not_followed(tokenizer, list, say)?;
    }
    let beginning = args.beginning.map(|n| clip.beginning(tokenizer, n as usize));
    let beginning = beginning.transpose().map_err(|e| WrongCall(format!("--beginning: {e}")))?.unwrap_or_default();
    Ok(Followed { clip, given, beginning })
}

/// Refuses a prompt of which nothing is followed.
fn check_prompt(args: &Args) -> Result<()> {
    if args.prompt.is_some() && args.joints.is_none() && args.beginning.is_none() {
        let what = "--prompt alone; say what is followed: --joints LIST, --beginning FRAMES, or both";
        return Err(WrongCall(what.into()).into());
    }
    Ok(())
}

/// The files that are written.
fn outs(args: &Args) -> Vec<PathBuf> {
    let numbered = |i: u8| {
        let mut name = args.out.file_stem().unwrap_or_default().to_owned();
        name.push(format!("-{i}."));
        name.push(args.out.extension().unwrap_or_default());
        args.out.with_file_name(name)
    };
    match args.variations {
        1 => vec![args.out.clone()],
        n => (1..=n).map(numbered).collect(),
    }
}

/// Parts of the list that name nothing the model knows. (A group is followed as far as it is known.)
fn say_not_followed(tokenizer: &Tokenizer, list: &str, say: Say) -> Result<()> {
    for part in list.split(',').filter(|_| list.contains(',')) {
        let joints = joints::parse(part)?.joints;
        if !joints.iter().any(|j| tokenizer.channels().joints().contains(j)) {
            say.line(format_args!("{} is not followed: the model doesn't know it", part.trim()));
        }
    }
    Ok(())
}

fn check_out(args: &Args) -> Result<()> {
    for out in outs(args) {
        if let Some(prompt) = &args.prompt {
            super::not_over_itself(prompt, &out)?;
        }
    }
    let extension = super::writable(&args.out)?;
    if args.draw.get()?.greedy && args.variations > 1 {
        let what = "--variations with --greedy: the likeliest dance is always the same; leave one of them out";
        return Err(WrongCall(what.into()).into());
    }
    if args.rig == RigArg::Prompt && extension == "npz" {
        return Err(WrongCall(
            "--rig prompt with an .npz: AMASS files are on the model's rig; write .bvh or .json".into(),
        )
        .into());
    }
    Ok(())
}

fn words(
    args: &Args,
    model: &mut dyn NextToken,
    tokenizer: &Tokenizer,
    prompt: Option<&Followed>,
    frames: usize,
    say: Say,
) -> Result<Vec<Words>> {
    let followed = prompt.filter(|p| !p.given.is_empty());
    let ids = followed.map(|p| tokenizer.ids_of_words(&p.clip.words)).transpose()?.unwrap_or_default();
    let length = tokenizer.frames_per_word();
    let mut plan = Plan::free(tokenizer.grammar(), frames.div_ceil(length), args.draw.get()?, args.seed);
    if let Some(prompt) = prompt {
        (plan.beginning, plan.given, plan.prompt) = (&prompt.beginning, &prompt.given, &ids);
    }
    plan.guesses = args.guesses.map_or(plan.guesses, usize::from);
    let bar = super::progress::bar(frames as u64, "frames", say);
    let danced = dances(model, &plan, &mut |words| bar.set_position((words * length).min(frames) as u64));
    bar.finish_and_clear();
    let danced = danced?;
    if danced.guessed > 0 {
        say.line(format_args!("{} of {} tokens guessed ahead were right", danced.right, danced.guessed));
    }
    Ok(danced.ids.iter().map(|ids| tokenizer.words_of_ids(ids).words).collect())
}

/// Reads the written file back and says which share of the given characters it codes otherwise.
fn say_share_changed(
    args: &Args,
    out: &Path,
    tokenizer: &Tokenizer,
    words: &Words,
    prompt: &Followed,
    say: Say,
) -> Result<()> {
    if prompt.given.is_empty() {
        return Ok(());
    }
    let options = format::ReadOptions {
        map: args.read.map.clone(),
        unit: args.read.unit.into(),
        bvh_position: args.read.bvh_position.into(),
        ..Default::default()
    };
    let (_, clip) = kinelm::corpus::load::load_clip(out, &options, tokenizer.fps())?;
    let again = tokenizer.encode(&clip)?.words;
    if let Some(share) = prompt::share_changed(words.codes(), again.codes(), &prompt.given, prompt.clip.words.len()) {
        say.line(format_args!(
            "read back from the prompt's rig, {:.4} % of the given characters differ",
            100.0 * share
        ));
    }
    Ok(())
}
