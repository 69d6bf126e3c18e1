//! `kinelm inspect`.

use super::{Say, print, read::ReadArgs};
use anyhow::Result;
use kinelm_motion::format::{self, ReadOptions, RestFrame, Unit, resolve_floor};
use kinelm_motion::inspect::report;
use kinelm_motion::{FaultKind, Motion, Warning};
use kinelm_store::Kind;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// Motion files (.bvh .npz .pkl .json)
    #[arg(required = true)]
    files: Vec<PathBuf>,
    /// One JSON object a file and line instead of text
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    read: ReadArgs,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let options = args.read.of_files(&args.files, RestFrame::Keep, say);
    let mut failed = 0;
    for (file, options) in args.files.iter().zip(&options) {
        match read(file, options) {
            Ok(mut motion) => {
                // a rig that no map knows has no feet to go by, which is said as its rig
                let floor = resolve_floor(&mut motion, options).ok();
                let report = report(&motion, floor);
                print(&if args.json { report.json() + "\n" } else { report.text() })?;
            }
            // the one file's format says how the call is wrong
            Err(e) if e.kind() == Kind::Call && args.files.len() == 1 && !args.json => return Err(e.into()),
            Err(e) => {
                failed += 1;
                if args.json {
                    let line = serde_json::json!({"schema": 1, "file": file, "error": e.to_string()});
                    print(&format!("{line}\n"))?;
                }
                say.error(e);
            }
        }
    }
    anyhow::ensure!(failed == 0, "{failed} of {} files could not be read", args.files.len());
    Ok(())
}

/// A file whose unit nobody can tell is still worth a look: it is read as metres, and that is a doubt.
fn read(file: &Path, options: &ReadOptions) -> kinelm_motion::Result<Motion> {
    match format::read(file, options) {
        Err(e) if e.fault() == Some(FaultKind::UnitUnknown) => {
            let mut motion = format::read(file, &ReadOptions { unit: Unit::Metre, ..options.clone() })?;
            let what = "the unit can't be told from the legs, lengths are shown as if metres; give --unit".into();
            motion.warnings.push(Warning { kind: "unit_unknown", what });
            Ok(motion)
        }
        other => other,
    }
}
