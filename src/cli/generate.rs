//! `kinelm generate`.

use super::{ComputeArgs, ReadingArgs, Say, WrongCall, read::ReadArgs};
use anyhow::Result;
use kinelm::generate::prompt::{self, Prompt, RestJoints};
use kinelm::generate::sampling::Draw;
use kinelm::generate::{NextToken, Plan, dances, reader};
use kinelm::model::{Which, load_run};
use kinelm_motion::format::{self, RestFrame};
use kinelm_motion::joints;
use kinelm_tokenizer::{Tokenizer, Words};
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The run folder of a trained model
    #[arg(long, value_name = "RUN")]
    run: PathBuf,
    /// The clip whose joints are followed
    #[arg(long, value_name = "CLIP")]
    prompt: PathBuf,
    /// The joints that are followed: groups (root, right_arm, legs, ...), names and ids; root brings the translation
    #[arg(long, value_name = "LIST")]
    joints: String,
    /// Frames to make, at the model's rate; the prompt's length if not given
    #[arg(long, value_parser = clap::value_parser!(u32).range(1..))]
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
    /// Always the likeliest character, instead of drawing by probability
    #[arg(long, conflicts_with = "temperature")]
    greedy: bool,
    /// Below 1 bolder in what is likely, above 1 in what is not
    #[arg(long, default_value_t = 1.0, value_parser = super::read::positive)]
    temperature: f64,
    /// The rig the dance is written on: the model's (SMPL-24), or the prompt's own
    #[arg(long, value_enum, default_value = "model")]
    rig: RigArg,
    /// What the joints do that the model doesn't know
    #[arg(long, value_enum, default_value = "identity")]
    rest_joints: RestArg,
    /// Free characters that are guessed to be those of the frame before, and verified in one read; changes no character.
    /// If not given, 8 with --greedy and none without: drawn characters are too rarely those of the frame before
    #[arg(long, value_name = "N", value_parser = clap::value_parser!(u8).range(..=64), hide_short_help = true)]
    guesses: Option<u8>,
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
    let options = args.read.options(RestFrame::Drop);
    let map = args.read.map.as_deref();
    check_out(&args)?;
    let selection = joints::parse(&args.joints).map_err(|e| WrongCall(e.to_string()))?;
    let run = load_run(&args.run, Which::Auto)?;
    run.notes.iter().for_each(|note| say.line(note));
    let tokenizer = &Tokenizer::load(&run.tokenizer)?;
    let prompt = Prompt::load(&args.prompt, &options, tokenizer)?;
    super::warn(&prompt.motion, say);
    let given = prompt::given_places(tokenizer, &selection).map_err(|e| WrongCall(e.to_string()))?;
    say_not_followed(tokenizer, &args.joints, say)?;
    let frames = args.frames.map_or(prompt.frames(), |n| n as usize);
    if frames > prompt.frames() {
        let (p, free) = (prompt.frames(), frames - prompt.frames());
        say.line(format_args!("the prompt ends after {p} frames; the {free} that follow are generated free"));
    }
    let mut model = reader(&run, args.compute.get(), args.reading.get(args.variations.into()))?;
    let danced = codes(&args, &mut *model, tokenizer, &prompt, &given, frames, say)?;
    for (codes, out) in danced.iter().zip(outs(&args)) {
        let clip = prompt.decode(tokenizer, codes, args.rest_joints.into())?;
        let motion = match args.rig {
            RigArg::Model => prompt::on_model_rig(&out, clip),
            RigArg::Prompt => prompt.on_own_rig(&clip, map)?,
        };
        format::write(&out, &motion)?;
        super::convert::told(&out, &motion, say);
        if args.rig == RigArg::Prompt {
            say_share_changed(&args, &out, tokenizer, codes, &given, prompt.frames(), say)?;
        }
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
        super::not_over_itself(&args.prompt, &out)?;
    }
    let extension = super::writable(&args.out)?;
    if args.greedy && args.variations > 1 {
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

fn codes(
    args: &Args,
    model: &mut dyn NextToken,
    tokenizer: &Tokenizer,
    prompt: &Prompt,
    given: &[bool],
    frames: usize,
    say: Say,
) -> Result<Vec<Words>> {
    let words = tokenizer.ids_of_words(&prompt.words)?;
    let draw = if args.greedy { Draw::Greedy } else { Draw::Temperature(args.temperature) };
    let plan = Plan::of_words(tokenizer, given, &words, frames, draw, args.seed);
    let plan = Plan { guesses: args.guesses.map_or(plan.guesses, usize::from), ..plan };
    let bar = super::progress::bar(frames as u64, "frames", say);
    let danced = dances(model, &plan, &mut |done| bar.set_position(done as u64));
    bar.finish_and_clear();
    let danced = danced?;
    if danced.guessed > 0 {
        say.line(format_args!("{} of {} characters guessed ahead were right", danced.right, danced.guessed));
    }
    Ok(danced.ids.iter().map(|ids| tokenizer.words_of_ids(ids).words).collect())
}

/// Reads the written file back and says which share of the given characters it codes otherwise.
fn say_share_changed(
    args: &Args,
    out: &Path,
    tokenizer: &Tokenizer,
    words: &Words,
    given: &[bool],
    prompt: usize,
    say: Say,
) -> Result<()> {
    let options = format::ReadOptions {
        map: args.read.map.clone(),
        unit: args.read.unit.into(),
        bvh_position: args.read.bvh_position.into(),
        ..Default::default()
    };
    let (_, clip) = kinelm::corpus::load::load_clip(out, &options, tokenizer.fps())?;
    let again = tokenizer.encode(&clip)?.words;
    if let Some(share) = prompt::share_changed(words.codes(), again.codes(), given, prompt) {
        say.line(format_args!(
            "read back from the prompt's rig, {:.4} % of the given characters differ",
            100.0 * share
        ));
    }
    Ok(())
}
