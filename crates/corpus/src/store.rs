//! The token store, read with its hashes checked.

use super::array_file::ArrayFile;
use super::record::{ClipRecord, MUSIC, Manifest, Split, VERSION};
use super::tokens::Tokens;
use super::words::{ClipWords, Index};
use crate::music::clip_music::{ClipMusic, FeatureRows};
use crate::{Error, Result};
use bytemuck::Pod;
use kinelm_motion::format::ReadOptions;
use kinelm_music::feature::CHANNELS;
use kinelm_store::{FileRecord, input};
use kinelm_tokenizer::{Slot, Tokenizer, Words};
use serde::Deserialize;
use std::ops::Range;
use std::path::{Path, PathBuf};

pub(super) const MANIFEST: &str = "corpus.json";
pub(super) const CLIPS: &str = "clips.jsonl";
pub(super) const TOKENIZER: &str = "tokenizer.json";

/// How a corpus is opened.
#[derive(Debug, Clone, Copy)]
pub struct CorpusOptions {
    /// Whether the files are trusted: tokens and music are not hashed, and ids that the tokenizer doesn't have are refused
    /// only where they are read.
    pub trust: bool,
    /// Whether tokens and music stay on disk even if they fit into memory, for callers that read clip by clip.
    pub streamed: bool,
    /// Called with the file that is being hashed, and when that is done.
    pub progress: fn(&str),
}

impl Default for CorpusOptions {
    fn default() -> Self {
        CorpusOptions { trust: false, streamed: false, progress: |_| () }
    }
}

/// A corpus folder, open for reading.
#[derive(Debug)]
pub struct Corpus {
    dir: PathBuf,
    manifest: Manifest,
    hash: String,
    clips: Vec<ClipRecord>,
    tokens: Tokens,
    words: Index,
    music: Option<ArrayFile<f32>>,
    tokenizer: Tokenizer,
}

impl Corpus {
    /// Opens a corpus folder: checks version, lengths and hashes, and reads the tokens if memory has room for them.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`]; [`kinelm_store::Error::File`] when a file is of another version, damaged, or doesn't fit the others; it says
    /// what was found, what was expected and how to go on.
    pub fn open(dir: impl AsRef<Path>) -> Result<Self> {
        Corpus::open_with(dir, CorpusOptions::default())
    }

    /// As [`Corpus::open`], with options.
    ///
    /// # Errors
    /// As [`Corpus::open`].
    pub fn open_with(dir: impl AsRef<Path>, options: CorpusOptions) -> Result<Self> {
        let dir = dir.as_ref().to_owned();
        let (manifest, hash) = read_manifest(&dir)?;
        let path = dir.join(CLIPS);
        let text = input::bytes(&path).map_err(Error::io(&path))?;
        manifest.clips.check(&path, &text)?;
        let clips = parse_clips(&path, &text)?;
        check_clips(&path, &manifest, &clips)?;
        let tokenizer = load_tokenizer(&dir, &manifest)?;
        let kind = manifest.token_type;
        let help = "the file was cut or changed after it was written: make the corpus again";
        let path = dir.join(kind.file_name());
        let bytes = open_array(&path, &manifest.tokens, help, options)?;
        let tokens = Tokens { bytes, kind, path: path.clone(), vocabulary: manifest.vocabulary };
        if !options.trust {
            tokens.check_all()?;
        }
        let words = Index::find(&path, &manifest, &clips, &tokens)?;
        let music = manifest.music.as_ref();
        let music = music.map(|record| open_array(&dir.join(MUSIC), record, help, options)).transpose()?;
        Ok(Corpus { dir, manifest, hash, clips, tokens, words, music, tokenizer })
    }

    /// The folder.
    pub fn dir(&self) -> &Path {
        &self.dir
    }

    /// `corpus.json`.
    pub fn manifest(&self) -> &Manifest {
        &self.manifest
    }

    /// SHA-256 of `corpus.json`, which holds those of the other files: it names the corpus.
    pub fn hash(&self) -> &str {
        &self.hash
    }

    /// The tokenizer that made the tokens.
    pub fn tokenizer(&self) -> &Tokenizer {
        &self.tokenizer
    }

    /// All clips, in the order of the token file.
    pub fn clips(&self) -> &[ClipRecord] {
        &self.clips
    }

