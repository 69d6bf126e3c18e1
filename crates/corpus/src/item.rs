//! A motion file of a dataset, or a part of one, and what is known of it.

use super::archive::Member;
use super::record::Split;
use super::sidecar;
use crate::{Error, Result};
use kinelm_motion::format::{Format, ReadOptions};
use kinelm_store::input;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// A motion file, or a segment of one, and what is known of it.
#[derive(Debug, Clone, PartialEq)]
pub struct Item {
    /// The file; of one inside an archive its path there, below the archive's.
    pub path: PathBuf,
    /// Where it lies in an archive, if it does.
    pub member: Option<Member>,
    /// The path below its source without extension, `/` between parts; unique in the dataset.
    pub name: String,
    /// Values by field.
    pub labels: BTreeMap<String, String>,
    /// Labels of parts of the clip; `super::segments::split_items` splits by them.
    pub timed: Vec<TimedLabels>,
    /// Ranges that a corpus does without.
    pub excluded: Vec<TimeRange>,
    /// The part of the file that the item is; `None` for all of it.
    pub segment: Option<Segment>,
    /// The recording; the name if nothing else is known.
    pub take: String,
    /// The split.
    pub split: Split,
    /// The true source rate, if labels state it.
    pub fps: Option<f64>,
    /// Source frames to skip at the start, if labels state it.
    pub skip: Option<usize>,
    /// The height of the floor in metres, if labels state it.
    pub floor: Option<f64>,
    /// How the file is read by its sidecar, if it is a dance that has one.
    pub sidecar: Option<ReadOptions>,
    /// The time of its music at which it begins, in seconds, if labels state it.
    pub music_from_s: Option<f64>,
    /// Its number among all items.
    pub key: usize,
    /// Index into `Dataset::sources`.
    pub source: usize,
}

impl Item {
    /// The clip's name, without the range of a segment.
    pub(crate) fn clip_name(&self) -> &str {
        // a clip's own name may have an `@` too, so the last one counts
        let of_segment = self.segment.and_then(|_| self.name.rsplit_once('@'));
        of_segment.map_or(&self.name, |(name, _)| name)
    }

    /// The path below the source, for messages.
    pub fn file_name(&self) -> String {
        let name = self.clip_name();
        match self.path.extension().map(|e| e.to_string_lossy()) {
            // a name that clashed with another has its extension already
            Some(extension) if !name.ends_with(&format!(".{extension}")) => format!("{name}.{extension}"),
            _ => name.to_owned(),
        }
    }

    /// The bytes of the file.
    ///
    /// # Errors
    /// A name of no known format, which is refused before it is read; [`kinelm_store::Error::Io`].
    pub fn bytes(&self) -> Result<Vec<u8>> {
        Format::of(&self.path)?;
        let bytes = self.member.as_ref().map_or_else(|| input::bytes(&self.path), Member::bytes);
        bytes.map_err(Error::io(&self.path))
    }

    /// The file on disk that is read.
    pub fn file(&self) -> &Path {
        self.member.as_ref().map_or(&self.path, |member| &member.archive)
    }

    /// How the file is read: as its labels state, else its sidecar, else `options`.
    pub fn read_options(&self, options: &ReadOptions) -> ReadOptions {
        let options = match &self.sidecar {
            Some(sidecar) => sidecar::combined(sidecar.clone(), options),
            None => options.clone(),
        };
        ReadOptions {
            fps_source: self.fps.or(options.fps_source),
            skip: self.skip.unwrap_or(options.skip),
            floor: self.floor.or(options.floor),
            ..options
        }
    }
}

impl Default for Item {
    fn default() -> Self {
        Item {
            path: PathBuf::new(),
            member: None,
            name: String::new(),
            labels: BTreeMap::new(),
            timed: Vec::new(),
            excluded: Vec::new(),
            segment: None,
            take: String::new(),
            split: Split::Train,
            fps: None,
            skip: None,
            floor: None,
            sidecar: None,
            music_from_s: None,
            key: 0,
            source: 0,
        }
    }
}

/// Labels of a part of a clip.
#[derive(Debug, Clone, PartialEq)]
pub struct TimedLabels {
    /// The first second, 0 or more.
    pub from_s: f64,
    /// The second after the last, more than `from_s`; infinite for the clip's end.
    pub to_s: f64,
    /// Values by field.
    pub labels: BTreeMap<String, String>,
    /// The line of the CSV that states them.
    pub line: usize,
}

impl TimedLabels {
    /// Whether both hold at some time.
    pub(super) fn overlaps(&self, other: &TimedLabels) -> bool {
        self.from_s < other.to_s && other.from_s < self.to_s
    }
}

/// A range of an item in seconds.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct TimeRange {
    /// The first second, 0 or more.
    pub from_s: f64,
    /// The second after the last; infinite for the clip's end.
    pub to_s: f64,
    /// The line of the CSV that states it.
    pub line: usize,
}

/// A part of a clip.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Segment {
    /// The first second.
    pub from_s: f64,
    /// The second after the last; infinite for the clip's end.
    pub to_s: f64,
    /// Whether a row has labels for it; then the clip must not end before it.
    pub labelled: bool,
    /// The line of the CSV that states its beginning or end.
    pub line: usize,
    /// Whether that CSV is the one of excluded ranges; else it is that of the labels.
    pub beside_excluded: bool,
}
