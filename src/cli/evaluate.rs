//! `kinelm evaluate`.

mod dance;
mod prediction;

use super::{ComputeArgs, ReadingArgs, Say, WrongCall, print};
use anyhow::Result;
use kinelm::corpus::{ClipRecord, Corpus, Split};
use kinelm::evaluate::baselines::figure_row;
use kinelm::evaluate::likelihood::likelihood_by_token;
use kinelm::evaluate::per_joint::{by_part, by_place, places};
use kinelm::evaluate::{CodeSplits, Floors, measure};
use kinelm::model::{Reading, Which, load_run};
use std::path::PathBuf;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Bits a frame of static models, fitted on train and measured on test: what any model has to get below
    Baselines(BaselinesArgs),
    /// Bits a frame of a trained model, with the static floors of the same tokens beside it
    Likelihood(LikelihoodArgs),
    /// Whether dances freeze, repeat themselves, answer to their prompts, copy, with real ones beside them
    Dance(dance::Args),
    /// What a model foretells of the next 400 ms, with standing still and going on beside it
    Prediction(prediction::Args),
}

#[derive(Debug, clap::Args)]
pub struct BaselinesArgs {
    /// A corpus folder
    #[arg(long, value_name = "CORPUS", required_unless_present = "tokens")]
    corpus: Option<PathBuf>,
    /// Bare codes: train and test (F, C) uint16, train_len and test_len
    #[arg(long, value_name = "FILE.npz", conflicts_with = "corpus")]
    tokens: Option<PathBuf>,
    /// Bins of the codes in --tokens
    #[arg(long, default_value_t = 360, value_parser = clap::value_parser!(u32).range(2..=65_536))]
    bins: u32,
    /// The split that is measured
    #[arg(long, default_value = "test", value_name = "train|valid|test")]
    split: Split,
    /// One JSON object instead of a table
    #[arg(long)]
    json: bool,
}

#[derive(Debug, clap::Args)]
pub struct LikelihoodArgs {
    /// The run folder of a trained model
    #[arg(long, value_name = "RUN")]
    run: PathBuf,
    /// A corpus folder of the same tokenizer
    #[arg(long, value_name = "CORPUS")]
    corpus: PathBuf,
    /// The split that is measured
    #[arg(long, default_value = "test", value_name = "train|valid|test")]
    split: Split,
    /// Windows at most, spread evenly; 0: all, each token scored once
    #[arg(long, default_value_t = 0, value_name = "N")]
    windows: usize,
    /// What the model is told of a clip, where it was trained with conditions: its labels, or nothing
    #[arg(long, value_enum, default_value = "labels")]
    conditions: ConditionsArg,
    /// Also which joints cost the bits, where a word is a frame of one character a channel
    #[arg(long)]
    per_joint: bool,
    #[command(flatten)]
    reading: ReadingArgs,
    #[command(flatten)]
    compute: ComputeArgs,
    /// One JSON object instead of a table
    #[arg(long)]
    json: bool,
}

/// `--conditions`.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum ConditionsArg {
    /// The clip's labels
    Labels,
    /// Every label is unknown
    None,
}

pub fn run(command: Command, say: Say) -> Result<()> {
    match command {
        Command::Baselines(args) => baselines(args),
        Command::Likelihood(args) => model(args, say),
        Command::Dance(args) => dance::run(&args, say),
        Command::Prediction(args) => prediction::run(&args, say),
    }
}