    /// The clips of a split, in the order of the token file.
    pub fn split(&self, split: Split) -> impl Iterator<Item = &ClipRecord> {
        self.clips.iter().filter(move |c| c.split == split)
    }

    /// Tokens a frame of the clips of a split, on average, spaces among them; W where a word of W tokens is a frame.
    #[cfg(test)]
    pub fn tokens_per_frame(&self, split: Split) -> f64 {
        let sum = |of: &dyn Fn(&ClipRecord) -> usize| self.split(split).map(of).sum::<usize>() as f64;
        sum(&|c| c.tokens) / sum(&|c| c.frames).max(1.0)
    }

    /// The tokens of all clips.
    pub fn tokens(&self) -> &Tokens {
        &self.tokens
    }

    /// The music of a clip of this corpus.
    ///
    /// # Errors
    /// A file of music that was truncated while in use.
    pub fn music<'a>(&'a self, clip: &'a ClipRecord) -> Result<ClipMusic<'a>> {
        let mut rows = FeatureRows { fps: self.manifest.fps, ..FeatureRows::default() };
        if let (Some(music), Some(of)) = (&self.music, clip.music) {
            rows.numbers = music.read(of.first * CHANNELS..(of.first + of.rows) * CHANNELS)?;
        }
        Ok(ClipMusic { beats_s: clip.beats_s(), rows })
    }

    /// Where the words of a clip of this corpus stand.
    ///
    /// # Panics
    /// For a clip of another corpus.
    pub fn words(&self, clip: &ClipRecord) -> ClipWords<'_> {
        let words = self.manifest.words_of(clip.frames);
        // clips without tokens stand where the next one does, and have no words
        let number = self.clips.partition_point(|c| c.offset < clip.offset);
        self.words.of(number, words, clip)
    }

    /// Frames of some words of a clip: L a word, fewer where the clip ends inside the last one.
    pub fn frames_of(&self, clip: &ClipRecord, words: Range<usize>) -> usize {
        let frames = |words: usize| clip.frames.min(words.saturating_mul(self.manifest.frames_per_word));
        frames(words.end) - frames(words.start)
    }

    /// All ids of a clip of this corpus.
    ///
    /// # Errors
    /// A token file that was cut while it was in use.
    pub fn clip_ids(&self, clip: &ClipRecord) -> Result<Vec<u32>> {
        self.ids(clip, 0..clip.tokens)
    }

    /// Ids of some words of a clip of this corpus.
    ///
    /// # Errors
    /// As [`Corpus::clip_ids`].
    ///
    /// # Panics
    /// If the range leaves the clip.
    pub fn word_ids(&self, clip: &ClipRecord, words: Range<usize>) -> Result<Vec<u32>> {
        let all = self.words(clip);
        assert!(words.end <= all.len(), "words {words:?} of {}, which has {}", clip.name, all.len());
        self.ids(clip, all.start(words.start)..all.start(words.end))
    }

    /// Some ids of a clip of this corpus, tokens counted from the clip's first.
    ///
    /// # Errors
    /// As [`Corpus::clip_ids`].
    ///
    /// # Panics
    /// If the range leaves the clip.
    pub fn ids(&self, clip: &ClipRecord, tokens: Range<usize>) -> Result<Vec<u32>> {
        assert!(tokens.end <= clip.tokens, "tokens {tokens:?} of {}, which has {}", clip.name, clip.tokens);
        self.tokens.ids(clip.offset + tokens.start..clip.offset + tokens.end)
    }

    /// The characters of a clip of this corpus, word by word, without the spaces.
    ///
    /// # Errors
    /// [`kinelm_store::Error::File`] when an id stands where it may not; as [`Corpus::clip_ids`].
    pub fn clip_words(&self, clip: &ClipRecord) -> Result<Words> {
        self.some_words(clip, 0..self.words(clip).len())
    }

    /// As [`Corpus::clip_words`], of some of the clip's words.
    ///
    /// # Errors
    /// As [`Corpus::clip_words`].
    ///
    /// # Panics
    /// If the range leaves the clip.
    pub fn some_words(&self, clip: &ClipRecord, words: Range<usize>) -> Result<Words> {
        let first = self.words(clip).start(words.start);
        let ids = self.word_ids(clip, words)?;
        let grammar = self.tokenizer.grammar();
        let mut place = Slot::default();
        for (i, &id) in ids.iter().enumerate() {
            // the hash says that these ids were written, not that they form words
            if !grammar.allows(place, id) {
                let found = format!("id {id} at token {} of clip {}", first + i, clip.name);
                let expected =
                    format!("an id that may stand there, behind {} characters of its word", place.characters);
                return Err(Error::file(&self.dir, found, expected, "make the corpus again"));
            }
            place = grammar.advance(place, id);
        }
        Ok(self.tokenizer.words_of_ids(&ids).words)
    }
}

