//! From motion files to a tokenizer and to a corpus, on all cores, in memory that doesn't grow with the data.
//!
//! Files are worked on in blocks, side by side inside a block, and taken in their order: neither the tokenizer nor a
//! corpus depends on the number of threads. A bad file is named, counted and passed over.

use super::gather::{Gathered, Item};
use super::load::{Loaded, Wanted, item_options, load_item, load_whole};
use super::record::{BeatsOf, ClipBeats, ClipRecord, Failure, LeftOut, Manifest, Shard, Split};
use super::timed::in_pieces;
use super::writer::{CorpusWriter, NewClip};
use crate::music::find::{Heard, OfClip};
use crate::music::{own, tempo};
use crate::{Error, Result};
use kinelm_motion::FaultKind;
use kinelm_motion::format::{RateDoubt, RateDoubts, ReadOptions};
use kinelm_store::counted;
use kinelm_tokenizer::{Encoded, Fit, Tokenizer, TokenizerConfig};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

/// Files a block holds for each thread: few enough that results wait in little memory, enough that a long file at a
/// block's end keeps others waiting only now and then.
pub const BLOCK_PER_THREAD: usize = 8;

/// How a corpus or a tokenizer is made.
#[derive(Debug, Clone, Default)]
pub struct BuildOptions {
    /// How files are read.
    pub read: ReadOptions,
    /// Any bad file fails the run; all are named first.
    pub strict: bool,
    /// Only a piece of the files.
    pub shard: Option<Shard>,
    /// A corpus that stands at the place is replaced.
    pub force: bool,
    /// Where the clips' music is, whose beats and sound a corpus keeps; none is looked for if not given.
    pub music: Option<PathBuf>,
    /// Clips without music get motion-derived beats, of their own steps.
    pub own_beats: bool,
    /// What the clips are taken without, for the corpus to tell: what [`super::left_out::leave_out`] gave the items.
    pub left_out: Vec<LeftOut>,
}

/// What happens while files are worked on.
#[derive(Debug)]
pub enum Event<'a> {
    /// A file was done, well or not.
    Done {
        /// Files so far.
        done: usize,
        /// Of how many.
        of: usize,
        /// Frames so far, at the tokenizer's rate.
        frames: usize,
    },
    /// A file could not be taken.
    Failed {
        /// The file.
        item: &'a Item,
        /// Why.
        error: &'a Error,
    },
}

/// What the user sees of the work; `Break` ends it, and nothing is left on disk.
pub type Watch<'a> = dyn FnMut(Event<'_>) -> ControlFlow<()> + 'a;

/// What a run found.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Summary {
    /// Files taken.
    pub clips: usize,
    /// Their frames at the tokenizer's rate.
    pub frames: usize,
    /// Files that could not be taken.
    pub failed: Vec<Failure>,
    /// Files of a motion format that hold none.
    pub no_motion: usize,
    /// Doubts of rates.
    pub doubts: RateDoubts,
    /// Other oddities by kind: how many files have it, and the first as an example.
    pub warnings: BTreeMap<&'static str, (usize, String)>,
    /// Translation values that were clipped to the tokenizer's range.
    pub clipped: usize,
    /// Rotations that took a second code.
    pub second_codes: usize,
    /// Frames added to fill last tiles.
    pub padded: usize,
    /// Files whose music was heard.
    pub with_music: usize,
    /// Files that have motion-derived beats.
    pub with_own_beats: usize,
}

impl Summary {
    /// What the user should be told, one line each.
    pub fn lines(&self) -> Vec<String> {
        let mut lines: Vec<String> = (self.warnings.iter())
            .map(|(kind, (files, first))| format!("{kind}: {}, the first {first}", counted(*files, "files")))
            .collect();
        lines.extend(self.doubts.line());
        if self.no_motion > 0 {
            lines.push(format!("{} files hold no motion and are left out", self.no_motion));
        }
        if self.padded > 0 {
            lines.push(format!("{} frames were added to fill the last words of clips", self.padded));
        }
        if !self.failed.is_empty() {
            lines.push(format!("{} could not be taken", counted(self.failed.len(), "files")));
        }
        lines
    }
}

