//! The static models that a model is measured beside.

use crate::cli::{TrustArgs, WrongCall, wrong_call};
use crate::corpus::{Corpus, Split};
use crate::evaluate::floors::codes::frames;
use crate::evaluate::{Extent, Floors};
use anyhow::Result;
use std::path::PathBuf;

/// The static models beside what is measured.
#[derive(Debug, clap::Args)]
pub struct FloorsArgs {
    /// How many frames of each split static models are fitted and measured on
    #[arg(long, value_enum, default_value = "sample")]
    floors: FloorsArg,
    /// Fit the static models on the train clips of this corpus, which has the same tokenizer, instead of --corpus
    #[arg(long, value_name = "CORPUS")]
    floors_from: Option<PathBuf>,
}

/// `--floors`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum FloorsArg {
    /// None: no static models
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
    /// How many frames of each split; `None` for no floors.
    pub fn extent(&self) -> Option<Extent> {
        match self.floors {
            FloorsArg::None => None,
            FloorsArg::Sample => Some(Extent::Sample),
            FloorsArg::All => Some(Extent::All),
        }
    }

    /// What they are fitted on, opened; a corpus of another tokenizer than that of `corpus` is a wrong call.
    pub fn fitted(&self, corpus: &Corpus, trust: TrustArgs) -> Result<Fitted> {
        if let (None, Some(other)) = (self.extent(), &self.floors_from) {
            wrong_call!(
                "--floors-from {} with --floors none: nothing is fitted; leave one of them out",
                other.display()
            );
        }
        let Some(extent) = self.extent() else { return Ok(Fitted::Nothing("--floors none".into())) };
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
    /// Whether every code of so many frames gets its bits.
    pub fn is_all_of(&self, frames: usize) -> bool {
        match self {
            Fitted::Own(extent) | Fitted::Other(_, extent) => extent.is_all_of(frames),
            Fitted::Nothing(_) => false,
        }
    }

    /// The floors of a split of `corpus`, or why there are none; `each`: with the bits of every code.
    pub fn measure(&self, corpus: &Corpus, split: Split, each: bool) -> Result<std::result::Result<Floors, String>> {
        let (fitted, extent) = match self {
            Fitted::Own(extent) => (corpus, *extent),
            Fitted::Other(other, extent) => (&**other, *extent),
            Fitted::Nothing(why) => return Ok(Err(why.clone())),
        };
        crate::cli::progress::stage("fitting and measuring static models");
        Ok(Ok(Floors::of_corpora(fitted, corpus, split, extent, each)?))
    }
}
