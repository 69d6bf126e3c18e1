//! A label for a part of a dance: `genre=salsa@0s:10s`.

use super::span::Span;
use kinelm_corpus::labels::LabelFilter;
use kinelm_motion::moment::Moment;
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// A label for a time: `FIELD=VALUE[@FROM:TO]`, half-open. Without a time it holds throughout.
///
/// ```
/// use kinelm_generate::request::TimedLabel;
///
/// let label: TimedLabel = "genre=salsa@0s:10s".parse()?;
/// assert_eq!((label.field.as_str(), label.value.as_str(), label.is_always()), ("genre", "salsa", false));
/// # Ok::<(), String>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct TimedLabel {
    /// The field.
    pub field: String,
    /// Its value.
    pub value: String,
    /// Beginning; `None`: from the first frame.
    pub from: Option<Moment>,
    /// End; `None`: to the last frame.
    pub to: Option<Moment>,
}

impl FromStr for TimedLabel {
    type Err = String;

    fn from_str(text: &str) -> std::result::Result<TimedLabel, String> {
        let pair = |label: &str| label.parse::<LabelFilter>().map_err(|e| e.to_string());
        pair(text)?;
        let Span { joints: label, from, to } = text.parse()?;
        let LabelFilter { field, value } = pair(&label)?;
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
    /// Whether it holds throughout the dance.
    pub fn is_always(&self) -> bool {
        self.from.is_none() && self.to.is_none()
    }

    /// A span with the label in place of the joints.
    pub(crate) fn span(&self) -> Span {
        Span { joints: format!("{}={}", self.field, self.value), from: self.from, to: self.to }
    }
}