/// Fits a tokenizer on the train clips.
///
/// # Errors
/// [`kinelm_store::Error::Call`] when no train clip could be taken, or any file is bad and `strict` is given; [`kinelm_store::Error::Stopped`] when `watch` broke off;
/// [`Error::Tokenizer`] for settings outside their limits.
pub fn fit(
    gathered: &Gathered,
    config: TokenizerConfig,
    options: &BuildOptions,
    watch: &mut Watch<'_>,
) -> Result<(Tokenizer, Summary)> {
    let mut all = Fit::new(config.clone())?;
    let items: Vec<&Item> = gathered.items.iter().filter(|i| i.split == Split::Train).collect();
    if items.is_empty() {
        return Err(Error::call("no clip is in the train split, and a tokenizer is fitted on that alone"));
    }
    let work = |_: &Item, loaded: &Loaded| {
        let mut one = Fit::new(config.clone())?;
        one.add(&loaded.clip)?;
        Ok((one, loaded.clip.frames()))
    };
    let summary = each(&items, options, Wanted::from(&config), watch, work, |_, _, (one, frames), _| {
        all.merge(&one)?;
        Ok(frames)
    })?;
    check(&summary, options, items.len())?;
    Ok((all.finish()?, summary))
}

/// Tokenizes all clips (or a shard of them) into a corpus folder at `out`; clips whose labels change are cut into pieces, as are those
/// out of whose middle something is left out.
///
/// # Errors
/// Those of [`CorpusWriter`]; [`kinelm_store::Error::Call`] when no clip could be taken, or any file is bad and `strict` is given, or
/// `watch` broke off. Nothing is written then.
pub fn tokenize(
    gathered: &Gathered,
    tokenizer: &Tokenizer,
    out: &Path,
    options: &BuildOptions,
    watch: &mut Watch<'_>,
) -> Result<(Manifest, Summary)> {
    let mut writer = CorpusWriter::create(out, tokenizer, &gathered.sources, options.shard, options.force)?;
    let pieces = in_pieces(&gathered.items);
    let items: Vec<&Item> = pieces.iter().filter(|i| options.shard.is_none_or(|s| s.holds(i.key))).collect();
    let fps = tokenizer.fps();
    let heard = options.music.as_ref().map(|folder| Heard::of(&items, folder, fps)).transpose()?;
    let work = |item: &Item, loaded: &Loaded| {
        let (encoded, length) = (tokenizer.encode(&loaded.clip)?, (loaded.clip.frames(), loaded.clip.fps()));
        let of_music = heard.as_ref().map_or(Ok(None), |heard| heard.of_clip(item, length))?;
        let own = options.own_beats && of_music.is_none();
        let own = if own { own::beats_s(&loaded.clip, loaded.floor_m.map(|_| 0.0))? } else { None };
        let (of, OfClip { beats_s, sound, tempo }) = match of_music {
            Some(music) => (Some(BeatsOf::Music), music),
            None => (own.as_ref().map(|_| BeatsOf::Motion), own.map(OfClip::steps).unwrap_or_default()),
        };
        let beats = of.map(|of| ClipBeats { of, times_s: beats_s });
        Ok(Coded {
            ids: tokenizer.ids_of_words(&encoded.words)?,
            encoded,
            frames: length.0,
            floor_m: loaded.floor_m,
            beats,
            sound,
            tempo,
        })
    };
    let summary = each(&items, options, tokenizer.config().into(), watch, work, |item, sha256, coded, summary| {
        let Coded { ids, encoded, frames, floor_m, beats, sound, tempo } = coded;
        match beats.as_ref().map(|beats: &ClipBeats| beats.of) {
            Some(BeatsOf::Music) => summary.with_music += 1,
            Some(BeatsOf::Motion) => summary.with_own_beats += 1,
            None => {}
        }
        let (clipped, second_codes) = (encoded.clipped as usize, encoded.second_codes as usize);
        summary.clipped += clipped;
        summary.second_codes += second_codes;
        summary.padded += encoded.padded as usize;
        let Item { name, mut labels, split, take, key, source, .. } = item.clone();
        let read = item_options(item, &options.read);
        if let Some(tempo) = tempo {
            labels.entry(tempo::FIELD.into()).or_insert(tempo);
        }
        let record = ClipRecord {
            name,
            labels,
            split,
            take,
            key,
            source,
            sha256,
            frames,
            clipped,
            second_codes,
            floor_m,
            read,
            beats,
            // the writer's to say
            offset: 0,
            tokens: 0,
            sound: None,
        };
        writer.push(NewClip { record, sound }, &ids)?;
        Ok(frames)
    })?;
    check(&summary, options, items.len())?;
    summary.failed.iter().for_each(|f| writer.fail(f.clone()));
    writer.left_out(&options.left_out);
    Ok((writer.finish()?, summary))
}