/// Reads `corpus.json`, its version first; the second value is its hash.
fn read_manifest(dir: &Path) -> Result<(Manifest, String)> {
    #[derive(Deserialize)]
    struct Versioned {
        version: u32,
    }
    let path = dir.join(MANIFEST);
    let text = input::bytes(&path).map_err(|e| match e.kind() {
        std::io::ErrorKind::NotFound if dir.is_dir() => {
            let help = "a corpus is a folder that `kinelm tokenize DATA --out CORPUS` wrote";
            Error::file(dir, "no corpus.json", "a corpus folder", help)
        }
        std::io::ErrorKind::NotFound => {
            let help = "give its folder by `corpus`, also to resume a run whose corpus was moved";
            Error::file(dir, "nothing", "a corpus folder", help)
        }
        _ => Error::io(&path)(e),
    })?;
    let bad = |e: serde_json::Error| {
        let at = kinelm_store::SourcePos { path: path.clone(), line: e.line(), column: e.column() };
        Error::at(at, e.to_string(), "the manifest of a corpus", "make the corpus again with `kinelm tokenize`")
    };
    // the version alone, because a manifest of another one may lack fields of this one
    let head: Versioned = serde_json::from_slice(&text).map_err(bad)?;
    if head.version != VERSION {
        let help = match head.version > VERSION {
            true => "use a newer kinelm",
            false => "make it again with `kinelm tokenize`",
        };
        return Err(Error::file(&path, format!("version {}", head.version), format!("version {VERSION}"), help));
    }
    let manifest = serde_json::from_slice(&text).map_err(bad)?;
    Ok((manifest, FileRecord::of(&text).sha256))
}

/// How the corpus at `dir` read the file with this hash; `None` where it doesn't have it.
///
/// # Errors
/// A corpus that is gone, of another version or damaged.
pub fn read_options_in(dir: &Path, sha256: &str) -> Result<Option<ReadOptions>> {
    let (manifest, _) = read_manifest(dir)?;
    let path = dir.join(CLIPS);
    let text = input::bytes(&path).map_err(Error::io(&path))?;
    manifest.clips.check(&path, &text)?;
    let clips = parse_clips(&path, &text)?;
    Ok(clips.into_iter().find(|clip| clip.sha256 == sha256).map(|clip| clip.read))
}

/// The folder's tokenizer, if it is the one that made the tokens.
fn load_tokenizer(dir: &Path, manifest: &Manifest) -> Result<Tokenizer> {
    let path = dir.join(TOKENIZER);
    let tokenizer = Tokenizer::load(&path)?;
    let (found, expected) = (Coding::of(&tokenizer), manifest.coding());
    if found != expected {
        let say = |s: &Coding| {
            let Coding { tokenizer, frames_per_word, tokens_per_word, vocabulary, fps } = s;
            let tokens = tokens_per_word.map_or("any number of".to_string(), |w| w.to_string());
            format!(
                "tokenizer {tokenizer} with {frames_per_word} frames and {tokens} tokens a word, {vocabulary} ids, {fps} fps"
            )
        };
        let help = "put back the tokenizer.json that the corpus was made with, or make the corpus again";
        return Err(Error::file(&path, say(&found), say(&expected), help));
    }
    Ok(tokenizer)
}

/// Opens a large file of a corpus and checks its hash, unless it is trusted.
fn open_array<T: Pod + Send + Sync>(
    path: &Path,
    record: &FileRecord,
    help: &'static str,
    options: CorpusOptions,
) -> Result<ArrayFile<T>> {
    let array = match options.streamed {
        true => ArrayFile::open_within(path, record.bytes, help, 0)?,
        false => ArrayFile::open(path, record.bytes, help)?,
    };
    if !options.trust {
        (options.progress)(&format!("hashing {}, {} MB", path.display(), record.bytes.div_ceil(1_000_000)));
        let checked = array.check(record);
        (options.progress)("at work");
        checked?;
    }
    Ok(array)
}

