//! Writing the token store: whole or not at all.

use super::record::{
    ClipRecord, ClipSound, Count, Failure, LeftOut, Manifest, SOUND, Shard, SourceRecord, Split, TokenType, VERSION,
};
use super::store::{CLIPS, Coding, MANIFEST, TOKENIZER};
use crate::{Error, Result, ours};
use kinelm_music::feature::CHANNELS;
use kinelm_store::files::PendingFolder;
use kinelm_store::hash::hex;
use kinelm_store::{FileRecord, input};
use kinelm_tokenizer::{SPACE, Tokenizer};
use sha2::{Digest, Sha256};
use std::collections::HashSet;
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

/// A clip for [`CorpusWriter::push`].
#[derive(Debug, Clone, PartialEq)]
pub struct NewClip {
    /// What is known of it; its places in the token file and in that of music, and its tokens, are the writer's to say.
    pub record: ClipRecord,
    /// (N, 35) what its music sounds like, at each frame; empty: it has none.
    pub sound: Vec<f32>,
}

/// Writes a corpus into a hidden folder beside its place and moves it there when it is whole. Dropped before
/// [`CorpusWriter::finish`], it leaves nothing.
#[derive(Debug)]
pub struct CorpusWriter {
    work: PendingFolder,
    force: bool,
    tokens: HashingFile,
    clips: HashingFile,
    /// Begun with the first clip that has music.
    sound: Option<HashingFile>,
    token_type: TokenType,
    manifest: Manifest,
    sources: Vec<Sha256>,
    names: HashSet<String>,
    last_key: Option<usize>,
    offset: usize,
}

impl CorpusWriter {
    /// Begins a corpus at `dir` with its tokenizer and the paths it is made from.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Taken`] when what stands at `dir` is no corpus, or one of another tokenizer and `force` is not given;
    /// [`kinelm_store::Error::Io`].
    pub fn create(
        dir: impl AsRef<Path>,
        tokenizer: &Tokenizer,
        sources: &[String],
        shard: Option<Shard>,
        force: bool,
    ) -> Result<Self> {
        let dir = dir.as_ref().to_owned();
        check_place(&dir, tokenizer, force)?;
        let work = PendingFolder::create(&dir)?;
        let coding = Coding::of(tokenizer);
        let token_type = TokenType::of_vocabulary(coding.vocabulary);
        work.write(TOKENIZER, tokenizer.to_json().as_bytes())?;
        let empty = FileRecord::of(b"");
        let source = |path: &String| SourceRecord { path: path.clone(), clips: 0, sha256: String::new() };
        Ok(CorpusWriter {
            tokens: HashingFile::create(work.path().join(token_type.file_name()))?,
            clips: HashingFile::create(work.path().join(CLIPS))?,
            sound: None,
            manifest: Manifest {
                version: VERSION,
                tokenizer: coding.tokenizer,
                frames_per_word: coding.frames_per_word,
                tokens_per_word: coding.tokens_per_word,
                vocabulary: coding.vocabulary,
                fps: coding.fps,
                token_type,
                tokens: empty.clone(),
                clips: empty,
                sound: None,
                count: Count::default(),
                splits: Split::ALL.into_iter().map(|s| (s, Count::default())).collect(),
                sources: sources.iter().map(source).collect(),
                failed: Vec::new(),
                left_out: Vec::new(),
                shard,
            },
            sources: vec![Sha256::new(); sources.len()],
            names: HashSet::new(),
            last_key: None,
            offset: 0,
            token_type,
            force,
            work,
        })
    }

    /// Appends a clip of the `ids` of ceil(F / L) words. Keys ascend, so that the order of a corpus never depends on who was faster.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Call`] when the ids are not the words of the clip's frames or outside the vocabulary, the name stood before, the key is not
    /// above the last one, or the source is not listed; [`kinelm_store::Error::Io`].
    pub fn push(&mut self, clip: NewClip, ids: &[u32]) -> Result<()> {
        self.check(&clip, ids)?;
        self.tokens.write(&self.token_type.to_bytes(ids))?;
        let sound = self.push_sound(&clip.sound)?;
        let (offset, tokens) = (self.offset, ids.len());
        let record = ClipRecord { offset, tokens, sound, ..clip.record };
        let ClipRecord { name, sha256, source, frames, .. } = &record;
        self.sources[*source].update(format!("{name} {sha256}\n"));
        self.manifest.sources[*source].clips += 1;
        self.manifest.count.add(*frames);
        self.manifest.splits.entry(record.split).or_default().add(*frames);
        self.names.insert(name.clone());
        self.last_key = Some(record.key);
        self.offset += tokens;
        let line = serde_json::to_string(&record).expect("a record of strings and integers is JSON");
        self.clips.write(format!("{line}\n").as_bytes())
    }

