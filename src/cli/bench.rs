//! `kinelm bench read` and `tokenize`.

use super::{Say, print};
use anyhow::{Context, Result};
use kinelm_motion::format::{ReadOptions, bvh};
use kinelm_motion::{Clip, synth};
use kinelm_tokenizer::{Tokenizer, TokenizerConfig};
use rayon::prelude::*;
use serde_json::json;
use std::path::PathBuf;
use std::time::Instant;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// MB/s of a BVH's number block, on one core
    Read {
        /// The file; a made-up dance if not given
        file: Option<PathBuf>,
        #[command(flatten)]
        how: How,
    },
    /// Frames/s of encoding and decoding made-up dances of 13 joints, on all threads
    Tokenize {
        #[command(flatten)]
        how: How,
    },
}

#[derive(Debug, clap::Args)]
pub struct How {
    /// Repeats; the median is what counts
    #[arg(long, default_value_t = 15, value_parser = clap::value_parser!(u16).range(1..))]
    repeats: u16,
    /// One JSON object a row instead of a table
    #[arg(long)]
    json: bool,
}

pub fn run(command: Command, say: Say) -> Result<()> {
    match command {
        Command::Read { file, how } => read(file, &how, say),
        Command::Tokenize { how } => tokenize(&how, say),
    }
}

/// Median, smallest and largest of `repeats` timings of `work`, as rates of `amount` a second.
fn rates(repeats: u16, amount: f64, mut work: impl FnMut() -> Result<()>) -> Result<[f64; 3]> {
    work()?;
    let mut rates = Vec::new();
    for _ in 0..repeats {
        let started = Instant::now();
        work()?;
        rates.push(amount / started.elapsed().as_secs_f64());
    }
    rates.sort_by(f64::total_cmp);
    Ok([rates[rates.len() / 2], rates[0], rates[rates.len() - 1]])
}

fn row(how: &How, what: &str, config: &str, unit: &str, [median, low, high]: [f64; 3]) -> Result<()> {
    if how.json {
        let line = json!({"schema": 1, "what": what, "config": config, unit: median, "spread": [low, high]});
        return print(&format!("{line}\n"));
    }
    print(&format!(
        "{what:<10} {config:<44} {median:>12.1} {unit} (median of {}; {low:.1} to {high:.1})\n",
        how.repeats
    ))
}

fn read(file: Option<PathBuf>, how: &How, say: Say) -> Result<()> {
    let options = ReadOptions::default();
    let (path, bytes) = match file {
        Some(path) => {
            let bytes = std::fs::read(&path).with_context(|| path.display().to_string())?;
            (path, bytes)
        }
        None => {
            let dance = synth::corpus(1, 1, 60.0, 120.0)?.remove(0);
            let source = bvh::BvhSource::plain(dance.clip.skeleton())?;
            (PathBuf::from("made-up.bvh"), source.to_bytes(&dance.clip)?)
        }
    };
    let head = bvh::parse_head(&path, &bytes, &options)?;
    let block = (bytes.len() - head.rows_at) as f64 / 1e6;
    let mut numbers = 0;
    let found = rates(how.repeats, block, || {
        let (rows, _) = head.rows(&path, &bytes, &options)?;
        numbers = rows.len();
        Ok(())
    })?;
    say.line(format_args!("{}: {numbers} numbers in {block:.2} MB", path.display()));
    row(how, "read", "number block, one core", "MB/s", found)
}

fn tokenize(how: &How, say: Say) -> Result<()> {
    let clips: Vec<Clip> = synth::corpus(1, 32, 60.0, 20.0)?.into_iter().map(|d| d.clip).collect();
    let tokenizer = Tokenizer::fit(&clips, TokenizerConfig::default())?;
    let frames: usize = clips.iter().map(Clip::frames).sum();
    let codes: Vec<Vec<u16>> = clips.iter().map(|c| Ok(tokenizer.encode(c)?.codes)).collect::<Result<_>>()?;
    say.line(format_args!("{} clips, {frames} frames, {} threads", clips.len(), rayon::current_num_threads()));
    let encode = rates(how.repeats, frames as f64, || {
        clips.par_iter().try_for_each(|clip| {
            let encoded = tokenizer.encode(clip)?;
            anyhow::ensure!(encoded.codes.len() == clip.frames() * 42, "a frame is 42 characters");
            Ok(())
        })
    })?;
    row(how, "tokenize", "encode, 13 joints, 360 bins", "frames/s", encode)?;
    let decode = rates(how.repeats, frames as f64, || {
        codes.par_iter().try_for_each(|codes| {
            tokenizer.decode(codes, kinelm_tokenizer::Rest::Identity)?;
            Ok(())
        })
    })?;
    row(how, "tokenize", "decode, 13 joints, 360 bins", "frames/s", decode)
}