/// A clip in words, and what is known of its music.
struct Coded {
    ids: Vec<u32>,
    encoded: Encoded,
    frames: usize,
    floor_m: Option<f64>,
    beats: Option<ClipBeats>,
    sound: Vec<f32>,
    tempo: Option<String>,
}

/// Whether what was found is enough.
pub fn check(summary: &Summary, options: &BuildOptions, items: usize) -> Result<()> {
    let failed = summary.failed.len();
    // a shard may well consist of bad files; merging it with the others brings their names along
    let whole = options.shard.is_none();
    if let Some(first) = summary.failed.first().filter(|_| options.strict || (whole && failed == items)) {
        let why = if options.strict { ", and --strict is given" } else { "" };
        let (name, reason) = (&first.name, &first.why);
        return Err(Error::call(format!(
            "{failed} of {items} files could not be taken{why}; nothing was written; the first was {name}: {reason}"
        )));
    }
    if items == 0 && !options.left_out.is_empty() && whole {
        return Err(Error::call("what is left out (--leave-out) leaves nothing of the clips; nothing was written"));
    }
    if summary.clips == 0 && items > 0 && whole {
        return Err(Error::call(format!("{items} files, and none holds motion")));
    }
    Ok(())
}

/// Loads and works on every item, side by side; takes the results in order. `take` returns the frames of the clip.
pub fn each<T: Send>(
    items: &[&Item],
    options: &BuildOptions,
    wanted: Wanted,
    watch: &mut Watch<'_>,
    work: impl Fn(&Item, &Loaded) -> Result<T> + Sync,
    mut take: impl FnMut(&Item, String, T, &mut Summary) -> Result<usize>,
) -> Result<Summary> {
    let files = Files::default();
    let one = |item: &Item| {
        let loaded = match item.piece {
            Some(_) => files.piece(item, &options.read, wanted)?,
            None => load_item(item, &options.read, wanted)?,
        };
        if loaded.clip.frames() == 0 {
            return Ok(None); // nothing is left behind the last labels
        }
        let made = work(item, &loaded).map_err(|e| named(item, e))?;
        Ok(Some((made, loaded.sha256, loaded.warnings, loaded.doubt)))
    };
    let mut summary = Summary::default();
    let (mut done, mut odd, mut read) = (0, BTreeSet::new(), HashSet::new());
    for block in items.chunks(BLOCK_PER_THREAD * rayon::current_num_threads()) {
        let results: Vec<Result<_>> = block.par_iter().map(|item| one(item)).collect();
        files.forget_all_but(block[block.len() - 1]);
        for (item, result) in block.iter().zip(results) {
            done += 1;
            let mut goes_on = ControlFlow::Continue(());
            match result {
                Ok(None) => {}
                Ok(Some((made, sha256, warnings, doubt))) => {
                    if read.insert(&item.path) {
                        summary.doubts.add(&item.file_name(), doubt);
                    }
                    for warning in warnings.into_iter().filter(|warning| !RateDoubt::is_warning(warning)) {
                        let first = || (0, format!("{}: {}", item.name, warning.what));
                        let known = summary.warnings.entry(warning.kind).or_insert_with(first);
                        // a file that labels cut comes once a piece
                        known.0 += usize::from(odd.insert((warning.kind, &item.path)));
                    }
                    summary.frames += take(item, sha256, made, &mut summary)?;
                    summary.clips += 1;
                }
                Err(Error::Motion(e)) if e.fault() == Some(FaultKind::NoMotion) => summary.no_motion += 1,
                Err(error) => {
                    let (key, name, why) = (item.key, item.name.clone(), error.to_string());
                    summary.failed.push(Failure { key, name, why });
                    goes_on = watch(Event::Failed { item, error: &error });
                }
            }
            let event = Event::Done { done, of: items.len(), frames: summary.frames };
            if goes_on.is_break() || watch(event).is_break() {
                let of = items.len();
                return Err(Error::stopped(format!("stopped after {done} of {of} files; nothing was written")));
            }
        }
    }
    Ok(summary)
}