    /// Appends the rows (N, 35) of a clip's music.
    fn push_sound(&mut self, numbers: &[f32]) -> Result<Option<ClipSound>> {
        if numbers.is_empty() {
            return Ok(None);
        }
        let file = match &mut self.sound {
            Some(file) => file,
            none => none.insert(HashingFile::create(self.work.path().join(SOUND))?),
        };
        let row = CHANNELS * size_of::<f32>();
        let first = (file.bytes / row as u64) as usize;
        file.write(&numbers.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>())?;
        Ok(Some(ClipSound { first, rows: numbers.len() / CHANNELS }))
    }

    fn check(&self, NewClip { record: clip, sound }: &NewClip, ids: &[u32]) -> Result<()> {
        let fail = |what: String| Err(Error::call(format!("{}: {what}", clip.name)));
        let v = self.manifest.vocabulary;
        let expected = self.manifest.words_of(clip.frames);
        let (found, whole) = match self.manifest.tokens_per_word {
            Some(w) => (ids.len() / w.max(1), ids.len().is_multiple_of(w)),
            None => (ids.iter().filter(|&&id| id == SPACE).count(), ids.last().is_none_or(|&id| id == SPACE)),
        };
        if found != expected || !whole {
            let part = if whole { "" } else { " and a part of one" };
            return fail(format!("{found} words{part} for {} frames; expected {expected} words", clip.frames));
        }
        if u32::try_from(ids.len()).is_err() {
            return fail(format!("{} tokens; a clip holds at most 2^32 - 1; cut it in two", ids.len()));
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
        if !sound.len().is_multiple_of(CHANNELS) {
            return fail(format!("{} numbers of its music; expected {CHANNELS} a row", sound.len()));
        }
        Ok(())
    }

    /// Records a file that could not be taken.
    pub fn fail(&mut self, failure: Failure) {
        self.manifest.failed.push(failure);
    }

    /// Records what the clips were taken without.
    pub fn left_out(&mut self, ranges: &[LeftOut]) {
        self.manifest.left_out = ranges.to_vec();
    }

    /// Moves the whole corpus to its place.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`]; [`kinelm_store::Error::Taken`] where something else stands there and `force` is not given.
    pub fn finish(mut self) -> Result<Manifest> {
        self.manifest.tokens = self.tokens.finish()?;
        self.manifest.clips = self.clips.finish()?;
        self.manifest.sound = self.sound.as_mut().map(HashingFile::finish).transpose()?;
        for (record, hash) in self.manifest.sources.iter_mut().zip(&self.sources) {
            record.sha256 = hex(hash.clone());
        }
        let mut json = serde_json::to_string_pretty(&self.manifest).expect("a manifest is JSON");
        json.push('\n');
        self.work.write(MANIFEST, json.as_bytes())?;
        match self.force {
            true => self.work.commit_over(&LAYOUT)?,
            false => self.work.commit(HELP)?,
        }
        Ok(self.manifest)
    }
}

/// What the folder may hold of a corpus, what tells of the others first.
pub const LAYOUT: [&str; 6] = [MANIFEST, CLIPS, TOKENIZER, "tokens.u16", "tokens.u32", SOUND];

/// Files are replaced in a corpus alone, and without `force` only by the same: of another tokenizer they can't be.
fn check_place(dir: &Path, tokenizer: &Tokenizer, force: bool) -> Result<()> {
    let is_used = fs::read_dir(dir).is_ok_and(|mut entries| entries.next().is_some());
    if fs::symlink_metadata(dir).is_err() || (dir.is_dir() && !is_used) {
        return Ok(());
    }
    // a run has a corpus.json too
    if let Some(kind) = ours::kind(dir).filter(|kind| *kind != ours::CORPUS) {
        return Err(Error::taken(dir, format!("exists and is {kind}; give another place for the corpus")));
    }
    if !dir.join(MANIFEST).is_file() {
        return Err(Error::taken(dir, "exists and is no corpus; give another place for the corpus"));
    }
    if !force && input::peek_bytes(&dir.join(TOKENIZER)).is_ok_and(|found| found != tokenizer.to_json().as_bytes()) {
        return Err(Error::taken(dir, format!("holds a corpus of another tokenizer; {HELP}")));
    }
    Ok(())
}

const HELP: &str = "give another place for the corpus, or --force to replace its files";

/// A file that is hashed while it is written.
#[derive(Debug)]
struct HashingFile {
    path: PathBuf,
    file: BufWriter<File>,
    hash: Sha256,
    bytes: u64,
}

impl HashingFile {
    fn create(path: PathBuf) -> Result<Self> {
        let file = BufWriter::new(File::create(&path).map_err(Error::io(&path))?);
        Ok(HashingFile { path, file, hash: Sha256::new(), bytes: 0 })
    }

