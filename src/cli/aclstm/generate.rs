//! `kinelm aclstm generate`.

use crate::baselines::aclstm::FPS;
use crate::baselines::aclstm::dance::{Recipe, Told};
use crate::baselines::aclstm::run::Trained;
use crate::cli::read::{ReadArgs, frames_at};
use crate::cli::{ForceArgs, Say, WrongCall, asked, filter, generate, progress, writable, written_as};
use crate::generate::MOST_FRAMES;
use crate::generate::request::FootMode;
use crate::model::CheckpointChoice;
use anyhow::{Context, Result};
use kinelm_motion::format::{self, RestFrame};
use kinelm_store::output::{Outputs, is_same};
use kinelm_store::sidecar;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The run folder of a trained network
    #[arg(long, value_name = "RUN", required_unless_present = "again")]
    run: Option<PathBuf>,
    /// The clip that the dance goes on from, on the run's rig
    #[arg(long, value_name = "CLIP", required_unless_present = "again")]
    seed_clip: Option<PathBuf>,
    /// Frames of it that drive the network, at 30 a second, or 10s
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = frames_at(FPS, 1..=u32::MAX))]
    seed_frames: u32,
    /// Where they begin: frames at 30 a second behind the run's margin
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = frames_at(FPS, 0..=u32::MAX))]
    seed_from: u32,
    /// Frames to make, at 30 a second, or 12s
    #[arg(long, value_name = "N", default_value_t = 400, value_parser = frames_at(FPS, 1..=MOST_FRAMES as u32))]
    frames: u32,
    /// Put the seed in front of them
    #[arg(long)]
    with_seed: bool,
    /// Where the dance goes (.bvh .npz .json .glb); FILE.bvh.kinelm.json beside it tells where it is from
    #[arg(long, value_name = "FILE", required_unless_present = "again")]
    out: Option<PathBuf>,
    /// Make a dance again, to the same bytes, from the FILE.bvh.kinelm.json beside it; --run, --seed-clip and --out if they
    /// are elsewhere now
    #[arg(long, value_name = "FILE.bvh.kinelm.json", conflicts_with_all = ["seed_frames", "seed_from", "frames", "with_seed",
        "feet", "fps_source", "unit", "up", "map", "bvh_position", "root", "lenient", "keep_rest", "drop_rest", "skip",
        "body_model", "floor"])]
    again: Option<PathBuf>,
    /// Feet that stand are held where they stand, and the body on its floor; or all is left as the network says it
    #[arg(long, value_enum, default_value = "lock")]
    feet: FeetArg,
    #[command(flatten)]
    force: ForceArgs,
    #[command(flatten)]
    read: ReadArgs,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum FeetArg {
    Lock,
    Off,
}

pub fn run(args: &Args, say: Say) -> Result<()> {
    if let Some(file) = &args.again {
        return again(args, file, say);
    }
    let out = args.out.as_deref().context("no file to write to")?;
    writable(out)?;
    let clip = args.seed_clip.clone().context("no clip to go on from")?;
    let recipe = Recipe {
        run: args.run.clone().context("no run folder")?,
        read: args.read.of_file(&clip, RestFrame::Keep, say),
        clip,
        from: args.seed_from as usize,
        seed_frames: args.seed_frames as usize,
        frames: args.frames as usize,
        with_seed: args.with_seed,
        feet: match args.feet {
            FeetArg::Lock => FootMode::Lock,
            FeetArg::Off => FootMode::Off,
        },
    };
    if let Some(path) = [&recipe.run, &recipe.clip].into_iter().find(|path| path.to_str().is_none()) {
        let what = "a name that is no UTF-8 can't be kept beside the dance; give it another name";
        return Err(WrongCall(format!("{}: {what}", path.display())).into());
    }
    let outputs = outputs(args, &recipe);
    outputs.check([out])?;
    outputs.check_replaceable(out, None)?;
    outputs.check_replaceable(&sidecar::path_of(out), None)?;
    let (told, bytes) = made(&recipe, CheckpointChoice::Auto, out, say)?;
    told.write(out, &bytes, &outputs)?;
    Ok(())
}

/// What a recipe reads is not written over.
fn outputs(args: &Args, recipe: &Recipe) -> Outputs {
    let read = recipe.read.map.iter().map(PathBuf::from).chain(recipe.read.body_model.clone());
    args.force.outputs(read.chain([recipe.run.clone(), recipe.clip.clone()]).chain(args.again.clone()))
}

/// The dance of a recipe as a file of this name, and what is told of it.
fn made(recipe: &Recipe, which: CheckpointChoice, out: &Path, say: Say) -> Result<(Told, Vec<u8>)> {
    let trained = Trained::load(&recipe.run, which)?;
    trained.notes.iter().for_each(|note| say.line(note));
    let bar = progress::bar(recipe.frames as u64, "frames", say);
    let made = recipe.make(&trained, &mut |frames| bar.set_position(frames as u64));
    drop(bar);
    let made = made.map_err(asked)?;
    crate::cli::warn(&made.motion, say);
    let motion = written_as(out, made.motion, recipe.read.map.as_deref())?;
    let bytes = format::to_bytes(out, &motion)?;
    crate::cli::convert::told(out, &motion, say);
    if let Some(locked) = &made.locked {
        filter::say_locked(locked, FPS, say);
    }
    let written = (out, motion.clip.fps());
    Ok((Told::of(recipe, (trained.step, &trained.sha256), &made.clip_sha256, written, &bytes), bytes))
}

/// Makes a dance again and holds it to the hash of the first.
fn again(args: &Args, file: &Path, say: Say) -> Result<()> {
    let first = Told::load(file)?;
    let out = generate::again::out(args.out.as_ref(), file, &first.output.file)?;
    let mut recipe = first.recipe.clone();
    recipe.run = args.run.clone().unwrap_or(recipe.run);
    recipe.clip = args.seed_clip.clone().unwrap_or(recipe.clip);
    let outputs = outputs(args, &recipe);
    outputs.check([&*out])?;
    outputs.check_replaceable(&out, Some(&first.output.sha256))?;
    let (told, bytes) = made(&recipe, CheckpointChoice::Step(first.step), &out, say)?;
    first.check(&told)?;
    match is_same(&sidecar::path_of(&out), file) {
        true => outputs.write(&out, &bytes).map(|_| ())?, // and it tells of the dance already
        false => told.write(&out, &bytes, &outputs)?,
    }
    Ok(())
}
