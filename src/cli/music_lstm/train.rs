//! `kinelm music-lstm train`.

use crate::baselines::Settings;
use crate::baselines::music_lstm::Config;
use crate::baselines::music_lstm::config::{Audio, Effort, Pose};
use crate::baselines::music_lstm::data::MusicSources;
use crate::baselines::music_lstm::train::{Start, train};
use crate::cli::Say;
use crate::cli::read::ReadArgs;
use crate::cli::updates::{self, ResumeArgs, set};
use crate::cli::values::positive;
use crate::corpus::labels::LabelFilter;
use anyhow::Result;
use kinelm_motion::format::RestFrame;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Motion files or folders of them, all of one rig
    #[arg(value_name = "DATA", required = true)]
    data: Vec<PathBuf>,
    /// The folder of the music: the file that a clip's label `music` names, else one with the clip's name
    #[arg(long, value_name = "FOLDER")]
    music: PathBuf,
    /// The run folder to create
    #[arg(long, value_name = "RUN")]
    run: PathBuf,
    /// Splits, takes, true rates and music of the DATA, as for kinelm tokenize: a CSV or a pattern
    #[arg(long, value_name = "FILE.csv|PATTERN")]
    labels: Vec<String>,
    /// Use only clips with this label; may be repeated
    #[arg(long, value_name = "FIELD=VALUE")]
    only: Vec<LabelFilter>,
    /// Settings: small, dissertation, or a TOML file. The flags below override them
    #[arg(long, value_name = "NAME|FILE")]
    config: Option<PathBuf>,
    /// The music features
    #[arg(long, value_enum)]
    audio: Option<Audio>,
    /// The loss of poses
    #[arg(long, value_enum)]
    pose: Option<Pose>,
    /// The loss of effort, which is added to it
    #[arg(long, value_enum)]
    effort: Option<Effort>,
    /// Add the loss of effort every N updates
    #[arg(long, value_name = "N")]
    effort_every: Option<u64>,
    /// Teacher forcing: the probability that the last layer sees the true previous frame, 0 to 1
    #[arg(long, value_name = "P")]
    teacher: Option<f64>,
    /// Sequences of an update
    #[arg(long, value_name = "N")]
    batch: Option<u16>,
    /// Adam's learning rate
    #[arg(long, value_name = "RATE", value_parser = positive)]
    rate: Option<f64>,
    /// Total updates
    #[arg(long, value_name = "N")]
    steps: Option<u64>,
    /// Seed of the first weights and of the sequences
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    /// Any other setting, as in the file: length=60, width=64; may be repeated. The other options win over it
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    #[command(flatten)]
    read: ReadArgs,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    // the margin leaves out what precedes the motion
    let motion = updates::sources(&args.data, &args.labels, &args.only, args.read.options(RestFrame::Keep))?;
    let places = MusicSources { music: updates::stored(&args.music)?, motion };
    follow(&args.run, &Start::New(config(&args)?, places), say)
}

pub fn resume(args: &ResumeArgs, say: Say) -> Result<()> {
    follow(&args.run, &Start::Resume(args.changes()), say)
}

fn follow(run: &Path, request: &Start, say: Say) -> Result<()> {
    updates::follow("kinelm music-lstm", run, say, |stop, report| train(run, request, stop, report))
}

fn config(args: &Args) -> Result<Config> {
    let mut config = args.config.as_deref().map(Config::find).transpose()?.unwrap_or_default().with_keys(&args.set)?;
    set(&mut config.audio, args.audio);
    set(&mut config.pose, args.pose);
    set(&mut config.effort, args.effort);
    set(&mut config.effort_every, args.effort_every);
    set(&mut config.teacher, args.teacher);
    set(&mut config.batch, args.batch);
    set(&mut config.learning_rate, args.rate);
    set(&mut config.steps, args.steps);
    set(&mut config.seed, args.seed);
    config.validate()?;
    Ok(config)
}