    fn write(&mut self, bytes: &[u8]) -> Result<()> {
        self.hash.update(bytes);
        self.bytes += bytes.len() as u64;
        self.file.write_all(bytes).map_err(Error::io(&self.path))
    }

    fn finish(&mut self) -> Result<FileRecord> {
        self.file.flush().and_then(|()| self.file.get_ref().sync_all()).map_err(Error::io(&self.path))?;
        Ok(FileRecord { bytes: self.bytes, sha256: hex(self.hash.clone()) })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Corpus;
    use crate::samples::{begin, clip, small, words};

    #[test]
    fn the_same_clips_give_the_same_bytes() {
        let tmp = tempfile::tempdir().unwrap();
        let (a, b) = (tmp.path().join("a"), tmp.path().join("b"));
        small(&a);
        small(&b);
        for file in [MANIFEST, CLIPS, "tokens.u16", TOKENIZER] {
            assert_eq!(fs::read(a.join(file)).unwrap(), fs::read(b.join(file)).unwrap(), "{file}");
        }
    }

    #[test]
    fn nothing_is_overwritten_unasked() {
        let tmp = tempfile::tempdir().unwrap();
        let dir = tmp.path().join("c");
        small(&dir);
        fs::write(dir.join("notes.txt"), "x").unwrap();
        let mut w = begin(&dir, false).unwrap();
        w.push(clip("z", 0, Split::Valid, 1), &words(1)).unwrap();
        let e = w.finish().unwrap_err().to_string();
        assert!(e.contains("--force"), "{e}");
        small(&dir);
        let mut w = begin(&dir, true).unwrap();
        w.push(clip("z", 0, Split::Valid, 1), &words(1)).unwrap();
        assert_eq!(Corpus::open(&dir).unwrap().clips()[0].name, "a", "the old one stands until the new one is whole");
        w.finish().unwrap();
        assert_eq!(Corpus::open(&dir).unwrap().clips()[0].name, "z");
        assert!(dir.join("notes.txt").exists(), "what is no part of it stays");
        let other = tmp.path().join("letters");
        fs::create_dir(&other).unwrap();
        fs::write(other.join("dear.txt"), "x").unwrap();
        assert!(begin(&other, true).unwrap_err().to_string().contains("no corpus"));
        assert_eq!(fs::read_dir(tmp.path()).unwrap().count(), 2);
    }

    #[test]
    fn a_dropped_writer_leaves_nothing() {
        let tmp = tempfile::tempdir().unwrap();
        begin(&tmp.path().join("c"), false).unwrap().push(clip("a", 0, Split::Train, 1), &words(1)).unwrap();
        assert_eq!(fs::read_dir(tmp.path()).unwrap().count(), 0);
    }

    #[test]
    fn nonsense_is_refused() {
        let tmp = tempfile::tempdir().unwrap();
        let mut w = begin(&tmp.path().join("c"), false).unwrap();
        let says = |r: Result<()>| r.unwrap_err().to_string();
        let one = |name: &str, key| clip(name, key, Split::Train, 1);
        assert!(says(w.push(one("a", 0), &words(1)[1..])).contains("0 words and a part of one for 1 frames"));
        assert!(says(w.push(one("a", 0), &words(2))).contains("2 words for 1 frames; expected 1 words"));
        assert!(says(w.push(one("a", 0), &[9999; 7])).contains("expected an id below"));
        w.push(one("a", 3), &words(1)).unwrap();
        let none = |name: &str, key| clip(name, key, Split::Train, 0);
        assert!(says(w.push(none("a", 4), &[])).contains("stands once"));
        assert!(says(w.push(none("b", 3), &[])).contains("keys ascend"));
        let odd = NewClip { sound: vec![0.0; 36], ..none("b", 4) };
        assert!(says(w.push(odd, &[])).contains("36 numbers of its music; expected 35 a row"));
        let mut far = none("b", 4);
        far.record.source = 1;
        assert!(says(w.push(far, &[])).contains("source 1"));
    }
}
