//! Which checkpoint of a run is read, and which stay.

use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Which checkpoint to read.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum CheckpointChoice {
    /// The best, or the latest of a run without validation clips.
    #[default]
    Auto,
    /// The best on the validation clips.
    Best,
    /// The latest.
    Latest,
    /// The one after this many updates.
    Step(u64),
}

impl FromStr for CheckpointChoice {
    type Err = String;

    /// `best`, `latest` or a number of updates.
    fn from_str(text: &str) -> Result<CheckpointChoice, String> {
        match text {
            "best" => Ok(CheckpointChoice::Best),
            "latest" => Ok(CheckpointChoice::Latest),
            number => number.parse().map(CheckpointChoice::Step).map_err(|_| "expected a step, latest or best".into()),
        }
    }
}

/// Checkpoints that stay beside the best; in files a number or `"all"`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "InFile", into = "InFile")]
pub enum Keep {
    /// The last of them, 1 or more.
    Last(usize),
    /// Every one.
    All,
}

/// [`Keep`] as files have it.
#[derive(Serialize, Deserialize)]
#[serde(untagged, expecting = "expected a number of checkpoints, or \"all\"")]
enum InFile {
    Number(usize),
    Name(String),
}

impl TryFrom<InFile> for Keep {
    type Error = String;

    fn try_from(found: InFile) -> Result<Keep, String> {
        match found {
            InFile::Number(n) => Ok(Keep::Last(n)),
            InFile::Name(name) if name == "all" => Ok(Keep::All),
            InFile::Name(name) => Err(format!("keep is {name:?}; expected a number of checkpoints, or \"all\"")),
        }
    }
}

impl From<Keep> for InFile {
    fn from(keep: Keep) -> InFile {
        match keep {
            Keep::Last(n) => InFile::Number(n),
            Keep::All => InFile::Name("all".into()),
        }
    }
}

impl Keep {
    /// Whether it is within its limits: at least one checkpoint stays.
    pub fn is_valid(self) -> bool {
        self != Keep::Last(0)
    }

    /// The newest checkpoints that stay.
    pub fn newest(self) -> usize {
        match self {
            Keep::Last(n) => n,
            Keep::All => usize::MAX,
        }
    }
}

impl fmt::Display for Keep {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Keep::Last(n) => write!(f, "{n}"),
            Keep::All => write!(f, "all"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(Debug, PartialEq, Serialize, Deserialize)]
    struct File {
        keep: Keep,
    }

    #[test]
    fn files_have_a_number_or_all() {
        for (keep, text) in [(Keep::Last(2), "keep = 2\n"), (Keep::All, "keep = \"all\"\n")] {
            assert_eq!(toml::to_string(&File { keep }).unwrap(), text);
            assert_eq!(toml::from_str::<File>(text).unwrap(), File { keep });
        }
        for text in ["keep = \"some\"", "keep = -1", "keep = 1.5"] {
            let message = toml::from_str::<File>(text).unwrap_err().to_string();
            assert!(message.contains("expected a number of checkpoints, or \"all\""), "{text}: {message}");
        }
    }

    #[test]
    fn a_choice_is_a_step_or_a_name() {
        let of = |text: &str| text.parse::<CheckpointChoice>();
        assert_eq!(of("best"), Ok(CheckpointChoice::Best));
        assert_eq!(of("latest"), Ok(CheckpointChoice::Latest));
        assert_eq!(of("120"), Ok(CheckpointChoice::Step(120)));
        for wrong in ["-1", "", "first", "1.5"] {
            assert_eq!(of(wrong).unwrap_err(), "expected a step, latest or best");
        }
    }
}
