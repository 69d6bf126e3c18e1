//! A label that a dance has for a time: `genre=salsa@0s:10s`.

use super::span::Span;
use kinelm_corpus::labels;
use kinelm_motion::moment::Moment;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// A label over a time: `FIELD=VALUE[@FROM:TO]`, half-open. Without a time: throughout.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct TimedLabel {
    /// The field.
    pub field: String,
    /// Its value.
    pub value: String,
    /// From when on; `None`: from the beginning.
    pub from: Option<Moment>,
    /// Until when; `None`: to the end.
    pub to: Option<Moment>,
}

impl FromStr for TimedLabel {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<TimedLabel, String> {
        let told = |label: &str| labels::pair(label).map_err(|e| e.to_string());
        told(text)?;
        let Span { joints: label, from, to } = text.parse()?;
        let (field, value) = told(&label)?;
        Ok(TimedLabel { field, value, from, to })
    }
}

impl TryFrom<String> for TimedLabel {
    type Error = String;

    fn try_from(text: String) -> std::result::Result<TimedLabel, String> {
        text.parse()
    }
}

impl From<TimedLabel> for String {
    fn from(label: TimedLabel) -> String {
        label.to_string()
    }
}

impl fmt::Display for TimedLabel {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        self.span().fmt(out)
    }
}

impl TimedLabel {
    /// Whether it holds throughout.
    pub fn is_always(&self) -> bool {
        self.from.is_none() && self.to.is_none()
    }

    /// The time, and the label in the place of the joints.
    pub(crate) fn span(&self) -> Span {
        Span { joints: format!("{}={}", self.field, self.value), from: self.from, to: self.to }
    }
}
