//! `kinelm evaluate`.

mod compare;
mod dance;
mod gaps;
mod likelihood;
mod prediction;

use super::{Say, TrustArgs, WrongCall, print, wrong_call};
use crate::corpus::{Corpus, Split};
use crate::evaluate::floors::codes::frames;
use crate::evaluate::{ChannelFloors, CodeSplits, Extent, Floors};
use anyhow::Result;
use std::path::{Path, PathBuf};

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Bits a frame of static models, fitted on train and measured on test: what any model has to get below
    Baselines(BaselinesArgs),
    /// Bits per frame of a trained model, next to the static floors of the same tokens
    Likelihood(likelihood::Args),
    /// Whether dances freeze, repeat themselves, respond to their prompts or copy, compared with real ones
    Dance(dance::Args),
    /// How well a model fills gaps, compared with linear interpolation
    Gaps(gaps::Args),
    /// How well a model predicts the next 400 ms, compared with zero and constant velocity
    Prediction(prediction::Args),
}

#[derive(Debug, clap::Args)]
pub struct BaselinesArgs {
    /// A corpus folder
    #[arg(long, value_name = "CORPUS", required_unless_present = "tokens")]
    corpus: Option<PathBuf>,
    /// Bare codes: train and test (F, C) uint16, train_len and test_len
    #[arg(long, value_name = "FILE.npz", conflicts_with_all = ["corpus", "floors_from"])]
    tokens: Option<PathBuf>,
    /// Bins of the codes in --tokens
    #[arg(long, default_value_t = 360, value_parser = clap::value_parser!(u32).range(2..=65_536))]
    bins: u32,
    /// The split to measure
    #[arg(long, default_value = "test", value_name = "train|valid|test")]
    split: Split,
    /// Print one JSON object instead of a table
    #[arg(long)]
    json: bool,
    #[command(flatten)]
    floors: FloorsArgs,
    #[command(flatten)]
    trust: TrustArgs,
}

/// The static models beside what is measured.
#[derive(Debug, clap::Args)]
pub struct FloorsArgs {
    /// How many frames of each split static models and xz are fitted and measured on
    #[arg(long, value_enum, default_value = "sample")]
    floors: FloorsArg,
    /// Fit the static models on the train clips of this corpus, which has the same tokenizer, instead of --corpus
    #[arg(long, value_name = "CORPUS")]
    floors_from: Option<PathBuf>,
}

/// `--floors`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum FloorsArg {
    /// None: no static models, no xz
    None,
    /// All, or a sample of about 200,000 where there are more
    Sample,
    /// All, in memory
    All,
}

/// What static models are fitted on.
pub enum Fitted {
    /// The corpus that is measured.
    Own(Extent),
    /// Another one.
    Other(Box<Corpus>, Extent),
    /// Nothing, which is why.
    Nothing(String),
}

impl FloorsArgs {
    /// What they are fitted on, opened; a corpus of another tokenizer than that of `corpus` is a wrong call.
    pub fn fitted(&self, corpus: &Corpus, trust: TrustArgs) -> Result<Fitted> {
        let extent = match self.floors {
            FloorsArg::None => return Ok(Fitted::Nothing("--floors none".into())),
            FloorsArg::Sample => Extent::Sample,
            FloorsArg::All => Extent::All,
        };
        let Some(other) = &self.floors_from else {
            let what =
                format!("{} has no train frame to fit on; --floors-from CORPUS names one", corpus.dir().display());
            return Ok(if frames(corpus, Split::Train) > 0 { Fitted::Own(extent) } else { Fitted::Nothing(what) });
        };
        let other = trust.open(other)?;
        let dir = other.dir().display();
        let [found, expected] = [&other, corpus].map(|corpus| corpus.tokenizer().base_hash());
        if found != expected {
            let what =
                format!("--floors-from {dir}: a corpus of tokenizer {found}; expected that of --corpus, {expected}");
            return Err(WrongCall(what).into());
        }
        if frames(&other, Split::Train) == 0 {
            return Err(WrongCall(format!("--floors-from {dir}: no train frame; expected some to fit on")).into());
        }
        Ok(Fitted::Other(Box::new(other), extent))
    }
}

impl Fitted {
    /// The floors of a split of `corpus`, or why there are none.
    pub fn measure(&self, corpus: &Corpus, split: Split) -> Result<std::result::Result<Floors, String>> {
        let (fitted, extent) = match self {
            Fitted::Own(extent) => (corpus, *extent),
            Fitted::Other(other, extent) => (&**other, *extent),
            Fitted::Nothing(why) => return Ok(Err(why.clone())),
        };
        super::progress::stage("fitting and measuring static models");
        Ok(Ok(Floors::of_corpora(fitted, (corpus, split), extent)?))
    }
}

/// Opens the corpus that `--real` names.
pub fn real_corpus(real: &Path, trust: TrustArgs) -> Result<Corpus> {
    if !real.join("corpus.json").exists() {
        wrong_call!("--real {}: no corpus.json; expected a corpus, as kinelm tokenize makes it", real.display());
    }
    Ok(trust.open(real)?)
}

pub fn run(command: Command, say: Say) -> Result<()> {
    match command {
        Command::Baselines(args) => baselines(args),
        Command::Likelihood(args) => likelihood::run(&args, say),
        Command::Dance(args) => dance::run(&args, say),
        Command::Gaps(args) => gaps::run(&args, say),
        Command::Prediction(args) => prediction::run(&args, say),
    }
}

fn baselines(args: BaselinesArgs) -> Result<()> {
    let extent = match args.floors.floors {
        FloorsArg::None => return Err(WrongCall("--floors none: nothing is left to measure".into()).into()),
        FloorsArg::Sample => Extent::Sample,
        FloorsArg::All => Extent::All,
    };
    let found = match (&args.corpus, &args.tokens) {
        (Some(corpus), _) => {
            let opened = args.trust.open(corpus)?;
            let fitted = args.floors.fitted(&opened, args.trust)?;
            if frames(&opened, args.split) == 0 {
                let (corpus, split) = (corpus.display(), args.split);
                anyhow::bail!("{corpus}: no frame in the {split} split; try another --split");
            }
            fitted.measure(&opened, args.split)?.map_err(|why| anyhow::anyhow!(why))?
        }
        (_, Some(tokens)) => Floors::Channels(Box::new(ChannelFloors::measure(&CodeSplits::load_npz(
            tokens,
            args.bins as usize,
            extent,
        )?)?)),
        _ => return Err(WrongCall("give --corpus or --tokens".into()).into()),
    };
    print(&if args.json { format!("{}\n", found.to_json()) } else { format!("{found}\n") })
}
