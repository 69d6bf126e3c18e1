//! Writing the token store: whole or not at all.

use super::record::{
    ClipRecord, Count, ExcludedRange, Failure, MUSIC, Manifest, MusicRows, Shard, SourceRecord, Split, TokenType,
    VERSION,
};
use super::store::{CLIPS, Coding, MANIFEST, TOKENIZER};
use crate::{Error, Result, artifacts};
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
    /// Its record; the writer sets its offset, tokens and rows of music.
    pub record: ClipRecord,
    /// (N, 35) the features of its music, empty if it has none.
    pub music: Vec<f32>,
}

/// Writes a corpus into a hidden folder beside its output and renames that when the corpus is whole. A writer that is dropped
/// before [`CorpusWriter::finish`] leaves nothing.
#[derive(Debug)]
pub struct CorpusWriter {
    work: PendingFolder,
    force: bool,
    tokens: HashingFile,
    clips: HashingFile,
    /// Created with the first clip that has music.
    music: Option<HashingFile>,
    token_type: TokenType,
    manifest: Manifest,
    sources: Vec<Sha256>,
    names: HashSet<String>,
    last_key: Option<usize>,
    offset: usize,
}

impl CorpusWriter {
    /// Begins a corpus at `dir`, made with `tokenizer` from the paths `sources`.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Taken`] if `dir` holds something else than a corpus, or one of another tokenizer and `force` is not set;
    /// [`kinelm_store::Error::Io`].
    pub fn create(
        dir: impl AsRef<Path>,
        tokenizer: &Tokenizer,
        sources: &[String],
        shard: Option<Shard>,
        force: bool,
    ) -> Result<Self> {
        let dir = dir.as_ref().to_owned();
        check_output(&dir, tokenizer, force)?;
        let work = PendingFolder::create(&dir)?;
        let coding = Coding::of(tokenizer);
        let token_type = TokenType::of_vocabulary(coding.vocabulary);
        work.write(TOKENIZER, tokenizer.to_json().as_bytes())?;
        let empty = FileRecord::of(b"");
        let source = |path: &String| SourceRecord { path: path.clone(), clips: 0, sha256: String::new() };
        Ok(CorpusWriter {
            tokens: HashingFile::create(work.path().join(token_type.file_name()))?,
            clips: HashingFile::create(work.path().join(CLIPS))?,
            music: None,
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
                music: None,
                count: Count::default(),
                splits: Split::ALL.into_iter().map(|s| (s, Count::default())).collect(),
                sources: sources.iter().map(source).collect(),
                failed: Vec::new(),
                excluded: Vec::new(),
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

    /// Appends a clip with the `ids` of its ceil(F / L) words. Keys ascend, so that the order of a corpus doesn't depend on
    /// threads.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Invalid`] if the ids are not as many words as the frames take or outside the vocabulary, the
    /// name was used before, the key is not above the last one, or the source is not listed; [`kinelm_store::Error::Io`].
    pub fn push(&mut self, clip: NewClip, ids: &[u32]) -> Result<()> {
        self.check(&clip, ids)?;
        self.tokens.write(&self.token_type.to_bytes(ids))?;
        let music = self.push_music(&clip.music)?;
        let (offset, tokens) = (self.offset, ids.len());
        let record = ClipRecord { offset, tokens, music, ..clip.record };
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

    /// Appends the features (N, 35) of a clip's music.
    fn push_music(&mut self, numbers: &[f32]) -> Result<Option<MusicRows>> {
        if numbers.is_empty() {
            return Ok(None);
        }
        let file = match &mut self.music {
            Some(file) => file,
            none => none.insert(HashingFile::create(self.work.path().join(MUSIC))?),
        };
        let row = CHANNELS * size_of::<f32>();
        let first = (file.bytes / row as u64) as usize;
        file.write(&numbers.iter().flat_map(|x| x.to_le_bytes()).collect::<Vec<u8>>())?;
        Ok(Some(MusicRows { first, rows: numbers.len() / CHANNELS }))
    }

    fn check(&self, NewClip { record: clip, music }: &NewClip, ids: &[u32]) -> Result<()> {
        let wrong = |what: &str, found: String, expected: String| {
            Err(Error::in_clip(&clip.name)(Error::invalid(what.to_string(), found, expected)))
        };
        let v = self.manifest.vocabulary;
        let expected = self.manifest.words_of(clip.frames);
        let (found, whole) = match self.manifest.tokens_per_word {
            Some(w) => (ids.len() / w.max(1), ids.len().is_multiple_of(w)),
            // every word ends with a space, so spaces count the words and the last id is one
            None => (ids.iter().filter(|&&id| id == SPACE).count(), ids.last().is_none_or(|&id| id == SPACE)),
        };
        if found != expected || !whole {
            let part = if whole { "" } else { " and a part of one" };
            let found = format!("{found} words{part} for {} frames", clip.frames);
            return wrong("its text", found, format!("{expected} words"));
        }
        if u32::try_from(ids.len()).is_err() {
            return wrong("its length", format!("{} tokens", ids.len()), "at most 2^32 - 1; cut it in two".into());
        }
        if let Some(i) = ids.iter().position(|&id| id as usize >= v) {
            return wrong(&format!("token {i}"), ids[i].to_string(), format!("an id below {v}"));
        }
        if self.names.contains(&clip.name) {
            return wrong("its name", "in the corpus already".into(), "a name of its own".into());
        }
        if let Some(last) = self.last_key.filter(|last| clip.key <= *last) {
            return wrong("its key", clip.key.to_string(), format!("ascending keys, more than {last}"));
        }
        if clip.source >= self.sources.len() {
            let expected = format!("below {}, the number of sources", self.sources.len());
            return wrong("its source", clip.source.to_string(), expected);
        }
        if !music.len().is_multiple_of(CHANNELS) {
            return wrong("its music", format!("{} numbers", music.len()), format!("{CHANNELS} a row"));
        }
        Ok(())
    }

    /// Records a file that was skipped.
    pub(crate) fn fail(&mut self, failure: Failure) {
        self.manifest.failed.push(failure);
    }

    /// Records the ranges that clips were taken without.
    pub(crate) fn exclude(&mut self, ranges: &[ExcludedRange]) {
        self.manifest.excluded = ranges.to_vec();
    }

    /// Writes the manifest and moves the corpus to its output.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`]; [`kinelm_store::Error::Taken`] if something else is there and `force` is not set.
    pub fn finish(mut self) -> Result<Manifest> {
        self.manifest.tokens = self.tokens.finish()?;
        self.manifest.clips = self.clips.finish()?;
        self.manifest.music = self.music.as_mut().map(HashingFile::finish).transpose()?;
        for (record, hash) in self.manifest.sources.iter_mut().zip(&self.sources) {
            record.sha256 = hex(hash.clone());
        }
        let mut json = serde_json::to_string_pretty(&self.manifest).expect("a manifest is JSON");
        json.push('\n');
        // last, since it has the hashes of all other files
        self.work.write(MANIFEST, json.as_bytes())?;
        match self.force {
            true => self.work.commit_over(&LAYOUT)?,
            false => self.work.commit(HELP)?,
        }
        Ok(self.manifest)
    }
}

/// The files of a corpus folder; the manifest, which has the hashes of the others, is first.
pub const LAYOUT: [&str; 6] = [MANIFEST, CLIPS, TOKENIZER, "tokens.u16", "tokens.u32", MUSIC];

/// Refuses an output that is not free, a corpus to be replaced by `force`, or a corpus that may turn out to be the same.
fn check_output(dir: &Path, tokenizer: &Tokenizer, force: bool) -> Result<()> {
    let is_used = fs::read_dir(dir).is_ok_and(|mut entries| entries.next().is_some());
    if fs::symlink_metadata(dir).is_err() || (dir.is_dir() && !is_used) {
        return Ok(());
    }
    // a run has a corpus.json too
    if let Some(kind) = artifacts::kind(dir).filter(|kind| *kind != artifacts::CORPUS) {
        return Err(Error::taken(dir, format!("exists and is {kind}; give another output")));
    }
    if !dir.join(MANIFEST).is_file() {
        return Err(Error::taken(dir, "exists and is no corpus; give another output"));
    }
    if !force && input::peek_bytes(&dir.join(TOKENIZER)).is_ok_and(|found| found != tokenizer.to_json().as_bytes()) {
        return Err(Error::taken(dir, format!("holds a corpus of another tokenizer; {HELP}")));
    }
    Ok(())
}

const HELP: &str = "give another output, or set `force` to replace its files";

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
        // synced before the folder is renamed, or a crash could leave a corpus of empty files
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
    fn nothing_is_overwritten_without_force() {
        let tmp = tempfile::tempdir().unwrap();
        let dir = tmp.path().join("c");
        small(&dir);
        fs::write(dir.join("notes.txt"), "x").unwrap();
        let mut w = begin(&dir, false).unwrap();
        w.push(clip("z", 0, Split::Valid, 1), &words(1)).unwrap();
        let e = w.finish().unwrap_err().to_string();
        assert!(e.contains("`force`"), "{e}");
        small(&dir);
        let mut w = begin(&dir, true).unwrap();
        w.push(clip("z", 0, Split::Valid, 1), &words(1)).unwrap();
        assert_eq!(
            Corpus::open(&dir).unwrap().clips()[0].name,
            "a",
            "the earlier one stays until the new one is whole"
        );
        w.finish().unwrap();
        assert_eq!(Corpus::open(&dir).unwrap().clips()[0].name, "z");
        assert!(dir.join("notes.txt").exists(), "other files stay");
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
    fn bad_clips_are_refused() {
        let tmp = tempfile::tempdir().unwrap();
        let mut w = begin(&tmp.path().join("c"), false).unwrap();
        let says = |r: Result<()>| r.unwrap_err().to_string();
        let one = |name: &str, key| clip(name, key, Split::Train, 1);
        assert!(says(w.push(one("a", 0), &words(1)[1..])).contains("0 words and a part of one for 1 frames"));
        assert!(says(w.push(one("a", 0), &words(2))).contains("its text is 2 words for 1 frames; expected 1 words"));
        assert!(says(w.push(one("a", 0), &[9999; 7])).contains("expected an id below"));
        w.push(one("a", 3), &words(1)).unwrap();
        let none = |name: &str, key| clip(name, key, Split::Train, 0);
        assert!(says(w.push(none("a", 4), &[])).contains("a name of its own"));
        assert!(says(w.push(none("b", 3), &[])).contains("ascending keys"));
        let odd = NewClip { music: vec![0.0; 36], ..none("b", 4) };
        assert!(says(w.push(odd, &[])).contains("its music is 36 numbers; expected 35 a row"));
        let mut far = none("b", 4);
        far.record.source = 1;
        assert!(says(w.push(far, &[])).contains("its source is 1"));
    }
}
