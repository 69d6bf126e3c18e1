//! `kinelm tokenize`.

use super::{ForceArgs, Say, data::DataArgs, read::ReadArgs};
use crate::corpus::Shard;
use crate::corpus::build::{BuildOptions, tokenize};
use crate::corpus::exclude::exclude;
use crate::corpus::writer::LAYOUT;
use anyhow::Result;
use kinelm_motion::format::RestFrame;
use kinelm_music::feature::rate_of;
use kinelm_store::counted;
use kinelm_tokenizer::Tokenizer;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    data: DataArgs,
    /// The corpus folder to write
    #[arg(long, value_name = "CORPUS")]
    out: PathBuf,
    /// The tokenizer; ready takes that of kinelm's own model
    #[arg(long, value_name = "FILE|ready", value_parser = super::values::tokenizer_file())]
    tokenizer: PathBuf,
    /// Encode only shard I of N, counted from 0; `corpus merge` puts shards together
    #[arg(long, value_name = "I/N")]
    shard: Option<Shard>,
    /// The folder of the clips' music: the files that the label `music` names, from the second `music_from` on, else
    /// files with the clips' names, there or next to the motion. The corpus stores their beats
    #[arg(long, value_name = "FOLDER")]
    music: Option<PathBuf>,
    /// Give clips without music the beats of their own steps
    #[arg(long)]
    motion_beats: bool,
    /// Ranges of clips that the corpus does without, a CSV (clip, from_s, to_s, why) such as `corpus clean` writes; corpus.json
    /// lists them. A clip out of whose middle something is left out becomes two
    #[arg(long, value_name = "FILE.csv")]
    exclude: Option<PathBuf>,
    /// Overwrite the files of a corpus in --out
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    read: ReadArgs,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let tokenizer = Tokenizer::load(&args.tokenizer)?;
    let mut dataset = args.data.find(say)?;
    // `find` has printed these
    let notes = dataset.notes.len();
    let excluded = args.exclude.as_ref().map(|csv| exclude(&mut dataset, csv)).transpose()?.unwrap_or_default();
    dataset.notes[notes..].iter().for_each(|line| say.line(line));
    let inputs = args.data.files(&dataset).chain([args.tokenizer.clone()]).chain(args.exclude.clone());
    let inputs = inputs.chain(args.read.files());
    ForceArgs { force: args.force }.outputs(inputs).check_folder(&args.out, &LAYOUT)?;
    let options = BuildOptions {
        shard: args.shard,
        force: args.force,
        music: args.music.clone(),
        motion_beats: args.motion_beats,
        excluded,
        ..args.data.build_options(args.read.options(RestFrame::Drop))
    };
    let (manifest, summary) =
        tokenize(&dataset, &tokenizer, &args.out, &options, &mut *super::progress::watch(say, "writing the corpus"))?;
    for line in summary.lines() {
        say.line(line);
    }
    if let Some(folder) = &args.music {
        let (with_music, clips) = (counted(summary.with_music, "clips"), summary.clips);
        say.line(format_args!("{}: {with_music} of {clips} have music", folder.display()));
        if let Err(e) = rate_of(tokenizer.fps()) {
            say.line(format_args!("their beats are kept, not what they sound like: {e}"));
        }
    }
    if args.motion_beats {
        let (own, clips) = (counted(summary.with_motion_beats, "clips"), summary.clips);
        say.line(format_args!("{own} of {clips} have motion-derived beats"));
    }
    let (n, f) = (manifest.count.clips, manifest.count.frames);
    let tokens = manifest.token_count();
    let (clips, frames) = (counted(n, "clips"), counted(f, "frames"));
    say.line(format_args!("{}: {clips}, {frames}, {tokens} tokens", args.out.display()));
    Ok(())
}
