//! The token store: written whole or not at all, read with its hashes checked.

use super::map::MappedFile;
use super::record::{
    ClipRecord, Count, Failure, FileRecord, Manifest, Shard, SourceRecord, Split, TokenType, VERSION, hex,
};
use crate::{Error, Result, files};
use serde::Deserialize;
use sha2::{Digest, Sha256};
use std::collections::{BTreeMap, HashSet};
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::ops::Range;
use std::path::{Path, PathBuf};

const MANIFEST: &str = "corpus.json";
const CLIPS: &str = "clips.jsonl";
const TOKENIZER: &str = "tokenizer.json";

/// The tokens of all clips, memory-mapped.
#[derive(Debug)]
pub struct Tokens {
    bytes: MappedFile,
    kind: TokenType,
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
    /// # Panics
    /// If the range leaves the file.
    pub fn ids(&self, places: Range<usize>) -> impl ExactSizeIterator<Item = u32> + '_ {
        let width = self.kind.width();
        self.bytes[places.start * width..places.end * width].chunks_exact(width).map(move |b| match *b {
            [a, b] => u16::from_le_bytes([a, b]).into(),
            [a, b, c, d] => u32::from_le_bytes([a, b, c, d]),
            _ => unreachable!("chunks are two or four bytes"),
        })
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
}

