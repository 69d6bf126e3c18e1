//! For the tests: a run on one of the small corpora, which are [`kinelm_corpus::fixture`]'s.

use crate::{CorpusPart, PretrainOptions, Silent, TrainConfig, TrainFile, pretrain};
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
    pretrain(&options, &AtomicBool::new(false), &mut Silent).unwrap();
    load_run(&dir.join("run"), CheckpointChoice::Auto).unwrap()
}
