//! `kinelm music-lstm evaluate`.

use crate::baselines::FPS;
use crate::baselines::music_lstm::evaluate::{Options, evaluate};
use crate::baselines::music_lstm::run::Trained;
use crate::cli::values::frames_at;
use crate::cli::{CheckpointArg, Say, WrongCall, print, progress};
use crate::corpus::Split;
use anyhow::Result;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The run folder of a trained network
    #[arg(long, value_name = "RUN")]
    run: PathBuf,
    #[command(flatten)]
    checkpoint: CheckpointArg,
    /// The split of the unheard music: valid or test
    #[arg(long, value_name = "SPLIT", default_value = "test")]
    split: Split,
    /// Frames of one long dance to that music, to measure whether it freezes
    #[arg(long, value_name = "N", default_value_t = 12_000, value_parser = frames_at(FPS, 30..=1 << 20))]
    frames: u32,
    /// Cut-off frequency of the Butterworth filter that dances are also measured after, Hz
    #[arg(long, value_name = "HZ", default_value_t = 6.0, value_parser = crate::cli::values::positive)]
    cutoff: f64,
    /// Print one JSON object instead of tables
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args, say: Say) -> Result<()> {
    if args.split == Split::Train {
        let what = "--split train: the music of the training is measured anyway; expected valid or test";
        return Err(WrongCall(what.into()).into());
    }
    let trained = Trained::load(&args.run, args.checkpoint.get())?;
    trained.notes.iter().for_each(|note| say.line(note));
    let options = Options { split: args.split, frames: args.frames as usize, cutoff_hz: args.cutoff };
    let bar = progress::bar(0, "frames", say);
    let report = evaluate(&trained, &options, &mut |done| bar.set_position(done as u64));
    // the bar goes before an error is printed
    drop(bar);
    let report = report?;
    print(&if args.json { format!("{}\n", serde_json::to_string(&report)?) } else { format!("{report}\n") })
}
