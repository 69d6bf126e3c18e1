//! `kinelm tokenizer study`.

use super::data::DataArgs;
use super::{ForceArgs, Say, WrongCall, print, progress, read::ReadArgs};
use crate::evaluate::study;
use crate::evaluate::study::{Event, StudyOptions, default_rows, study};
use anyhow::{Context, Result};
use kinelm_motion::format::RestFrame;
use kinelm_motion::joints;
use kinelm_store::input;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    data: DataArgs,
    /// The folder for tables, plots, the page and finished rows; an interrupted study is resumed from it
    #[arg(long, value_name = "FOLDER", default_value = "study")]
    out: PathBuf,
    /// The rows: [[row]] tables with a name and a tokenizer's settings [default: configs/tokenizer/study.toml;
    /// study-13.toml for fewer than 24 joints]
    #[arg(long, value_name = "FILE.toml")]
    schemes: Option<PathBuf>,
    /// Joints of rows that state none: 13, 18, 24, or a list of groups, names and ids
    #[arg(long, default_value = "13", value_name = "13|18|24|LIST")]
    joints: String,
    /// Frames per second of rows that state none [default: 60, or the slowest file's rate if lower]
    #[arg(long, value_parser = super::values::positive)]
    fps: Option<f64>,
    /// The rows that the page shows beside the original [default: one of the DCT tiles and one lapped row]
    #[arg(long, value_name = "ROW,ROW", value_delimiter = ',')]
    show: Vec<String>,
    /// Also draw how these components of rotations are distributed, with each row's bin edges: right_shoulder.x, ..
    #[arg(long, value_name = "JOINT.AXIS,..", value_delimiter = ',')]
    channels: Vec<String>,
    /// Measure all rows again, and overwrite files in --out that no study wrote
    #[arg(long)]
    force: bool,
    #[command(flatten)]
    read: ReadArgs,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let joints = joints::parse(&args.joints).map_err(|e| WrongCall(e.to_string()))?.joints;
    let rows = match &args.schemes {
        Some(path) => (input::text(path).with_context(|| path.display().to_string())?, path.clone()),
        None => {
            let (text, path) = default_rows(joints.len());
            (text.to_string(), path.into())
        }
    };
    let build = args.data.build_options(args.read.options(RestFrame::Drop));
    let options = StudyOptions {
        build,
        rows,
        joints,
        fps: args.fps,
        force: args.force,
        shown: args.show,
        channels: args.channels,
    };
    let dataset = args.data.find(say)?;
    let inputs = args.data.files(&dataset).chain(args.schemes.clone()).chain(args.read.files());
    let outputs = ForceArgs { force: args.force }.outputs(inputs);
    let report = study(&dataset, &options, &args.out, &outputs, &mut watch(say))?;
    for line in report.notes() {
        say.line(line);
    }
    for (table, _) in study::tables::tables(&report) {
        print(&format!("{}\n", table.terminal()))?;
    }
    let channels = if options.channels.is_empty() { "" } else { ", channels.png" };
    say.line(format_args!("{}: study.md, study.json, bins.png, rate.png{channels}, page.html", args.out.display()));
    Ok(())
}

/// A bar over the clips of all rows, with the name of the one at work.
fn watch(say: Say) -> impl FnMut(Event<'_>) {
    let mut shown: Option<progress::Bar> = None;
    let mut name = String::new();
    move |event| {
        let line = |text: String| match &shown {
            Some(bar) => bar.suspend(|| say.line(text)),
            None => say.line(text),
        };
        match event {
            Event::Skipped(item, error) => say.left_out(format_args!("{}: left out: {error}", item.name)),
            Event::Note(text) => line(text.into()),
            Event::Row(row) => name = row.to_string(),
            Event::Step { done, of } => {
                let bar = shown.get_or_insert_with(|| progress::bar(of, "clips", say));
                bar.set_position(done);
                bar.set_message(name.clone());
                // the last clip ends the bar, or the tables would follow one that is still drawn
                if done == of {
                    shown = None;
                }
            }
        }
    }
}