/// Files of which several pieces are taken: each is read once.
#[derive(Default)]
struct Files(Mutex<HashMap<PathBuf, Arc<OnceLock<Option<Loaded>>>>>);

impl Files {
    fn piece(&self, item: &Item, options: &ReadOptions, wanted: Wanted) -> Result<Loaded> {
        let cell = self.lock().entry(item.path.clone()).or_default().clone();
        match cell.get_or_init(|| load_whole(item, options, wanted).ok()) {
            Some(whole) => whole.piece(item),
            // every piece tells what is wrong
            None => load_item(item, options, wanted),
        }
    }

    /// Keeps the file of this item, the next of which may be a piece of it too.
    fn forget_all_but(&self, item: &Item) {
        self.lock().retain(|path, _| *path == item.path);
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<PathBuf, Arc<OnceLock<Option<Loaded>>>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// An error of the tokenizer with the file it is about.
fn named(item: &Item, error: Error) -> Error {
    match error {
        Error::Tokenizer(e) => Error::call(format!("{}: {e}", item.path.display())),
        other => other,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Corpus, gather, merge, samples};
    use kinelm_motion::{Clip, Motion, Quat, Source, format};
    use std::fs;
    use std::path::PathBuf;

    /// A folder of walks of different lengths, a bad file among them, and a CSV beside it.
    fn data() -> (tempfile::TempDir, PathBuf, String) {
        let tmp = tempfile::tempdir().unwrap();
        let dir = tmp.path().join("data");
        fs::create_dir(&dir).unwrap();
        let mut csv = "clip,split,kind\n".to_string();
        for i in 0..7 {
            let path = dir.join(format!("walk{i}.bvh"));
            let motion =
                Motion { path: path.clone(), clip: samples::walk(3 + i), source: Source::Plain, warnings: vec![] };
            format::write(&path, &motion).unwrap();
            csv += &format!("walk{i},{},walk\n", ["train", "train", "test", "valid"][i % 4]);
        }
        fs::write(dir.join("walk3b.bvh"), "HIERARCHY\nROOT").unwrap();
        let labels = tmp.path().join("labels.csv");
        fs::write(&labels, csv).unwrap();
        (tmp, dir, labels.display().to_string())
    }

    #[test]
    fn a_file_that_labels_cut_is_counted_once() {
        let tmp = tempfile::tempdir().unwrap();
        let (clip, path) = (samples::walk(40), tmp.path().join("w.bvh"));
        // nothing turned, and then a pose that is held
        let turned = Quat::from_rotation_z(1.0);
        let rotation = |i: usize| if i < clip.joints() || i % clip.joints() != 16 { Quat::IDENTITY } else { turned };
        let rotations = (0..40 * clip.joints()).map(rotation).collect();
        let clip = Clip::new(clip.skeleton().clone(), clip.fps(), clip.root().to_vec(), rotations).unwrap();
        let motion = Motion { path: path.clone(), clip, source: Source::Plain, warnings: vec![] };
        format::write(&path, &motion).unwrap();
        let csv = tmp.path().join("labels.csv");
        fs::write(&csv, "clip,split,kind,from_s,to_s\nw,train,a,0,0.5\nw,train,b,0.5,\n").unwrap();
        let gathered = gather(&[path], &[csv.display().to_string()]).unwrap();
        let config = TokenizerConfig::uniform(&[0, 1, 2], 20.0, 90);
        let options = BuildOptions::default();
        let (tokenizer, _) = fit(&gathered, config, &options, &mut go).unwrap();
        let (_, summary) = tokenize(&gathered, &tokenizer, &tmp.path().join("c"), &options, &mut go).unwrap();
        assert_eq!((summary.clips, summary.warnings["rest_frame"].0), (2, 1), "{summary:?}");
    }

    fn go(_: Event<'_>) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn bytes(dir: &Path) -> Vec<Vec<u8>> {
        ["corpus.json", "clips.jsonl", "tokens.u16", "tokenizer.json"].map(|f| fs::read(dir.join(f)).unwrap()).into()
    }

    #[test]
    fn files_become_a_corpus_and_shards_merge_to_the_same_bytes() {
        let (tmp, dir, labels) = data();
        let gathered = gather(&[dir], &[labels]).unwrap();
        let options = BuildOptions::default();
        let config = TokenizerConfig::uniform(&[0, 1, 2], 20.0, 90);
        let (tokenizer, summary) = fit(&gathered, config.clone(), &options, &mut go).unwrap();
        assert_eq!((summary.clips, summary.failed.len()), (4, 0), "{summary:?}");

        let whole = tmp.path().join("whole");
        let mut failed = Vec::new();
        let mut watch = |e: Event<'_>| {
            if let Event::Failed { item, .. } = e {
                failed.push(item.name.clone());
            }
            ControlFlow::Continue(())
        };
        let (manifest, summary) = tokenize(&gathered, &tokenizer, &whole, &options, &mut watch).unwrap();
        assert_eq!(failed, ["walk3b"]);
        assert_eq!((manifest.count.clips, manifest.count.frames, summary.frames), (7, 42, 42));
        assert_eq!(manifest.failed[0].key, 4);
        assert!(manifest.failed[0].why.contains("walk3b.bvh"), "{}", manifest.failed[0].why);

        let corpus = Corpus::open(&whole).unwrap();
        let clip = load_item(&gathered.items[0], &options.read, tokenizer.config().into()).unwrap().clip;
        assert_eq!(corpus.clip_words(&corpus.clips()[0]).unwrap(), tokenizer.encode(&clip).unwrap().words);

        for of in [1, 3, 20] {
            let shards: Vec<PathBuf> = (0..of)
                .map(|index| {
                    let out = tmp.path().join(format!("shard-{index}-{of}"));
                    let options = BuildOptions { shard: Some(Shard { index, of }), ..options.clone() };
                    tokenize(&gathered, &tokenizer, &out, &options, &mut go).unwrap();
                    out
                })
                .collect();
            let merged = tmp.path().join(format!("merged-{of}"));
            let backwards: Vec<PathBuf> = shards.iter().rev().cloned().collect();
            merge(&backwards, &merged, false).unwrap();
            assert_eq!(bytes(&merged), bytes(&whole), "{of} shards");
        }
    }

    #[test]
    fn threads_change_nothing() {
        let (tmp, dir, labels) = data();
        let gathered = gather(&[dir], &[labels]).unwrap();
        let make = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let out = tmp.path().join(format!("c{threads}"));
            pool.install(|| {
                let options = BuildOptions::default();
                let (t, _) = fit(&gathered, TokenizerConfig::default(), &options, &mut go).unwrap();
                tokenize(&gathered, &t, &out, &options, &mut go).unwrap();
            });
            bytes(&out)
        };
        assert_eq!(make(1), make(3));
    }