fn model(args: LikelihoodArgs, say: Say) -> Result<()> {
    let run = load_run(&args.run, Which::Auto)?;
    run.notes.iter().for_each(|note| say.line(note));
    let corpus = Corpus::open(&args.corpus)?;
    let (ours, theirs) = (run.load_tokenizer()?.base_hash(), corpus.tokenizer().base_hash());
    if ours != theirs {
        let what = format!(
            "the run's tokenizer is {ours} without labels, the corpus's {theirs}; tokenize the data with the run's"
        );
        return Err(WrongCall(what).into());
    }
    let clips: Vec<_> = corpus.split(args.split).collect();
    let reading = args.reading.get(1);
    let mut model = match reading == Reading::default() {
        true => run.scores(args.compute.get())?,
        // as it is read when it generates
        false => Box::new(run.reader(reading)?),
    };
    let known = run.load_conditions()?;
    let conditions = match args.conditions {
        ConditionsArg::Labels => known,
        ConditionsArg::None => known.unknown(),
    };
    if args.per_joint {
        places(corpus.tokenizer()).map_err(|e| WrongCall(format!("--per-joint: {e}")))?;
    }
    let found = match args.per_joint {
        true => {
            by_place(&mut *model, &corpus, &clips, args.windows, &conditions)?.map(|(found, bits)| (found, Some(bits)))
        }
        false => {
            // of some windows alone nobody knows how many tokens they have
            let tokens = if args.windows == 0 { clips.iter().map(|c| c.tokens).sum() } else { 0 };
            let (bar, mut done) = (super::progress::bar(tokens as u64, "tokens", say), 0);
            let mut each = |_: &ClipRecord, _, _| {
                done += 1;
                if done % 512 == 0 {
                    bar.set_position(done);
                }
            };
            let found = likelihood_by_token(&mut *model, &corpus, &clips, args.windows, &conditions, &mut each);
            found?.map(|found| (found, None))
        }
    };
    let (found, bits) =
        found.ok_or_else(|| anyhow::anyhow!("{}: no {} clip has a frame", args.corpus.display(), args.split))?;
    super::progress::stage("static models fitted and measured");
    let floors = Floors::of_corpus(&corpus, args.split)?;
    let checkpoint = run.checkpoint.display().to_string();
    let all_frames: usize = clips.iter().map(|c| c.frames).sum();
    let in_all = |bits_per_frame: f64| bits_per_frame * all_frames as f64;
    if args.json {
        let mut line = serde_json::json!({
            "schema": 1, "checkpoint": checkpoint, "split": args.split.to_string(),
            "bits_per_frame": found.bits_per_frame, "bits_per_s": found.bits_per_frame * corpus.manifest().fps,
            "nats_per_token": found.nats_per_token, "tokens": found.tokens, "frames": found.frames,
            "windows": found.windows, "all_windows": found.all_windows, "pseudo": found.pseudo, "floors": floors.to_json(),
            "all_frames": all_frames,
            "bits": {"model": in_all(found.bits_per_frame), "order0": in_all(floors.order0()), "xz9": floors.xz().map(in_all)},
        });
        if let Some(bits) = bits {
            line["places"] = serde_json::to_value(&bits)?;
            line["parts"] = by_part(&bits)
                .into_iter()
                .map(|(part, bits)| (part, bits.into()))
                .collect::<serde_json::Map<_, _>>()
                .into();
        }
        return print(&format!("{line}\n"));
    }
    let name = if found.pseudo { "the model (pseudo)" } else { "the model" };
    let mut table = format!("{floors}\n{}\n", figure_row(name, found.bits_per_frame, None));
    table += &format!(
        "\n{:<32} {:>12} {:>14}\n",
        format!("{all_frames} frames of {}", args.split),
        "bits/frame",
        "bits in all"
    );
    let rows = [("order 0", Some(floors.order0())), ("xz -9", floors.xz()), (name, Some(found.bits_per_frame))];
    for (name, bits) in rows.into_iter().filter_map(|(name, bits)| Some((name, bits?))) {
        table += &format!("{name:<32} {bits:>12.2} {:>14.0}\n", in_all(bits));
    }
    if let Some(bits) = bits {
        table += &format!("\n{:<32} {:>12} {:>14}\n", "under the model", "bits/frame", "share %");
        for (part, bits) in by_part(&bits) {
            table += &format!("{part:<32} {bits:>12.2} {:>14.1}\n", 100.0 * bits / found.bits_per_frame);
        }
    }
    print(&table)?;
    let (tokens, frames, windows, of) = (found.tokens, found.frames, found.windows, found.all_windows);
    let per_s = found.bits_per_frame * corpus.manifest().fps;
    say.line(format_args!(
        "{checkpoint}: {per_s:.1} bits/s; {tokens} tokens of {frames} frames scored once, in {windows} of {of} windows"
    ));
    if found.pseudo {
        say.line(
            "a masked model sees both sides of what it is asked: its bits are no likelihood and stand beside no other",
        );
    } else if found.bits_per_frame >= floors.best() {
        let best = floors.best();
        say.line(format_args!("the model is not below the best static model of its own tokens, {best:.2} bits/frame"));
    }
    Ok(())
}

fn baselines(args: BaselinesArgs) -> Result<()> {
    let found = match (&args.corpus, &args.tokens) {
        (Some(corpus), _) => {
            let (opened, split) = (Corpus::open(corpus)?, args.split);
            for needed in [Split::Train, split] {
                let frames: usize = opened.split(needed).map(|c| c.frames).sum();
                anyhow::ensure!(
                    frames > 0,
                    "{}: no frame in the {needed} split; try another --split",
                    corpus.display()
                );
            }
            super::progress::stage("static models fitted and measured");
            Floors::of_corpus(&opened, split)?
        }
        (_, Some(tokens)) => Floors::Channels(Box::new(measure(&CodeSplits::load_npz(tokens, args.bins as usize)?)?)),
        _ => return Err(WrongCall("give --corpus or --tokens".into()).into()),
    };
    print(&if args.json { format!("{}\n", found.to_json()) } else { format!("{found}\n") })
}
