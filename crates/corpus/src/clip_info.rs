//! The labels of one clip, and the fields that are no labels.

use super::csv::{FROM, TO};
use super::item::TimedLabels;
use super::record::Split;
use crate::{Error, Result};
use std::collections::BTreeMap;
use std::str::FromStr;

/// Columns and pattern fields that are no labels.
pub(super) const RESERVED: [&str; 9] = ["clip", "split", "take", "fps", "skip", "floor", "music_from", FROM, TO];

/// Pattern fields that name a file and nothing that could be learned.
const NO_LABEL: [&str; 2] = ["set", "id"];

/// What is known of one clip.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ClipInfo {
    /// Values by field; empty values are left out.
    pub labels: BTreeMap<String, String>,
    /// The split, if stated.
    pub split: Option<Split>,
    /// The recording, if stated.
    pub take: Option<String>,
    /// The true source rate, if stated.
    pub fps: Option<f64>,
    /// Source frames to skip at the start, if stated.
    pub skip: Option<usize>,
    /// The height of the floor in metres, if stated.
    pub floor: Option<f64>,
    /// The time of its music at which the clip begins, in seconds, if stated.
    pub music_from_s: Option<f64>,
    /// Labels of parts of the clip.
    pub timed: Vec<TimedLabels>,
}

impl ClipInfo {
    /// Sets one value; an empty one says nothing. The error is what was expected.
    pub(super) fn set(&mut self, field: &str, value: &str) -> std::result::Result<(), &'static str> {
        fn number<T: FromStr>(
            value: &str,
            is_valid: impl Fn(&T) -> bool,
            expected: &'static str,
        ) -> std::result::Result<Option<T>, &'static str> {
            value.parse().ok().filter(is_valid).map(Some).ok_or(expected)
        }
        if value.is_empty() {
            return Ok(());
        }
        let is_rate = |f: &f64| f.is_finite() && *f > 0.0;
        let is_time = |s: &f64| s.is_finite() && *s >= 0.0;
        match field {
            // the table reads these itself
            "clip" | FROM | TO => {}
            "split" => self.split = number(value, |_| true, "train, valid or test")?,
            "take" => self.take = Some(value.to_owned()),
            "fps" => self.fps = number(value, is_rate, "a positive number of frames per second")?,
            "floor" => self.floor = number(value, |m: &f64| m.is_finite(), "a height in metres")?,
            "music_from" => self.music_from_s = number(value, is_time, "seconds, 0 or more")?,
            "skip" => self.skip = number(value, |_| true, "a whole number of frames")?,
            _ => {
                self.labels.insert(field.to_owned(), value.to_owned());
            }
        }
        Ok(())
    }

    /// The information that a pattern's fields give about the file at `path`.
    pub(super) fn from_fields(fields: BTreeMap<String, String>, path: &str) -> Result<ClipInfo> {
        let mut info = ClipInfo::default();
        for (field, value) in fields {
            let wrong = |expected| {
                let found = format!("`{value}` by the pattern");
                Error::in_clip(path)(Error::invalid(format!("the {field}"), found, expected))
            };
            if [FROM, TO].contains(&field.as_str()) {
                return Err(wrong("a column of a CSV"));
            }
            if !NO_LABEL.contains(&field.as_str()) {
                info.set(&field, &value).map_err(wrong)?;
            }
        }
        Ok(info)
    }
}