impl Corpus {
    /// Opens a corpus folder: checks version, lengths and hashes, maps the tokens.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::File`] when a file is of another version, damaged, or doesn't fit the others; it says
    /// what was found, what was wanted and how to go on.
    pub fn open(dir: impl AsRef<Path>) -> Result<Self> {
        let dir = dir.as_ref().to_owned();
        let (manifest, hash) = read_manifest(&dir)?;
        let path = dir.join(CLIPS);
        let text = fs::read(&path).map_err(Error::io(&path))?;
        manifest.clips.check(&path, &text)?;
        let clips = parse_clips(&path, &text)?;
        check_clips(&path, &manifest, &clips)?;
        let kind = manifest.token_type;
        let bytes = MappedFile::open(&dir.join(kind.file_name()), &manifest.tokens)?;
        Ok(Corpus { dir, manifest, hash, clips, tokens: Tokens { bytes, kind } })
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

    /// The folder's `tokenizer.json`.
    pub fn tokenizer_path(&self) -> PathBuf {
        self.dir.join(TOKENIZER)
    }

    /// All clips, in the order of the token file.
    pub fn clips(&self) -> &[ClipRecord] {
        &self.clips
    }

    /// The clips of a split, in the order of the token file.
    pub fn split(&self, split: Split) -> impl Iterator<Item = &ClipRecord> {
        self.clips.iter().filter(move |c| c.split == split)
    }

    /// W: the characters of a word and its space.
    pub fn tokens_per_frame(&self) -> usize {
        self.manifest.tokens_per_frame
    }

    /// The tokens of all clips.
    pub fn tokens(&self) -> &Tokens {
        &self.tokens
    }

    /// (F * W) ids of a clip of this corpus.
    pub fn clip_ids(&self, clip: &ClipRecord) -> Vec<u32> {
        self.frame_ids(clip, 0..clip.frames)
    }

    /// Ids of some frames of a clip of this corpus, frames counted from the clip's first.
    ///
    /// # Panics
    /// If the range leaves the clip.
    pub fn frame_ids(&self, clip: &ClipRecord, frames: Range<usize>) -> Vec<u32> {
        assert!(frames.end <= clip.frames, "frames {frames:?} of {}, which has {}", clip.name, clip.frames);
        let w = self.tokens_per_frame();
        self.tokens.ids(clip.offset + frames.start * w..clip.offset + frames.end * w).collect()
    }
}

/// Reads `corpus.json`, its version first; the second value is its hash.
fn read_manifest(dir: &Path) -> Result<(Manifest, String)> {
    #[derive(Deserialize)]
    struct Head {
        version: u32,
    }
    let path = dir.join(MANIFEST);
    let text = fs::read(&path).map_err(|e| match e.kind() {
        std::io::ErrorKind::NotFound if dir.is_dir() => {
            let help = "a corpus is a folder that `kinelm tokenize DATA --out CORPUS` wrote";
            Error::file(dir, "no corpus.json", "a corpus folder", help)
        }
        _ => Error::io(&path)(e),
    })?;
    let bad = |e: serde_json::Error| {
        let at = kinelm_motion::Place { path: path.clone(), line: e.line(), column: e.column() };
        Error::at(at, e.to_string(), "the manifest of a corpus", "make the corpus again with `kinelm tokenize`")
    };
    let head: Head = serde_json::from_slice(&text).map_err(bad)?;
    if head.version != VERSION {
        let help = if head.version > VERSION { "use a newer kinelm" } else { "make the corpus again" };
        return Err(Error::file(&path, format!("version {}", head.version), format!("version {VERSION}"), help));
    }
    let manifest = serde_json::from_slice(&text).map_err(bad)?;
    Ok((manifest, FileRecord::of(&text).sha256))
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
    for clip in clips {
        if clip.offset != next {
            let found = format!("clip {} at token {}", clip.name, clip.offset);
            return Err(Error::file(path, found, format!("token {next}"), "make the corpus again"));
        }
        if clip.source >= manifest.sources.len() {
            let found = format!("clip {} of source {}", clip.name, clip.source);
            let expected = format!("one of the {} sources of corpus.json", manifest.sources.len());
            return Err(Error::file(path, found, expected, "make the corpus again"));
        }
        next = (clip.frames.checked_mul(manifest.tokens_per_frame).and_then(|n| n.checked_add(next)))
            .ok_or_else(|| Error::file(path, format!("{} frames", clip.frames), "a number of tokens", ""))?;
    }
    let bytes = (next as u64).saturating_mul(manifest.token_type.width() as u64);
    if bytes != manifest.tokens.bytes {
        let found = format!("clips of {bytes} bytes of tokens");
        return Err(Error::file(path, found, format!("{} bytes", manifest.tokens.bytes), "make the corpus again"));
    }
    Ok(())
}

/// What all tokens of a corpus share; all of it comes from the tokenizer.
#[derive(Debug, Clone, PartialEq)]
pub struct Shape {
    /// SHA-256 that the tokenizer states of itself.
    pub tokenizer: String,
    /// W: the characters of a word and its space.
    pub tokens_per_frame: usize,
    /// Ids are below this.
    pub vocabulary: usize,
    /// Frames per second.
    pub fps: f64,
}

/// A clip for [`CorpusWriter::push`]: a [`ClipRecord`] without what the writer counts itself.
#[derive(Debug, Clone, PartialEq)]
#[expect(missing_docs, reason = "the fields are those of ClipRecord")]
pub struct NewClip {
    pub name: String,
    pub labels: BTreeMap<String, String>,
    pub split: Split,
    pub take: String,
    pub key: usize,
    pub source: usize,
    pub sha256: String,
    pub clipped: usize,
    pub second_codes: usize,
}

/// Writes a corpus into a hidden folder beside its place and moves it there when it is whole. Dropped before
/// [`CorpusWriter::finish`], it leaves nothing.
#[derive(Debug)]
pub struct CorpusWriter {
    dir: PathBuf,
    work: PathBuf,
    force: bool,
    tokens: HashingFile,
    clips: HashingFile,
    token_type: TokenType,
    manifest: Manifest,
    sources: Vec<Sha256>,
    names: HashSet<String>,
    last_key: Option<usize>,
    offset: usize,
}

impl CorpusWriter {
    /// Begins a corpus at `dir` with the bytes of its `tokenizer.json` and the paths it is made from.
    ///
    /// # Errors
    /// [`Error::Call`] when something stands at `dir` already and `force` is not given, or it is given and what stands
    /// there is no corpus; [`Error::Io`].
    pub fn create(
        dir: impl AsRef<Path>,
        shape: &Shape,
        tokenizer_json: &[u8],
        sources: &[String],
        shard: Option<Shard>,
        force: bool,
    ) -> Result<Self> {
        let dir = dir.as_ref().to_owned();
        refuse_to_overwrite(&dir, force)?;
        let work = files::beside(&dir, "writing")?;
        fs::create_dir_all(&work).map_err(Error::io(&work))?;
        let token_type = TokenType::of_vocabulary(shape.vocabulary);
        files::write_whole(&work.join(TOKENIZER), tokenizer_json)?;
        let empty = FileRecord::of(b"");
        let source = |path: &String| SourceRecord { path: path.clone(), clips: 0, sha256: String::new() };
        Ok(CorpusWriter {
            tokens: HashingFile::create(work.join(token_type.file_name()))?,
            clips: HashingFile::create(work.join(CLIPS))?,
            manifest: Manifest {
                version: VERSION,
                tokenizer: shape.tokenizer.clone(),
                tokens_per_frame: shape.tokens_per_frame,
                vocabulary: shape.vocabulary,
                fps: shape.fps,
                token_type,
                tokens: empty.clone(),
                clips: empty,
                count: Count::default(),
                splits: Split::ALL.into_iter().map(|s| (s, Count::default())).collect(),
                sources: sources.iter().map(source).collect(),
                failed: Vec::new(),
                shard,
            },
            sources: vec![Sha256::new(); sources.len()],
            names: HashSet::new(),
            last_key: None,
            offset: 0,
            token_type,
            force,
            dir,
            work,
        })
    }

