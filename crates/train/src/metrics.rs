//! The metrics of a run: `metrics.jsonl`, one object per line, and TensorBoard events.

use super::tensorboard::EventFile;
use crate::{Error, Result};
use kinelm_model::run::CONFIG;
use kinelm_model::scored_windows::Likelihood;
use kinelm_store::owned::{self, Access};
use kinelm_store::{files, input};
use serde::{Deserialize, Serialize};
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};

/// The file of a run's metrics.
pub const METRICS: &str = "metrics.jsonl";

/// Metrics of one step.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
pub struct StepMetrics {
    /// Updates done with it.
    pub step: u64,
    /// Mean loss of its batch, nats a token.
    pub loss: f64,
    /// The same as bits per frame, at the training clips' mean number of tokens per frame.
    pub bits_per_frame: f64,
    /// The learning rate.
    pub rate: f64,
    /// The gradient's norm before clipping.
    pub gradient_norm: f64,
    /// Tokens trained on so far, without padding.
    pub tokens: u64,
    /// Tokens per second of this step.
    pub tokens_per_second: f64,
}

/// The open metrics files of a run.
pub struct Metrics {
    path: PathBuf,
    file: File,
    events: EventFile,
}

impl Metrics {
    /// Opens the metrics of `run`, taking out those of steps after `step`: the run goes on from there.
    ///
    /// # Errors
    /// I/O errors.
    pub fn open(run: &Path, step: u64) -> Result<Metrics> {
        let path = run.join(METRICS);
        if let Ok(old) = input::text(&path) {
            let earlier = |line: &&str| {
                let object: Option<serde_json::Value> = serde_json::from_str(line).ok();
                object.and_then(|o| o["step"].as_u64()).is_some_and(|s| s <= step)
            };
            let kept: String = old.lines().filter(earlier).flat_map(|l| [l, "\n"]).collect();
            // also a last line that a full disk cut: it parses as nothing, and the next line would be joined to it
            if kept != old {
                files::write_whole(&path, kept.as_bytes())?;
            }
        }
        let file = owned::open(run, METRICS, Access::Append, u64::MAX)?;
        let config = input::text(&run.join(CONFIG)).unwrap_or_default();
        Ok(Metrics { path, file, events: EventFile::create(run, step, &config)? })
    }

    /// Syncs the file to disk, so that no later checkpoint is ahead of it.
    ///
    /// # Errors
    /// I/O errors.
    pub fn sync(&mut self) -> Result<()> {
        self.file.sync_data().map_err(Error::io(&self.path))
    }

    /// Writes the metrics of a step.
    ///
    /// # Errors
    /// I/O errors.
    pub fn step(&mut self, metrics: &StepMetrics) -> Result<()> {
        self.line("train", metrics)?;
        let f = metrics;
        let values = [
            ("train/loss", f.loss),
            ("train/bits_per_frame", f.bits_per_frame),
            ("train/rate", f.rate),
            ("train/gradient_norm", f.gradient_norm),
            ("train/tokens_per_second", f.tokens_per_second),
        ];
        self.events.scalars(f.step, &values)
    }

    /// Writes a measurement on the validation clips.
    ///
    /// # Errors
    /// I/O errors.
    pub(crate) fn valid(&mut self, step: u64, found: &Likelihood) -> Result<()> {
        #[derive(Serialize)]
        struct Valid<'a> {
            step: u64,
            #[serde(flatten)]
            found: &'a Likelihood,
        }
        self.line("valid", &Valid { step, found })?;
        let bits = if found.pseudo { "valid/pseudo_bits_per_frame" } else { "valid/bits_per_frame" };
        let values = [(bits, found.bits_per_frame), ("valid/loss", found.nats_per_token)];
        self.events.scalars(step, &values)
    }

    /// Writes any metrics of a step: a line of this kind, and these values for TensorBoard.
    ///
    /// # Errors
    /// I/O errors.
    pub fn other(&mut self, kind: &str, step: u64, metrics: &impl Serialize, values: &[(&str, f64)]) -> Result<()> {
        self.line(kind, metrics)?;
        self.events.scalars(step, values)
    }

    fn line(&mut self, kind: &str, metrics: &impl Serialize) -> Result<()> {
        #[derive(Serialize)]
        struct Line<'a, T> {
            schema: u32,
            kind: &'a str,
            #[serde(flatten)]
            metrics: &'a T,
        }
        let line = serde_json::to_string(&Line { schema: 1, kind, metrics }).expect("metrics are JSON");
        // one write a line, so that a killed process leaves whole lines
        self.file.write_all(format!("{line}\n").as_bytes()).map_err(Error::io(&self.path))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn resuming_drops_later_and_incomplete_lines() {
        let dir = tempfile::tempdir().unwrap();
        let of_step = |step| StepMetrics {
            step,
            loss: 1.5,
            bits_per_frame: 3.0,
            rate: 0.1,
            gradient_norm: 1.0,
            tokens: 7,
            tokens_per_second: 9.0,
        };
        let mut metrics = Metrics::open(dir.path(), 0).unwrap();
        for step in 1..=4 {
            metrics.step(&of_step(step)).unwrap();
        }
        drop(metrics);
        let path = dir.path().join("metrics.jsonl");
        let mut text = std::fs::read_to_string(&path).unwrap();
        text.push_str("{\"schema\":1,\"kind\":\"tr");
        std::fs::write(&path, text).unwrap();
        Metrics::open(dir.path(), 2).unwrap().step(&of_step(3)).unwrap();
        let text = std::fs::read_to_string(&path).unwrap();
        let steps: Vec<u64> = text
            .lines()
            .map(|l| serde_json::from_str::<serde_json::Value>(l).unwrap()["step"].as_u64().unwrap())
            .collect();
        assert_eq!(steps, [1, 2, 3]);
        assert!(text.starts_with("{\"schema\":1,\"kind\":\"train\",\"step\":1,\"loss\":1.5,"));
    }
}
