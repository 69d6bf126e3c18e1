//! Arguments that several commands have.

use super::{ours, progress};
use crate::corpus::{Corpus, Opening};
use crate::model::{Compute, DeviceName, Form, ReaderOptions};
use kinelm_model::{KvKind, WeightKind};
use kinelm_store::output::Outputs;
use std::path::{Path, PathBuf};

/// Where and how a model computes.
#[derive(Debug, Clone, Copy, clap::Args)]
pub struct ComputeArgs {
    /// The processor, or the Nvidia card of this number (where kinelm was built with CUDA)
    #[arg(long, value_name = "cpu|cuda:N", default_value = "cpu")]
    device: DeviceName,
    /// The fastest form of the model that the device has, or the plain one that it is compared with
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
    /// Neither hash a corpus's files nor look through its tokens when it is opened, which takes long for many hours: they
    /// are as they were written
    #[arg(long)]
    trust: bool,
}

impl TrustArgs {
    /// Of a corpus that is read again and again: in memory, where there is room.
    pub fn opening(self) -> Opening {
        Opening { trust: self.trust, streamed: false, tell: progress::stage }
    }

    /// A corpus that is read clip by clip.
    ///
    /// # Errors
    /// Those of [`Corpus::open_with`].
    pub fn open(self, dir: &Path) -> crate::Result<Corpus> {
        Ok(Corpus::open_with(dir, Opening { streamed: true, ..self.opening() })?)
    }
}

/// How a model is read, token after token.
#[derive(Debug, Clone, Copy, clap::Args)]
pub struct ReadingArgs {
    /// How the weights are held: as they are, or as bytes with a scale a column, which is faster where memory
    /// limits and has cost less than 0.01 % of the bits a frame
    #[arg(long, value_enum, default_value = "f32")]
    weights: WeightKind,
    /// How keys and values of what was read are held: as they are, or as half floats,
    /// which has cost less than 0.01 % of the bits a frame
    #[arg(long, value_enum, default_value = "f32")]
    kv: KvKind,
}

impl ReadingArgs {
    /// As the library has it, for so many sequences.
    pub fn get(self, streams: usize) -> ReaderOptions {
        ReaderOptions { streams, weights: self.weights, kv: self.kv }
    }
}

/// What a command that writes may write over.
#[derive(Debug, Clone, Copy, clap::Args)]
pub struct ForceArgs {
    /// Replace what stands at an output and isn't this program's own beyond doubt; never a file that the call reads
    #[arg(long)]
    pub force: bool,
}

impl ForceArgs {
    /// The outputs of a call that reads these files and folders.
    pub fn outputs(self, inputs: impl IntoIterator<Item = impl Into<PathBuf>>) -> Outputs {
        Outputs::new(ours::OURS, inputs, self.force)
    }
}
