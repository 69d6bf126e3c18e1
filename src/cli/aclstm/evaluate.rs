//! `kinelm aclstm evaluate`.

use crate::cli::{Say, asked, print, progress};
use anyhow::Result;
use kinelm::aclstm::evaluate::{Options, SHORT, evaluate};
use kinelm::aclstm::run::Trained;
use kinelm::corpus::Split;
use kinelm::model::Which;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The run folder of a trained network; the clips are those of its own DATA
    #[arg(long, value_name = "RUN")]
    run: PathBuf,
    /// The split that seeds are from
    #[arg(long, value_name = "train|valid|test", default_value = "test")]
    split: Split,
    /// Seeds of each length, spread evenly over the clips
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = clap::value_parser!(u16).range(1..=4096))]
    seeds: u16,
    /// Frames of a seed, at 30 a second
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_values_t = [100, 200, 300], value_parser = clap::value_parser!(u32).range(1..=1 << 20))]
    seed_frames: Vec<u32>,
    /// Frames that are made of each, to see for how long they move
    #[arg(long, value_name = "N", default_value_t = 4000, value_parser = clap::value_parser!(u32).range(SHORT as i64..=1 << 20))]
    frames: u32,
    /// One JSON object instead of tables
    #[arg(long)]
    json: bool,
}

pub fn run(args: &Args, say: Say) -> Result<()> {
    let trained = Trained::load(&args.run, Which::Auto)?;
    trained.notes.iter().for_each(|note| say.line(note));
    let options = Options {
        split: args.split,
        seeds: args.seeds.into(),
        lengths: args.seed_frames.iter().map(|n| *n as usize).collect(),
        frames: args.frames as usize,
    };
    let bar = progress::bar((options.lengths.len() * options.frames) as u64, "frames", say);
    let report = evaluate(&trained, &options, &mut |done| bar.set_position(done as u64));
    drop(bar);
    let report = report.map_err(asked)?;
    print(&if args.json { format!("{}\n", serde_json::to_string(&report)?) } else { format!("{report}\n") })
}
