//! Music on a page: embedded if it is small, else a file beside the page.

use super::data::base64;
use serde_json::json;
use std::path::Path;

/// Bytes up to which a file is embedded.
pub const EMBEDDED: u64 = 8 << 20;

/// The media type of a sound file, by its name.
pub fn media_type(path: &Path) -> &'static str {
    match extension(path).as_str() {
        "mp3" => "audio/mpeg",
        "ogg" | "oga" => "audio/ogg",
        "flac" => "audio/flac",
        "m4a" | "mp4" => "audio/mp4",
        "aac" => "audio/aac",
        _ => "audio/wav",
    }
}

/// The music of a page.
#[derive(Debug, Clone, PartialEq)]
pub struct Music {
    /// A file name beside the page, or a `data:` address with the sound.
    src: String,
    /// Label of its switch.
    name: String,
    /// The music's time when the dance begins, seconds; below 0 it begins later than the dance.
    pub from_s: f64,
    /// Its beats, seconds of the music; may be empty.
    pub beats_s: Vec<f64>,
}

impl Music {
    /// A file embedded in the page.
    pub fn embedded(path: &Path, bytes: &[u8], from_s: f64, beats_s: Vec<f64>) -> Music {
        let kind = media_type(path);
        Music { src: format!("data:{kind};base64,{}", base64(bytes)), name: name(path), from_s, beats_s }
    }

    /// A file beside the page.
    pub fn beside(path: &Path, from_s: f64, beats_s: Vec<f64>) -> Music {
        let coded = |b: u8| match b {
            // the unreserved characters of RFC 3986 but `~`: a `#` or `%` in a name would end or change the address
            b'a'..=b'z' | b'A'..=b'Z' | b'0'..=b'9' | b'-' | b'_' | b'.' => char::from(b).to_string(),
            _ => format!("%{b:02X}"),
        };
        let src = name(path).bytes().map(coded).collect();
        Music { src, name: name(path), from_s, beats_s }
    }

    /// The JSON for the page's script.
    pub(super) fn json(&self) -> String {
        // 0.1 ms, far below a frame, saves half of the text
        let beats: Vec<f64> = self.beats_s.iter().map(|b| (b * 1e4).round() / 1e4).collect();
        json!({ "src": self.src, "name": self.name, "from": self.from_s, "beats": beats }).to_string()
    }
}

fn name(path: &Path) -> String {
    path.file_name().map(|n| n.to_string_lossy().into_owned()).unwrap_or_default()
}

fn extension(path: &Path) -> String {
    path.extension().map(|e| e.to_string_lossy().to_lowercase()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_name_is_an_address_and_a_sound_too() {
        let m = Music::beside(Path::new("a/my song#1.mp3"), 1.5, vec![0.123456]);
        let json: serde_json::Value = serde_json::from_str(&m.json()).unwrap();
        assert_eq!(json["src"], "my%20song%231.mp3");
        assert_eq!((json["from"].as_f64(), json["beats"][0].as_f64()), (Some(1.5), Some(0.1235)));
        let m = Music::embedded(Path::new("x.OGG"), b"abc", 0.0, vec![]);
        assert!(m.json().contains("data:audio/ogg;base64,YWJj"));
    }
}
