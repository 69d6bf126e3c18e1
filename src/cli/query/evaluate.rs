//! `kinelm query evaluate`.

use super::{TransformArg, joints_of};
use crate::classify::embedding::MODELS;
use crate::cli::data::DataArgs;
use crate::cli::read::ReadArgs;
use crate::cli::values::{count, rate, window};
use crate::cli::{CheckpointArg, ForceArgs, Say, print, progress, wrong_call};
use crate::corpus::labels::LabelFilter;
use crate::model::CheckpointChoice;
use crate::spectral::WindowSpec;
use crate::spectral::query::{Distance, EvaluateOptions, Exclude, evaluate, tables};
use anyhow::Result;
use kinelm_motion::format::RestFrame;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    data: DataArgs,
    /// Label fields, separated by commas [default: all that every clip has]
    #[arg(long, value_name = "FIELD,FIELD", value_delimiter = ',')]
    fields: Vec<String>,
    /// Use only clips with this label; may be repeated
    #[arg(long, value_name = "FIELD=VALUE")]
    only: Vec<LabelFilter>,
    /// Transforms to measure, separated by commas [default: stft,dct,pca, and model with --run]
    #[arg(long, value_enum, value_name = "stft|dct|pca|model", value_delimiter = ',')]
    transform: Vec<TransformArg>,
    /// The run whose embedding is measured too
    #[arg(long, value_name = "RUN", value_parser = crate::cli::values::run_folder())]
    run: Option<PathBuf>,
    #[command(flatten)]
    checkpoint: CheckpointArg,
    /// Leave out the bin of the STFT at 0 Hz, which holds the mean pose
    #[arg(long)]
    no_dc: bool,
    /// Distance measures, separated by commas
    #[arg(long, value_delimiter = ',', default_value = "cosine,euclid", value_enum)]
    distance: Vec<Distance>,
    /// What neighbours the main figures exclude; the others are printed too
    #[arg(long, default_value = "take", value_enum)]
    exclude: Exclude,
    /// Neighbours
    #[arg(short, default_value_t = 10, value_parser = clap::value_parser!(u16).range(1..))]
    k: u16,
    /// Joints to compare: 13, 18, 24, or a list of groups, names and ids
    #[arg(long, value_name = "13|18|24|LIST", default_value = "24")]
    joints: String,
    /// Frames of a window
    #[arg(long, value_name = "FRAMES", default_value_t = 128, value_parser = window)]
    window: usize,
    /// Frames from one window to the next
    #[arg(long, value_name = "FRAMES", default_value_t = 64, value_parser = count)]
    hop: usize,
    /// Frames per second
    #[arg(long, value_parser = rate, default_value_t = 60.0)]
    fps: f64,
    /// Use rotation vectors that jump at half a turn (compat), instead of continuous ones
    #[arg(long)]
    raw: bool,
    /// Print Markdown tables
    #[arg(long, conflicts_with = "json")]
    markdown: bool,
    /// Print one JSON object with all figures
    #[arg(long)]
    json: bool,
    /// Also write that object to a file
    #[arg(long, value_name = "FILE.json")]
    save: Option<PathBuf>,
    #[command(flatten)]
    force: ForceArgs,
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
    let mut transforms = args.transform.clone();
    if transforms.is_empty() {
        transforms = vec![TransformArg::Stft, TransformArg::Dct, TransformArg::Pca];
        transforms.extend(args.run.is_some().then_some(TransformArg::Model));
    }
    let measured = |transform| transforms.contains(&transform);
    if args.no_dc && !measured(TransformArg::Stft) {
        wrong_call!("--no-dc: only an STFT has a bin at 0 Hz; add stft to --transform");
    }
    if args.run.is_some() && !measured(TransformArg::Model) {
        wrong_call!("--run: only the transform model reads a run; add model to --transform");
    }
    // no_dc is of the STFT, and refused by the others
    let kind = |t: &TransformArg| t.kind(args.no_dc && *t == TransformArg::Stft, None, args.run());
    let options = EvaluateOptions {
        build: args.data.build_options(args.read.options(RestFrame::Drop)),
        windows: WindowSpec { frames: args.window, hop: args.hop, fps: args.fps },
        joints: joints_of(&args.joints)?,
        raw: args.raw,
        transforms: transforms.iter().map(kind).collect::<Result<_>>()?,
        distances: args.distance.clone(),
        fields: args.fields.clone(),
        only: args.only.clone(),
        exclude: args.exclude,
        k: args.k.into(),
        models: MODELS,
    };
    let dataset = args.data.find(say)?;
    let outputs = args.force.outputs(args.data.files(&dataset).chain(args.run.clone()).chain(args.read.files()));
    outputs.check(args.save.as_deref())?;
    let report = evaluate(&dataset, &options, &mut *progress::watch(say, "measuring neighbours"))?;
    for line in report.summary.lines() {
        say.line(line);
    }
    let figures = serde_json::to_string(&report)? + "\n";
    if let Some(path) = &args.save {
        outputs.write(path, figures.as_bytes())?;
    }
    if args.json {
        return print(&figures);
    }
    if args.markdown {
        return print(&tables::markdown(&report));
    }
    for line in tables::notes(&report) {
        say.line(line);
    }
    let tables: Vec<String> = tables::tables(&report).iter().map(|table| table.terminal()).collect();
    print(&tables.join("\n"))
}
