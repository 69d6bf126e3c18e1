//! `kinelm spectrum`.

use super::{ForceArgs, Say, read::ReadArgs};
use crate::spectral::picture::{SpectrumOptions, charts};
use anyhow::Result;
use kinelm_motion::format::{self, RestFrame};
use kinelm_motion::joints;
use kinelm_motion::moment::Moment;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    #[arg(help = super::with_extensions("A motion file (READ)"))]
    clip: PathBuf,
    /// Where the plot goes (.png .svg): a joint's spectrogram, the body's spectral embedding, the joint's coefficients
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// The joint, by its name in the file [default: the root]
    #[arg(long, value_name = "NAME")]
    joint: Option<String>,
    /// Where the plotted part starts: 2.5s, 2.5 or 40f
    #[arg(long, value_name = "SECONDS", default_value = "0s", allow_negative_numbers = true, value_parser = super::values::time)]
    at: Moment,
    /// Its length, in the same form [default: to the clip's end]
    #[arg(long, value_parser = super::values::length)]
    seconds: Option<Moment>,
    /// Frames per second to resample to
    #[arg(long, default_value_t = 60.0, value_parser = super::values::positive)]
    fps: f64,
    /// Leave out the mean pose, which outweighs all movement
    #[arg(long)]
    no_dc: bool,
    #[command(flatten)]
    force: ForceArgs,
    #[command(flatten)]
    read: ReadArgs,
}

pub fn run(args: &Args, say: Say) -> Result<()> {
    let outputs = args.force.outputs([args.clip.clone()].into_iter().chain(args.read.files()));
    super::picture(&args.out, &outputs)?;
    let motion = format::read(&args.clip, &args.read.of_file(&args.clip, RestFrame::Drop, say))?;
    super::warn(&motion, say);
    let skeleton = motion.clip.skeleton();
    let joint = match &args.joint {
        None => 0,
        Some(name) => {
            joints::find_in_rig(skeleton, name).map_err(|e| anyhow::anyhow!("{}: {e}", args.clip.display()))?
        }
    };
    let own = motion.clip.fps();
    let (from_s, seconds) = (args.at.seconds(own), args.seconds.map(|length| length.seconds(own)));
    let options = SpectrumOptions { joint, from_s, seconds, fps: args.fps, no_dc: args.no_dc };
    let charts = charts(&motion.clip, &options).map_err(|e| anyhow::anyhow!("{}: {e}", args.clip.display()))?;
    super::draw_charts(&args.out, &charts, &outputs)?;
    say.line(format_args!(
        "{}: the spectra of {} in {}",
        args.out.display(),
        skeleton.names()[joint],
        args.clip.display()
    ));
    Ok(())
}
