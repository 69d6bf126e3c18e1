//! `kinelm aclstm evaluate`.

use crate::baselines::FPS;
use crate::baselines::aclstm::evaluate::{Options, Report, SHORT, Test, evaluate, evaluate_dances};
use crate::baselines::aclstm::run::Trained;
use crate::cli::values::frames_at;
use crate::cli::{CheckpointArg, ForceArgs, Say, print, progress};
use crate::corpus::Split;
use anyhow::Result;
use kinelm_motion::format;
use kinelm_store::counted;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The run folder of a trained network; the clips are those of its own DATA
    #[arg(long, value_name = "RUN")]
    run: PathBuf,
    #[command(flatten)]
    checkpoint: CheckpointArg,
    /// The split that seeds are taken from
    #[arg(long, value_name = "train|valid|test", default_value = "test")]
    split: Split,
    /// Seeds of each length, spread evenly over the clips
    #[arg(long, value_name = "N", default_value_t = 50, value_parser = clap::value_parser!(u16).range(1..=4096))]
    seeds: u16,
    /// Frames of a seed, at 30 per second
    #[arg(long, value_name = "LIST", value_delimiter = ',', default_values_t = [100, 200, 300], value_parser = frames_at(FPS, 1..=1 << 20))]
    seed_frames: Vec<u32>,
    /// Frames generated from each seed, to measure for how long they keep moving
    #[arg(long, value_name = "N", default_value_t = 4000, value_parser = frames_at(FPS, SHORT as u32..=1 << 20))]
    frames: u32,
    /// Write the longest seeds instead, as seed-01.bvh and so on at 30 frames per second, for another program to
    /// continue
    #[arg(long, value_name = "FOLDER", conflicts_with_all = ["dances", "json"])]
    write_seeds: Option<PathBuf>,
    /// Measure these dances instead of the network's: named as the seeds of --write-seeds, each starting with its seed,
    /// for some seeds or all
    #[arg(long, value_name = "FOLDER")]
    dances: Option<PathBuf>,
    /// Print one JSON object instead of tables
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    force: ForceArgs,
}

pub fn run(args: &Args, say: Say) -> Result<()> {
    let trained = Trained::load(&args.run, args.checkpoint.get())?;
    trained.notes.iter().for_each(|note| say.line(note));
    let options = Options {
        split: args.split,
        seeds: args.seeds.into(),
        lengths: args.seed_frames.iter().map(|n| *n as usize).collect(),
        frames: args.frames as usize,
    };
    if let Some(folder) = &args.write_seeds {
        return write_seeds(args, &trained, &options, folder, say);
    }
    let report = match &args.dances {
        Some(folder) => evaluate_dances(&trained, &options, folder)?,
        None => own(&trained, &options, say)?,
    };
    if args.dances.is_some() && report.seeds < options.seeds {
        say.line(format_args!("{} of {} have a dance", report.seeds, counted(options.seeds, "seeds")));
    }
    print(&if args.json { format!("{}\n", serde_json::to_string(&report)?) } else { format!("{report}\n") })
}

fn own(trained: &Trained, options: &Options, say: Say) -> Result<Report> {
    let bar = progress::bar((options.lengths.len() * options.frames) as u64, "frames", say);
    Ok(evaluate(trained, options, &mut |done| bar.set_position(done as u64))?)
}

fn write_seeds(args: &Args, trained: &Trained, options: &Options, folder: &Path, say: Say) -> Result<()> {
    let test = Test::load(trained, options)?;
    let frames = options.lengths.iter().copied().max().unwrap_or(0);
    let outputs = args.force.outputs(trained.file.sources.data.iter().chain([&args.run]));
    let paths: Vec<PathBuf> = test.seeds.iter().map(|seed| folder.join(format!("{}.bvh", seed.name))).collect();
    // all names, before the first file
    outputs.check(paths.iter().map(PathBuf::as_path))?;
    for (seed, path) in test.seeds.iter().zip(&paths) {
        outputs.write(path, &format::to_bytes(path, &seed.motion(frames, path))?)?;
    }
    let seeds = counted(test.seeds.len(), "seeds");
    say.line(format_args!("{}: {seeds} of {}", folder.display(), counted(frames, "frames")));
    Ok(())
}
