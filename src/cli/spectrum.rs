//! `kinelm spectrum`.

use super::named::{named, options};
use super::view::stem;
use super::{ForceArgs, Odd, Say, WrongCall, read::ReadArgs};
use crate::spectral::picture::{Spectra, SpectrumOptions, charts, panels};
use crate::view::{Figure, Page, plot};
use anyhow::Result;
use kinelm_motion::format;
use kinelm_motion::moment::Moment;
use kinelm_motion::{Motion, joints};
use kinelm_store::output::Outputs;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct Args {
    #[arg(required = true, value_name = "CLIP")]
    #[arg(help = super::with_extensions("Motion files (READ), side by side on one scale. Reading options of one file \
        follow its name, FILE:fps=60,skip=10"))]
    clips: Vec<PathBuf>,
    /// Where the plot goes (.png .svg): a joint's spectrogram, the body's spectral embedding, the joint's coefficients
    #[arg(long, value_name = "FILE")]
    out: Option<PathBuf>,
    /// Where a page goes (.html) that plays the clips beside their spectra
    #[arg(long, value_name = "FILE")]
    page: Option<PathBuf>,
    /// The joint, by its name in the files [default: the root]
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
    if args.out.is_none() && args.page.is_none() {
        return Err(WrongCall(
            "nowhere to put the spectra; give --out for a picture, --page for a page, or both".into(),
        )
        .into());
    }
    let files = args.clips.iter().map(|clip| named(clip)).collect::<Result<Vec<_>>>()?;
    let paths: Vec<&Path> = files.iter().map(|file| &*file.path).collect();
    let outputs = args.force.outputs(paths.iter().map(|path| path.to_path_buf()).chain(args.read.files()));
    outputs.check(args.out.as_deref().into_iter().chain(args.page.as_deref()))?;
    args.out.as_deref().map_or(Ok(()), |out| super::picture(out, &outputs))?;
    args.page.as_deref().map_or(Ok(()), super::page)?;
    let options = options(&files, &args.read, say)?;
    let odd = Odd::new(say);
    let (mut motions, mut all) = (Vec::new(), Vec::new());
    for (path, options) in paths.iter().zip(&options) {
        let motion = format::read(path, options)?;
        odd.warn(&motion, options);
        all.push(args.spectra(&motion).map_err(|e| anyhow::anyhow!("{}: {e}", path.display()))?);
        motions.push(motion);
    }
    drop(odd);
    if let Some(out) = &args.out {
        draw(out, &all, &outputs)?;
        say.line(format_args!("{}: the spectra of {}", out.display(), listed(&paths)));
    }
    if let Some(page) = &args.page {
        let parts: Vec<_> = motions.iter().zip(&all).map(|(motion, spectra)| spectra.part_of(&motion.clip)).collect();
        let figure = |(part, motion): (_, &Motion)| {
            let from_s = args.at.seconds(motion.clip.fps());
            Figure::new(stem(&motion.path), part).note(format!("from {from_s} s on"))
        };
        let figures: Vec<Figure> = parts.iter().zip(&motions).map(figure).collect();
        let text = Page::new(&figures).panels(&panels(&all)).html()?;
        outputs.write(page, text.as_bytes())?;
        say.line(format_args!("{}: {} KB; open it in a browser", page.display(), text.len() / 1000));
    }
    Ok(())
}

/// Draws a row of charts for each spectrum, a column a clip; of one clip all in a row.
fn draw(out: &Path, all: &[Spectra], outputs: &Outputs) -> Result<()> {
    let charts = charts(all)?;
    let columns = if all.len() == 1 { charts.len() } else { all.len() };
    if let Some(bytes) = plot::in_columns(out, &charts, columns)? {
        outputs.write(out, &bytes)?;
    }
    Ok(())
}

fn listed(paths: &[&Path]) -> String {
    paths.iter().map(|path| path.display().to_string()).collect::<Vec<_>>().join(", ")
}

impl Args {
    fn spectra(&self, motion: &Motion) -> Result<Spectra> {
        let (clip, own) = (&motion.clip, motion.clip.fps());
        let joint = self.joint.as_ref().map_or(Ok(0), |name| joints::find_in_rig(clip.skeleton(), name))?;
        let (from_s, seconds) = (self.at.seconds(own), self.seconds.map(|length| length.seconds(own)));
        let options = SpectrumOptions { joint, from_s, seconds, fps: self.fps, no_dc: self.no_dc };
        Ok(Spectra::of(&stem(&motion.path), clip, &options)?)
    }
}