    /// Appends a clip of (F * W) `ids`. Keys ascend, so that the order of a corpus never depends on who was faster.
    ///
    /// # Errors
    /// [`Error::Call`] when the ids are no whole words or outside the vocabulary, the name stood before, the key is not
    /// above the last one, or the source is not listed; [`Error::Io`].
    pub fn push(&mut self, clip: NewClip, ids: &[u32]) -> Result<()> {
        self.check(&clip, ids)?;
        let frames = ids.len() / self.manifest.tokens_per_frame;
        match self.token_type {
            TokenType::U16 => self.tokens.write(ids.iter().flat_map(|&id| (id as u16).to_le_bytes()))?,
            TokenType::U32 => self.tokens.write(ids.iter().flat_map(|&id| id.to_le_bytes()))?,
        }
        let NewClip { name, labels, split, take, key, source, sha256, clipped, second_codes } = clip;
        self.sources[source].update(format!("{name} {sha256}\n"));
        self.manifest.sources[source].clips += 1;
        self.manifest.count.add(frames);
        self.manifest.splits.entry(split).or_default().add(frames);
        self.names.insert(name.clone());
        self.last_key = Some(key);
        let offset = self.offset;
        self.offset += ids.len();
        let record =
            ClipRecord { name, offset, frames, labels, split, take, key, source, sha256, clipped, second_codes };
        let line = serde_json::to_string(&record).expect("a record of strings and integers is JSON");
        self.clips.write(line.into_bytes().into_iter().chain([b'\n']))
    }

    fn check(&self, clip: &NewClip, ids: &[u32]) -> Result<()> {
        let fail = |what: String| Err(Error::Call(format!("{}: {what}", clip.name)));
        let (w, v) = (self.manifest.tokens_per_frame, self.manifest.vocabulary);
        if w == 0 || !ids.len().is_multiple_of(w) {
            return fail(format!("{} tokens; expected whole words of {w}", ids.len()));
        }
        if let Some(i) = ids.iter().position(|&id| id as usize >= v) {
            return fail(format!("token {i} is {}; expected an id below {v}", ids[i]));
        }
        if self.names.contains(&clip.name) {
            return fail("a clip of this name is in the corpus already; every name stands once".into());
        }
        if self.last_key.is_some_and(|last| clip.key <= last) {
            return fail(format!("key {} after {:?}; keys ascend", clip.key, self.last_key));
        }
        if clip.source >= self.sources.len() {
            return fail(format!("source {}; the corpus lists {}", clip.source, self.sources.len()));
        }
        Ok(())
    }

    /// Records a file that could not be taken.
    pub fn fail(&mut self, failure: Failure) {
        self.manifest.failed.push(failure);
    }

    /// Moves the whole corpus to its place.
    ///
    /// # Errors
    /// [`Error::Io`]; [`Error::Call`] as in [`CorpusWriter::create`], when something came to stand there meanwhile.
    pub fn finish(mut self) -> Result<Manifest> {
        self.manifest.tokens = self.tokens.finish()?;
        self.manifest.clips = self.clips.finish()?;
        for (record, hash) in self.manifest.sources.iter_mut().zip(&self.sources) {
            record.sha256 = hex(hash.clone());
        }
        let mut json = serde_json::to_string_pretty(&self.manifest).expect("a manifest is JSON");
        json.push('\n');
        files::write_whole(&self.work.join(MANIFEST), json.as_bytes())?;
        refuse_to_overwrite(&self.dir, self.force)?;
        let old = files::beside(&self.dir, "old")?;
        let replaces = self.dir.exists();
        if replaces {
            fs::rename(&self.dir, &old).map_err(Error::io(&self.dir))?;
        }
        if let Err(e) = fs::rename(&self.work, &self.dir) {
            let _ = fs::rename(&old, &self.dir);
            return Err(Error::io(&self.dir)(e));
        }
        files::sync_folder(files::folder_of(&self.dir))?;
        if replaces {
            fs::remove_dir_all(&old).map_err(Error::io(&old))?;
        }
        Ok(self.manifest.clone())
    }
}

impl Drop for CorpusWriter {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.work); // gone already after `finish`
    }
}

