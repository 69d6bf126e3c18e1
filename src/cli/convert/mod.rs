//! `kinelm convert`.

mod clip;
mod rig;
mod together;

use super::{ForceArgs, Odd, Say, WrongCall, extension, read::ReadArgs};
use crate::corpus::in_out::{self, Pair};
use anyhow::{Context, Result};
use clip::{converted, cut};
use kinelm_motion::Motion;
use kinelm_motion::format::positions::Positions;
use kinelm_motion::format::{self, Format, Importer, RestFrame, Unit};
use kinelm_motion::moment::Moment;
use kinelm_store::counted;
use rig::RigArgs;
use std::path::{Path, PathBuf};
use together::{together, write_together};

const PATHS: &str = "Motion files (READ) or folders of them, then the file to write (.bvh .npz .json .glb .vrma), or for several a \
    folder, where paths below a folder are kept. An .npz is AMASS SMPL+H; a .glb has a body and can hold several clips, which \
    play together";

#[derive(Debug, clap::Args)]
pub struct Args {
    #[arg(required = true, value_names = ["IN", "OUT"], help = super::with_extensions(PATHS))]
    paths: Vec<PathBuf>,
    /// The format of files in a folder [default: each file's own; .npz for .pkl, .bvh for .amc, .fbx and .vrm]
    #[arg(long, value_parser = Format::WRITTEN)]
    format: Option<String>,
    /// Frames per second to resample to
    #[arg(long, value_parser = super::values::rate)]
    fps: Option<f64>,
    #[command(flatten)]
    rig: RigArgs,
    /// Joints that keep moving, on the SMPL body: 13, 18, 24, or a list of groups, names (SMPL's or the file's) and
    /// ids; the others hold the rest pose
    #[arg(long, value_name = "LIST")]
    joints: Option<String>,
    /// Start here: 2.5s, 2.5 or 40f (frames of the file); negative counts from the end
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    from: Option<Moment>,
    /// End before this time
    #[arg(long, value_name = "TIME", allow_hyphen_values = true)]
    to: Option<Moment>,
    /// Stay at one place of the floor, for programs that move the character themselves; heights stay
    #[arg(long, conflicts_with = "at_origin")]
    in_place: bool,
    /// Begin at the origin of the floor
    #[arg(long)]
    at_origin: bool,
    /// Write what this program imports as it is (docs/engines.md): .bvh in metres with a root of its own, or .glb (unreal:
    /// .glb alone), with names that it keeps
    #[arg(long = "for", value_name = "PROGRAM", value_enum, conflicts_with_all = ["write_unit", "positions"])]
    importer: Option<Program>,
    /// The unit of a BVH output [default: that of its own file, else cm]
    #[arg(long, value_name = "m|cm|mm|in", value_parser = metres)]
    write_unit: Option<f64>,
    /// Write joint positions instead of AMASS: positions (F,N,3) in metres, joints, parents, fps; in the file's own
    /// order with all its position channels, unless rate, rig, joints or a part is requested
    #[arg(long, conflicts_with = "write_unit")]
    positions: bool,
    #[command(flatten)]
    force: ForceArgs,
    #[command(flatten)]
    read: ReadArgs,
}

/// A program that imports the output.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum Program {
    Blender,
    Three,
    Unreal,
}

impl From<Program> for Importer {
    fn from(program: Program) -> Importer {
        match program {
            Program::Blender => Importer::Blender,
            Program::Three => Importer::Three,
            Program::Unreal => Importer::Unreal,
        }
    }
}

/// Metres of a unit.
fn metres(text: &str) -> Result<f64, String> {
    let unit: Unit = text.parse()?;
    unit.metres().ok_or("expected a unit such as m, cm, mm or in".into())
}

