//! `kinelm tokenizer text` and `decode`; `fit` and `study` have files of their own.

use super::{ForceArgs, Say, print, read::ReadArgs};
use crate::corpus::ModelClip;
use crate::evaluate::words_page::words_page;
use anyhow::{Context, Result};
use kinelm_motion::Motion;
use kinelm_motion::format::{self, RestFrame};
use kinelm_store::{counted, input};
use kinelm_tokenizer::Tokenizer;
use std::path::PathBuf;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Fit a tokenizer on the train clips of DATA
    Fit(Box<super::fit::Args>),
    /// Print a clip as one line of words
    Text(TextArgs),
    /// Decode words to motion
    Decode(DecodeArgs),
    /// Compare tokenizers on DATA: words, bytes, bits, errors, speed
    Study(Box<super::study::Args>),
}

#[derive(Debug, clap::Args)]
pub struct TextArgs {
    /// A motion file
    clip: PathBuf,
    /// The tokenizer; ready takes that of kinelm's own model
    #[arg(long, value_name = "FILE|ready", value_parser = super::values::tokenizer_file())]
    tokenizer: PathBuf,
    /// Write a page with the words beside the body that they decode to (.html), instead of printing them
    #[arg(long, value_name = "FILE")]
    page: Option<PathBuf>,
    #[command(flatten)]
    force: ForceArgs,
    #[command(flatten)]
    read: ReadArgs,
}

#[derive(Debug, clap::Args)]
pub struct DecodeArgs {
    /// A text file of words; - for standard input
    words: PathBuf,
    /// Where the motion goes (.bvh .npz .json)
    out: PathBuf,
    /// The tokenizer; ready takes that of kinelm's own model
    #[arg(long, value_name = "FILE|ready", value_parser = super::values::tokenizer_file())]
    tokenizer: PathBuf,
    #[command(flatten)]
    force: ForceArgs,
    /// The height of the floor that heights are added to, metres
    #[arg(long, value_name = "METRES", default_value_t = 0.0, allow_negative_numbers = true, value_parser = metres)]
    floor: f64,
}

/// A height.
fn metres(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|x: &f64| x.is_finite()).ok_or("expected a height in metres".into())
}

pub fn run(command: Command, say: Say) -> Result<()> {
    match command {
        Command::Fit(args) => super::fit::run(*args, say),
        Command::Text(args) => text(args, say),
        Command::Decode(args) => decode(args, say),
        Command::Study(args) => super::study::run(*args, say),
    }
}

fn text(args: TextArgs, say: Say) -> Result<()> {
    let outputs = args.force.outputs([&args.clip, &args.tokenizer].into_iter().cloned().chain(args.read.files()));
    outputs.check(args.page.as_deref())?;
    let tokenizer = Tokenizer::load(&args.tokenizer)?;
    let options = args.read.of_file(&args.clip, RestFrame::Drop, say);
    let placed = ModelClip::load(&args.clip, &options, tokenizer.config().into())?;
    super::warn(&placed.motion, say);
    let encoded = tokenizer.encode(&placed.lowered())?;
    // `clipped` counts both
    let (steps, heights) = (encoded.clipped.saturating_sub(encoded.off_range), encoded.off_range);
    if steps > 0 {
        say.line(format_args!("{steps} steps of the root lay outside the fitted range and are caught up later"));
    }
    if heights > 0 {
        let what = "of the root above the floor lay outside the fitted range and end at its edge";
        say.line(format_args!("{heights} heights {what}; --floor METRES says where the floor is"));
    }
    let Some(page) = &args.page else { return print(&format!("{}\n", tokenizer.text(&encoded.words)?)) };
    let html = words_page(&tokenizer, &encoded.words, &super::view::stem(&args.clip))?;
    outputs.write(page, html.as_bytes())?;
    let (words, kb) = (counted(encoded.words.len(), "words"), html.len() / 1000);
    say.line(format_args!("{}: {words}, {kb} KB; open it in a browser", page.display()));
    Ok(())
}

/// Bytes that a frame takes while it is decoded and written.
const FRAME_BYTES: usize = 1 << 13;
/// Frames that are decoded at most, 109 minutes at 20 a second: a byte of text may stand for twenty.
const MOST_FRAMES: usize = 1 << 17;

fn decode(args: DecodeArgs, say: Say) -> Result<()> {
    super::writable(&args.out)?;
    let outputs = args.force.outputs([&args.words, &args.tokenizer]);
    outputs.check([&*args.out])?;
    let tokenizer = Tokenizer::load(&args.tokenizer)?;
    let text = match args.words.as_os_str() == "-" {
        true => std::io::read_to_string(std::io::stdin())?,
        false => input::text(&args.words).with_context(|| args.words.display().to_string())?,
    };
    let words = tokenizer.words_of_text(&text).with_context(|| args.words.display().to_string())?;
    let blank = text.trim().is_empty();
    let frames = words.len().saturating_mul(tokenizer.frames_per_word());
    anyhow::ensure!(
        frames <= MOST_FRAMES,
        "{}: {} words are {frames} frames; expected at most {MOST_FRAMES}: decode it in several pieces",
        args.words.display(),
        words.len()
    );
    let (needed, free) = (frames.saturating_mul(FRAME_BYTES) as u64, kinelm_store::memory::free());
    anyhow::ensure!(
        free.is_none_or(|free| needed <= free),
        "{}: {} words are {frames} frames, which take more memory than there is",
        args.words.display(),
        words.len()
    );
    anyhow::ensure!(!words.is_empty() && !blank, "{}: no words, nothing to decode", args.words.display());
    let clip = tokenizer.decode(&words, tokenizer.uncoded_pose())?;
    let clip = if tokenizer.config().above_floor() { clip.raised(args.floor) } else { clip };
    let motion = Motion::new(args.out.clone(), clip);
    outputs.write(&args.out, &format::to_bytes(&args.out, &motion)?)?;
    super::convert::report_written(&args.out, &motion, say);
    Ok(())
}
