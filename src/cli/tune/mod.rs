//! `kinelm tune`: kinelm's own model learns a user's dances.

mod measure;

use super::data::DataArgs;
use super::{ComputeArgs, ForceArgs, Say, TrustArgs, WrongCall, print, progress, read::ReadArgs};
use crate::corpus::Dataset;
use crate::corpus::build::tokenize;
use crate::corpus::writer::LAYOUT;
use crate::evaluate::dance::Reference;
use crate::model::run::TOKENIZER;
use crate::train::{CorpusPart, PretrainOptions, TrainFile, finetune};
use anyhow::Result;
use kinelm_motion::format::RestFrame;
use kinelm_tokenizer::Tokenizer;
use measure::{Comparison, HeldOut};
use std::path::{Path, PathBuf};

/// The settings of its training.
const SETTINGS: &str = "tune";

#[derive(Debug, clap::Args)]
pub struct Args {
    #[command(flatten)]
    data: DataArgs,
    /// The run folder to create; the dances as words are beside it in RUN-corpus
    #[arg(long, value_name = "RUN")]
    run: PathBuf,
    /// Training steps, over those of the settings `tune`
    #[arg(long, value_name = "N")]
    steps: Option<u64>,
    /// Seed of the order of windows, dropout and augmentation
    #[arg(long, value_name = "N")]
    seed: Option<u64>,
    #[command(flatten)]
    compute: ComputeArgs,
    #[command(flatten)]
    trust: TrustArgs,
    #[command(flatten)]
    read: ReadArgs,
}

pub fn run(args: Args, say: Say) -> Result<()> {
    let ready = kinelm_ready::run()?;
    let folder = corpus_folder(&args.run)?;
    let dataset = args.data.find(say)?;
    write_words(&args, &dataset, &ready, &folder, say)?;
    let corpus = args.trust.open(&folder)?;
    let split = measure::held_out_split(&corpus);
    let real = split.map(|_| Reference::load(&corpus)).transpose()?;
    let held_out = split.zip(real.as_ref());
    let held_out = held_out.map(|(split, real)| HeldOut::of(split, real, &dataset, args.compute.get())).transpose()?;
    let before = held_out.as_ref().map(|held_out| held_out.measure(&ready)).transpose()?;
    let options = PretrainOptions {
        from: Some(ready),
        file: Some(TrainFile::find(Path::new(SETTINGS))?),
        corpora: vec![CorpusPart::once(folder)],
        run: Some(args.run.clone()),
        steps: args.steps,
        seed: args.seed,
        compute: args.compute.get(),
        opening: args.trust.opening(),
        ..PretrainOptions::default()
    };
    let summary = super::training::with_lines(say, |stop, progress| finetune(&options, stop, progress))?;
    super::pretrain::report(&summary, "finetune", say)?;
    match (&held_out, before) {
        (Some(held_out), Some(before)) => {
            let after = held_out.measure(&args.run)?;
            print(&Comparison(held_out, [before, after]).to_string())
        }
        _ => Ok(()),
    }
}

/// Where the dances become words: RUN-corpus.
fn corpus_folder(run: &Path) -> Result<PathBuf> {
    let Some(name) = run.file_name() else {
        return Err(WrongCall(format!("--run {}; expected a folder's name", run.display())).into());
    };
    let mut name = name.to_owned();
    name.push("-corpus");
    Ok(run.with_file_name(name))
}

/// Writes the corpus in the words of the model of `ready`.
fn write_words(args: &Args, dataset: &Dataset, ready: &Path, corpus: &Path, say: Say) -> Result<()> {
    let tokenizer = Tokenizer::load(ready.join(TOKENIZER))?;
    let inputs = args.data.files(dataset).chain(args.read.files());
    ForceArgs { force: false }.outputs(inputs).check_folder(corpus, &LAYOUT)?;
    let options = args.data.build_options(args.read.options(RestFrame::Drop));
    let mut watch = progress::watch(say, "writing the corpus");
    let (_, summary) = tokenize(dataset, &tokenizer, corpus, &options, &mut *watch)?;
    summary.lines().iter().for_each(|line| say.line(line));
    Ok(())
}
