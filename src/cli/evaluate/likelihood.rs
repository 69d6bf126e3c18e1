//! `kinelm evaluate likelihood`.

use super::{Fitted, FloorsArgs};
use crate::cli::{ComputeArgs, ReadingArgs, Say, TrustArgs, WrongCall, print, progress};
use crate::corpus::{ClipRecord, Corpus, Split};
use crate::evaluate::Floors;
use crate::evaluate::floors::figure_row;
use crate::evaluate::gap_bits::{GapBits, gap_bits};
use crate::evaluate::per_joint::{SlotBits, by_part, by_slot, slots};
use crate::model::likelihood::{Likelihood, likelihood_by_token};
use crate::model::{CheckpointChoice, LoadedRun, ReaderOptions, load_run};
use anyhow::Result;
use serde_json::{Map, Value, json};
use std::path::PathBuf;

#[derive(Debug, clap::Args)]
pub struct Args {
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
    /// Also gaps of so many frames (10, or 10,20,40), whose end is told to a model that can be told (model.goal), and isn't
    #[arg(long, value_name = "FRAMES", value_delimiter = ',')]
    gaps: Vec<usize>,
    #[command(flatten)]
    reading: ReadingArgs,
    #[command(flatten)]
    compute: ComputeArgs,
    #[command(flatten)]
    floors: FloorsArgs,
    /// One JSON object instead of a table
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
    /// Every label is unknown
    None,
}

/// What is known of a model on a split.
struct Measured {
    checkpoint: String,
    split: Split,
    found: Likelihood,
    /// Of each place of a word, where it was asked for.
    places: Option<Vec<SlotBits>>,
    /// Of gaps of every length that was asked for.
    gaps: Vec<GapBits>,
    /// Or why there are none.
    floors: std::result::Result<Floors, String>,
    /// Frames of the split, scored or not.
    all_frames: usize,
    fps: f64,
}

pub fn run(args: &Args, say: Say) -> Result<()> {
    let run = load_run(&args.run, CheckpointChoice::Auto)?;
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
        return print(&format!("{}\n", measured.line()?));
    }
    print(&measured.table())?;
    measured.tell(say);
    Ok(())
}