/// A folder is replaced only by the user's word, and only if it is a corpus or empty.
fn refuse_to_overwrite(dir: &Path, force: bool) -> Result<()> {
    let shown = dir.display();
    if fs::symlink_metadata(dir).is_err() {
        return Ok(());
    }
    if fs::read_dir(dir).is_ok_and(|mut entries| entries.next().is_none()) {
        return Ok(());
    }
    if !dir.join(MANIFEST).is_file() {
        return Err(Error::Call(format!("{shown} exists and is no corpus; give another place for the corpus")));
    }
    if !force {
        return Err(Error::Call(format!("{shown} holds a corpus; give another place, or --force to replace it")));
    }
    Ok(())
}

/// A file that is hashed while it is written.
#[derive(Debug)]
struct HashingFile {
    path: PathBuf,
    file: BufWriter<File>,
    hash: Sha256,
    bytes: u64,
    chunk: Vec<u8>,
}

impl HashingFile {
    fn create(path: PathBuf) -> Result<Self> {
        let file = BufWriter::new(File::create(&path).map_err(Error::io(&path))?);
        Ok(HashingFile { path, file, hash: Sha256::new(), bytes: 0, chunk: Vec::new() })
    }

    fn write(&mut self, bytes: impl Iterator<Item = u8>) -> Result<()> {
        self.chunk.clear();
        self.chunk.extend(bytes);
        self.hash.update(&self.chunk);
        self.bytes += self.chunk.len() as u64;
        self.file.write_all(&self.chunk).map_err(Error::io(&self.path))
    }

