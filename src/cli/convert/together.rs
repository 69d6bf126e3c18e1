//! Several clips into one GLB, where they play together.

use super::Args;
use super::clip::{converted, cut};
use crate::cli::{Odd, Say, WrongCall, extension};
use anyhow::Result;
use kinelm_motion::format::{self, Importer, RestFrame};
use std::path::{Path, PathBuf};

/// The GLB that several clips are written to, and the clips.
pub fn together(args: &Args) -> Option<(&Path, &[PathBuf])> {
    let (out, given) = args.paths.split_last()?;
    // a .glb holds no mere positions
    (given.len() > 1 && extension(out) == "glb" && !out.is_dir() && !args.positions).then_some((out, given))
}

pub fn write_together(args: &Args, inputs: &[PathBuf], out: &Path, say: Say) -> Result<()> {
    if args.write_unit.is_some() {
        let what = format!("--write-unit with {}: a .glb is in metres; leave it out", out.display());
        return Err(WrongCall(what).into());
    }
    let read = inputs.iter().cloned().chain(args.read.files());
    let outputs = args.force.outputs(read.chain(args.rig.files()));
    outputs.check([out])?;
    let rig = args.rig.load(say)?;
    args.rig.check_no_character(rig.as_ref(), "several dancers in one .glb")?;
    let (options, odd) = (args.read.of_files(inputs, RestFrame::Keep, say), Odd::new(say));
    let mut clips = Vec::with_capacity(inputs.len());
    for (input, options) in inputs.iter().zip(options) {
        let motion = format::read(input, &options)?;
        odd.warn(&motion, &options);
        let motion = cut(args, motion)?;
        let name = input.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let clip = converted(args, rig.as_ref(), motion, out)?.clip;
        let clip = match args.importer {
            Some(program) => Importer::from(program).fit(&clip)?,
            None => clip,
        };
        clips.push((name, clip));
    }
    let named: Vec<_> = clips.iter().map(|(name, clip)| (name.as_str(), clip)).collect();
    outputs.write(out, &format::glb::to_bytes(&named)?)?;
    say.line(format_args!("{}: {} dancers", out.display(), clips.len()));
    Ok(())
}
