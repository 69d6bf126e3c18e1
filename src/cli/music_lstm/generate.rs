//! `kinelm music-lstm generate`.

use crate::baselines::music_lstm::FPS;
use crate::baselines::music_lstm::dance::{Recipe, Told};
use crate::baselines::music_lstm::run::Trained;
use crate::cli::read::frames_at;
use crate::cli::{ForceArgs, Say, WrongCall, asked, generate, progress, writable, written_as};
use crate::generate::MOST_FRAMES;
use crate::model::CheckpointChoice;
use anyhow::{Context, Result};
use kinelm_motion::format;
use kinelm_motion::moment::Moment;
use kinelm_store::output::is_same;
use kinelm_store::sidecar;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The run folder of a trained network
    #[arg(long, value_name = "RUN", required_unless_present = "again")]
    run: Option<PathBuf>,
    /// The music that is danced to (wav, flac, ogg, mp3, m4a)
    #[arg(long, value_name = "FILE", required_unless_present = "again")]
    music: Option<PathBuf>,
    /// The music's time at the dance's first frame
    #[arg(long, value_name = "SECONDS", default_value = "0s", value_parser = crate::cli::read::time)]
    music_from: Moment,
    /// Frames to make, at 30 a second, or 12s; as many as the music has, if not given
    #[arg(long, value_name = "N", value_parser = frames_at(FPS, 1..=MOST_FRAMES as u32))]
    frames: Option<u32>,
    /// Where the dance goes (.bvh .npz .json .glb); FILE.bvh.kinelm.json beside it tells where it is from
    #[arg(long, value_name = "FILE", required_unless_present = "again")]
    out: Option<PathBuf>,
    /// Make a dance again, to the same bytes, from the FILE.bvh.kinelm.json beside it; --run, --music and --out if they are
    /// elsewhere now
    #[arg(long, value_name = "FILE.bvh.kinelm.json", conflicts_with_all = ["music_from", "frames"])]
    again: Option<PathBuf>,
    #[command(flatten)]
    force: ForceArgs,
}

pub fn run(args: &Args, say: Say) -> Result<()> {
    if let Some(file) = &args.again {
        return again(args, file, say);
    }
    let out = args.out.as_deref().context("no file to write to")?;
    writable(out)?;
    let recipe = Recipe {
        run: args.run.clone().context("no run folder")?,
        music: args.music.clone().context("no music")?,
        from_s: args.music_from.seconds(FPS),
        frames: args.frames.map(|frames| frames as usize),
    };
    if let Some(path) = [&recipe.run, &recipe.music].into_iter().find(|path| path.to_str().is_none()) {
        let what = "a name that is no UTF-8 can't be kept beside the dance; give it another name";
        return Err(WrongCall(format!("{}: {what}", path.display())).into());
    }
    let outputs = args.force.outputs([recipe.run.clone(), recipe.music.clone()]);
    outputs.check([out])?;
    outputs.check_replaceable(out, None)?;
    outputs.check_replaceable(&sidecar::path_of(out), None)?;
    let (told, bytes) = made(&recipe, CheckpointChoice::Auto, out, say)?;
    told.write(out, &bytes, &outputs)?;
    Ok(())
}

/// The dance of a recipe as a file of this name, and what is told of it.
fn made(recipe: &Recipe, which: CheckpointChoice, out: &Path, say: Say) -> Result<(Told, Vec<u8>)> {
    let trained = Trained::load(&recipe.run, which)?;
    trained.notes.iter().for_each(|note| say.line(note));
    let bar = progress::bar(recipe.frames.unwrap_or(0) as u64, "frames", say);
    let made = recipe.make(&trained, &mut |frames| bar.set_position(frames as u64));
    drop(bar);
    let made = made.map_err(asked)?;
    let motion = written_as(out, made.motion, None)?;
    let bytes = format::to_bytes(out, &motion)?;
    crate::cli::convert::told(out, &motion, say);
    let written = (out, motion.clip.fps());
    Ok((Told::of(recipe, (trained.step, &trained.sha256), &made.music_sha256, written, &bytes), bytes))
}

/// Makes a dance again and holds it to the hash of the first.
fn again(args: &Args, file: &Path, say: Say) -> Result<()> {
    let first = Told::load(file)?;
    let out = generate::again::out(args.out.as_ref(), file, &first.output.file)?;
    let mut recipe = first.recipe.clone();
    recipe.run = args.run.clone().unwrap_or(recipe.run);
    recipe.music = args.music.clone().unwrap_or(recipe.music);
    let outputs = args.force.outputs([recipe.run.clone(), recipe.music.clone(), file.to_owned()]);
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