    fn finish(&mut self) -> Result<FileRecord> {
        self.file.flush().and_then(|()| self.file.get_ref().sync_all()).map_err(Error::io(&self.path))?;
        Ok(FileRecord { bytes: self.bytes, sha256: hex(self.hash.clone()) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    const W: usize = 3;

    fn shape(vocabulary: usize) -> Shape {
        Shape { tokenizer: "t".repeat(64), tokens_per_frame: W, vocabulary, fps: 20.0 }
    }

    fn clip(name: &str, key: usize, split: Split) -> NewClip {
        let labels = BTreeMap::from([("genre".to_string(), "salsa".to_string())]);
        let (name, take, sha256) = (name.to_string(), name.to_string(), "0".repeat(64));
        NewClip { name, labels, split, take, key, source: 0, sha256, clipped: 2, second_codes: 1 }
    }

    fn begin(dir: &Path, vocabulary: usize, force: bool) -> Result<CorpusWriter> {
        CorpusWriter::create(dir, &shape(vocabulary), b"{}", &["data".to_string()], None, force)
    }

    fn small(dir: &Path, vocabulary: usize) -> Manifest {
        let mut w = begin(dir, vocabulary, false).unwrap();
        w.push(clip("a", 0, Split::Train), &[6, 7, 5, 8, 9, 5]).unwrap();
        w.push(clip("b", 2, Split::Test), &[]).unwrap();
        w.push(clip("c", 5, Split::Train), &[9, 9, 5]).unwrap();
        w.fail(Failure { key: 1, name: "x".into(), why: "damaged".into() });
        w.finish().unwrap()
    }

    #[test]
    fn what_was_written_is_read() {
        for (vocabulary, file) in [(400, "tokens.u16"), (70_000, "tokens.u32")] {
            let tmp = tempfile::tempdir().unwrap();
            let dir = tmp.path().join("c");
            let manifest = small(&dir, vocabulary);
            assert!(dir.join(file).is_file());
            let c = Corpus::open(&dir).unwrap();
            assert_eq!(*c.manifest(), manifest);
            assert_eq!(manifest.count, Count { clips: 3, frames: 3 });
            assert_eq!(manifest.splits[&Split::Train], Count { clips: 2, frames: 3 });
            let train: Vec<_> = c.split(Split::Train).map(|r| c.clip_ids(r)).collect();
            assert_eq!(train, [vec![6, 7, 5, 8, 9, 5], vec![9, 9, 5]]);
            assert_eq!(c.frame_ids(&c.clips()[0], 1..2), [8, 9, 5]);
            assert_eq!((c.tokens().len(), c.clips()[1].frames, c.clips()[0].clipped), (9, 0, 2));
            assert_eq!(fs::read_dir(tmp.path()).unwrap().count(), 1, "nothing is left beside the corpus");
        }
    }

    #[test]
    fn the_same_clips_give_the_same_bytes() {
        let tmp = tempfile::tempdir().unwrap();
        let (a, b) = (tmp.path().join("a"), tmp.path().join("b"));
        small(&a, 400);
        small(&b, 400);
        for file in [MANIFEST, CLIPS, "tokens.u16", TOKENIZER] {
            assert_eq!(fs::read(a.join(file)).unwrap(), fs::read(b.join(file)).unwrap(), "{file}");
        }
    }

    #[test]
    fn nothing_is_overwritten_unasked() {
        let tmp = tempfile::tempdir().unwrap();
        let dir = tmp.path().join("c");
        small(&dir, 400);
        let e = begin(&dir, 400, false).unwrap_err().to_string();
        assert!(e.contains("--force"), "{e}");
        let mut w = begin(&dir, 400, true).unwrap();
        w.push(clip("z", 0, Split::Valid), &[9, 9, 5]).unwrap();
        assert_eq!(Corpus::open(&dir).unwrap().clips()[0].name, "a", "the old one stands until the new one is whole");
        w.finish().unwrap();
        assert_eq!(Corpus::open(&dir).unwrap().clips()[0].name, "z");
        let other = tmp.path().join("letters");
        fs::create_dir(&other).unwrap();
        fs::write(other.join("dear.txt"), "x").unwrap();
        assert!(begin(&other, 400, true).unwrap_err().to_string().contains("no corpus"));
        assert_eq!(fs::read_dir(tmp.path()).unwrap().count(), 2);
    }

    #[test]
    fn a_dropped_writer_leaves_nothing() {
        let tmp = tempfile::tempdir().unwrap();
        begin(&tmp.path().join("c"), 400, false).unwrap().push(clip("a", 0, Split::Train), &[6, 7, 5]).unwrap();
        assert_eq!(fs::read_dir(tmp.path()).unwrap().count(), 0);
    }

    #[test]
    fn nonsense_is_refused_by_the_writer() {
        let tmp = tempfile::tempdir().unwrap();
        let mut w = begin(&tmp.path().join("c"), 400, false).unwrap();
        let says = |r: Result<()>| r.unwrap_err().to_string();
        assert!(says(w.push(clip("a", 0, Split::Train), &[6, 7])).contains("whole words of 3"));
        assert!(says(w.push(clip("a", 0, Split::Train), &[6, 400, 5])).contains("id below 400"));
        w.push(clip("a", 3, Split::Train), &[6, 7, 5]).unwrap();
        assert!(says(w.push(clip("a", 4, Split::Train), &[])).contains("stands once"));
        assert!(says(w.push(clip("b", 3, Split::Train), &[])).contains("keys ascend"));
        let far = NewClip { source: 1, ..clip("b", 4, Split::Train) };
        assert!(says(w.push(far, &[])).contains("source 1"));
    }

    #[test]
    fn damage_is_named() {
        let tmp = tempfile::tempdir().unwrap();
        let dir = tmp.path().join("c");
        let says = || Corpus::open(&dir).unwrap_err().to_string();
        assert!(says().contains("corpus.json"));
        small(&dir, 400);
        let intact: Vec<_> = [MANIFEST, CLIPS, "tokens.u16"].map(|f| (f, fs::read(dir.join(f)).unwrap())).into();
        let manifest = String::from_utf8(intact[0].1.clone()).unwrap();
        for (file, bytes, expected) in [
            (
                MANIFEST,
                manifest.replace("\"version\": 1", "\"version\": 9").into_bytes(),
                "found version 9, expected version 1",
            ),
            (MANIFEST, manifest[..40].into(), "corpus.json:"),
            (MANIFEST, manifest.replace("\"fps\"", "\"fpz\"").into_bytes(), "fpz"),
            (CLIPS, b"{}\n".to_vec(), "clips.jsonl: found 3 bytes"),
            ("tokens.u16", vec![0; 17], "found 17 bytes, expected 18 bytes"),
            ("tokens.u16", vec![0; 18], "SHA-256"),
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
}
