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
    /// Write joint positions instead of AMASS: positions (F,N,3) in metres, joints, parents, fps; in the file's own order,
    /// rate and channels
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
        // what was odd in the file is found in reading its motion
        super::warn(&format::read(&args.input, &options)?, say);
        let positions = format::positions(&args.input, &options)?;
        positions.save(&args.output)?;
        let (out, n, f) = (args.output.display(), positions.joints.len(), positions.frames());
        say.line(format_args!("{out}: {f} frames of {n} points at {} fps", positions.fps));
        return Ok(());
    }
    check(&args)?;
    let motion = format::read(&args.input, &options)?;
    super::warn(&motion, say);
    let selection = |list: &str| {
        let list = joints::in_smpl_names(list, motion.clip.skeleton(), args.read.map.as_deref())?;
        joints::parse(&list)
    };
    let wanted = Wanted {
        fps: args.fps,
        rig: match (&args.skeleton, ext.as_str()) {
            (Some(name), _) => Some(Rig::find(name, &options)?),
            (None, "npz") => Some(Rig::Smpl(kinelm_motion::smpl::neutral())),
            (None, _) => None,
        },
        joints: args.joints.as_deref().map(selection).transpose().map_err(|e| WrongCall(e.to_string()))?,
    };
    let motion = convert(motion, &wanted, args.read.map.as_deref())?;
    format::write(&args.output, &motion)?;
    told(&args.output, &motion, say);
    Ok(())
}

/// What can be known to be wrong before anything is read.
fn check(args: &Args) -> Result<()> {
    if super::writable(&args.output)? == "npz" && args.skeleton.as_deref().is_some_and(|s| s != "smpl") {
        return Err(
            WrongCall("--skeleton with an .npz: AMASS files are on SMPL's joints; write .bvh or .json".into()).into()
        );
    }
    super::not_over_itself(&args.input, &args.output)
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
