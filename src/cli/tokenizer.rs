//! `kinelm tokenizer fit`, `text` and `decode`.

use super::data::DataArgs;
use super::{Say, WrongCall, print, read::ReadArgs};
use anyhow::{Context, Result};
use kinelm::corpus;
use kinelm_motion::format::{self, RestFrame};
use kinelm_motion::{Motion, Source, joints};
use kinelm_tokenizer::{Form, Rest, SchemeConfig, Tokenizer, TokenizerConfig, Travel, UniformConfig};
use std::path::PathBuf;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Fit a tokenizer on the train clips of DATA
    Fit(FitArgs),
    /// A clip as one line of words
    Text(TextArgs),
    /// Words back to motion
    Decode(DecodeArgs),
}

#[derive(Debug, clap::Args)]
pub struct FitArgs {
    #[command(flatten)]
    data: DataArgs,
    /// Where the tokenizer goes
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Joints that are coded: 13, 24, or a list of groups, names and ids
    #[arg(long, default_value = "13", value_name = "13|24|LIST")]
    joints: String,
    /// Frames per second of the words
    #[arg(long, default_value_t = 20.0, value_parser = super::read::positive)]
    fps: f64,
    /// Bins a component
    #[arg(long, default_value_t = 360, value_parser = clap::value_parser!(u32).range(2..=21_054))]
    bins: u32,
    /// Bins centred on 0, or with an edge at 0
    #[arg(long, value_enum, default_value = "centred")]
    form: FormArg,
    /// The root's translation as steps in the decoded heading, or as places in metres
    #[arg(long, value_enum, default_value = "velocity")]
    translation: TravelArg,
    /// The root's height alone
    #[arg(long, value_enum, default_value = "velocity")]
    height: TravelArg,
    #[command(flatten)]
    read: ReadArgs,
}

#[derive(Debug, clap::Args)]
pub struct TextArgs {
    /// A motion file
    clip: PathBuf,
    /// The tokenizer
    #[arg(long, value_name = "FILE")]
    tokenizer: PathBuf,
    #[command(flatten)]
    read: ReadArgs,
}

#[derive(Debug, clap::Args)]
pub struct DecodeArgs {
    /// A text of words; - for standard input
    words: PathBuf,
    /// Where the motion goes (.bvh .npz .json)
    out: PathBuf,
    /// The tokenizer
    #[arg(long, value_name = "FILE")]
    tokenizer: PathBuf,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum FormArg {
    Centred,
    Edge,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum TravelArg {
    Velocity,
    Absolute,
}

impl From<TravelArg> for Travel {
    fn from(t: TravelArg) -> Travel {
        match t {
            TravelArg::Velocity => Travel::Velocity,
            TravelArg::Absolute => Travel::Absolute,
        }
    }
}

pub fn run(command: Command, say: Say) -> Result<()> {
    match command {
        Command::Fit(args) => fit(args, say),
        Command::Text(args) => text(args, say),
        Command::Decode(args) => decode(args, say),
    }
}

fn text(args: TextArgs, say: Say) -> Result<()> {
    let tokenizer = Tokenizer::load(&args.tokenizer)?;
    let options = args.read.options(RestFrame::Drop);
    let (motion, clip) = corpus::load::load_clip(&args.clip, &options, tokenizer.fps())?;
    super::warn(&motion, say);
    let encoded = tokenizer.encode(&clip)?;
    let clipped = encoded.clipped;
    if clipped > 0 {
        say.line(format_args!("{clipped} steps of the root lay outside the fitted range and are caught up later"));
    }
    print(&format!("{}\n", tokenizer.text(&encoded.words)?))
}

fn decode(args: DecodeArgs, say: Say) -> Result<()> {
    super::writable(&args.out)?;
    let tokenizer = Tokenizer::load(&args.tokenizer)?;
    let text = match args.words.as_os_str() == "-" {
        true => std::io::read_to_string(std::io::stdin())?,
        false => std::fs::read_to_string(&args.words).with_context(|| args.words.display().to_string())?,
    };
    let words = tokenizer.words_of_text(&text).with_context(|| args.words.display().to_string())?;
    anyhow::ensure!(!words.is_empty(), "{}: no words, nothing to decode", args.words.display());
    let clip = tokenizer.decode(&words, Rest::Identity)?;
    let motion = Motion { path: args.out.clone(), clip, source: Source::Plain, warnings: Vec::new() };
    format::write(&args.out, &motion)?;
    super::convert::told(&args.out, &motion, say);
    Ok(())
}

fn fit(args: FitArgs, say: Say) -> Result<()> {
    let selection = joints::parse(&args.joints).map_err(|e| WrongCall(e.to_string()))?;
    let uniform = UniformConfig {
        bins: args.bins,
        form: match args.form {
            FormArg::Centred => Form::Centred,
            FormArg::Edge => Form::Edge,
        },
        translation: args.translation.into(),
        height: args.height.into(),
        ..Default::default()
    };
    let config = TokenizerConfig {
        joints: selection.joints,
        fps: args.fps,
        scheme: SchemeConfig::Uniform(uniform),
        ..Default::default()
    };
    config.validate().map_err(|e| WrongCall(e.to_string()))?;
    let gathered = args.data.gather(say)?;
    let options = args.data.build_options(args.read.options(RestFrame::Drop));
    let (tokenizer, summary) = corpus::build::fit(&gathered, config, &options, &mut *super::progress::watch(say))?;
    tokenizer.save(&args.out)?;
    for line in summary.lines() {
        say.line(line);
    }
    let (c, w) = (tokenizer.channels().len(), tokenizer.longest_word());
    say.line(format_args!("{}: words of {c} characters, {w} tokens a frame", args.out.display()));
    Ok(())
}
