//! Lists of runs below some folders, with their progress.

use super::log::LastStep;
use crate::config::TrainConfig;
use crate::folder::is_written;
use crate::metrics::METRICS;
use crate::run::RunFile;
use crate::{Error, Result};
use kinelm_model::checkpoint::{Best, Checkpoints};
use kinelm_model::layout;
use kinelm_model::run::CONFIG;
use kinelm_store::input;
use serde::{Deserialize, Serialize};
use std::path::{Path, PathBuf};
use std::time::UNIX_EPOCH;

/// Depth of the search for runs.
const DEPTH: usize = 4;

/// The status of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Status {
    /// A process writes it.
    Running,
    /// It can be resumed.
    Stopped,
    /// It reached its last step, or its patience ended it.
    Done,
}

impl Status {
    /// The status as a word.
    pub fn name(self) -> &'static str {
        match self {
            Status::Running => "running",
            Status::Stopped => "stopped",
            Status::Done => "done",
        }
    }
}

/// A run in a list.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Listed {
    /// Its folder.
    pub run: PathBuf,
    /// Its status.
    pub status: Status,
    /// Updates done.
    pub step: u64,
    /// Updates in all.
    pub steps: u64,
    /// The last step's loss, in the network's own measure; of a GPT nats a token.
    pub loss: Option<f64>,
    /// The best measurement on the validation clips.
    pub best: Option<Best>,
    /// Tokens trained on so far; `None` for an LSTM, which has none.
    pub tokens: Option<u64>,
    /// When it last wrote, seconds since 1970.
    pub written: Option<u64>,
    /// Its model: kind, positions of a GPT, layers x width.
    pub model: String,
    /// Parameters of a GPT.
    pub parameters: Option<usize>,
}

/// The part of `config.toml` that a list shows.
struct Shown {
    steps: u64,
    model: String,
    parameters: Option<usize>,
    /// How the training of a GPT ends early.
    train: Option<TrainConfig>,
}

impl Shown {
    /// Of a run of any kind.
    fn read(run: &Path) -> Result<Shown> {
        if let Some(LstmRun { kind, config }) = LstmRun::read(run) {
            let model = format!("{kind} {}x{}", config.layers, config.width);
            return Ok(Shown { steps: config.steps, model, parameters: None, train: None });
        }
        let RunFile { model: m, tokens, train, .. } = RunFile::read(run)?;
        Ok(Shown {
            steps: train.steps,
            model: format!("{} {} {}x{}", in_file(&m.kind), in_file(&m.positions), m.layers, m.width),
            parameters: Some(layout::parameters(&m, &tokens).iter().map(|p| p.len()).sum()),
            train: Some(train),
        })
    }
}

/// `config.toml` of an LSTM, which is another crate's: what a list shows of it.
#[derive(Deserialize)]
struct LstmRun {
    kind: String,
    config: LstmConfig,
}

#[derive(Deserialize)]
struct LstmConfig {
    steps: u64,
    layers: usize,
    width: usize,
}

impl LstmRun {
    /// `None` for a run without a kind, which is a GPT's, and for what can't be read.
    fn read(run: &Path) -> Option<LstmRun> {
        toml::from_str(&input::text(&run.join(CONFIG)).ok()?).ok()
    }
}

/// The runs among these folders and below them, by path. `note` receives the errors of runs that can't be read.
///
/// # Errors
/// A folder that can't be listed.
pub fn list(folders: &[PathBuf], note: &mut dyn FnMut(String)) -> Result<Vec<Listed>> {
    let mut runs = Vec::new();
    for folder in folders {
        if !folder.is_dir() {
            return Err(Error::file(folder, "no folder", "a folder of runs", ""));
        }
        look(folder, DEPTH, &mut runs, note)?;
    }
    runs.sort_by(|a, b| a.run.cmp(&b.run));
    // folders may be given twice, or one inside another
    runs.dedup_by(|a, b| a.run == b.run);
    Ok(runs)
}

fn look(folder: &Path, depth: usize, runs: &mut Vec<Listed>, note: &mut dyn FnMut(String)) -> Result<()> {
    if folder.join(CONFIG).is_file() && folder.join("checkpoints").is_dir() {
        match listed(folder) {
            Ok(run) => runs.push(run),
            Err(e) => note(e.to_string()),
        }
        // nothing below a run is a run
        return Ok(());
    }
    if depth == 0 {
        return Ok(());
    }
    for entry in std::fs::read_dir(folder).map_err(Error::io(folder))?.flatten() {
        let hidden = entry.file_name().to_string_lossy().starts_with('.');
        // links may form a cycle
        if hidden || !entry.file_type().is_ok_and(|t| t.is_dir()) {
            continue;
        }
        if let Err(e) = look(&entry.path(), depth - 1, runs, note) {
            note(e.to_string());
        }
    }
    Ok(())
}

/// A value as a training file writes it.
fn in_file(value: &impl Serialize) -> String {
    serde_json::to_value(value).ok().and_then(|v| v.as_str().map(String::from)).unwrap_or_default()
}

