//! TensorBoard event files: scalars, and the run's configuration as text.
//!
//! A record is its length (8 bytes), a masked CRC-32C of those, the data, a masked CRC-32C of the data; the data are an
//! `Event` message. Source: tensorflow's record_writer.cc, event.proto and summary.proto; tensorboard's text plugin.

use crate::{Error, Result};
use std::fs::File;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::time::{SystemTime, UNIX_EPOCH};

/// An event file being written.
pub struct EventFile {
    path: PathBuf,
    file: File,
}

impl EventFile {
    /// Begins a new event file in `folder` for a run after `step` updates, with its configuration. Readers discard later steps
    /// of earlier files.
    ///
    /// # Errors
    /// I/O errors.
    pub fn create(folder: &Path, step: u64, config: &str) -> Result<EventFile> {
        let time = now();
        let (mut path, mut file) = (PathBuf::new(), Err(std::io::ErrorKind::AlreadyExists.into()));
        // two files of the same second
        for n in 0..100 {
            path = folder.join(format!("events.out.tfevents.{:010}.kinelm.{n}", time as u64));
            file = File::create_new(&path);
            if file.is_ok() {
                break;
            }
        }
        let file = file.map_err(Error::io(&path))?;
        let mut events = EventFile { path, file };
        let mut event = double(1, time);
        event.extend(bytes(3, b"brain.Event:2"));
        events.record(&event)?;
        // a session start: TensorBoard drops what earlier files hold from this step on
        events.record(&begun(time, step + 1))?;
        events.record(&text(time, step, "config", config))?;
        Ok(events)
    }

    /// Adds the values of `step`.
    ///
    /// # Errors
    /// I/O errors.
    pub fn scalars(&mut self, step: u64, values: &[(&str, f64)]) -> Result<()> {
        let event = event(now(), step, values);
        self.record(&event)
    }

    fn record(&mut self, data: &[u8]) -> Result<()> {
        self.file.write_all(&framed(data)).map_err(Error::io(&self.path))
    }
}

fn now() -> f64 {
    SystemTime::now().duration_since(UNIX_EPOCH).map_or(0.0, |d| d.as_secs_f64())
}

/// An event that begins a session at `step`.
fn begun(time: f64, step: u64) -> Vec<u8> {
    let start = number(1, 1);
    [double(1, time), number(2, step), bytes(7, &start)].concat()
}

/// An event of one text, as Markdown code.
fn text(time: f64, step: u64, tag: &str, text: &str) -> Vec<u8> {
    let code: String = text.lines().flat_map(|line| ["    ", line, "\n"]).collect();
    // a tensor without dimensions of one string
    let tensor = [number(1, 7), bytes(2, b""), bytes(8, code.as_bytes())].concat();
    let metadata = [bytes(1, &bytes(1, b"text")), number(4, 2)].concat();
    let value = [bytes(1, tag.as_bytes()), bytes(8, &tensor), bytes(9, &metadata)].concat();
    [double(1, time), number(2, step), bytes(5, &bytes(1, &value))].concat()
}

fn event(time: f64, step: u64, values: &[(&str, f64)]) -> Vec<u8> {
    let mut summary = Vec::new();
    for (tag, value) in values {
        let mut one = bytes(1, tag.as_bytes());
        // field 2, simple_value, of wire type 5: four bytes
        one.push(2 << 3 | 5);
        one.extend((*value as f32).to_le_bytes());
        summary.extend(bytes(1, &one));
    }
    let mut event = double(1, time);
    event.extend(number(2, step));
    event.extend(bytes(5, &summary));
    event
}

fn framed(data: &[u8]) -> Vec<u8> {
    // TFRecord masks its sums, so that the sum of data that hold sums isn't constant
    let masked = |data: &[u8]| crc32c::crc32c(data).rotate_right(15).wrapping_add(0xa282_ead8).to_le_bytes();
    let length = (data.len() as u64).to_le_bytes();
    [&length[..], &masked(&length), data, &masked(data)].concat()
}

/// Field `number` of type double.
fn double(number: u8, value: f64) -> Vec<u8> {
    let mut out = vec![number << 3 | 1];
    out.extend(value.to_le_bytes());
    out
}

/// Field `field` of an integer type.
fn number(field: u8, value: u64) -> Vec<u8> {
    let mut out = vec![field << 3];
    out.extend(varint(value));
    out
}

/// Field `number` of type bytes, string or message.
fn bytes(number: u8, value: &[u8]) -> Vec<u8> {
    let mut out = vec![number << 3 | 2];
    out.extend(varint(value.len() as u64));
    out.extend(value);
    out
}

fn varint(mut value: u64) -> Vec<u8> {
    let mut out = Vec::new();
    while value >= 0x80 {
        out.push(value as u8 | 0x80);
        value >>= 7;
    }
    out.push(value as u8);
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn events_are_framed_as_tensorflow_frames_them() {
        // scripts/reference/tensorboard_event.py: tensorboard's own Event message and record writer
        let golden = include_str!("../tests/golden/tensorboard_event.json");
        let golden: serde_json::Value = serde_json::from_str(golden).unwrap();
        let scalars = event(2.5, 300, &[("loss", 1.25), ("rate", -3.0)]);
        let text = text(2.5, 300, "config", "a = 1\n[b]\n");
        for (name, event) in [("record", scalars), ("start", begun(2.5, 300)), ("text", text)] {
            let hex: String = framed(&event).iter().map(|b| format!("{b:02x}")).collect();
            assert_eq!(hex, golden[name].as_str().unwrap(), "{name}");
        }
    }

    #[test]
    fn two_runs_in_one_second_have_two_files() {
        let dir = tempfile::tempdir().unwrap();
        for _ in 0..2 {
            EventFile::create(dir.path(), 0, "").unwrap().scalars(1, &[("loss", 2.0)]).unwrap();
        }
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 2);
    }
}
