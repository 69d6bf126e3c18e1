//! `kinelm-lab tokenize`.

use crate::{How, Rates, Row, Say, Unit, seconds};
use anyhow::Result;
use kinelm::motion::joints::THIRTEEN;
use kinelm::motion::{Clip, synth};
use kinelm::tokenizer::{Tokenizer, TokenizerConfig, Words};
use rayon::prelude::*;
use serde_json::json;

#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    how: How,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let clips: Vec<Clip> = synth::corpus(1, 32, 60.0, 20.0)?.into_iter().map(|d| d.clip).collect();
    let tokenizer =
        Tokenizer::fit(&clips, TokenizerConfig { joints: THIRTEEN.to_vec(), ..TokenizerConfig::default() })?;
    let frames: usize = clips.iter().map(Clip::frames).sum();
    let words: Vec<Words> = clips.iter().map(|c| Ok(tokenizer.encode(c)?.words)).collect::<Result<_>>()?;
    let (threads, repeats) = (rayon::current_num_threads(), args.how.repeats.unwrap_or(15));
    say.line(format_args!("{} clips, {frames} frames", clips.len()));
    let row = |config: &str, timed: &[f64]| {
        let (rates, more) = (Rates::of(frames as f64, timed), json!({}));
        Row { what: "tokenize", config, unit: Unit::Frames, rates, threads, more }.print(&args.how)
    };
    let encode = seconds(1, repeats, || {
        clips.par_iter().try_for_each(|clip| {
            let encoded = tokenizer.encode(clip)?;
            // 3 of the root, 3 of each joint
            anyhow::ensure!(encoded.words.codes().len() == clip.frames() * 42, "a frame is 42 characters");
            Ok(())
        })
    })?;
    row("encode, 13 joints, 360 bins", &encode)?;
    let decode = seconds(1, repeats, || {
        words.par_iter().try_for_each(|words| {
            tokenizer.decode(words, kinelm::tokenizer::UncodedPose::Identity)?;
            Ok(())
        })
    })?;
    row("decode, 13 joints, 360 bins", &decode)
}
