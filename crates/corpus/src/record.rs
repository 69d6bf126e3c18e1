//! The manifest of a corpus folder, `corpus.json`, and the lines of its `clips.jsonl`.

use crate::{Error, Result};
use kinelm_motion::format::ReadOptions;
use kinelm_store::FileRecord;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;

/// The version of the folder's format.
pub const VERSION: u32 = 5;

/// What a clip is used for.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Split {
    /// Fitting tables and weights.
    Train,
    /// Choosing between models and settings.
    Valid,
    /// The final figures.
    Test,
}

impl Split {
    /// All three, in order.
    pub const ALL: [Split; 3] = [Split::Train, Split::Valid, Split::Test];
}

impl fmt::Display for Split {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Split::Train => "train",
            Split::Valid => "valid",
            Split::Test => "test",
        })
    }
}

impl FromStr for Split {
    type Err = Error;

    fn from_str(text: &str) -> Result<Self> {
        Split::ALL
            .into_iter()
            .find(|s| s.to_string() == text)
            .ok_or_else(|| Error::invalid("the split", format!("`{text}`"), "train, valid or test"))
    }
}

/// The file of the features of the clips' music.
pub const MUSIC: &str = "music.f32";

/// The width of a number in the token file.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum TokenType {
    /// Two bytes: vocabularies up to 65,536.
    U16,
    /// Four bytes.
    U32,
}

impl TokenType {
    /// The narrowest type for ids below `vocabulary`.
    pub(crate) fn of_vocabulary(vocabulary: usize) -> Self {
        // ids are below the vocabulary's size, so 65,536 ids still fit
        if vocabulary <= 1 << 16 { TokenType::U16 } else { TokenType::U32 }
    }

    /// Bytes of a token.
    pub fn width(self) -> usize {
        match self {
            TokenType::U16 => 2,
            TokenType::U32 => 4,
        }
    }

    /// Encodes ids, which fit the type.
    pub fn to_bytes(self, ids: &[u32]) -> Vec<u8> {
        match self {
            TokenType::U16 => ids.iter().flat_map(|&id| (id as u16).to_le_bytes()).collect(),
            TokenType::U32 => ids.iter().flat_map(|&id| id.to_le_bytes()).collect(),
        }
    }

    /// Decodes bytes of the file.
    pub(crate) fn ids_of(self, bytes: &[u8]) -> impl ExactSizeIterator<Item = u32> + '_ {
        bytes.chunks_exact(self.width()).map(|b| match *b {
            [a, b] => u16::from_le_bytes([a, b]).into(),
            [a, b, c, d] => u32::from_le_bytes([a, b, c, d]),
            _ => unreachable!("chunks are two or four bytes"),
        })
    }

    /// The token file's name.
    pub fn file_name(self) -> &'static str {
        match self {
            TokenType::U16 => "tokens.u16",
            TokenType::U32 => "tokens.u32",
        }
    }
}

/// A part of a corpus, made on one of several machines.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shard {
    /// Its number, from 0.
    pub index: usize,
    /// The number of shards.
    pub of: usize,
}

impl Shard {
    /// The shard of this number among `of`.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Invalid`] for a number that isn't among them.
    pub fn new(index: usize, of: usize) -> Result<Shard> {
        let shard = Shard { index, of };
        if index < of { Ok(shard) } else { Err(no_shard(&shard.to_string())) }
    }

    /// Whether the item with this key belongs to the shard. Keys are dealt in turn, so that shards are of similar size.
    pub(crate) fn holds(&self, key: usize) -> bool {
        key % self.of == self.index
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index, self.of)
    }
}

impl FromStr for Shard {
    type Err = Error;

    /// `I/N`, I from 0 to N - 1.
    fn from_str(text: &str) -> Result<Self> {
        let parsed = text.split_once('/').and_then(|(i, n)| Some((i.parse().ok()?, n.parse().ok()?)));
        match parsed {
            Some((index, of)) => Shard::new(index, of),
            None => Err(no_shard(text)),
        }
    }
}

fn no_shard(text: &str) -> Error {
    Error::invalid("the shard", format!("`{text}`"), "I/N with I from 0 to N - 1, such as 0/4")
}

/// Clips and frames.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Count {
    /// Clips.
    pub clips: usize,
    /// Frames at the tokenizer's rate.
    pub frames: usize,
}

impl Count {
    /// Counts one more clip.
    pub(crate) fn add(&mut self, frames: usize) {
        self.clips += 1;
        self.frames += frames;
    }
}

/// A file or folder that the corpus was made from.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SourceRecord {
    /// As the user named it.
    pub path: String,
    /// The number of its clips.
    pub clips: usize,
    /// SHA-256 of the names and hashes of those clips' files, in the order of the corpus.
    pub sha256: String,
}

/// A file that was skipped.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Failure {
    /// Its number among all files found.
    pub key: usize,
    /// The clip's name.
    pub name: String,
    /// The error.
    pub why: String,
}

/// A range of a clip that the corpus does without.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ExcludedRange {
    /// The clip's name.
    pub clip: String,
    /// The first second of the range, in the clip as it is read.
    pub from_s: f64,
    /// The second after the last; `null` for the clip's end.
    pub to_s: Option<f64>,
    /// The reason.
    pub why: String,
}

