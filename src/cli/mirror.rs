//! `kinelm mirror`.

use super::many::InOut;
use super::{ForceArgs, Odd, Say, read::ReadArgs};
use crate::corpus::in_out::Pair;
use anyhow::Result;
use kinelm_motion::format::{self, RestFrame};
use kinelm_motion::mirror::Mirror;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    files: InOut,
    #[command(flatten)]
    force: ForceArgs,
    #[command(flatten)]
    read: ReadArgs,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let pairs = args.files.pairs()?;
    let clips: Vec<PathBuf> = pairs.iter().map(|p| p.input.clone()).collect();
    let outputs = args.force.outputs(clips.iter().cloned().chain(args.read.files()));
    outputs.check(pairs.iter().map(|p| &*p.output))?;
    let (options, odd) = (args.read.of_files(&clips, RestFrame::Keep, say), Odd::new(say));
    super::each_file(&clips, say, |i, path| {
        let Pair { output, .. } = &pairs[i];
        let motion = format::read(path, &options[i])?;
        odd.warn(&motion, &options[i]);
        let clip = Mirror::new(motion.humanoid()?)?.apply(&motion.clip)?;
        let mirrored = super::written_as(output, motion.with_clip(clip))?;
        outputs.write(output, &format::to_bytes(output, &mirrored)?)?;
        super::convert::report_written(output, &mirrored, say);
        Ok(())
    })?;
    Ok(())
}
