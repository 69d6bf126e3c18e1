//! The token store, read with its hashes checked.

use super::record::{ClipRecord, FileRecord, Manifest, SOUND, Split, TokenType, VERSION};
use super::stored::Stored;
use super::words::{ClipWords, Index};
use crate::model::music::Sound;
use crate::model::music::features::Rows;
use crate::{Error, Result};
use bytemuck::Pod;
use kinelm_motion::format::{ReadOptions, input};
use kinelm_music::feature::CHANNELS;
use kinelm_tokenizer::{Place, Tokenizer, Words};
use serde::Deserialize;
use std::ops::Range;
use std::path::{Path, PathBuf};

pub(super) const MANIFEST: &str = "corpus.json";
pub(super) const CLIPS: &str = "clips.jsonl";
pub(super) const TOKENIZER: &str = "tokenizer.json";

/// How a corpus is opened.
#[derive(Debug, Clone, Copy)]
pub struct Opening {
    /// Neither are the files of tokens and music hashed nor are all ids looked through: they are as they were written. An
    /// id that the tokenizer hasn't is refused where it is read.
    pub trust: bool,
    /// The tokens stay in their file, whatever memory is free: for one that reads clip by clip.
    pub streamed: bool,
    /// Learns what is being hashed, and that it is done.
    pub tell: fn(&str),
}

impl Default for Opening {
    fn default() -> Self {
        Opening { trust: false, streamed: false, tell: |_| () }
    }
}

/// The tokens of all clips.
#[derive(Debug)]
pub struct Tokens {
    bytes: Stored<u8>,
    kind: TokenType,
    path: PathBuf,
    /// Ids are below this.
    vocabulary: usize,
}

impl Tokens {
    /// How many there are.
    pub fn len(&self) -> usize {
        self.bytes.len() / self.kind.width()
    }

    /// Whether there is none.
    pub fn is_empty(&self) -> bool {
        self.len() == 0
    }

    /// The ids of a range of places.
    ///
    /// # Errors
    /// A token file that was cut while it was in use; an id that the tokenizer hasn't.
    ///
    /// # Panics
    /// If the range leaves the file.
    pub fn ids(&self, places: Range<usize>) -> Result<Vec<u32>> {
        let width = self.kind.width();
        let bytes = self.bytes.read(places.start * width..places.end * width)?;
        self.check(&bytes)?;
        Ok(self.kind.ids_of(&bytes).collect())
    }

    /// Refuses ids that the tokenizer hasn't: a model has no row for them.
    fn check(&self, bytes: &[u8]) -> Result<()> {
        let largest = self.kind.ids_of(bytes).max();
        largest.filter(|id| *id as usize >= self.vocabulary).map_or(Ok(()), |id| {
            let expected = format!("ids below {}, those of its tokenizer.json", self.vocabulary);
            Err(Error::file(&self.path, format!("id {id}"), expected, "make the corpus again"))
        })
    }

    fn check_all(&self) -> Result<()> {
        self.bytes.blocks().try_for_each(|block| self.check(&self.bytes.read(block)?))
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
    sound: Option<Stored<f32>>,
    tokenizer: Tokenizer,
}

impl Corpus {
    /// Opens a corpus folder: checks version, lengths and hashes, and reads the tokens if memory has room for them.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::File`] when a file is of another version, damaged, or doesn't fit the others; it says
    /// what was found, what was wanted and how to go on.
    pub fn open(dir: impl AsRef<Path>) -> Result<Self> {
        Corpus::open_with(dir, Opening::default())
    }

