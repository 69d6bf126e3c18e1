//! `kinelm-lab read`.

use crate::{How, Rates, Row, Say, Unit, seconds};
use anyhow::{Context, Result};
use kinelm::motion::format::{ReadOptions, bvh};
use kinelm::motion::synth;
use serde_json::json;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The file; a made-up dance if not given
    file: Option<PathBuf>,
    #[command(flatten)]
    how: How,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let options = ReadOptions::default();
    let (path, bytes) = match args.file {
        Some(path) => {
            let bytes = kinelm::store::input::bytes(&path).with_context(|| path.display().to_string())?;
            (path, bytes)
        }
        None => {
            let dance = synth::corpus(1, 1, 60.0, 120.0)?.remove(0);
            let source = bvh::BvhSource::for_skeleton(dance.clip.skeleton())?;
            (PathBuf::from("made-up.bvh"), source.to_bytes(&dance.clip)?)
        }
    };
    let head = bvh::parse_header(&path, &bytes, &options)?;
    let block = (bytes.len() - head.rows_at) as f64 / 1e6;
    let mut numbers = 0;
    let timed = seconds(1, args.how.repeats.unwrap_or(15), || {
        let (rows, _) = head.rows(&path, &bytes, &options)?;
        numbers = rows.len();
        Ok(())
    })?;
    say.line(format_args!("{}: {numbers} numbers in {block:.2} MB", path.display()));
    let rates = Rates::of(block, &timed);
    let more = json!({"numbers": numbers});
    Row { what: "read", config: "number block", unit: Unit::Megabytes, rates, threads: 1, more }.print(&args.how)
}