fn measure(args: &Args, run: &LoadedRun, corpus: &Corpus, fitted: &Fitted, say: Say) -> Result<Measured> {
    let clips: Vec<_> = corpus.split(args.split).collect();
    let reading = args.reading.get(1);
    let mut model = match reading == ReaderOptions::default() {
        true => run.scores(args.compute.get())?,
        // as it is read when it generates
        false => Box::new(run.reader(reading)?),
    };
    let known = run.load_conditions()?;
    let conditions = match args.conditions {
        ConditionsArg::Labels => known,
        ConditionsArg::None => known.unknown(),
    };
    let found = if args.per_joint {
        slots(corpus.tokenizer()).map_err(|e| WrongCall(format!("--per-joint: {e}")))?;
        by_slot(&mut *model, corpus, &clips, args.windows, &conditions)?.map(|(found, bits)| (found, Some(bits)))
    } else {
        // of some windows alone nobody knows how many tokens they have
        let tokens = if args.windows == 0 { clips.iter().map(|c| c.tokens).sum() } else { 0 };
        let (bar, mut done) = (progress::bar(tokens as u64, "tokens", say), 0);
        let mut each = |_: &ClipRecord, _, _| {
            done += 1;
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
    Ok(Measured {
        checkpoint: run.checkpoint.display().to_string(),
        split: args.split,
        found,
        places,
        gaps,
        floors: fitted.measure(corpus, args.split)?,
        all_frames: clips.iter().map(|c| c.frames).sum(),
        fps: corpus.manifest().fps,
    })
}

impl Measured {
    /// Bits of all frames of the split.
    fn in_all(&self, bits_per_frame: f64) -> f64 {
        bits_per_frame * self.all_frames as f64
    }

    /// `--json`.
    fn line(&self) -> Result<Value> {
        let Measured { found, all_frames, .. } = self;
        let floors = self.floors.as_ref().ok();
        let in_all = |bits: f64| self.in_all(bits);
        let mut line = json!({
            "schema": 1, "checkpoint": self.checkpoint, "split": self.split.to_string(),
            "bits_per_frame": found.bits_per_frame, "bits_per_s": found.bits_per_frame * self.fps,
            "nats_per_token": found.nats_per_token, "tokens": found.tokens, "frames": found.frames,
            "windows": found.windows, "all_windows": found.all_windows, "pseudo": found.pseudo, "floors": floors.map(Floors::to_json),
            "all_frames": all_frames,
            "bits": {
                "model": in_all(found.bits_per_frame), "order0": floors.map(|f| in_all(f.order0())),
                "xz9": floors.and_then(Floors::xz).map(in_all),
            },
        });
        if let Some(places) = &self.places {
            line["places"] = serde_json::to_value(places)?;
            line["parts"] =
                by_part(places).into_iter().map(|(part, bits)| (part, bits.into())).collect::<Map<_, _>>().into();
        }
        if !self.gaps.is_empty() {
            line["gaps"] = serde_json::to_value(&self.gaps)?;
        }
        Ok(line)
    }

    fn table(&self) -> String {
        let Measured { split, found, places, gaps, floors, all_frames, .. } = self;
        let name = if found.pseudo { "the model (pseudo)" } else { "the model" };
        let beside = match floors {
            Ok(floors) => floors.to_string(),
            Err(why) => {
                format!("{:<32} {:>12}\n{:<32} {:>12}   {why}", "bits/frame", "all frames", "static models", "n/a")
            }
        };
        let mut table = format!("{beside}\n{}\n", figure_row(name, found.bits_per_frame, None));
        let floors = floors.as_ref().ok();
        let of = format!("{all_frames} frames of {split}");
        table += &format!("\n{of:<32} {:>12} {:>14}\n", "bits/frame", "bits in all");
        let [order0, xz] = [floors.map(Floors::order0), floors.and_then(Floors::xz)];
        let rows = [("order 0", order0), ("xz -9", xz), (name, Some(found.bits_per_frame))];
        for (name, bits) in rows.into_iter().filter_map(|(name, bits)| Some((name, bits?))) {
            table += &format!("{name:<32} {bits:>12.2} {:>14.0}\n", self.in_all(bits));
        }
        if !gaps.is_empty() {
            table += &format!("\n{:<32} {:>12} {:>14}\n", "in gaps, bits/frame", "untold", "told the end");
        }
        for gap in gaps {
            let name = format!("{} of {} frames", gap.gaps, gap.frames);
            table += &format!("{name:<32} {:>12.2} {:>14.2}\n", gap.unconditioned, gap.conditioned);
            let (untold, told) = (gap.unconditioned_end, gap.conditioned_end);
            table += &format!("{:<32} {untold:>12.2} {told:>14.2}\n", "  their last quarter");
        }
        if let Some(places) = places {
            table += &format!("\n{:<32} {:>12} {:>14}\n", "under the model", "bits/frame", "share %");
            for (part, bits) in by_part(places) {
                table += &format!("{part:<32} {bits:>12.2} {:>14.1}\n", 100.0 * bits / found.bits_per_frame);
            }
        }
        table
    }

    /// What stands beside the table.
    fn tell(&self, say: Say) {
        let Measured { checkpoint, found, floors, fps, .. } = self;
        let (tokens, frames, windows, of) = (found.tokens, found.frames, found.windows, found.all_windows);
        let per_s = found.bits_per_frame * fps;
        say.line(format_args!(
            "{checkpoint}: {per_s:.1} bits/s; {tokens} tokens of {frames} frames scored once, in {windows} of {of} windows"
        ));
        if found.pseudo {
            say.line(
                "a masked model sees both sides of what it is asked: its bits are no likelihood and stand beside no other",
            );
        } else if let Some(best) = floors.as_ref().ok().map(Floors::best).filter(|best| found.bits_per_frame >= *best) {
            say.line(format_args!(
                "the model is not below the best static model of its own tokens, {best:.2} bits/frame"
            ));
        }
    }
}