    #[test]
    fn strict_and_stopped_runs_write_nothing() {
        let (tmp, dir, labels) = data();
        let gathered = gather(&[dir], &[labels]).unwrap();
        let out = tmp.path().join("c");
        let before = fs::read_dir(tmp.path()).unwrap().count();
        let strict = BuildOptions { strict: true, ..BuildOptions::default() };
        let e = tokenize(&gathered, &samples::tokenizer(), &out, &strict, &mut go).unwrap_err().to_string();
        assert!(e.starts_with("1 of 8 files could not be taken, and --strict is given; nothing was written"), "{e}");
        let mut stop = |e: Event<'_>| match e {
            Event::Done { done: 2, .. } => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        };
        let e = tokenize(&gathered, &samples::tokenizer(), &out, &BuildOptions::default(), &mut stop).unwrap_err();
        assert!(e.to_string().contains("stopped after 2 of 8 files"), "{e}");
        assert_eq!(fs::read_dir(tmp.path()).unwrap().count(), before);
    }

    #[test]
    fn only_bad_files_are_an_error() {
        let tmp = tempfile::tempdir().unwrap();
        fs::write(tmp.path().join("a.bvh"), "").unwrap();
        let gathered = gather(&[tmp.path().into()], &[]).unwrap();
        let out = tmp.path().join("c");
        let e = tokenize(&gathered, &samples::tokenizer(), &out, &BuildOptions::default(), &mut go).unwrap_err();
        assert!(e.to_string().contains("1 of 1 files") && e.to_string().contains("a.bvh"), "{e}");
    }
}