/// `corpus.json`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Manifest {
    /// [`VERSION`].
    pub version: u32,
    /// The tokenizer's hash.
    pub tokenizer: String,
    /// L: frames per word; a clip's last word may have fewer.
    pub frames_per_word: usize,
    /// W: tokens per word with its space; `null` if words differ in length.
    pub tokens_per_word: Option<usize>,
    /// Ids are below this.
    pub vocabulary: usize,
    /// Frames per second.
    pub fps: f64,
    /// The width of a token, little-endian.
    pub token_type: TokenType,
    /// The token file.
    pub tokens: FileRecord,
    /// `clips.jsonl`.
    pub clips: FileRecord,
    /// `music.f32`, (N, 35) little-endian, if clips have music.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub music: Option<FileRecord>,
    /// All clips.
    pub count: Count,
    /// Clips by split.
    pub splits: BTreeMap<Split, Count>,
    /// The files and folders that it was made from, in the order given.
    pub sources: Vec<SourceRecord>,
    /// Files that were skipped.
    pub failed: Vec<Failure>,
    /// Ranges that clips were taken without.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub excluded: Vec<ExcludedRange>,
    /// Which shard this is, if it is not the whole corpus.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shard: Option<Shard>,
}

impl Manifest {
    /// Tokens of all clips.
    pub fn token_count(&self) -> u64 {
        self.tokens.bytes / self.token_type.width() as u64
    }

    /// The number of words of a clip of `frames`.
    pub(crate) fn words_of(&self, frames: usize) -> usize {
        frames.div_ceil(self.frames_per_word.max(1))
    }
}

/// A line of `clips.jsonl`.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClipRecord {
    /// Path below its source without extension, with `/`; unique in the corpus.
    pub name: String,
    /// Index of its first token in the token file.
    pub offset: usize,
    /// Its tokens with the spaces.
    pub tokens: usize,
    /// F; the clip has ceil(F / L) words.
    pub frames: usize,
    /// Values by field.
    pub labels: BTreeMap<String, String>,
    /// The split.
    pub split: Split,
    /// The recording it belongs to; no recording is in two splits.
    pub take: String,
    /// Its number among all files found; shards are merged by it.
    pub key: usize,
    /// Index into the manifest's sources.
    pub source: usize,
    /// SHA-256 of the file it was read from.
    pub sha256: String,
    /// Components of translation steps that were clipped to the tokenizer's range.
    #[serde(default)]
    pub clipped: usize,
    /// Rotations that took the second code (near a half turn).
    #[serde(default)]
    pub second_codes: usize,
    /// Height of the file's floor in metres, if it was subtracted before encoding.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub floor_m: Option<f64>,
    /// How the file was read.
    pub read: ReadOptions,
    /// Its beats, if requested and found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub beats: Option<ClipBeats>,
    /// The features of its music, if it has some.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub music: Option<MusicRows>,
}

impl ClipRecord {
    /// Its beats in seconds from its first frame, ascending; empty if it has none.
    pub fn beats_s(&self) -> &[f64] {
        self.beats.as_ref().map_or(&[], |beats| &beats.times_s)
    }
}

/// The beats of a clip.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ClipBeats {
    /// Where they come from.
    pub source: BeatSource,
    /// Seconds from its first frame, ascending; some may be before it or after its last.
    pub times_s: Vec<f64>,
}

/// A clip's rows of `music.f32`, each the 35 features of [`kinelm_music::feature`]: one for each frame and for one more
/// second, as far as the music goes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MusicRows {
    /// The row of the first frame.
    pub first: usize,
    /// The number of rows.
    pub rows: usize,
}

/// Where beats come from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum BeatSource {
    /// The music of the clip.
    Music,
    /// The clip's own steps (`crate::music::motion_beats`).
    Motion,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn splits_and_shards_are_read_strictly() {
        assert_eq!("valid".parse::<Split>().unwrap(), Split::Valid);
        assert!("Valid".parse::<Split>().unwrap_err().to_string().contains("train, valid or test"));
        assert_eq!("1/4".parse::<Shard>().unwrap(), Shard { index: 1, of: 4 });
        for bad in ["4/4", "1", "a/2", "0/0", "-1/2", ""] {
            assert!(bad.parse::<Shard>().is_err(), "{bad}");
        }
        let s = Shard { index: 1, of: 3 };
        assert_eq!((0..7).filter(|&k| s.holds(k)).collect::<Vec<_>>(), [1, 4]);
    }

    #[test]
    fn the_width_follows_the_vocabulary() {
        assert_eq!(TokenType::of_vocabulary(65_536), TokenType::U16);
        assert_eq!(TokenType::of_vocabulary(65_537), TokenType::U32);
        for (kind, ids) in [(TokenType::U16, [0, 258, 65_535]), (TokenType::U32, [0, 258, 70_000])] {
            let bytes = kind.to_bytes(&ids);
            assert_eq!(bytes.len(), 3 * kind.width());
            assert_eq!((bytes[kind.width()], bytes[kind.width() + 1]), (2, 1), "little-endian");
            assert!(kind.ids_of(&bytes).eq(ids));
        }
    }
}