fn parse_clips(path: &Path, text: &[u8]) -> Result<Vec<ClipRecord>> {
    let lines = text.split(|&b| b == b'\n').enumerate().filter(|(_, l)| !l.is_empty());
    let parse = |(i, line): (usize, &[u8])| {
        serde_json::from_slice(line).map_err(|e| {
            let at = kinelm_store::SourcePos { path: path.to_owned(), line: i + 1, column: e.column() };
            Error::at(at, e.to_string(), "the record of a clip", "make the corpus again")
        })
    };
    lines.map(parse).collect()
}

/// Checks that the clips are contiguous in the token file and sum to the manifest's counts.
fn check_clips(path: &Path, manifest: &Manifest, clips: &[ClipRecord]) -> Result<()> {
    let mut next = 0_usize;
    let music = manifest.music.as_ref().map_or(0, |file| file.bytes / (CHANNELS * size_of::<f32>()) as u64);
    for clip in clips {
        let rows = clip.music.map_or(Some(0), |of| of.first.checked_add(of.rows));
        // checked once here, so that slices of the music stay inside the file
        if rows.is_none_or(|rows| rows as u64 > music) {
            let found = format!("clip {} with music up to row {}", clip.name, rows.unwrap_or(usize::MAX));
            return Err(Error::file(
                path,
                found,
                format!("at most {music}, those of {MUSIC}"),
                "make the corpus again",
            ));
        }
        if clip.offset != next {
            let found = format!("clip {} at token {}", clip.name, clip.offset);
            return Err(Error::file(path, found, format!("token {next}"), "make the corpus again"));
        }
        if clip.source >= manifest.sources.len() {
            let found = format!("clip {} of source {}", clip.name, clip.source);
            let expected = format!("one of the {} sources of corpus.json", manifest.sources.len());
            return Err(Error::file(path, found, expected, "make the corpus again"));
        }
        let words = manifest.words_of(clip.frames);
        let tokens = manifest.tokens_per_word.map_or(Some(clip.tokens), |w| words.checked_mul(w));
        // starts of words are stored as u32
        if tokens != Some(clip.tokens) || u32::try_from(clip.tokens).is_err() {
            let found = format!("clip {} of {} frames in {} tokens", clip.name, clip.frames, clip.tokens);
            let expected = match manifest.tokens_per_word {
                Some(w) => format!("{words} words of {w} tokens"),
                None => "at most 2^32 - 1 tokens".into(),
            };
            return Err(Error::file(path, found, expected, "make the corpus again"));
        }
        next = next
            .checked_add(clip.tokens)
            .ok_or_else(|| Error::file(path, format!("{} tokens", clip.tokens), "a number of tokens", ""))?;
    }
    let bytes = (next as u64).saturating_mul(manifest.token_type.width() as u64);
    if bytes != manifest.tokens.bytes {
        let found = format!("clips of {bytes} bytes of tokens");
        return Err(Error::file(path, found, format!("{} bytes", manifest.tokens.bytes), "make the corpus again"));
    }
    Ok(())
}

/// How the clips of a corpus were coded, which all its tokens share; all of it comes from the tokenizer.
#[derive(Debug, Clone, PartialEq)]
pub struct Coding {
    /// SHA-256 that the tokenizer states of itself.
    pub tokenizer: String,
    /// L: the frames that a word stands for.
    pub frames_per_word: usize,
    /// W: the tokens of a word with its space; `None` where words differ in length.
    pub tokens_per_word: Option<usize>,
    /// Ids are below this.
    pub vocabulary: usize,
    /// Frames per second.
    pub fps: f64,
}

impl Coding {
    /// What a tokenizer says.
    pub(crate) fn of(tokenizer: &Tokenizer) -> Self {
        Coding {
            tokenizer: tokenizer.hash(),
            frames_per_word: tokenizer.frames_per_word(),
            tokens_per_word: tokenizer.tokens_per_word(),
            vocabulary: tokenizer.vocabulary().len() as usize,
            fps: tokenizer.fps(),
        }
    }
}

impl Manifest {
    /// What all tokens share.
    pub(crate) fn coding(&self) -> Coding {
        Coding {
            tokenizer: self.tokenizer.clone(),
            frames_per_word: self.frames_per_word,
            tokens_per_word: self.tokens_per_word,
            vocabulary: self.vocabulary,
            fps: self.fps,
        }
    }
}

#[cfg(test)]
mod tests;
