//! `kinelm evaluate likelihood`.

use super::floors::{Fitted, FloorsArgs};
use crate::cli::{CheckpointArg, ComputeArgs, ReadingArgs, Say, TrustArgs, WrongCall, print, progress};
use crate::corpus::{ClipRecord, Corpus, Split};
use crate::evaluate::floors::codes::frames;
use crate::evaluate::gap_bits::gap_bits;
use crate::evaluate::likelihood::LikelihoodReport;
use crate::evaluate::per_joint::{by_slot, slots};
use crate::model::likelihood::likelihood_by_token;
use crate::model::{LoadedRun, ReaderOptions, load_run};
use anyhow::Result;
use std::collections::BTreeMap;
use std::f64::consts::LN_2;
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
    /// The run folder of a trained model
    #[arg(long, value_name = "RUN", value_parser = crate::cli::values::run_folder())]
    run: PathBuf,
    #[command(flatten)]
    checkpoint: CheckpointArg,
    /// A corpus folder of the same tokenizer
    #[arg(long, value_name = "CORPUS")]
    corpus: PathBuf,
    /// The split to measure
    #[arg(long, default_value = "test", value_name = "train|valid|test")]
    split: Split,
    /// Windows at most, spread evenly; 0: all, each token scored once
    #[arg(long, default_value_t = 0, value_name = "N")]
    windows: usize,
    /// What the model is conditioned on, where it was trained with conditions
    #[arg(long, value_enum, default_value = "labels")]
    conditions: ConditionsArg,
    /// Also print the bits per joint, where a word is a frame with one character per channel
    #[arg(long)]
    per_joint: bool,
    /// Also measure gaps of these lengths in frames (10, or 10,20,40), with and without conditioning on what follows
    /// them, for a model that has it (model.goal)
    #[arg(long, value_name = "FRAMES", value_delimiter = ',')]
    gaps: Vec<usize>,
    #[command(flatten)]
    reading: ReadingArgs,
    #[command(flatten)]
    compute: ComputeArgs,
    #[command(flatten)]
    floors: FloorsArgs,
    /// Print one JSON object instead of a table
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    trust: TrustArgs,
}

/// `--conditions`.
#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum ConditionsArg {
    /// The clip's labels
    Labels,
    /// Nothing: every label unknown
    None,
}

pub fn run(args: &Args, say: Say) -> Result<()> {
    let run = load_run(&args.run, args.checkpoint.get())?;
    run.notes.iter().for_each(|note| say.line(note));
    let corpus = args.trust.open(&args.corpus)?;
    let (ours, theirs) = (run.load_tokenizer()?.base_hash(), corpus.tokenizer().base_hash());
    if ours != theirs {
        let what = format!(
            "the run's tokenizer is {ours} without labels, the corpus's {theirs}; tokenize the data with the run's"
        );
        return Err(WrongCall(what).into());
    }
    let fitted = args.floors.fitted(&corpus, args.trust)?;
    let measured = measure(args, &run, &corpus, &fitted, say)?;
    if args.json {
        return print(&format!("{}\n", measured.to_json()));
    }
    print(&measured.table())?;
    measured.notes().iter().for_each(|note| say.line(note));
    Ok(())
}

fn measure(args: &Args, run: &LoadedRun, corpus: &Corpus, fitted: &Fitted, say: Say) -> Result<LikelihoodReport> {
    let clips: Vec<_> = corpus.split(args.split).collect();
    let reading = args.reading.get(1);
    let mut model = match reading == ReaderOptions::default() {
        true => run.scores(args.compute.get())?,
        // as the model is read when it generates
        false => Box::new(run.reader(reading)?),
    };
    let known = run.load_conditions()?;
    let conditions = match args.conditions {
        ConditionsArg::Labels => known,
        ConditionsArg::None => known.unknown(),
    };
    let mut nats_of: BTreeMap<String, f64> = BTreeMap::new();
    // by the clips' places in the corpus: bits of every code, where a word is a frame of codes and a space, and the floors
    // have them too
    let mixes = args.windows == 0 && !args.per_joint && fitted.is_all_of(frames(corpus, args.split));
    let word = corpus.tokenizer().tokens_per_word().filter(|_| mixes).unwrap_or(0);
    let mut bits_of: BTreeMap<u64, Vec<f32>> = BTreeMap::new();
    let found = if args.per_joint {
        // for its message: the error of `by_slot` doesn't name the flag
        slots(corpus.tokenizer()).map_err(|e| WrongCall(format!("--per-joint: {e}")))?;
        by_slot(&mut *model, corpus, &clips, args.windows, &conditions)?.map(|(found, bits)| (found, Some(bits)))
    } else {
        // how many tokens a part of the windows has is known only after they are read
        let tokens = if args.windows == 0 { clips.iter().map(|c| c.tokens).sum() } else { 0 };
        let (bar, mut done) = (progress::bar(tokens as u64, "tokens", say), 0);
        let mut each = |clip: &ClipRecord, token: usize, nats: f64| {
            if word > 0 && token % word < word - 1 {
                bits_of.entry(clip.offset as u64).or_default().push((nats / LN_2) as f32);
            }
            match nats_of.get_mut(&clip.name) {
                Some(sum) => *sum += nats,
                None => drop(nats_of.insert(clip.name.clone(), nats)),
            }
            done += 1;
            // moving the bar at every token would take longer than the sum
            if done % 512 == 0 {
                bar.set_position(done);
            }
        };
        let found = likelihood_by_token(&mut *model, corpus, &clips, args.windows, &conditions, &mut each);
        found?.map(|found| (found, None))
    };
    let (found, places) =
        found.ok_or_else(|| anyhow::anyhow!("{}: no {} clip has a frame", args.corpus.display(), args.split))?;
    let mut gaps = Vec::new();
    for &frames in &args.gaps {
        let found = gap_bits(&mut *model, corpus, &clips, frames, &conditions);
        gaps.extend(found.map_err(|e| WrongCall(format!("--gaps {frames}: {e}")))?);
    }
    // a part of the windows doesn't cover whole clips
    let whole = |c: &&&ClipRecord| args.windows == 0 && c.frames > 0;
    let bits = |c: &&ClipRecord| Some((c.name.clone(), nats_of.get(&c.name)? / LN_2 / c.frames as f64));
    let whole_clips = clips.iter().filter(whole).filter_map(bits).collect();
    let floors = fitted.measure(corpus, args.split, mixes)?;
    let bits: Vec<Vec<f32>> = clips.iter().filter_map(|clip| bits_of.remove(&(clip.offset as u64))).collect();
    let mixed = floors.as_ref().ok().filter(|_| !found.pseudo).and_then(|floors| floors.mixed_with(&bits));
    Ok(LikelihoodReport {
        mixed,
        clips: whole_clips,
        checkpoint: run.checkpoint.display().to_string(),
        split: args.split,
        found,
        places,
        gaps,
        floors,
        all_frames: clips.iter().map(|c| c.frames).sum(),
        fps: corpus.manifest().fps,
    })
}
