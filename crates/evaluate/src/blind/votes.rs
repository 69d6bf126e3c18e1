//! The votes that a page saved.

use super::Key;
use crate::{Error, Result};
use kinelm_store::input;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// The votes of one person.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Votes {
    /// 1.
    pub schema: u32,
    /// The page's hash.
    pub page: String,
    /// A random name that the page made.
    pub voter: String,
    /// At most one a trial.
    pub votes: Vec<Vote>,
}

/// One answer.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Vote {
    /// The index of the trial, from 0.
    pub trial: usize,
    /// The index of the answer, from 0 on the left.
    pub choice: usize,
    /// How long it took, seconds.
    pub seconds: f64,
}

impl Votes {
    /// Reads the votes of a study.
    ///
    /// # Errors
    /// I/O errors; [`kinelm_store::Error::File`] for votes of another page, and for trials and answers that the study
    /// doesn't have or that are there twice.
    pub fn load(path: &Path, key: &Key) -> Result<Votes> {
        let bytes = input::bytes(path).map_err(Error::io(path))?;
        let wrong = |found: String, expected: &str| Error::file(path, found, expected, "");
        let votes: Votes =
            serde_json::from_slice(&bytes).map_err(|e| wrong(e.to_string(), "votes that a page saved"))?;
        if votes.schema != 1 {
            return Err(wrong(format!("schema {}", votes.schema), "schema 1"));
        }
        if votes.page != key.page {
            let expected = format!("votes of the key's page, {}", key.page);
            return Err(wrong(format!("votes of another page, {}", votes.page), &expected));
        }
        let (trials, choices) = (key.trials.len(), key.ask.choices().len());
        let mut seen = vec![false; trials];
        for Vote { trial, choice, .. } in &votes.votes {
            if *trial >= trials || *choice >= choices || std::mem::replace(&mut seen[*trial], true) {
                let expected = format!("each of {trials} trials at most once, answers below {choices}");
                return Err(wrong(format!("trial {trial}, answer {choice}"), &expected));
            }
        }
        Ok(votes)
    }
}
