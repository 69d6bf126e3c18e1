//! `metrics.jsonl` of a run, read while it may still be written.

use crate::metrics::{METRICS, StepMetrics};
use crate::{Error, Result};
use kinelm_model::run::CONFIG;
use kinelm_store::input;
use kinelm_store::owned::{self, Access};
use serde::Deserialize;
use std::io::{Read, Seek, SeekFrom};
use std::path::Path;

/// Bytes that are read at the end of a file, to know the progress of a run.
const END: u64 = 1 << 16;

/// A measurement on the validation clips.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub struct Valid {
    /// After how many updates.
    pub step: u64,
    /// Bits a frame.
    pub bits_per_frame: f64,
    /// Nats a token.
    pub nats_per_token: f64,
    /// Of a masked model: a pseudo-likelihood.
    #[serde(default)]
    pub pseudo: bool,
}

/// The last update in the metrics of a run of any kind.
#[derive(Debug, Clone, Copy, PartialEq, Deserialize)]
pub struct LastStep {
    /// Updates done with it.
    pub step: u64,
    /// Its loss, in the network's own measure; of a GPT nats a token.
    pub loss: f64,
    /// Tokens trained on so far, of a GPT.
    pub tokens: Option<u64>,
}

impl LastStep {
    /// From the end of the file; `None` without an update there.
    pub fn read(run: &Path) -> Option<LastStep> {
        let read = || -> std::io::Result<Vec<u8>> {
            let file = owned::open(run, METRICS, Access::Read, u64::MAX);
            let mut file = file.map_err(std::io::Error::other)?;
            let length = file.metadata()?.len();
            file.seek(SeekFrom::Start(length.saturating_sub(END)))?;
            let mut bytes = Vec::new();
            file.read_to_end(&mut bytes)?;
            Ok(bytes)
        };
        // measurements have no loss of this name
        read().ok()?.rsplit(|b| *b == b'\n').find_map(|line| serde_json::from_slice(line).ok())
    }
}

/// An update of an LSTM, or a measurement on its validation clips.
#[derive(Debug, Clone, Copy, Default, PartialEq, Deserialize)]
pub struct LstmLoss {
    /// Updates done.
    #[serde(default)]
    pub step: u64,
    /// The loss, in the network's own measure.
    pub loss: f64,
    /// The root's part of it.
    pub root: Option<f64>,
    /// The rotations' part of it.
    pub rotations: Option<f64>,
    /// The update's duration.
    #[serde(default)]
    pub seconds: f64,
}

/// The metrics of a run.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Log {
    /// Of an LSTM, what its loss depends on, such as `aclstm quaternion`: losses of others can't be compared with it.
    pub form: Option<String>,
    /// The steps of a GPT.
    pub steps: Vec<StepMetrics>,
    /// The measurements of a GPT.
    pub valid: Vec<Valid>,
    /// The updates of an LSTM.
    pub lstm: Vec<LstmLoss>,
    /// The measurements of an LSTM.
    pub lstm_valid: Vec<LstmLoss>,
    /// Incomplete lines: the last of a run that is being written, or those of a full disk.
    pub incomplete: usize,
}

impl Log {
    /// All metrics of a run.
    ///
    /// # Errors
    /// A folder without metrics; what the system refuses.
    pub fn read(run: &Path) -> Result<Log> {
        let path = run.join(METRICS);
        input::note(&path);
        let bytes = owned::bytes(run, METRICS, u64::MAX)?.ok_or_else(|| {
            let help = "a run is a folder that `kinelm pretrain --run RUN` wrote";
            Error::file(run, format!("no {METRICS}"), "a run folder", help)
        })?;
        Ok(Log { form: form(run), ..Log::parse(&bytes) })
    }

    fn parse(bytes: &[u8]) -> Log {
        #[derive(Deserialize)]
        #[serde(tag = "kind", rename_all = "snake_case")]
        enum Line {
            Train(StepMetrics),
            #[serde(rename = "aclstm", alias = "music-lstm")]
            Lstm(LstmLoss),
            Valid(Measured),
        }
        #[derive(Deserialize)]
        #[serde(untagged)]
        enum Measured {
            Gpt(Valid),
            Lstm { step: u64, valid: LstmLoss },
        }
        let mut log = Log::default();
        for line in bytes.split(|b| *b == b'\n').filter(|l| !l.is_empty()) {
            match serde_json::from_slice(line) {
                Ok(Line::Train(step)) => log.steps.push(step),
                Ok(Line::Lstm(step)) => log.lstm.push(step),
                Ok(Line::Valid(Measured::Gpt(valid))) => log.valid.push(valid),
                Ok(Line::Valid(Measured::Lstm { step, valid })) => log.lstm_valid.push(LstmLoss { step, ..valid }),
                Err(_) => log.incomplete += 1,
            }
        }
        log
    }

