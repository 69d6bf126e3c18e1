//! `kinelm aclstm train`.

use crate::baselines::Settings;
use crate::baselines::aclstm::train::{Start, train};
use crate::baselines::aclstm::{Config, Form};
use crate::cli::Say;
use crate::cli::read::ReadArgs;
use crate::cli::updates::{self, ResumeArgs, set};
use crate::cli::values::positive;
use crate::corpus::labels::LabelFilter;
use anyhow::Result;
use kinelm_engine::lstm::Wiring;
use kinelm_motion::format::RestFrame;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Motion files or folders of them, all of one rig
    #[arg(value_name = "DATA", required = true)]
    data: Vec<PathBuf>,
    /// The run folder to create
    #[arg(long, value_name = "RUN")]
    run: PathBuf,
    /// Splits, takes and true rates of the DATA, as for kinelm tokenize: a CSV or a pattern
    #[arg(long, value_name = "FILE.csv|PATTERN")]
    labels: Vec<String>,
    /// Use only clips with this label; may be repeated
    #[arg(long, value_name = "FIELD=VALUE")]
    only: Vec<LabelFilter>,
    /// Settings: 256, published, or a TOML file. The flags below override them
    #[arg(long, value_name = "NAME|FILE")]
    config: Option<PathBuf>,
    /// The representation of a pose
    #[arg(long, value_enum)]
    representation: Option<Form>,
    /// The order of the root's Euler angles, such as YXZ, instead of the file's
    #[arg(long, value_name = "ORDER")]
    root_order: Option<String>,
    /// Auto-conditioning: how many of its own frames the network is fed after each group of true ones; 0: none
    #[arg(long, value_name = "N")]
    condition: Option<u16>,
    /// Auto-conditioning: true frames in a group
    #[arg(long, value_name = "N")]
    groundtruth: Option<u16>,
    /// Units of a layer
    #[arg(long, value_name = "N")]
    width: Option<u16>,
    /// Layers
    #[arg(long, value_name = "N")]
    layers: Option<u8>,
    /// Which output of the layer below a layer sees
    #[arg(long, value_enum)]
    wiring: Option<Wiring>,
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
    /// Any other setting, as in the file: length=60, turn=false; may be repeated. The other options win over it
    #[arg(long = "set", value_name = "KEY=VALUE")]
    set: Vec<String>,
    #[command(flatten)]
    read: ReadArgs,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    // the margin leaves out what precedes the motion
    let sources = updates::sources(&args.data, &args.labels, &args.only, args.read.options(RestFrame::Keep))?;
    follow(&args.run, &Start::New(config(&args)?, sources), say)
}

pub fn resume(args: &ResumeArgs, say: Say) -> Result<()> {
    follow(&args.run, &Start::Resume(args.changes()), say)
}

fn follow(run: &Path, request: &Start, say: Say) -> Result<()> {
    updates::follow("kinelm aclstm", run, say, |stop, report| train(run, request, stop, report))
}

fn config(args: &Args) -> Result<Config> {
    let mut config = args.config.as_deref().map(Config::find).transpose()?.unwrap_or_default().with_keys(&args.set)?;
    config.root_order = args.root_order.clone().or(config.root_order);
    set(&mut config.form, args.representation);
    set(&mut config.condition, args.condition);
    set(&mut config.groundtruth, args.groundtruth);
    set(&mut config.width, args.width);
    set(&mut config.layers, args.layers);
    set(&mut config.wiring, args.wiring);
    set(&mut config.batch, args.batch);
    set(&mut config.learning_rate, args.rate);
    set(&mut config.steps, args.steps);
    set(&mut config.seed, args.seed);
    config.validate()?;
    Ok(config)
}