/// One run.
fn listed(run: &Path) -> Result<Listed> {
    let shown = Shown::read(run)?;
    let checkpoints = Checkpoints::of(run);
    let state = |which| checkpoints.named(which).and_then(|step| checkpoints.state(step).ok());
    let (latest, best) = (state("latest"), state("best").and_then(|s| s.best));
    let (last, saved) = (LastStep::read(run), latest.map_or((0, 0), |s| (s.step, s.tokens)));
    // the metrics are ahead of the checkpoint while a run goes on
    let step = last.map_or(saved.0, |last| last.step.max(saved.0));
    let tokens = shown.train.as_ref().map(|_| last.and_then(|last| last.tokens).unwrap_or(0).max(saved.1));
    let is_patience_out = |train: &TrainConfig| train.is_patience_out(saved.0, best.map(|b| b.step));
    let ended = saved.0 >= shown.steps || shown.train.as_ref().is_some_and(is_patience_out);
    let status = match (is_written(run), ended) {
        (true, _) => Status::Running,
        (false, true) => Status::Done,
        (false, false) => Status::Stopped,
    };
    let modified = |name: &str| run.join(name).metadata().and_then(|m| m.modified()).ok();
    let written = modified(METRICS).or_else(|| modified(CONFIG)).and_then(|t| t.duration_since(UNIX_EPOCH).ok());
    Ok(Listed {
        run: run.to_owned(),
        status,
        step,
        steps: shown.steps,
        loss: last.map(|l| l.loss),
        best,
        tokens,
        written: written.map(|d| d.as_secs()),
        model: shown.model,
        parameters: shown.parameters,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::data::CorpusPart;
    use crate::folder::RunFolder;
    use crate::{NoProgress, PretrainOptions, TrainConfig, TrainFile, fixture, pretrain};
    use kinelm_corpus::Split;
    use kinelm_model::ModelConfig;
    use std::sync::atomic::AtomicBool;

    #[test]
    fn runs_are_found_with_their_progress() {
        let dir = tempfile::tempdir().unwrap();
        fixture::corpus(dir.path(), &[(40, Split::Train), (12, Split::Valid)]);
        let model = ModelConfig { layers: 1, heads: 2, width: 16, context: 24, ..Default::default() };
        let train = TrainConfig { batch: 3, steps: 6, eval_every: 3, ..Default::default() };
        let run = |name: &str, steps| PretrainOptions {
            file: Some(TrainFile { model: model.clone(), train: train.clone(), ..Default::default() }),
            corpora: vec![CorpusPart::once(dir.path().join("corpus"))],
            run: Some(dir.path().join("runs").join(name)),
            steps: Some(steps),
            ..Default::default()
        };
        std::fs::create_dir_all(dir.path().join("runs/deep")).unwrap();
        let never = AtomicBool::new(false);
        let done = pretrain(&run("deep/b", 6), &never, &mut NoProgress).unwrap();
        // stopped at once
        pretrain(&run("a", 6), &AtomicBool::new(true), &mut NoProgress).unwrap();
        let broken = dir.path().join("runs/broken");
        std::fs::create_dir_all(broken.join("checkpoints")).unwrap();
        std::fs::write(broken.join(CONFIG), "version = 1").unwrap();
        let mut notes = Vec::new();
        let folders = [dir.path().to_owned(), dir.path().join("runs/a")];
        let runs = list(&folders, &mut |n| notes.push(n)).unwrap();
        assert!(notes.len() == 1 && notes[0].contains("broken"), "{notes:?}");
        let [a, b] = &runs[..] else { panic!("{runs:?}") };
        assert!(a.run.ends_with("runs/a") && b.run.ends_with("deep/b"));
        assert_eq!((a.status, a.step, a.steps, a.loss, a.best), (Status::Stopped, 0, 6, None, None));
        assert_eq!((b.status, b.step, b.tokens, b.best), (Status::Done, 6, Some(done.tokens), done.best));
        assert_eq!((b.loss, b.model.as_str()), (done.loss, "causal frame_joint 1x16"));
        assert!(b.parameters > Some(3000) && b.written.is_some_and(|w| w > 1_700_000_000));
        let held = RunFolder::open(&a.run).unwrap();
        assert_eq!(list(std::slice::from_ref(&a.run), &mut |_| ()).unwrap()[0].status, Status::Running);
        drop(held);
        // an LSTM's, of another crate
        let lstm = dir.path().join("lstm");
        std::fs::create_dir_all(lstm.join("checkpoints")).unwrap();
        let config = "kind = \"aclstm\"\nversion = 3\n[config]\nsteps = 9\nlayers = 3\nwidth = 256\nturn = true\n";
        std::fs::write(lstm.join(CONFIG), config).unwrap();
        std::fs::write(lstm.join(METRICS), "{\"schema\":1,\"kind\":\"aclstm\",\"step\":4,\"loss\":0.5}\n").unwrap();
        let found = list(&[lstm], &mut |note| panic!("{note}")).unwrap().remove(0);
        assert_eq!((found.status, found.step, found.steps, found.loss), (Status::Stopped, 4, 9, Some(0.5)));
        assert_eq!((&*found.model, found.tokens, found.parameters), ("aclstm 3x256", None, None));
        assert!(list(&[dir.path().join("none")], &mut |_| ()).unwrap_err().to_string().contains("no folder"));
    }
}
