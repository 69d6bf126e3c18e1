//! `kinelm music-lstm train`.

use crate::baselines::music_lstm::data::MusicSources;
use crate::baselines::music_lstm::train::{Start, train};
use crate::cli::Say;
use crate::cli::updates::{self, ResumeArgs, TrainArgs};
use anyhow::Result;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The folder of the music: the file that a clip's label `music` names, else one with the clip's name
    #[arg(long, value_name = "FOLDER")]
    music: PathBuf,
    #[command(flatten)]
    train: TrainArgs,
}

pub fn run(args: &Args, say: Say) -> Result<()> {
    let Args { music, train } = args;
    let sources = MusicSources { music: updates::stored(music)?, motion: train.sources()? };
    follow(&train.run, &Start::New(train.settings()?, sources), say)
}

pub fn resume(args: &ResumeArgs, say: Say) -> Result<()> {
    follow(&args.run, &Start::Resume(args.changes()), say)
}

fn follow(run: &Path, request: &Start, say: Say) -> Result<()> {
    updates::follow("kinelm music-lstm", run, say, |stop, report| train(run, request, stop, report))
}
