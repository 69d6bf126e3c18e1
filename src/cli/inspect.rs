//! `kinelm inspect`.

use super::{ForceArgs, Say, each_file, motion_files, print, read::ReadArgs, reported};
use anyhow::{Error, Result, ensure};
use kinelm_motion::format::{self, ReadOptions, RestFrame, Unit, resolve_floor};
use kinelm_motion::inspect::report;
use kinelm_motion::{FaultKind, Motion, Warning};
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct Args {
    #[arg(required = true, help = super::with_extensions("Motion files (READ), or folders of them"))]
    files: Vec<PathBuf>,
    /// One JSON object a file and line instead of text
    #[arg(long)]
    json: bool,
    /// Write the skeleton map of the one file, given or recognised, as a TOML to check and correct
    #[arg(long, value_name = "FILE")]
    map_out: Option<PathBuf>,
    #[command(flatten)]
    force: ForceArgs,
    #[command(flatten)]
    read: ReadArgs,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let files = motion_files(&args.files)?;
    let options = args.read.of_files(&files, RestFrame::Keep, say);
    let outputs = args.force.outputs(files.iter().cloned().chain(args.read.files()));
    outputs.check(args.map_out.iter().map(|p| &**p))?;
    ensure!(args.map_out.is_none() || files.len() == 1, "--map-out takes one file, here are {}", files.len());
    each_file(&files, say, |i, file| {
        let mut motion = reported(read(file, &options[i]).map_err(Error::from), file, args.json)?;
        // without a map for the rig there are no feet to find the floor by; the report names the rig as unknown
        let floor = resolve_floor(&mut motion, &options[i]).ok();
        if let Some(out) = &args.map_out {
            outputs.write(out, motion.humanoid()?.map().to_toml().as_bytes())?;
            say.line(format_args!("{}: skeleton map written", out.display()));
        }
        let report = report(&motion, floor);
        print(&if args.json { report.json() + "\n" } else { report.text() })
    })?;
    Ok(())
}

/// Reads a motion. A file of an unknown unit is read as metres, with a warning.
fn read(file: &Path, options: &ReadOptions) -> kinelm_motion::Result<Motion> {
    match format::read(file, options) {
        Err(e) if e.fault() == Some(FaultKind::UnitUnknown) => {
            let mut motion = format::read(file, &ReadOptions { unit: Unit::METRE, ..options.clone() })?;
            let what = "the legs don't tell the unit, lengths are shown as if in metres; give --unit".into();
            motion.warnings.push(Warning { kind: "unit_unknown", what });
            Ok(motion)
        }
        other => other,
    }
}
