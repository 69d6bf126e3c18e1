//! `kinelm music-lstm train`.

use crate::baselines::music_lstm::Config;
use crate::baselines::music_lstm::config::{Audio, Effort, Pose};
use crate::baselines::music_lstm::data::Places;
use crate::baselines::music_lstm::train::{Asked, train};
use crate::classify::Only;
use crate::cli::read::{ReadArgs, positive};
use crate::cli::{Say, asked, updates};
use anyhow::{Context, Result};
use kinelm_motion::format::RestFrame;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folders of motion files, or files, all of one rig
    #[arg(value_name = "DATA", required_unless_present = "resume", conflicts_with = "resume")]
    data: Vec<PathBuf>,
    /// The folder of the music: the file that a clip's label `music` names, else one of the clip's name
    #[arg(long, value_name = "FOLDER", required_unless_present = "resume", conflicts_with = "resume")]
    music: Option<PathBuf>,
    /// The run folder
    #[arg(long, value_name = "RUN")]
    run: PathBuf,
    /// Splits, takes, true rates and music of the DATA, as for kinelm tokenize: a CSV or a pattern
    #[arg(long, value_name = "FILE.csv|PATTERN", conflicts_with = "resume")]
    labels: Vec<String>,
    /// Only clips with this label; may be given again
    #[arg(long, value_name = "FIELD=VALUE", conflicts_with = "resume")]
    only: Vec<Only>,
    /// The settings: small, dissertation, or a TOML; what is given beside them goes before
    #[arg(long, value_name = "NAME|FILE", conflicts_with = "resume")]
    config: Option<PathBuf>,
    /// How music is heard
    #[arg(long, value_enum, conflicts_with = "resume")]
    audio: Option<AudioArg>,
    /// The loss of poses
    #[arg(long, value_enum, conflicts_with = "resume")]
    pose: Option<PoseArg>,
    /// The loss of effort that is added to it
    #[arg(long, value_enum, conflicts_with = "resume")]
    effort: Option<EffortArg>,
    /// In every so manieth update
    #[arg(long, value_name = "N", conflicts_with = "resume")]
    effort_every: Option<u64>,
    /// How often the last layer sees the true frame before, 0 to 1
    #[arg(long, value_name = "SHARE", conflicts_with = "resume")]
    teacher: Option<f64>,
    /// Sequences of an update
    #[arg(long, value_name = "N", conflicts_with = "resume")]
    batch: Option<u16>,
    /// Adam's rate
    #[arg(long, value_name = "RATE", value_parser = positive, conflicts_with = "resume")]
    rate: Option<f64>,
    /// Updates in all
    #[arg(long, value_name = "N")]
    steps: Option<u64>,
    /// The seed of the first weights and of the sequences
    #[arg(long, value_name = "N", conflicts_with = "resume")]
    seed: Option<u64>,
    /// Go on with the run from its last whole checkpoint, on the same files
    #[arg(long)]
    resume: bool,
    #[command(flatten)]
    read: ReadArgs,
}

/// `--audio`.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum AudioArg {
    /// Six windows around the frame's time, logarithms
    Fixed,
    /// As the dissertation prints it
    Compat,
}

/// `--pose`.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum PoseArg {
    /// The mean square, true quaternions with the nearer sign
    Aligned,
    /// With the signs as they are
    Compat,
    /// It isn't asked
    None,
}

/// `--effort`.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum EffortArg {
    /// By angular speeds
    Corrected,
    /// As the dissertation prints it
    Compat,
    /// It isn't asked
    None,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let asked_for = match args.resume {
        true => Asked::Resumed(args.steps),
        false => {
            let music = updates::kept(args.music.as_deref().context("no folder of music")?)?;
            // the margin leaves out what stands before the motion
            let read = args.read.options(RestFrame::Keep);
            let motion = updates::sources(&args.data, &args.labels, &args.only, read)?;
            Asked::New(config(&args)?, Places { music, motion })
        }
    };
    updates::follow("kinelm music-lstm train", &args.run, say, |stop, hear| train(&args.run, &asked_for, stop, hear))
}

fn config(args: &Args) -> Result<Config> {
    let mut config = args.config.as_deref().map(Config::find).transpose().map_err(asked)?.unwrap_or_default();
    config.audio = args.audio.map_or(config.audio, |audio| match audio {
        AudioArg::Fixed => Audio::Fixed,
        AudioArg::Compat => Audio::Compat,
    });
    config.pose = args.pose.map_or(config.pose, |pose| match pose {
        PoseArg::Aligned => Pose::Aligned,
        PoseArg::Compat => Pose::Compat,
        PoseArg::None => Pose::None,
    });
    config.effort = args.effort.map_or(config.effort, |effort| match effort {
        EffortArg::Corrected => Effort::Corrected,
        EffortArg::Compat => Effort::Compat,
        EffortArg::None => Effort::None,
    });
    config.effort_every = args.effort_every.unwrap_or(config.effort_every);
    config.teacher = args.teacher.unwrap_or(config.teacher);
    config.batch = args.batch.map_or(config.batch, usize::from);
    config.learning_rate = args.rate.unwrap_or(config.learning_rate);
    config.steps = args.steps.unwrap_or(config.steps);
    config.seed = args.seed.unwrap_or(config.seed);
    config.validate().map_err(asked)?;
    Ok(config)
}
