//! `kinelm compare`.

use super::named::{named, pair};
use super::view::stem;
use super::{ForceArgs, Say, print, progress, read::ReadArgs};
use crate::spectral::compare::{CompareOptions, compare};
use anyhow::Result;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The dance to compare with, of any rig. Reading options of one file follow its name, FILE:fps=60,skip=10 (also
    /// up, unit, map, root, rest, position)
    #[arg(value_name = "TEACHER")]
    teacher: PathBuf,
    /// The dance to compare, of any rig
    #[arg(value_name = "STUDENT")]
    student: PathBuf,
    /// Joints to compare: 13, 18, 24, or a list of groups, names and ids; the pelvis never counts, both have it in one
    /// place
    #[arg(long, value_name = "13|18|24|LIST", default_value = "24")]
    joints: String,
    /// The greatest lag, and how far the alignment may be off a straight line: 1s, 0.5 or 15f (frames, 30 a second)
    #[arg(long, value_name = "SECONDS", default_value = "1s", value_parser = super::values::length)]
    band: kinelm_motion::moment::Moment,
    /// Also write a page that plays both in step, with the worst moments as buttons (.html)
    #[arg(long, value_name = "FILE")]
    page: Option<PathBuf>,
    /// Print one JSON object instead of tables
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    force: ForceArgs,
    #[command(flatten)]
    read: ReadArgs,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    args.page.as_deref().map_or(Ok(()), super::page)?;
    let files = [named(&args.teacher)?, named(&args.student)?];
    let paths = [&files[0].path, &files[1].path];
    let outputs = args.force.outputs(paths.into_iter().cloned().chain(args.read.files()));
    outputs.check(args.page.as_deref())?;
    let [teacher, student] = pair(&files, &args.read, say)?;
    progress::stage("comparing the dances");
    let band_s = args.band.seconds(crate::spectral::compare::FPS);
    let compared = compare(&teacher, &student, &CompareOptions { joints: args.joints, band_s })?;
    if let Some(path) = &args.page {
        let page = compared.page([&stem(paths[0]), &stem(paths[1])])?;
        outputs.write(path, page.as_bytes())?;
        say.line(format_args!("{}: {} KB; open it in a browser", path.display(), page.len() / 1000));
    }
    if !args.json {
        return print(&format!("{}\n", compared.report));
    }
    let mut line = serde_json::to_value(&compared.report)?;
    line["schema"] = 1.into();
    line["teacher"] = serde_json::to_value(paths[0])?;
    line["student"] = serde_json::to_value(paths[1])?;
    print(&format!("{line}\n"))
}
