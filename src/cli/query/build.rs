//! `kinelm query build`.

use super::{TransformArg, joints_of};
use crate::classify::embedding::MODELS;
use crate::cli::data::DataArgs;
use crate::cli::read::ReadArgs;
use crate::cli::values::{count, rate, window};
use crate::cli::{CheckpointArg, Say, WrongCall, progress};
use crate::model::CheckpointChoice;
use crate::spectral::query::joint_names;
use crate::spectral::query::{Index, IndexRequest};
use anyhow::Result;
use kinelm_motion::format::RestFrame;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    data: DataArgs,
    /// The index folder; clips are added to an existing one, which keeps its options
    #[arg(long, value_name = "INDEX")]
    out: PathBuf,
    /// The features of a window [default: dct]
    #[arg(long, value_enum)]
    transform: Option<TransformArg>,
    /// With --transform model: the run
    #[arg(long, value_name = "RUN", value_parser = crate::cli::values::run_folder())]
    run: Option<PathBuf>,
    #[command(flatten)]
    checkpoint: CheckpointArg,
    /// With --transform stft: leave out the bin at 0 Hz, which holds the mean pose
    #[arg(long)]
    no_dc: bool,
    /// Coefficients per channel, for DCT or PCA [default: 16]
    #[arg(long, value_name = "N", value_parser = count)]
    keep: Option<usize>,
    /// Joints to compare: 13, 18, 24, or a list of groups, names and ids [default: 24]
    #[arg(long, value_name = "13|18|24|LIST")]
    joints: Option<String>,
    /// Frames of a window [default: 128]
    #[arg(long, value_name = "FRAMES", value_parser = window)]
    window: Option<usize>,
    /// Frames from one window to the next [default: 64]
    #[arg(long, value_name = "FRAMES", value_parser = count)]
    hop: Option<usize>,
    /// Frames per second [default: 60]
    #[arg(long, value_parser = rate)]
    fps: Option<f64>,
    /// Use rotation vectors that jump at half a turn (compat), instead of continuous ones
    #[arg(long)]
    raw: bool,
    #[command(flatten)]
    read: ReadArgs,
}

impl Args {
    /// The run and its checkpoint.
    fn run(&self) -> Option<(&Path, CheckpointChoice)> {
        Some((self.run.as_deref()?, self.checkpoint.get()))
    }
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let said = args.transform.is_some() || args.no_dc || args.keep.is_some() || args.run.is_some();
    // --run and --no-dc imply their transform
    let usual = if args.run.is_some() { TransformArg::Model } else { TransformArg::Dct };
    let transform = args.transform.unwrap_or(if args.no_dc { TransformArg::Stft } else { usual });
    let request = IndexRequest {
        transform: said.then(|| transform.kind(args.no_dc, args.keep, args.run())).transpose()?,
        frames: args.window,
        hop: args.hop,
        fps: args.fps,
        joints: args.joints.as_deref().map(joints_of).transpose()?,
        raw: args.raw.then_some(true),
        models: MODELS,
    };
    if args.run.is_some() && transform != TransformArg::Model {
        return Err(WrongCall("--run: only --transform model reads a run".into()).into());
    }
    let dataset = args.data.find(say)?;
    let options = args.data.build_options(args.read.options(RestFrame::Drop));
    let built =
        Index::build(&dataset, &request, &options, &args.out, &mut *progress::watch(say, "building the index"))?;
    for line in built.lines() {
        say.line(line);
    }
    let ((clips, windows), of) = (built.added, &built.options);
    say.line(format_args!(
        "{}: {clips} clips, {windows} windows added, {} in all; {}, {} frames at {} fps, hop {}, joints {}",
        args.out.display(),
        built.windows,
        of.transform.name(),
        of.windows.frames,
        of.windows.fps,
        of.windows.hop,
        joint_names(&of.joints)
    ));
    Ok(())
}
