//! `kinelm convert`.

use super::{Say, WrongCall, extension, read::ReadArgs};
use anyhow::Result;
use kinelm_motion::convert::{Rig, Wanted, convert};
use kinelm_motion::format::{self, RestFrame};
use kinelm_motion::{Motion, joints};
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// A motion file (.bvh .npz .pkl .json)
    input: PathBuf,
    /// The file to write (.bvh .npz .json); an .npz is AMASS SMPL+H
    output: PathBuf,
    /// Frames per second wanted
    #[arg(long, value_parser = super::read::positive)]
    fps: Option<f64>,
    /// The rig wanted: smpl, a body model (SMPL_*.npz), or a motion file whose rig is meant
    #[arg(long, value_name = "NAME|FILE")]
    skeleton: Option<String>,
    /// Joints that go on moving, on the SMPL body: 13, 24, or a list of groups, names and ids; the others stand at rest
    #[arg(long, value_name = "LIST")]
    joints: Option<String>,
    /// Write joint positions instead of AMASS: positions (F,N,3) in metres, joints, parents, fps
    #[arg(long, conflicts_with_all = ["fps", "skeleton", "joints"])]
    positions: bool,
    #[command(flatten)]
    read: ReadArgs,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let options = args.read.options(RestFrame::Keep);
    let ext = extension(&args.output);
    if args.positions {
        if ext != "npz" {
            return Err(WrongCall(format!("--positions writes .npz; OUT is {}", args.output.display())).into());
        }
        let positions = format::positions(&args.input, &options)?;
        positions.save(&args.output)?;
        say.line(format_args!("{}: {} points, {} fps", args.output.display(), positions.joints.len(), positions.fps));
        return Ok(());
    }
    let wanted = Wanted {
        fps: args.fps,
        rig: match (&args.skeleton, ext.as_str()) {
            (Some(name), _) => Some(Rig::find(name, &options)?),
            (None, "npz") => Some(Rig::Smpl(kinelm_motion::smpl::neutral())),
            (None, _) => None,
        },
        joints: args.joints.as_deref().map(joints::parse).transpose()?,
    };
    let motion = format::read(&args.input, &options)?;
    super::warn(&motion, say);
    let motion = convert(motion, &wanted, args.read.map.as_deref())?;
    format::write(&args.output, &motion)?;
    told(&args.output, &motion, say);
    Ok(())
}

/// Says what was written.
pub fn told(path: &std::path::Path, motion: &Motion, say: Say) {
    let clip = &motion.clip;
    say.line(format_args!(
        "{}: {} frames at {} fps, {} joints",
        path.display(),
        clip.frames(),
        clip.fps(),
        clip.joints()
    ));
}
