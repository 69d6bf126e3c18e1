//! One clip on its way to the output: the part of it, its rate, its rig.

use super::Args;
use crate::cli::{WrongCall, extension};
use anyhow::Result;
use kinelm_motion::convert::{ConvertOptions, Place, TargetRig, convert};
use kinelm_motion::moment::{Moment, Timebase};
use kinelm_motion::{Motion, joints, smpl};
use std::path::Path;

/// A motion at the rate and on the rig of the output.
pub fn converted(args: &Args, rig: Option<&TargetRig>, motion: Motion, output: &Path) -> Result<Motion> {
    let options = convert_options(args, rig, &motion, output)?;
    let motion = convert(motion, &options)?;
    let motion = match &args.rig.replace_animation {
        Some(name) => motion.replacing(name)?,
        None => motion,
    };
    Ok(if args.rig.embed { motion.embedded()? } else { motion })
}

/// The conversion for a motion that goes to `output`.
fn convert_options(args: &Args, rig: Option<&TargetRig>, motion: &Motion, output: &Path) -> Result<ConvertOptions> {
    let selection = |list: &str| {
        let list = joints::to_smpl_names(list, motion.clip.skeleton(), motion.map())?;
        joints::parse(&list)
    };
    // AMASS files are on SMPL's rig, whatever that of the input
    let npz = || (extension(output) == "npz" && !args.positions).then(|| TargetRig::Smpl(smpl::neutral()));
    Ok(ConvertOptions {
        fps: args.fps,
        rig: rig.cloned().or_else(npz),
        joints: args.joints.as_deref().map(selection).transpose().map_err(|e| WrongCall(e.to_string()))?,
        place: match (args.in_place, args.at_origin) {
            (true, _) => Place::InPlace,
            (_, true) => Place::AtOrigin,
            _ => Place::Own,
        },
    })
}

/// The frames from --from to --to.
pub fn cut(args: &Args, motion: Motion) -> Result<Motion> {
    let (frames, fps) = (motion.clip.frames(), motion.clip.fps());
    let scale = Timebase { frames, fps, left_out: 0, model_fps: None };
    let border = |flag: &str, moment: Option<Moment>, otherwise: usize| match moment.map(|m| m.boundary(scale)) {
        None => Ok(otherwise),
        Some(_) if matches!(moment, Some(Moment::Model(_))) => Err(WrongCall(format!(
            "--{flag} in frames of a model, and there is none; give seconds (2s) or frames (40f)"
        ))),
        Some(Some(border)) => Ok(border),
        Some(None) => {
            let s = motion.clip.duration_s();
            Err(WrongCall(format!("--{flag} lies outside the clip, which has {frames} frames, {s:.2} s at {fps} fps")))
        }
    };
    let (from, to) = (border("from", args.from, 0)?, border("to", args.to, frames)?);
    if args.from.is_none() && args.to.is_none() {
        return Ok(motion);
    }
    if from >= to {
        return Err(WrongCall(format!("--from frame {from}, --to frame {to}: nothing lies between")).into());
    }
    Ok(motion.slice(from..to))
}
