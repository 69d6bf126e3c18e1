//! The windows of a training in order, for other programs that train on them.

use super::batches::Batches;
use super::data::Data;
use super::run::RunFile;
use crate::{Error, Result};
use kinelm_motion::format::npz::{self, Values};
use std::path::{Path, PathBuf};

/// The windows of each step, (steps, rows, 3): the clip, the first token of it that the window shows, and the number of
/// tokens. Rows are those of all batches of a step. Clips count from 0 over the training clips that have frames, in the
/// order of `clips.jsonl`, corpus after corpus.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Order {
    /// Windows of a step: batch times accumulate.
    pub rows: usize,
    /// (steps, rows, 3).
    pub windows: Vec<i64>,
}

/// The largest order: 2.4 GB.
const MOST_WINDOWS: u64 = 100_000_000;

/// The order of the first `steps` steps of a run, without augmentation.
///
/// # Errors
/// Those of `Batches::of_run`; a run with stages; too many windows.
pub fn order(run: &RunFile, data: &Data, steps: u64) -> Result<Order> {
    if !run.train.stages.is_empty() {
        let why = "an order has windows of one length; leave the stages out";
        return Err(Error::unsupported("train.stages", why));
    }
    let mut batches = Batches::of_run(run, data)?;
    let rows = run.train.batch * run.train.accumulate;
    // checked, as `steps` comes from the command line
    if steps.checked_mul(rows as u64).is_none_or(|all| all > MOST_WINDOWS) {
        let (needs, limit) = (format!("{rows} windows each"), format!("{MOST_WINDOWS} windows"));
        return Err(Error::limit(format!("an order of {steps} steps"), needs, limit, "request fewer `steps`"));
    }
    let mut windows = Vec::new();
    for place in 0..steps * rows as u64 {
        let window = batches.window(place);
        let span = batches.span(window);
        windows.extend([span.clip, span.start, span.tokens].map(|n| n as i64));
    }
    Ok(Order { rows, windows })
}

impl Order {
    /// `windows` (steps, rows, 3) int64 as a file: `windows.npy` in the folder `out`, or an archive if `out` ends in `.npz`.
    ///
    /// # Errors
    /// Errors of writing the archive.
    pub fn to_file(&self, out: &Path) -> Result<(PathBuf, Vec<u8>)> {
        let shape = [self.windows.len() / 3 / self.rows, self.rows, 3];
        let values = Values::I64(&self.windows);
        if out.extension().is_some_and(|e| e == "npz") {
            let mut archive = npz::Writer::new();
            archive.add("windows", &shape, values)?;
            return Ok((out.to_owned(), archive.finish()?));
        }
        Ok((out.join("windows.npy"), npz::npy("windows", &shape, values)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{TrainConfig, fixture};
    use kinelm_corpus::Split;
    use kinelm_model::ModelConfig;

    #[test]
    fn more_windows_than_memory_holds_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let data = Data::one(fixture::corpus(dir.path(), &[(30, Split::Train)])).unwrap();
        let model = ModelConfig { layers: 1, heads: 1, width: 8, context: 36, ..Default::default() };
        let run = RunFile::new(&model, &TrainConfig { batch: 2, ..Default::default() }, &data).unwrap();
        for steps in [99_999_999_999, u64::MAX] {
            let message = order(&run, &data, steps).unwrap_err().to_string();
            assert!(message.contains("the limit is 100000000 windows"), "{message}");
        }
    }

    #[test]
    fn the_windows_are_those_of_training() {
        let dir = tempfile::tempdir().unwrap();
        let data = Data::one(fixture::corpus(dir.path(), &[(30, Split::Train), (9, Split::Valid), (4, Split::Train)]))
            .unwrap();
        let train = TrainConfig { batch: 2, accumulate: 3, ..Default::default() };
        let model = ModelConfig { context: 36, ..Default::default() };
        let run = RunFile::new(&model, &train, &data).unwrap();
        let found = order(&run, &data, 5).unwrap();
        assert_eq!((found.rows, found.windows.len()), (6, 5 * 6 * 3));
        let mut batches = Batches::of_run(&run, &data).unwrap();
        let clips: Vec<_> = batches.clips().collect();
        assert_eq!(clips.iter().map(|(_, c)| c.name.as_str()).collect::<Vec<_>>(), ["clip0", "clip2"]);
        for (batch, windows) in (0..15).map(|b| batches.batch(b).unwrap()).zip(found.windows.chunks(6)) {
            for (target, window) in batch.targets.chunks(36).zip(windows.chunks(3)) {
                let (corpus, clip) = clips[window[0] as usize];
                let ids = corpus.ids(clip, window[1] as usize..(window[1] + window[2]) as usize).unwrap();
                assert_eq!(target[..ids.len()], ids);
                assert!(target[ids.len()..].iter().all(|id| *id == 0));
            }
        }
        let (archive, zip) = found.to_file(&dir.path().join("o.npz")).unwrap();
        let (path, bytes) = found.to_file(&dir.path().join("o")).unwrap();
        assert_eq!((archive, path), (dir.path().join("o.npz"), dir.path().join("o/windows.npy")));
        let file = npyz::NpyFile::new(bytes.as_slice()).unwrap();
        assert_eq!(file.shape(), [5, 6, 3]);
        assert_eq!(file.into_vec::<i64>().unwrap(), found.windows);
        assert!(zip.starts_with(b"PK"));
    }
}
