//! `kinelm mirror`.

use super::many::{InOut, Pair};
use super::{ForceArgs, Say, read::ReadArgs};
use anyhow::Result;
use kinelm_motion::Motion;
use kinelm_motion::format::{self, RestFrame};
use kinelm_motion::mirror::Mirror;
use kinelm_motion::retarget::map_for;
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
    let options = args.read.options(RestFrame::Keep);
    super::each_file(&clips, "clips could not be mirrored", say, |i, path| {
        let Pair { output, .. } = &pairs[i];
        let motion = format::read(path, &options)?;
        super::warn(&motion, say);
        let rig = motion.clip.skeleton();
        let clip = Mirror::new(rig, &map_for(rig, args.read.map.as_deref())?)?.apply(&motion.clip)?;
        let mirrored = super::written_as(output, Motion { clip, ..motion }, args.read.map.as_deref())?;
        outputs.write(output, &format::to_bytes(output, &mirrored)?)?;
        super::convert::told(output, &mirrored, say);
        Ok(())
    })
}
