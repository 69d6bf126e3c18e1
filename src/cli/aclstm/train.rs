//! `kinelm aclstm train`.

use super::FormArg;
use crate::baselines::aclstm::Config;
use crate::baselines::aclstm::train::{Asked, train};
use crate::classify::Only;
use crate::cli::read::{ReadArgs, positive};
use crate::cli::{Say, asked, updates};
use anyhow::Result;
use kinelm_engine::lstm::Wiring;
use kinelm_motion::format::RestFrame;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Folders of motion files, or files, all of one rig
    #[arg(value_name = "DATA", required_unless_present = "resume", conflicts_with = "resume")]
    data: Vec<PathBuf>,
    /// The run folder
    #[arg(long, value_name = "RUN")]
    run: PathBuf,
    /// Splits, takes and true rates of the DATA, as for kinelm tokenize: a CSV or a pattern
    #[arg(long, value_name = "FILE.csv|PATTERN", conflicts_with = "resume")]
    labels: Vec<String>,
    /// Only clips with this label; may be given again
    #[arg(long, value_name = "FIELD=VALUE", conflicts_with = "resume")]
    only: Vec<Only>,
    /// The settings: 256, published, or a TOML; what is given beside them goes before
    #[arg(long, value_name = "NAME|FILE", conflicts_with = "resume")]
    config: Option<PathBuf>,
    /// How a pose is written
    #[arg(long, value_enum, conflicts_with = "resume")]
    representation: Option<FormArg>,
    /// The order of the root's angles, such as YXZ, instead of its file's (euler)
    #[arg(long, value_name = "ORDER", conflicts_with = "resume")]
    root_order: Option<String>,
    /// Frames of its own that the network is fed, behind every few true ones; 0: none
    #[arg(long, value_name = "N", conflicts_with = "resume")]
    condition: Option<u16>,
    /// True frames before them
    #[arg(long, value_name = "N", conflicts_with = "resume")]
    groundtruth: Option<u16>,
    /// Units of a layer
    #[arg(long, value_name = "N", conflicts_with = "resume")]
    width: Option<u16>,
    /// Layers
    #[arg(long, value_name = "N", conflicts_with = "resume")]
    layers: Option<u8>,
    /// fixed: a layer sees the one below at the same step; compat: at the step before, as the published code has it
    #[arg(long, value_name = "fixed|compat", value_parser = wiring, conflicts_with = "resume")]
    wiring: Option<Wiring>,
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

fn wiring(text: &str) -> Result<Wiring, String> {
    match text {
        "fixed" => Ok(Wiring::Fixed),
        "compat" => Ok(Wiring::Compat),
        _ => Err("expected fixed or compat".into()),
    }
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let asked_for = match args.resume {
        true => Asked::Resumed(args.steps),
        // the margin leaves out what stands before the motion
        false => {
            let read = args.read.options(RestFrame::Keep);
            Asked::New(config(&args)?, updates::sources(&args.data, &args.labels, &args.only, read)?)
        }
    };
    updates::follow("kinelm aclstm train", &args.run, say, |stop, hear| train(&args.run, &asked_for, stop, hear))
}

fn config(args: &Args) -> Result<Config> {
    let mut config = args.config.as_deref().map(Config::find).transpose().map_err(asked)?.unwrap_or_default();
    config.form = args.representation.map_or(config.form, Into::into);
    config.root_order = args.root_order.clone().or(config.root_order);
    config.condition = args.condition.map_or(config.condition, usize::from);
    config.groundtruth = args.groundtruth.map_or(config.groundtruth, usize::from);
    config.width = args.width.map_or(config.width, usize::from);
    config.layers = args.layers.map_or(config.layers, usize::from);
    config.wiring = args.wiring.unwrap_or(config.wiring);
    config.batch = args.batch.map_or(config.batch, usize::from);
    config.learning_rate = args.rate.unwrap_or(config.learning_rate);
    config.steps = args.steps.unwrap_or(config.steps);
    config.seed = args.seed.unwrap_or(config.seed);
    config.validate().map_err(asked)?;
    Ok(config)
}
