//! The readings of clips in the timeline's text: they hold for the library too, so that a card, the stage and the
//! generated dance show one clip.

use super::doubts::{Outcome, is_music};
use super::{Library, maps};
use crate::project::CACHE;
use crate::project::document::{Change, ClipRecord, Reading};
use crate::{Error, Result};
use kinelm_motion::format::{Unit, Up};
use kinelm_motion::rig::SkeletonMap;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use toml_edit::{DocumentMut, Item, TableLike, Value};

/// Files, each with its stated reading.
type Stated = Arc<Vec<(PathBuf, Reading)>>;

/// The last text, and its readings.
#[derive(Debug, Default)]
pub(super) struct Texts(Mutex<Option<(String, Stated)>>);

impl Texts {
    fn stated(&self, folder: &Path, text: Option<&str>) -> Stated {
        let Some(text) = text else { return Stated::default() };
        let mut last = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        // every card needs it on every view: parsing once a text is enough
        if let Some((_, stated)) = last.as_ref().filter(|(other, _)| other == text) {
            return stated.clone();
        }
        let stated = Arc::new(stated(folder, text));
        *last = Some((text.into(), stated.clone()));
        stated
    }
}

impl Library {
    /// The reading of a clip: its card's, and over that the timeline's.
    pub fn reading(&self, record: &ClipRecord) -> Reading {
        let stated =
            self.project.read(|document| self.texts.stated(self.project.folder(), document.timeline.as_deref()));
        self.over(record, &stated)
    }

    fn over(&self, record: &ClipRecord, stated: &[(PathBuf, Reading)]) -> Reading {
        let own = record.reading.clone();
        if stated.is_empty() {
            return own;
        }
        let of = |file: &Path| {
            let file = file.canonicalize().ok()?;
            stated.iter().find(|(other, _)| *other == file).map(|(_, reading)| reading.clone())
        };
        if let Some(stated) = of(&self.project.path(&record.file)) {
            return own.with(stated);
        }
        // a BVH that was made of it has all else in its numbers
        match of(&self.converted(&record.id)) {
            Some(Reading { map, floor, .. }) => own.with(Reading { map, floor, ..Reading::default() }),
            None => own,
        }
    }

    /// The clips whose readings differ between two texts of the timeline.
    pub fn read_otherwise(&self, before: Option<&str>, after: Option<&str>) -> Vec<ClipRecord> {
        let of = |text: Option<&str>| text.map(|text| stated(self.project.folder(), text)).unwrap_or_default();
        let (before, after) = (of(before), of(after));
        if before == after {
            return Vec::new();
        }
        let clips = self.project.read(|document| document.clips.clone());
        clips.into_iter().filter(|clip| self.over(clip, &before) != self.over(clip, &after)).collect()
    }

    /// A reading with the text of its map in place of the map's name.
    ///
    /// # Errors
    /// Those of [`maps::resolved`].
    pub fn resolved(&self, reading: Reading) -> Result<Reading> {
        let map = reading.map.as_deref().map(|map| maps::resolved(self.project.folder(), map)).transpose()?;
        Ok(Reading { map, ..reading })
    }

    /// The outcome of reading a file that is no clip of the library, without a trace. One at a time.
    ///
    /// # Errors
    /// I/O errors.
    pub fn looked_at(&self, file: &Path) -> Result<Outcome> {
        self.read_aside("looked-at", file, &Reading::default())
    }

    /// The outcome of a clip with another reading, without a trace. The caller makes sure that only one runs at a time.
    ///
    /// # Errors
    /// I/O errors.
    pub fn tried(&self, record: &ClipRecord, reading: &Reading) -> Result<Outcome> {
        let name = format!("{}-tried", record.id);
        self.read_aside(&name, &self.project.path(&record.file), &self.resolved(reading.clone())?)
    }

