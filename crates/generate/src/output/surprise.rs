//! Whether a prompt is anything that the model knows.

use crate::open::OpenRequest;
use crate::{Error, Result};
use kinelm_model::run::HELD_OUT;
use kinelm_store::input;
use serde::{Deserialize, Serialize};

/// Bits per frame of clips that a model has not seen.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct HeldOut {
    /// Of the middle clip.
    pub median: f64,
    /// The 95th percentile.
    pub p95: f64,
}

impl OpenRequest {
    /// What to expect of a prompt that is more surprising than 95 % of the run's held-out clips; `None` for others, where
    /// nothing of a prompt is given, of a masked model, and for a run that doesn't store how surprising these are.
    ///
    /// # Errors
    /// Errors of the model; a damaged file.
    pub fn surprise_note(&self) -> Result<Option<String>> {
        let path = self.resolved.run.join(HELD_OUT);
        let given = self.prompt.as_ref().filter(|prompt| !prompt.lends() && !self.is_masked());
        let Some(prompt) = given else { return Ok(None) };
        let Some(text) = input::text_if_there(&path).map_err(Error::io(&path))? else { return Ok(None) };
        let known: HeldOut = serde_json::from_str(&text)
            .map_err(|e| Error::file(&path, e.to_string(), "bits per frame of held-out clips", ""))?;
        let bits = self.bits_per_frame(&[&prompt.clip.words])?[0];
        Ok((bits > known.p95).then(|| {
            format!(
                "the prompt is {:.1} times as surprising as the dances that this model knows ({bits:.0} bits/frame): expect worse",
                bits / known.median
            )
        }))
    }
}