    /// Cumulative duration of the steps in seconds, without pauses and measurements.
    pub fn seconds(&self) -> Vec<f64> {
        let mut before = 0;
        let seconds = self.steps.iter().scan(0.0, |total, step| {
            // min: a log that goes back to fewer tokens adds nothing rather than underflow
            *total += (step.tokens - before.min(step.tokens)) as f64 / step.tokens_per_second.max(1e-9);
            before = step.tokens;
            Some(*total)
        });
        seconds.collect()
    }
}

/// What the loss of an LSTM's run depends on, out of its `config.toml`; `None` for a GPT's.
fn form(run: &Path) -> Option<String> {
    let config: toml::Table = toml::from_str(&input::text(&run.join(CONFIG)).ok()?).ok()?;
    let kind = config.get("kind")?.as_str()?;
    let of = |key: &str| config.get("config")?.get(key)?.as_str();
    let parts = ["form", "pose", "effort"].into_iter().filter_map(of).filter(|part| *part != "none");
    Some([kind].into_iter().chain(parts).collect::<Vec<_>>().join(" "))
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::metrics::{Metrics, StepMetrics};
    use kinelm_model::scored_windows::Likelihood;

    /// A run's metrics as training writes them.
    pub fn write(run: &Path, steps: u64) {
        std::fs::create_dir_all(run).unwrap();
        let mut metrics = Metrics::open(run, 0).unwrap();
        for step in 1..=steps {
            let loss = 3.0 / step as f64;
            let figures = StepMetrics {
                step,
                loss,
                bits_per_frame: 60.0 * loss,
                rate: 0.1,
                gradient_norm: 1.0,
                tokens: 50 * step,
                tokens_per_second: 25.0,
            };
            metrics.step(&figures).unwrap();
            if step.is_multiple_of(5) {
                let (bits_per_frame, nats_per_token) = (70.0 * loss, loss);
                let counts = [9, 3, 3, 9];
                let [tokens, frames, windows, all_windows] = counts;
                metrics
                    .valid(
                        step,
                        &Likelihood {
                            bits_per_frame,
                            nats_per_token,
                            tokens,
                            frames,
                            windows,
                            all_windows,
                            pseudo: false,
                        },
                    )
                    .unwrap();
            }
        }
    }

    #[test]
    fn metrics_are_read_without_incomplete_lines() {
        let dir = tempfile::tempdir().unwrap();
        write(dir.path(), 12);
        let whole = Log::read(dir.path()).unwrap();
        assert_eq!((whole.steps.len(), whole.valid.len(), whole.incomplete), (12, 2, 0));
        assert_eq!((whole.steps[11].loss, whole.valid[1].bits_per_frame), (0.25, 21.0));
        assert_eq!(whole.seconds(), (1..=12).map(|i| 2.0 * i as f64).collect::<Vec<_>>());
        let path = dir.path().join(METRICS);
        let bytes = input::bytes(&path).unwrap();
        std::fs::write(&path, &bytes[..bytes.len() - 30]).unwrap();
        let cut = Log::read(dir.path()).unwrap();
        assert_eq!((cut.steps.len(), cut.valid.len(), cut.incomplete), (11, 2, 1));
        assert_eq!(LastStep::read(dir.path()), Some(LastStep { step: 11, loss: 3.0 / 11.0, tokens: Some(550) }));
        // the end of a long file begins inside a line
        std::fs::write(&path, bytes.repeat(40)).unwrap();
        assert_eq!(LastStep::read(dir.path()), Some(LastStep { step: 12, loss: 0.25, tokens: Some(600) }));
        assert_eq!(LastStep::read(&dir.path().join("none")), None);
        let message = Log::read(&dir.path().join("none")).unwrap_err().to_string();
        assert!(message.contains("found no metrics.jsonl, expected a run folder"), "{message}");
    }
}
