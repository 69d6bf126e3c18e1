//! For tests: a run on one of the small corpora of [`kinelm_corpus::fixture`].

use crate::{CorpusPart, NoProgress, PretrainOptions, TrainConfig, TrainFile, pretrain};
pub use kinelm_corpus::fixture::*;
pub use kinelm_model::fixtures::TOKENS;
use kinelm_model::{CheckpointChoice, LoadedRun, ModelConfig, load_run};
use std::path::Path;
use std::sync::atomic::AtomicBool;

/// A run in `dir` on the corpus beside it.
pub fn run(dir: &Path, model: ModelConfig, train: TrainConfig) -> LoadedRun {
    let options = PretrainOptions {
        file: Some(TrainFile { model, train, ..Default::default() }),
        corpora: vec![CorpusPart::once(dir.join("corpus"))],
        run: Some(dir.join("run")),
        ..Default::default()
    };
    pretrain(&options, &AtomicBool::new(false), &mut NoProgress).unwrap();
    load_run(&dir.join("run"), CheckpointChoice::Auto).unwrap()
}
