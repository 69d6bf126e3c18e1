//! A dance, coded and decoded: how all dances are measured.

use crate::{Error, Result};
use kinelm_corpus::load::ModelClip;
use kinelm_corpus::{ClipRecord, Corpus};
use kinelm_motion::Clip;
use kinelm_motion::format::{FileRate, Format, ReadOptions};
use kinelm_tokenizer::{SPACE, Tokenizer, UncodedPose, Words};
use std::path::Path;

/// A dance, coded and decoded.
#[derive(Debug, Clone)]
pub struct Dance {
    /// Its name.
    pub name: String,
    /// Decoded, on SMPL-24.
    pub clip: Clip,
    /// Its words.
    pub words: Words,
    /// What its file says of its rate.
    pub rate: FileRate,
    /// Frames a second of the file that it was coded from, if that was read.
    pub file_fps: Option<f64>,
    pub(super) ids: Vec<u32>,
}

impl Dance {
    /// A clip of a corpus.
    ///
    /// # Errors
    /// Words that are not the tokenizer's.
    pub fn of_corpus(corpus: &Corpus, record: &ClipRecord) -> Result<Dance> {
        let (words, tokenizer) = (corpus.clip_words(record)?, corpus.tokenizer());
        Dance::new(record.name.clone(), words, record.frames, tokenizer)
    }

    /// A motion file.
    ///
    /// # Errors
    /// What reading, retargeting and coding fail with; no frames.
    pub fn of_file(path: &Path, options: &ReadOptions, tokenizer: &Tokenizer) -> Result<Dance> {
        Format::of(path)?; // refused by its name before it is read
        let bytes = kinelm_store::input::bytes(path).map_err(Error::io(path))?;
        Dance::of_bytes(path, &bytes, options, tokenizer)
    }

    /// The same of a file's bytes.
    ///
    /// # Errors
    /// Those of [`Dance::of_file`].
    pub(crate) fn of_bytes(path: &Path, bytes: &[u8], options: &ReadOptions, tokenizer: &Tokenizer) -> Result<Dance> {
        let placed = ModelClip::parse(path, bytes, options, tokenizer.config().into())?;
        let (clip, file_fps) = (placed.lowered(), Some(placed.motion.clip.fps()));
        let rate = FileRate::of(&placed.motion, options);
        if clip.frames() == 0 {
            return Err(Error::file(path, "no frames", "at least one", ""));
        }
        let words = tokenizer.encode(&clip)?.words;
        Ok(Dance { file_fps, rate, ..Dance::new(path.display().to_string(), words, clip.frames(), tokenizer)? })
    }

    pub(super) fn new(name: String, words: Words, frames: usize, tokenizer: &Tokenizer) -> Result<Dance> {
        let clip = tokenizer.decode(&words, UncodedPose::Identity)?;
        // a last tile is padded with frames that the clip doesn't have
        let clip = clip.slice(0..frames.min(clip.frames()));
        let ids = tokenizer.ids_of_words(&words)?;
        Ok(Dance { name, clip, words, file_fps: None, rate: FileRate::default(), ids })
    }

    /// Its first frames, at most `frames`, in whole words.
    pub(super) fn first(mut self, frames: usize, frames_per_word: usize) -> Dance {
        let words = frames.div_ceil(frames_per_word).min(self.words.len());
        let ids = self.word_ids()[..words].iter().map(|word| word.len()).sum();
        self.ids.truncate(ids);
        self.clip = self.clip.slice(0..frames.min(self.clip.frames()));
        self
    }

    /// Ids of each word, with its space.
    pub(super) fn word_ids(&self) -> Vec<&[u32]> {
        self.ids.split_inclusive(|&id| id == SPACE).collect()
    }
}
