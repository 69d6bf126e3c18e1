//! `kinelm aclstm generate`.

use crate::baselines::FPS;
use crate::baselines::aclstm::dance::{Request, Sidecar};
use crate::baselines::aclstm::run::Trained;
use crate::cli::read::ReadArgs;
use crate::cli::updates::{self, BaselineDance};
use crate::cli::values::frames_at;
use crate::cli::{CheckpointArg, ForceArgs, Say, convert, progress, warn, writable, written_as};
use crate::generate::MOST_FRAMES;
use crate::generate::request::FootMode;
use crate::model::CheckpointChoice;
use anyhow::Result;
use kinelm_motion::format::{self, RestFrame};
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The run folder of a trained network
    #[arg(long, value_name = "RUN")]
    run: PathBuf,
    #[command(flatten)]
    checkpoint: CheckpointArg,
    /// The clip to continue, on the run's rig
    #[arg(long, value_name = "CLIP")]
    seed_clip: PathBuf,
    /// Frames of the clip that are fed to the network, at 30 per second, or a time such as 10s
    #[arg(long, value_name = "N", default_value_t = 300, value_parser = frames_at(FPS, 1..=u32::MAX))]
    seed_frames: u32,
    /// The first of them, counted at 30 per second after the run's margin
    #[arg(long, value_name = "N", default_value_t = 0, value_parser = frames_at(FPS, 0..=u32::MAX))]
    seed_from: u32,
    /// Frames to generate, at 30 per second, or a time such as 12s
    #[arg(long, value_name = "N", default_value_t = 400, value_parser = frames_at(FPS, 1..=MOST_FRAMES as u32))]
    frames: u32,
    /// Write the seed in front of the generated frames
    #[arg(long)]
    with_seed: bool,
    /// Where the dance goes (.bvh .npz .json .glb .vrma). A sidecar, FILE.bvh.kinelm.json, records how it was made
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    /// Lock the feet while they are in contact with the floor, and keep the body on it, or leave all as the network has it
    #[arg(long, value_enum, default_value = "lock")]
    feet: FootMode,
    #[command(flatten)]
    force: ForceArgs,
    #[command(flatten)]
    read: ReadArgs,
}

pub fn run(args: &Args, say: Say) -> Result<()> {
    writable(&args.out)?;
    let request = Request {
        run: args.run.clone(),
        read: args.read.of_file(&args.seed_clip, RestFrame::Keep, say),
        clip: args.seed_clip.clone(),
        from: args.seed_from as usize,
        seed_frames: args.seed_frames as usize,
        frames: args.frames as usize,
        with_seed: args.with_seed,
        feet: args.feet,
    };
    updates::make(&request, args.checkpoint.get(), &args.out, args.force, say)
}

impl BaselineDance for Request {
    fn inputs(&self) -> Vec<PathBuf> {
        let read = self.read.map.iter().map(PathBuf::from).chain(self.read.body_model.clone());
        [self.run.clone(), self.clip.clone()].into_iter().chain(read).collect()
    }

    fn make(&self, which: CheckpointChoice, out: &Path, say: Say) -> Result<(Sidecar, Vec<u8>)> {
        let trained = Trained::load(&self.run, which)?;
        trained.notes.iter().for_each(|note| say.line(note));
        let bar = progress::bar(self.frames as u64, "frames", say);
        let made = Request::generate(self, &trained, &mut |frames| bar.set_position(frames as u64));
        // the bar goes before an error is printed
        drop(bar);
        let made = made?;
        warn(&made.motion, say);
        let motion = written_as(out, made.motion)?;
        let bytes = format::to_bytes(out, &motion)?;
        convert::report_written(out, &motion, say);
        made.locked.iter().flat_map(|locked| locked.notes(FPS)).for_each(|note| say.line(note));
        let fps = motion.clip.fps();
        Ok((Sidecar::of(self, trained.step, &trained.sha256, &made.clip_sha256, out, fps, &bytes), bytes))
    }
}