    /// Reads a file into places of this name, which are removed.
    fn read_aside(&self, name: &str, file: &Path, reading: &Reading) -> Result<Outcome> {
        let place = |extension: &str| self.project.folder().join(CACHE).join(format!("{name}.{extension}"));
        let convert = place("bvh");
        let found = self.reader.read(file, reading, &convert, &place("read"), &self.stop);
        let _ = std::fs::remove_file(&convert); // it may not be there
        found
    }

    /// The change after which a clip is read so.
    ///
    /// # Errors
    /// An unknown clip, music; those of [`Library::check_reading`].
    pub fn restated(&self, id: &str, reading: Reading) -> Result<Vec<Change>> {
        self.check_reading(&reading)?;
        let before = self.project.clip(id)?;
        if is_music(&before.file) {
            return Err(Error::invalid_parameter("clip", &before.name, "a clip with a body; this is music"));
        }
        let after = ClipRecord { reading, ..before.clone() };
        Ok(vec![Change::Clip { before: Some(Box::new(before)), after: Some(Box::new(after)) }])
    }

    /// Refuses a reading that fits no clip.
    ///
    /// # Errors
    /// A map that is neither built in nor the project's; numbers that are none.
    pub fn check_reading(&self, reading: &Reading) -> Result<()> {
        if let Some(map) = reading.map.as_deref().filter(|map| !maps::is_known(self.project.folder(), map)) {
            return Err(maps::unknown(map));
        }
        if let Some(floor) = reading.floor.filter(|floor| !floor.is_finite() || floor.abs() > HIGHEST_M) {
            return Err(Error::invalid_parameter(
                "floor",
                floor,
                format!("a height of -{HIGHEST_M} to {HIGHEST_M} metres"),
            ));
        }
        if let Some(fps) = reading.fps_source.filter(|fps| !(fps.is_finite() && *fps > 0.0)) {
            return Err(Error::invalid_parameter("fps_source", fps, "frames per second, more than 0"));
        }
        Ok(())
    }
}

/// The highest floor, and the lowest, metres.
const HIGHEST_M: f64 = 1000.0;

/// The reading of the BVH that a clip was converted to: map and floor, and the axes and unit that a BVH can't state.
/// All else is in its numbers.
pub fn of_converted(reading: Reading) -> Reading {
    let Reading { map, floor, .. } = reading;
    Reading { up: Some(Up::Y), unit: Some(Unit::CENTIMETRE), map, floor, ..Reading::default() }
}

/// The readings of files in a text. Faults of the text are reported by the timeline, and state nothing here.
fn stated(folder: &Path, text: &str) -> Vec<(PathBuf, Reading)> {
    let Ok(document) = text.parse::<DocumentMut>() else { return Vec::new() };
    let clips = document.get("clips").and_then(Item::as_table_like);
    let of = |item: &Item| {
        let table = item.as_table_like()?;
        let file = folder.join(table.get("file")?.as_str()?).canonicalize().ok()?;
        let reading = reading(table);
        // a text may name any path as a map: none but known ones is opened
        let map = reading.map.filter(|map| SkeletonMap::builtin(map).is_some() || maps::is_known(folder, map));
        Some((file, Reading { map, ..reading }))
    };
    clips.into_iter().flat_map(|clips| clips.iter()).filter_map(|(_, item)| of(item)).collect()
}

/// The keys of a clip that say how it is read, those that are as they should be.
fn reading(table: &dyn TableLike) -> Reading {
    let json = |item: &Item| match item.as_value()? {
        Value::String(text) => Some(text.value().as_str().into()),
        Value::Integer(number) => Some(serde_json::Value::from(*number.value())),
        Value::Float(number) => Some(serde_json::Value::from(*number.value())),
        _ => None,
    };
    let one = |key: &str| {
        let value = json(table.get(key)?)?;
        // one key at a time: one wrong value doesn't cost the others
        serde_json::from_value::<Reading>(serde_json::json!({ key: value })).ok()
    };
    Reading::KEYS.iter().filter_map(|key| one(key)).fold(Reading::default(), Reading::with)
}