    /// As [`Corpus::open`], with a choice of what is checked and held.
    ///
    /// # Errors
    /// As [`Corpus::open`].
    pub fn open_with(dir: impl AsRef<Path>, opening: Opening) -> Result<Self> {
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
        let bytes = stored(&path, &manifest.tokens, help, opening)?;
        let tokens = Tokens { bytes, kind, path: path.clone(), vocabulary: manifest.vocabulary };
        if !opening.trust {
            tokens.check_all()?;
        }
        let words = Index::find(&path, &manifest, &clips, &tokens)?;
        let sound = manifest.sound.as_ref();
        let sound = sound.map(|record| stored(&dir.join(SOUND), record, help, opening)).transpose()?;
        Ok(Corpus { dir, manifest, hash, clips, tokens, words, sound, tokenizer })
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
    pub fn tokens_per_frame(&self, split: Split) -> f64 {
        let sum = |of: &dyn Fn(&ClipRecord) -> usize| self.split(split).map(of).sum::<usize>() as f64;
        sum(&|c| c.tokens) / sum(&|c| c.frames).max(1.0)
    }

    /// The tokens of all clips.
    pub fn tokens(&self) -> &Tokens {
        &self.tokens
    }

    /// What is known of the music of a clip of this corpus.
    ///
    /// # Errors
    /// A file of music that was cut while it was in use.
    pub fn sound<'a>(&'a self, clip: &'a ClipRecord) -> Result<Sound<'a>> {
        let mut rows = Rows { fps: self.manifest.fps, ..Rows::default() };
        if let (Some(sound), Some(of)) = (&self.sound, clip.sound) {
            rows.numbers = sound.read(of.first * CHANNELS..(of.first + of.rows) * CHANNELS)?;
        }
        Ok(Sound { beats_s: clip.beats_s(), rows })
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
    /// [`Error::File`] when an id stands where it may not; as [`Corpus::clip_ids`].
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
        let mut place = Place::default();
        for (i, &id) in ids.iter().enumerate() {
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
            let help =
                "give its folder by --corpus; a run goes on with a corpus that was moved by --resume --corpus CORPUS";
            Error::file(dir, "nothing", "a corpus folder", help)
        }
        _ => Error::io(&path)(e),
    })?;
    let bad = |e: serde_json::Error| {
        let at = kinelm_motion::Place { path: path.clone(), line: e.line(), column: e.column() };
        Error::at(at, e.to_string(), "the manifest of a corpus", "make the corpus again with `kinelm tokenize`")
    };
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
pub fn reading_in(dir: &Path, sha256: &str) -> Result<Option<ReadOptions>> {
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
    let (found, wanted) = (Coding::of(&tokenizer), manifest.coding());
    if found != wanted {
        let say = |s: &Coding| {
            let Coding { tokenizer, frames_per_word, tokens_per_word, vocabulary, fps } = s;
            let tokens = tokens_per_word.map_or("any number of".to_string(), |w| w.to_string());
            format!(
                "tokenizer {tokenizer} with {frames_per_word} frames and {tokens} tokens a word, {vocabulary} ids, {fps} fps"
            )
        };
        let help = "put back the tokenizer.json that the corpus was made with, or make the corpus again";
        return Err(Error::file(&path, say(&found), say(&wanted), help));
    }
    Ok(tokenizer)
}

/// A large file of a corpus, its hash checked unless it is trusted.
fn stored<T: Pod + Send + Sync>(
    path: &Path,
    record: &FileRecord,
    help: &'static str,
    opening: Opening,
) -> Result<Stored<T>> {
    let stored = match opening.streamed {
        true => Stored::open_within(path, record.bytes, help, 0)?,
        false => Stored::open(path, record.bytes, help)?,
    };
    if !opening.trust {
        (opening.tell)(&format!("hashing {}, {} MB", path.display(), record.bytes.div_ceil(1_000_000)));
        let checked = stored.check(record);
        (opening.tell)("at work");
        checked?;
    }
    Ok(stored)
}

fn parse_clips(path: &Path, text: &[u8]) -> Result<Vec<ClipRecord>> {
    let lines = text.split(|&b| b == b'\n').enumerate().filter(|(_, l)| !l.is_empty());
    let parse = |(i, line): (usize, &[u8])| {
        serde_json::from_slice(line).map_err(|e| {
            let at = kinelm_motion::Place { path: path.to_owned(), line: i + 1, column: e.column() };
            Error::at(at, e.to_string(), "the record of a clip", "make the corpus again")
        })
    };
    lines.map(parse).collect()
}

/// Whether the clips lie one after the other and sum to what the manifest counts.
fn check_clips(path: &Path, manifest: &Manifest, clips: &[ClipRecord]) -> Result<()> {
    let mut next = 0_usize;
    let sound = manifest.sound.as_ref().map_or(0, |file| file.bytes / (CHANNELS * size_of::<f32>()) as u64);
    for clip in clips {
        let rows = clip.sound.map_or(Some(0), |of| of.first.checked_add(of.rows));
        if rows.is_none_or(|rows| rows as u64 > sound) {
            let found = format!("clip {} with music up to row {}", clip.name, rows.unwrap_or(usize::MAX));
            return Err(Error::file(
                path,
                found,
                format!("at most {sound}, those of {SOUND}"),
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
    pub fn of(tokenizer: &Tokenizer) -> Self {
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
    pub fn coding(&self) -> Coding {
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
mod tests {
    use super::*;
    use crate::corpus::samples::{small, tokenizer};
    use crate::corpus::{CorpusWriter, Count};
    use std::fs;
    use std::io::{Seek, Write};

    #[test]
    fn what_was_written_is_read() {
        let tmp = tempfile::tempdir().unwrap();
        let dir = tmp.path().join("c");
        let (manifest, ids) = small(&dir);
        assert!(dir.join("tokens.u16").is_file());
        let c = Corpus::open(&dir).unwrap();
        assert_eq!(*c.manifest(), manifest);
        assert_eq!(c.tokenizer(), &tokenizer());
        assert_eq!(manifest.count, Count { clips: 3, frames: 3 });
        assert_eq!(manifest.splits[&Split::Train], Count { clips: 2, frames: 3 });
        let train: Vec<_> = c.split(Split::Train).map(|r| c.clip_ids(r).unwrap()).collect();
        assert_eq!(train, [ids[0].clone(), ids[2].clone()]);
        assert_eq!(c.word_ids(&c.clips()[0], 1..2).unwrap(), ids[0][7..]);
        assert_eq!((c.tokens_per_frame(Split::Train), c.tokens_per_frame(Split::Valid)), (7.0, 0.0));
        assert_eq!((c.tokens().len(), c.clips()[1].frames, c.clips()[0].clipped), (3 * 7, 0, 2));
        assert_eq!(fs::read_dir(tmp.path()).unwrap().count(), 1, "nothing is left beside the corpus");
    }

    #[test]
    fn ids_that_the_tokenizer_has_not_are_refused() {
        let tmp = tempfile::tempdir().unwrap();
        let dir = tmp.path().join("c");
        small(&dir);
        let (tokens, manifest) = (dir.join("tokens.u16"), dir.join(MANIFEST));
        let mut bytes = fs::read(&tokens).unwrap();
        let before = FileRecord::of(&bytes).sha256;
        bytes[9] = 0x40;
        fs::write(&tokens, &bytes).unwrap();
        let text = fs::read_to_string(&manifest).unwrap().replace(&before, &FileRecord::of(&bytes).sha256);
        fs::write(&manifest, text).unwrap();
        let message = Corpus::open(&dir).unwrap_err().to_string();
        assert!(message.contains("tokens.u16: found id 16") && message.contains("expected ids below"), "{message}");
    }

    #[test]
    fn damage_is_named() {
        let tmp = tempfile::tempdir().unwrap();
        let dir = tmp.path().join("c");
        let says = || Corpus::open(&dir).unwrap_err().to_string();
        assert!(says().contains("found nothing, expected a corpus folder"));
        small(&dir);
        let intact: Vec<_> =
            [MANIFEST, CLIPS, "tokens.u16", TOKENIZER].map(|f| (f, fs::read(dir.join(f)).unwrap())).into();
        let manifest = String::from_utf8(intact[0].1.clone()).unwrap();
        let mut other = tokenizer();
        other.vocabulary_mut().add_conditioning("genre", "salsa").unwrap();
        for (file, bytes, expected) in [
            (
                MANIFEST,
                manifest.replace("\"version\": 3", "\"version\": 9").into_bytes(),
                "found version 9, expected version 3; use a newer kinelm",
            ),
            (
                MANIFEST,
                manifest.replace("\"version\": 3", "\"version\": 1").into_bytes(),
                "found version 1, expected version 3; make it again",
            ),
            (MANIFEST, manifest[..40].into(), "corpus.json:"),
            (MANIFEST, manifest.replace("\"fps\"", "\"fpz\"").into_bytes(), "fpz"),
            (CLIPS, b"{}\n".to_vec(), "clips.jsonl: found 3 bytes"),
            ("tokens.u16", vec![0; 41], "found 41 bytes, expected 42 bytes"),
            ("tokens.u16", vec![0; 42], "SHA-256"),
            (TOKENIZER, b"{}".to_vec(), "tokenizer.json"),
            (TOKENIZER, other.to_json().into_bytes(), "put back the tokenizer.json"),
        ] {
            fs::write(dir.join(file), bytes).unwrap();
            let said = says();
            assert!(said.contains(expected), "{said}");
            intact.iter().for_each(|(f, b)| fs::write(dir.join(f), b).unwrap());
        }
        Corpus::open(&dir).unwrap();
        fs::remove_file(dir.join(MANIFEST)).unwrap();
        assert!(says().contains("no corpus.json"));
    }

    #[test]
    fn records_that_lie_are_refused() {
        let tmp = tempfile::tempdir().unwrap();
        let dir = tmp.path().join("c");
        small(&dir);
        let clips = fs::read_to_string(dir.join(CLIPS)).unwrap();
        let manifest = fs::read_to_string(dir.join(MANIFEST)).unwrap();
        for (from, to, expected) in [
            ("\"offset\":14", "\"offset\":13", "found clip b at token 13, expected token 14"),
            ("\"frames\":1", "\"frames\":2", "clip c of 2 frames in 7 tokens, expected 2 words of 7"),
            ("\"tokens\":7", "\"tokens\":14", "clip c of 1 frames in 14 tokens"),
            ("\"frames\":1", "\"frames\":18446744073709551615", "18446744073709551615 words of 7"),
            ("\"source\":0", "\"source\":1", "one of the 1 sources"),
            ("\"key\":2", "\"key\":two", "clips.jsonl:2:"),
        ] {
            let lying = clips.replacen(from, to, 1);
            assert_ne!(lying, clips, "{from}");
            let (old, new) = (FileRecord::of(clips.as_bytes()), FileRecord::of(lying.as_bytes()));
            let signed = manifest
                .replace(&old.sha256, &new.sha256)
                .replace(&format!("\"bytes\": {}", old.bytes), &format!("\"bytes\": {}", new.bytes));
            fs::write(dir.join(CLIPS), lying).unwrap();
            fs::write(dir.join(MANIFEST), signed).unwrap();
            let said = Corpus::open(&dir).unwrap_err().to_string();
            assert!(said.contains(expected), "{said}");
        }
    }

    #[test]
    fn a_trusted_corpus_is_read_behind_its_2_32nd_token() {
        let tmp = tempfile::tempdir().unwrap();
        let dir = tmp.path().join("c");
        let (mut manifest, ids) = small(&dir);
        // two clips of zeros that take no room on the disk, then c
        let word = manifest.tokens_per_word.unwrap();
        let frames = (u32::MAX as usize - 6) / word;
        let text = fs::read_to_string(dir.join(CLIPS)).unwrap();
        let mut clips: Vec<ClipRecord> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
        let mut next = 0;
        for (clip, frames) in clips.iter_mut().zip([frames, 2, 1]) {
            (clip.offset, clip.frames, clip.tokens) = (next, frames, frames * word);
            next += clip.tokens;
        }
        assert!(clips[2].offset > 1 << 32 && clips[1].offset < 1 << 32);
        let lines: String = clips.iter().map(|clip| serde_json::to_string(clip).unwrap() + "\n").collect();
        manifest.clips = FileRecord::of(lines.as_bytes());
        manifest.tokens.bytes = 2 * next as u64;
        fs::write(dir.join(CLIPS), lines).unwrap();
        fs::write(dir.join(MANIFEST), serde_json::to_string(&manifest).unwrap()).unwrap();
        let mut file = fs::File::options().write(true).open(dir.join("tokens.u16")).unwrap();
        file.set_len(0).unwrap();
        file.seek(std::io::SeekFrom::Start(2 * clips[2].offset as u64)).unwrap();
        file.write_all(&manifest.token_type.to_bytes(&ids[2])).unwrap();
        let opening = Opening { trust: true, streamed: true, ..Opening::default() };
        let corpus = Corpus::open_with(&dir, opening).unwrap();
        assert_eq!(corpus.tokens().len(), next);
        assert_eq!(corpus.clip_ids(&corpus.clips()[2]).unwrap(), ids[2]);
        assert_eq!(corpus.word_ids(&corpus.clips()[1], 1..2).unwrap(), vec![0; word]);
        assert_eq!(corpus.words(&corpus.clips()[0]).len(), frames);
    }

    #[test]
    fn what_is_trusted_is_not_hashed_and_its_ids_are_refused_where_they_are_read() {
        let tmp = tempfile::tempdir().unwrap();
        let dir = tmp.path().join("c");
        small(&dir);
        let tokens = dir.join("tokens.u16");
        let mut bytes = fs::read(&tokens).unwrap();
        bytes[9] = 0x40;
        fs::write(&tokens, &bytes).unwrap();
        assert!(Corpus::open(&dir).unwrap_err().to_string().contains("SHA-256"));
        let corpus = Corpus::open_with(&dir, Opening { trust: true, ..Opening::default() }).unwrap();
        let message = corpus.clip_ids(&corpus.clips()[0]).unwrap_err().to_string();
        assert!(message.contains("tokens.u16: found id 16") && message.contains("expected ids below"), "{message}");
    }

    #[test]
    fn an_empty_corpus_opens() {
        let tmp = tempfile::tempdir().unwrap();
        let dir = tmp.path().join("c");
        CorpusWriter::create(&dir, &tokenizer(), &[], None, false).unwrap().finish().unwrap();
        assert!(Corpus::open(&dir).unwrap().tokens().is_empty());
    }
}
