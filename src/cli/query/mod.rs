//! `kinelm query`.

mod build;
mod evaluate;
mod find;

use super::{Say, WrongCall};
use crate::classify::embedding::of_run;
use crate::model::CheckpointChoice;
use crate::spectral::query::FeatureKind;
use crate::spectral::{LowDct, PcaBasis};
use anyhow::Result;
use kinelm_motion::joints;
use std::path::Path;

#[derive(Debug, clap::Subcommand)]
pub enum Command {
    /// Index the windows of clips, or add clips to an index
    Build(build::Args),
    /// Find windows that move like one of a clip: a table, and a page that plays them side by side
    Find(find::Args),
    /// Measure how well neighbours predict labels, for each transform and distance, compared with chance
    Evaluate(evaluate::Args),
}

pub fn run(command: Command, say: Say) -> Result<()> {
    match command {
        Command::Build(args) => build::run(args, say),
        Command::Find(args) => find::run(args, say),
        Command::Evaluate(args) => evaluate::run(args, say),
    }
}

/// The features of a window.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
enum TransformArg {
    /// Magnitudes of a short-time Fourier transform
    Stft,
    /// Low coefficients of a cosine transform
    Dct,
    /// Coordinates in a basis fitted to the windows
    Pca,
    /// A language model's embedding
    Model,
}

impl TransformArg {
    /// With its settings; of the model the run's.
    fn kind(self, no_dc: bool, keep: Option<usize>, run: Option<(&Path, CheckpointChoice)>) -> Result<FeatureKind> {
        if no_dc && self != TransformArg::Stft {
            return Err(WrongCall("--no-dc: only an STFT has a bin at 0 Hz".into()).into());
        }
        if keep.is_some() && !matches!(self, TransformArg::Dct | TransformArg::Pca) {
            return Err(WrongCall("--keep: only DCT and PCA keep some of their numbers".into()).into());
        }
        match (self, run) {
            (TransformArg::Stft, _) => Ok(FeatureKind::Stft { no_dc }),
            (TransformArg::Dct, _) => Ok(FeatureKind::Dct { keep: keep.unwrap_or(LowDct::KEEP) }),
            (TransformArg::Pca, _) => Ok(FeatureKind::Pca { keep: keep.unwrap_or(PcaBasis::KEEP) }),
            (TransformArg::Model, Some((run, which))) => Ok(of_run(run, which)?),
            (TransformArg::Model, None) => Err(WrongCall("--transform model needs --run RUN".into()).into()),
        }
    }
}

/// The joints of `--joints`; none stands for all 24.
fn joints_of(list: &str) -> Result<Vec<usize>> {
    let found = joints::parse(list).map_err(|e| WrongCall(format!("--joints {list}: {e}")))?.joints;
    Ok(if found.len() == 24 { Vec::new() } else { found })
}
