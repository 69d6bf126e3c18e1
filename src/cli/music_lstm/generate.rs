//! `kinelm music-lstm generate`.

use crate::baselines::FPS;
use crate::baselines::music_lstm::dance::{Request, Sidecar};
use crate::baselines::music_lstm::run::Trained;
use crate::cli::updates::{self, BaselineDance};
use crate::cli::values::{frames_at, time};
use crate::cli::{CheckpointArg, ForceArgs, Say, convert, progress, writable, written_as};
use crate::generate::MOST_FRAMES;
use crate::model::CheckpointChoice;
use anyhow::Result;
use kinelm_motion::format;
use kinelm_motion::moment::Moment;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The run folder of a trained network
    #[arg(long, value_name = "RUN")]
    run: PathBuf,
    #[command(flatten)]
    checkpoint: CheckpointArg,
    /// The music to dance to (.wav .flac .ogg .mp3 .m4a .aac)
    #[arg(long, value_name = "FILE")]
    music: PathBuf,
    /// The time in the music at which the dance starts
    #[arg(long, value_name = "SECONDS", default_value = "0s", value_parser = time)]
    music_from: Moment,
    /// Frames to generate, at 30 per second, or a time such as 12s [default: to the end of the music]
    #[arg(long, value_name = "N", value_parser = frames_at(FPS, 1..=MOST_FRAMES as u32))]
    frames: Option<u32>,
    /// Where the dance goes (.bvh .npz .json .glb .vrma). A sidecar, FILE.bvh.kinelm.json, records how it was made
    #[arg(long, value_name = "FILE")]
    out: PathBuf,
    #[command(flatten)]
    force: ForceArgs,
}

pub fn run(args: &Args, say: Say) -> Result<()> {
    writable(&args.out)?;
    let request = Request {
        run: args.run.clone(),
        music: args.music.clone(),
        from_s: args.music_from.seconds(FPS),
        frames: args.frames.map(|frames| frames as usize),
    };
    updates::make(&request, args.checkpoint.get(), &args.out, args.force, say)
}

impl BaselineDance for Request {
    fn inputs(&self) -> Vec<PathBuf> {
        vec![self.run.clone(), self.music.clone()]
    }

    fn make(&self, which: CheckpointChoice, out: &Path, say: Say) -> Result<(Sidecar, Vec<u8>)> {
        let trained = Trained::load(&self.run, which)?;
        trained.notes.iter().for_each(|note| say.line(note));
        let bar = progress::bar(self.frames.unwrap_or(0) as u64, "frames", say);
        let made = Request::generate(self, &trained, &mut |frames| bar.set_position(frames as u64));
        drop(bar);
        let made = made?;
        let motion = written_as(out, made.motion)?;
        let bytes = format::to_bytes(out, &motion)?;
        convert::report_written(out, &motion, say);
        let fps = motion.clip.fps();
        Ok((Sidecar::of(self, trained.step, &trained.sha256, &made.music_sha256, out, fps, &bytes), bytes))
    }
}