pub fn run(args: Args, say: Say) -> Result<()> {
    // not the parser's num_args: it would count anew after an option that is between them
    if let [only] = &args.paths[..] {
        let what = format!("{} alone; expected what to read, then what to write: IN OUT", only.display());
        return Err(WrongCall(what).into());
    }
    if let Some((out, inputs)) = together(&args) {
        return write_together(&args, inputs, out, say);
    }
    let pairs = pairs(&args)?;
    check(&args, &pairs)?;
    let inputs = pairs.iter().map(|p| p.input.clone()).chain(args.read.files());
    let outputs = args.force.outputs(inputs.chain(args.rig.files()));
    outputs.check(pairs.iter().map(|p| &*p.output))?;
    let rig = args.rig.load(say)?;
    if let Some(program) = args.importer {
        args.rig.check_no_character(rig.as_ref(), &format!("--for {program:?}"))?;
    }
    let inputs: Vec<PathBuf> = pairs.iter().map(|p| p.input.clone()).collect();
    let (options, odd) = (args.read.of_files(&inputs, RestFrame::Keep, say), Odd::new(say));
    super::each_file(&inputs, say, |i, input| {
        let output = &pairs[i].output;
        let count = if pairs.len() > 1 { format!("{} of {}: ", i + 1, pairs.len()) } else { String::new() };
        let motion = format::read(input, &options[i])?;
        odd.warn(&motion, &options[i]);
        let motion = cut(&args, motion)?;
        let written = if args.positions {
            let positions = match args.moves() {
                true => Positions::from_clip(&converted(&args, rig.as_ref(), motion, output)?.clip),
                false => format::positions(input, &options[i])?,
            };
            outputs.write(output, &positions.write()?)?;
            let (out, n, f) = (output.display(), positions.joints.len(), positions.frames());
            format!("{out}: {} of {n} points at {} fps", counted(f, "frames"), positions.fps)
        } else {
            let motion = converted(&args, rig.as_ref(), motion, output)?;
            let bytes = match (args.importer, args.write_unit) {
                (Some(program), _) => {
                    let name = output.file_stem().unwrap_or_default().to_string_lossy();
                    Importer::from(program).to_bytes(&name, &motion, Format::of(output)?)?
                }
                (None, Some(metres)) => format::bvh::to_bytes_in(&motion, metres)?,
                (None, None) => format::to_bytes(output, &motion)?,
            };
            outputs.write(output, &bytes)?;
            described(output, &motion)
        };
        say.line(format_args!("{count}{written}"));
        Ok(())
    })?;
    Ok(())
}

/// Inputs and their outputs.
fn pairs(args: &Args) -> Result<Vec<Pair>> {
    let (out, given) = args.paths.split_last().context("no files")?;
    let format = args.format.as_deref().or(args.positions.then_some("npz"));
    if !in_out::is_folder(given, out) {
        if let Some(format) = format.filter(|format| *format != extension(out)) {
            let out = out.display();
            let what = match args.positions {
                true => format!("--positions writes .npz; OUT is {out}"),
                false => {
                    format!("--format {format}, and OUT is {out}; give a name in .{format}, or a folder (it ends in /)")
                }
            };
            return Err(WrongCall(what).into());
        }
        return Ok(vec![Pair { input: given[0].clone(), output: out.clone() }]);
    }
    Ok(in_out::into_folder(given, out, |own| match (format, own) {
        (Some(format), _) => format.into(),
        (None, own) => in_out::written_for(own).into(),
    })?)
}

/// Refuses what is wrong whatever the files contain.
fn check(args: &Args, pairs: &[Pair]) -> Result<()> {
    for Pair { output, .. } in pairs {
        if super::writable_into(output, args.rig.embed)? == "npz" && args.rig.is_other() && !args.positions {
            let what = "--onto with an .npz: AMASS files are on SMPL's joints; write .bvh or .json";
            return Err(WrongCall(what.into()).into());
        }
        if args.write_unit.is_some() && extension(output) != "bvh" {
            let what =
                format!("--write-unit with {}: all files but a .bvh are in metres; leave it out", output.display());
            return Err(WrongCall(what).into());
        }
        if let Some(program) = args.importer {
            let formats = Importer::from(program).formats();
            if !Format::of_name(output).is_some_and(|format| formats.contains(&format)) {
                let names = if formats.contains(&Format::Bvh) { ".bvh or .glb" } else { ".glb" };
                let what = format!("{program:?} imports no {}; write {names}", output.display());
                return Err(WrongCall(what).into());
            }
        }
    }
    Ok(())
}

impl Args {
    /// Whether another rate, rig, or a part of the file is requested.
    fn moves(&self) -> bool {
        let moment = self.from.is_some() || self.to.is_some();
        let placed = self.in_place || self.at_origin;
        moment || placed || self.fps.is_some() || self.rig.onto.is_some() || self.joints.is_some()
    }
}

/// Prints what was written.
pub fn report_written(path: &Path, motion: &Motion, say: Say) {
    say.line(described(path, motion));
}

/// The length, rate and joints of a written file.
fn described(path: &Path, motion: &Motion) -> String {
    let clip = &motion.clip;
    let (frames, joints) = (counted(clip.frames(), "frames"), counted(clip.joints(), "joints"));
    format!("{}: {frames} at {} fps, {joints}", path.display(), clip.fps())
}
