//! Arguments that several commands have.

use super::{ours, progress};
use crate::corpus::{Corpus, CorpusOptions};
use crate::model::{CheckpointChoice, Compute, DeviceName, Form, ReaderOptions};
use crate::train::branch::Branch;
use kinelm_model::{KvKind, WeightKind};
use kinelm_store::output::Outputs;
use std::path::{Path, PathBuf};

/// Where and how a model computes.
#[derive(Debug, Clone, Copy, clap::Args)]
pub struct ComputeArgs {
    /// The CPU, or the Nvidia card with this number (if kinelm was built with CUDA)
    #[arg(long, value_name = "cpu|cuda:N", default_value = "cpu")]
    device: DeviceName,
    /// The implementation of the model: the fastest for the device, or the plain reference
    #[arg(long, value_name = "auto|plain", default_value = "auto", hide_short_help = true)]
    form: Form,
}

impl ComputeArgs {
    /// As the library has it.
    pub fn get(self) -> Compute {
        Compute { device: self.device, form: self.form }
    }
}

/// How corpora are opened.
#[derive(Debug, Clone, Copy, Default, clap::Args)]
pub struct TrustArgs {
    /// Skip checking the hashes and the tokens of a corpus when it is opened, which takes long for many hours of motion
    #[arg(long)]
    trust: bool,
}

impl TrustArgs {
    /// Options of a corpus that is read again and again: in memory, where there is room.
    pub fn opening(self) -> CorpusOptions {
        CorpusOptions { trust: self.trust, streamed: false, progress: progress::stage }
    }

    /// A corpus that is read clip by clip.
    ///
    /// # Errors
    /// Those of [`Corpus::open_with`].
    pub fn open(self, dir: &Path) -> crate::Result<Corpus> {
        Ok(Corpus::open_with(dir, CorpusOptions { streamed: true, ..self.opening() })?)
    }
}

/// How a model is read token by token.
#[derive(Debug, Clone, Copy, clap::Args)]
pub struct ReadingArgs {
    /// The format of the weights while sampling: as trained, or bytes with a scale per column, which are more than twice as
    /// fast; int8 has cost 0.03 % more bits per frame
    #[arg(long, value_enum, default_value = "f32")]
    weights: WeightKind,
    /// The format of cached keys and values: as computed, half floats or bytes; neither has cost more than 0.01 % of the bits
    /// per frame
    #[arg(long, value_enum, default_value = "f32")]
    kv: KvKind,
}

impl ReadingArgs {
    /// As the library has it, for `streams` sequences.
    pub fn get(self, streams: usize) -> ReaderOptions {
        ReaderOptions { streams, weights: self.weights, kv: self.kv }
    }
}

/// The checkpoint of a run that a command reads.
#[derive(Debug, Clone, Copy, clap::Args)]
pub struct CheckpointArg {
    /// The checkpoint of the run: a step, latest or best [default: best, or latest where none was validated]
    #[arg(long, value_name = "N|latest|best")]
    checkpoint: Option<CheckpointChoice>,
}

impl CheckpointArg {
    /// As the library has it.
    pub fn get(self) -> CheckpointChoice {
        self.checkpoint.unwrap_or_default()
    }
}

/// An earlier checkpoint that a resumed training goes on from, and the new run that does.
#[derive(Debug, Clone, clap::Args)]
pub struct BranchArgs {
    /// Go on from the checkpoint of this step, as a new run
    #[arg(long, value_name = "N", requires = "branch_run")]
    from_step: Option<u64>,
    /// The folder of the new run to create
    #[arg(long = "run", id = "branch_run", value_name = "NEW", requires = "from_step")]
    branch_run: Option<PathBuf>,
}

impl BranchArgs {
    /// As the library has it.
    pub fn get(self) -> Option<Branch> {
        Some(Branch { step: self.from_step?, run: self.branch_run? })
    }
}

/// The files that a command may overwrite.
#[derive(Debug, Clone, Copy, clap::Args)]
pub struct ForceArgs {
    /// Overwrite an output that kinelm didn't write itself; never an input of the call
    #[arg(long)]
    pub force: bool,
}

impl ForceArgs {
    /// The outputs of a call that reads these files and folders.
    pub fn outputs(self, inputs: impl IntoIterator<Item = impl Into<PathBuf>>) -> Outputs {
        Outputs::new(ours::OURS, inputs, self.force)
    }
}
