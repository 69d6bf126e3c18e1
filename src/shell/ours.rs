//! Recognises the program's own files and folders, which a call may write over.

use crate::corpus::artifacts;
use crate::corpus::music::beats;
use crate::view::{self, plot};
use kinelm_store::output::{Ours, extension};
use kinelm_store::{Result, input, sidecar};
use std::io::Read;
use std::path::Path;

/// The tests by which this program recognises its own files.
pub const OURS: Ours = Ours { is_marked, is_file, owner: artifacts::owner };

/// Bytes from a file's beginning within which pages, pictures and tables have our mark.
const MARK_WITHIN: u64 = 4096;

/// The first key of tables as JSON.
const JSON_MARKS: [&str; 2] = ["{\n  \"made_by\": \"kinelm\"", "{\"made_by\":\"kinelm\""];

/// Whether files of this name carry our mark inside.
fn is_marked(path: &Path) -> bool {
    ["html", "png", "svg", "md", "txt"].contains(&extension(path).as_str())
}

/// Whether this program made the file, beyond doubt.
fn is_file(path: &Path) -> Result<bool> {
    let mut head = Vec::new();
    // a file that can't be read isn't ours
    let _ = input::peek(path).and_then(|file| file.take(MARK_WITHIN).read_to_end(&mut head));
    let has = |mark: &[u8]| head.windows(mark.len()).any(|w| w == mark);
    match extension(path).as_str() {
        "html" => Ok(has(view::MARK.as_bytes())),
        "png" => Ok(has(&plot::PNG_MARK)),
        // other JSON of ours has a sidecar or is one, as the last line checks
        "json" if JSON_MARKS.iter().any(|mark| head.starts_with(mark.as_bytes())) => Ok(true),
        "svg" | "md" => Ok(has(plot::TEXT_MARK.as_bytes())),
        // beats that somebody has corrected aren't ours any more
        "txt" if !head.starts_with(beats::MARK.as_bytes()) => Ok(false),
        "txt" => Ok(input::peek_bytes(path).is_ok_and(|text| beats::is_as_written(&String::from_utf8_lossy(&text)))),
        _ => Ok(sidecar::is_beside_its_file(path) || sidecar::has_hash_of(path)?),
    }
}
