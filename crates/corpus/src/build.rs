//! From motion files to a tokenizer and to a corpus, on all cores, in memory that doesn't grow with the data.
//!
//! Files are worked on in blocks, in parallel inside a block, and their results are used in the order of the files, so the
//! number of threads changes neither a tokenizer nor a corpus. A bad file is reported, counted and skipped.

use super::dataset::Dataset;
use super::item::Item;
use super::load::{ClipSpec, ItemClip};
use super::record::{BeatSource, ClipBeats, ClipRecord, ExcludedRange, Failure, Manifest, Shard, Split};
use super::segments::split_items;
use super::writer::{CorpusWriter, NewClip};
use crate::music::library::{AlignedMusic, MusicLibrary};
use crate::music::{motion_beats, tempo};
use crate::{Error, Result};
use kinelm_motion::format::{FileRate, RateDoubt, RateDoubts, ReadOptions};
use kinelm_motion::{FaultKind, Warning};
use kinelm_store::counted;
use kinelm_tokenizer::{Encoded, Fit, Tokenizer, TokenizerConfig};
use rayon::prelude::*;
use std::collections::{BTreeMap, BTreeSet, HashMap, HashSet};
use std::fmt::Display;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, MutexGuard, OnceLock, PoisonError};

/// Files of a block per thread: few enough that waiting results take little memory, enough that a long file at a block's
/// end seldom leaves other threads idle.
pub const BLOCK_PER_THREAD: usize = 8;

/// How a corpus or a tokenizer is made.
#[derive(Debug, Clone, Default)]
pub struct BuildOptions {
    /// How files are read.
    pub read: ReadOptions,
    /// Whether a bad file fails the build, after all bad files are reported.
    pub strict: bool,
    /// The part of the files to take; all if not given.
    pub shard: Option<Shard>,
    /// Whether a corpus that exists at the output is replaced.
    pub force: bool,
    /// The folder of the clips' music, whose beats and features the corpus gets; no music if not given.
    pub music: Option<PathBuf>,
    /// Whether clips without music get motion-derived beats.
    pub motion_beats: bool,
    /// The ranges that [`super::exclude::exclude`] took out of the items, recorded in the corpus.
    pub excluded: Vec<ExcludedRange>,
}

/// Reports how a build goes on.
#[derive(Debug)]
pub enum BuildEvent<'a> {
    /// A file was done, well or not.
    Done {
        /// Files so far.
        done: usize,
        /// Files in all.
        of: usize,
        /// Frames so far, at the tokenizer's rate.
        frames: usize,
    },
    /// A file was skipped.
    Failed {
        /// The file.
        item: &'a Item,
        /// The reason.
        why: &'a str,
    },
}

/// A callback for progress; `Break` stops the build, which then leaves nothing on disk.
pub type BuildProgress<'a> = dyn FnMut(BuildEvent<'_>) -> ControlFlow<()> + 'a;

/// The outcome of a pass over the files.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Summary {
    /// Files taken.
    pub clips: usize,
    /// Their frames at the tokenizer's rate.
    pub frames: usize,
    /// Files that were skipped.
    pub failed: Vec<Failure>,
    /// Files of a motion format without motion in them.
    pub no_motion: usize,
    /// Doubts about rates.
    pub doubts: RateDoubts,
    /// Other oddities by kind: the number of files, and the first as an example.
    pub warnings: BTreeMap<&'static str, (usize, String)>,
    /// Translation values that were clipped to the tokenizer's range.
    pub clipped: usize,
    /// Rotations that took a second code.
    pub second_codes: usize,
    /// Frames added to fill last tiles.
    pub padded: usize,
    /// Files with music.
    pub with_music: usize,
    /// Files with motion-derived beats.
    pub with_motion_beats: usize,
}

impl Summary {
    /// Notes for the user, one line each.
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

    /// Fails if nothing was taken, or a file was skipped and `strict` is set. A shard may well consist of bad files.
    fn check(&self, options: &BuildOptions, items: usize) -> Result<()> {
        let (failed, whole) = (self.failed.len(), options.shard.is_none());
        if let Some(Failure { name, why, .. }) =
            self.failed.first().filter(|_| options.strict || (whole && failed == items))
        {
            let strict = if options.strict { ", since `strict` is set" } else { "" };
            let what = format!("readable motion in {failed} of {items} files");
            return Err(Error::missing(what, format!("nothing was written{strict}; the first is {name}: {why}")));
        }
        if items == 0 && !options.excluded.is_empty() && whole {
            return Err(Error::missing(
                "clip is left",
                "the excluded ranges (`exclude`) cover all; nothing was written",
            ));
        }
        if self.clips == 0 && items > 0 && whole {
            return Err(Error::missing(format!("motion in any of {items} files"), "nothing was written"));
        }
        Ok(())
    }
}

/// Fits a tokenizer on the train clips of a dataset.
///
/// # Errors
/// [`kinelm_store::Error::Missing`] when no train clip could be taken, or a file is bad and `strict` is set;
/// [`kinelm_store::Error::Stopped`] when `progress` stopped it; [`Error::Tokenizer`] for settings outside their limits.
///
/// ```
/// use kinelm_corpus::{BuildOptions, Corpus, Dataset, fit, tokenize};
/// use kinelm_tokenizer::TokenizerConfig;
/// use std::ops::ControlFlow::Continue;
/// # let dir = tempfile::tempdir()?;
/// # let data = dir.path().join("dances");
/// # std::fs::create_dir(&data)?;
/// # for dance in kinelm_motion::synth::corpus(1, 4, 4.0, 20.0)? {
/// #     let path = data.join(dance.name() + ".bvh");
/// #     let motion = kinelm_motion::Motion::new(&path, dance.clip);
/// #     kinelm_motion::format::write(&path, &motion)?;
/// # }
/// let (dataset, options) = (Dataset::find(&[data], &[])?, BuildOptions::default());
/// let (tokenizer, _) = fit(&dataset, TokenizerConfig::default(), &options, &mut |_| Continue(()))?;
/// let out = dir.path().join("corpus");
/// tokenize(&dataset, &tokenizer, &out, &options, &mut |_| Continue(()))?;
/// assert_eq!(Corpus::open(&out)?.clips().len(), 4);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn fit(
    dataset: &Dataset,
    config: TokenizerConfig,
    options: &BuildOptions,
    progress: &mut BuildProgress<'_>,
) -> Result<(Tokenizer, Summary)> {
    let mut all = Fit::new(config.clone())?;
    let items: Vec<&Item> = dataset.items.iter().filter(|i| i.split == Split::Train).collect();
    if items.is_empty() {
        return Err(Error::missing("clip in the train split", "a tokenizer is fitted on that alone"));
    }
    let work = |item: &Item, loaded: &ItemClip| {
        // a fit of its own: clips are added in parallel, and merged in the order of the items
        let mut one = Fit::new(config.clone())?;
        one.add(&loaded.clip).map_err(of_clip(item))?;
        Ok((one, loaded.clip.frames()))
    };
    let summary = for_each_clip(
        &items,
        options,
        ClipSpec::from(&config),
        progress,
        work,
        |_, _, (one, frames), _| -> Result<_> {
            all.merge(&one)?;
            Ok(frames)
        },
    )?;
    Ok((all.finish()?, summary))
}

/// Tokenizes the clips of a dataset, or a shard of them, into a corpus folder at `out`. Clips whose labels change, or out
/// of which ranges are excluded, are split into segments.
///
/// # Errors
/// Those of [`CorpusWriter`]; [`kinelm_store::Error::Missing`] when no clip could be taken, or a file is bad and `strict` is
/// set; [`kinelm_store::Error::Stopped`] when `progress` stopped it. Nothing is written then.
pub fn tokenize(
    dataset: &Dataset,
    tokenizer: &Tokenizer,
    out: &Path,
    options: &BuildOptions,
    progress: &mut BuildProgress<'_>,
) -> Result<(Manifest, Summary)> {
    let mut writer = CorpusWriter::create(out, tokenizer, &dataset.sources, options.shard, options.force)?;
    let items = split_items(&dataset.items);
    let items: Vec<&Item> = items.iter().filter(|i| options.shard.is_none_or(|s| s.holds(i.key))).collect();
    let fps = tokenizer.fps();
    let library = options.music.as_ref().map(|folder| MusicLibrary::find(&items, folder, fps)).transpose()?;
    let work = |item: &Item, loaded: &ItemClip| {
        let (encoded, frames) = (tokenizer.encode(&loaded.clip).map_err(of_clip(item))?, loaded.clip.frames());
        let music = library.as_ref().map_or(Ok(None), |library| library.align(item, frames, loaded.clip.fps()))?;
        let (beats, music, tempo) = match music {
            Some(AlignedMusic { beats_s, features, tempo }) => {
                (Some(ClipBeats { source: BeatSource::Music, times_s: beats_s }), features, tempo)
            }
            None if options.motion_beats => {
                // a clip that was lowered has its floor at y = 0
                let beats = motion_beats::beats_s(&loaded.clip, loaded.floor_m.map(|_| 0.0))?;
                (beats.map(|times_s| ClipBeats { source: BeatSource::Motion, times_s }), Vec::new(), None)
            }
            None => (None, Vec::new(), None),
        };
        let ids = tokenizer.ids_of_words(&encoded.words)?;
        Ok(EncodedClip { ids, encoded, frames, floor_m: loaded.floor_m, beats, music, tempo })
    };
    let spec = tokenizer.config().into();
    let summary = for_each_clip(&items, options, spec, progress, work, |item, sha256, clip, summary| -> Result<_> {
        let EncodedClip { ids, encoded, frames, floor_m, beats, music, tempo } = clip;
        match beats.as_ref().map(|beats| beats.source) {
            Some(BeatSource::Music) => summary.with_music += 1,
            Some(BeatSource::Motion) => summary.with_motion_beats += 1,
            None => {}
        }
        let (clipped, second_codes) = (encoded.clipped as usize, encoded.second_codes as usize);
        summary.clipped += clipped;
        summary.second_codes += second_codes;
        summary.padded += encoded.padded as usize;
        let read = item.read_options(&options.read);
        let Item { name, mut labels, split, take, key, source, .. } = item.clone();
        if let Some(tempo) = tempo {
            // a tempo that the user's labels state wins
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
            // the writer sets these
            offset: 0,
            tokens: 0,
            music: None,
        };
        writer.push(NewClip { record, music }, &ids)?;
        Ok(frames)
    })?;
    summary.failed.iter().for_each(|f| writer.fail(f.clone()));
    writer.exclude(&options.excluded);
    Ok((writer.finish()?, summary))
}

/// An error of the tokenizer with the clip that it is about.
fn of_clip(item: &Item) -> impl FnOnce(kinelm_tokenizer::Error) -> Error {
    let in_clip = Error::in_clip(item.path.display());
    |e| in_clip(e.into())
}

/// A clip in words, with its beats and music.
struct EncodedClip {
    ids: Vec<u32>,
    encoded: Encoded,
    frames: usize,
    floor_m: Option<f64>,
    beats: Option<ClipBeats>,
    /// (N, 35) the features of its music.
    music: Vec<f32>,
    tempo: Option<String>,
}

/// Loads every item and calls `work` on its clip, in parallel; calls `take` on the results in the order of the items, with
/// the hash of the item's file. `take` returns the frames of the clip.
///
/// # Errors
/// Those of `take`; those of `work` and of loading skip the item. [`kinelm_store::Error::Missing`] when no clip could be
/// taken, or a file is bad and `strict` is set; [`kinelm_store::Error::Stopped`] when `progress` stopped it.
pub fn for_each_clip<T: Send, E: From<Error> + Display + Send>(
    items: &[&Item],
    options: &BuildOptions,
    spec: ClipSpec,
    progress: &mut BuildProgress<'_>,
    work: impl Fn(&Item, &ItemClip) -> Result<T, E> + Sync,
    mut take: impl FnMut(&Item, String, T, &mut Summary) -> Result<usize, E>,
) -> Result<Summary, E> {
    let files = SegmentedFiles::default();
    let one = |item: &Item| {
        let loaded = match item.segment {
            Some(_) => files.load(item, &options.read, spec),
            None => ItemClip::load(item, &options.read, spec),
        };
        let loaded = match loaded {
            Ok(loaded) => loaded,
            Err(Error::Motion(e)) if e.fault() == Some(FaultKind::NoMotion) => return Worked::NoMotion,
            Err(e) => return Worked::Failed(e.to_string()),
        };
        if loaded.clip.frames() == 0 {
            // the file ends before the segment begins
            return Worked::Ended;
        }
        match work(item, &loaded) {
            Ok(result) => Worked::Done(result, loaded.sha256, loaded.warnings, loaded.rate),
            Err(e) => Worked::Failed(e.to_string()),
        }
    };
    let mut summary = Summary::default();
    let (mut done, mut warned, mut read) = (0, BTreeSet::new(), HashSet::new());
    for block in items.chunks(BLOCK_PER_THREAD * rayon::current_num_threads()) {
        let results: Vec<_> = block.par_iter().map(|item| one(item)).collect();
        // only the block's last file can have segments in the next block: items are in the order of files
        files.retain(block[block.len() - 1]);
        for (item, result) in block.iter().zip(results) {
            done += 1;
            let mut flow = ControlFlow::Continue(());
            match result {
                Worked::Ended => {}
                Worked::Done(result, sha256, warnings, rate) => {
                    // a file of several segments has one rate to doubt
                    if read.insert(&item.path) {
                        summary.doubts.add(&item.file_name(), rate);
                    }
                    for warning in warnings.into_iter().filter(|warning| !RateDoubt::is_warning(warning)) {
                        let first = || (0, format!("{}: {}", item.name, warning.what));
                        let entry = summary.warnings.entry(warning.kind).or_insert_with(first);
                        // every segment of a file brings the file's warnings
                        entry.0 += usize::from(warned.insert((warning.kind, &item.path)));
                    }
                    summary.frames += take(item, sha256, result, &mut summary)?;
                    summary.clips += 1;
                }
                Worked::NoMotion => summary.no_motion += 1,
                Worked::Failed(why) => {
                    flow = progress(BuildEvent::Failed { item, why: &why });
                    summary.failed.push(Failure { key: item.key, name: item.name.clone(), why });
                }
            }
            let of = items.len();
            if flow.is_break() || progress(BuildEvent::Done { done, of, frames: summary.frames }).is_break() {
                return Err(Error::stopped(format!("stopped after {done} of {of} files; nothing was written")).into());
            }
        }
    }
    summary.check(options, items.len())?;
    Ok(summary)
}

/// The result of an item.
enum Worked<T> {
    /// Its result, the hash of its file, and what reading it found.
    Done(T, String, Vec<Warning>, FileRate),
    /// The file ends where the last labels do.
    Ended,
    /// A file of the right format without motion.
    NoMotion,
    /// Reading or the work failed.
    Failed(String),
}

/// Files of which several segments are taken; each is read once.
#[derive(Default)]
struct SegmentedFiles(Mutex<HashMap<PathBuf, Arc<OnceLock<Option<ItemClip>>>>>);

impl SegmentedFiles {
    fn load(&self, item: &Item, options: &ReadOptions, spec: ClipSpec) -> Result<ItemClip> {
        let cell = self.lock().entry(item.path.clone()).or_default().clone();
        match cell.get_or_init(|| ItemClip::load_file(item, options, spec).ok()) {
            Some(whole) => whole.segment(item),
            // every segment reports the error
            None => ItemClip::load(item, options, spec),
        }
    }

    /// Drops all files but the item's, of which the next block may take another segment.
    fn retain(&self, item: &Item) {
        self.lock().retain(|path, _| *path == item.path);
    }

    fn lock(&self) -> MutexGuard<'_, HashMap<PathBuf, Arc<OnceLock<Option<ItemClip>>>>> {
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Corpus, merge, samples};
    use kinelm_motion::{Clip, Motion, Quat, Vec3, format};
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
            let motion = Motion::new(&path, samples::walk(3 + i));
            format::write(&path, &motion).unwrap();
            csv += &format!("walk{i},{},walk\n", ["train", "train", "test", "valid"][i % 4]);
        }
        fs::write(dir.join("walk3b.bvh"), "HIERARCHY\nROOT").unwrap();
        let labels = tmp.path().join("labels.csv");
        fs::write(&labels, csv).unwrap();
        (tmp, dir, labels.display().to_string())
    }

    #[test]
    fn the_rates_of_a_folder_are_doubted_together() {
        let tmp = tempfile::tempdir().unwrap();
        let dir = tmp.path().join("data");
        fs::create_dir(&dir).unwrap();
        for (name, falls) in [("falls", true), ("walks", false), ("stated", false)] {
            let path = dir.join(format!("{name}.bvh"));
            let walk = samples::walk(240);
            let y = |f: usize| if falls { 30.0 - 4.9 * (f as f64 / 60.0).powi(2) } else { 0.97 };
            let root = walk.root().iter().enumerate().map(|(f, p)| Vec3::new(p.x, y(f), p.z)).collect();
            let clip = Clip::new(walk.skeleton().clone(), 120.0, root, walk.rotations().to_vec()).unwrap();
            format::write(&path, &Motion::new(&path, clip)).unwrap();
        }
        let csv = tmp.path().join("labels.csv");
        fs::write(&csv, "clip,split,fps\nfalls,train,\nwalks,train,\nstated,train,120\n").unwrap();
        let dataset = Dataset::find(&[dir], &[csv.display().to_string()]).unwrap();
        let config = TokenizerConfig::uniform(&[0, 1, 2], 20.0, 90);
        let (_, summary) = fit(&dataset, config, &BuildOptions::default(), &mut go).unwrap();
        let line = summary.doubts.line().unwrap();
        assert!(line.starts_with("2 of 3 files doubt their rates: 1 by how they fall, falls"), "{line}");
        assert!(line.ends_with("`--fps-source 60` is for all"), "{line}");
    }

    #[test]
    fn a_file_in_segments_is_counted_once() {
        let tmp = tempfile::tempdir().unwrap();
        let (clip, path) = (samples::walk(40), tmp.path().join("w.bvh"));
        // the rest pose, and then a constant pose
        let turned = Quat::from_rotation_z(1.0);
        let rotation = |i: usize| if i < clip.joints() || i % clip.joints() != 16 { Quat::IDENTITY } else { turned };
        let rotations = (0..40 * clip.joints()).map(rotation).collect();
        let clip = Clip::new(clip.skeleton().clone(), clip.fps(), clip.root().to_vec(), rotations).unwrap();
        let motion = Motion::new(&path, clip);
        format::write(&path, &motion).unwrap();
        let csv = tmp.path().join("labels.csv");
        fs::write(&csv, "clip,split,kind,from_s,to_s\nw,train,a,0,0.5\nw,train,b,0.5,\n").unwrap();
        let dataset = Dataset::find(&[path], &[csv.display().to_string()]).unwrap();
        let config = TokenizerConfig::uniform(&[0, 1, 2], 20.0, 90);
        let options = BuildOptions::default();
        let (tokenizer, _) = fit(&dataset, config, &options, &mut go).unwrap();
        let (_, summary) = tokenize(&dataset, &tokenizer, &tmp.path().join("c"), &options, &mut go).unwrap();
        assert_eq!((summary.clips, summary.warnings["rest_frame"].0), (2, 1), "{summary:?}");
    }

    fn go(_: BuildEvent<'_>) -> ControlFlow<()> {
        ControlFlow::Continue(())
    }

    fn bytes(dir: &Path) -> Vec<Vec<u8>> {
        ["corpus.json", "clips.jsonl", "tokens.u16", "tokenizer.json"].map(|f| fs::read(dir.join(f)).unwrap()).into()
    }

    #[test]
    fn files_become_a_corpus_and_shards_merge_to_the_same_bytes() {
        let (tmp, dir, labels) = data();
        let dataset = Dataset::find(&[dir], &[labels]).unwrap();
        let options = BuildOptions::default();
        let config = TokenizerConfig::uniform(&[0, 1, 2], 20.0, 90);
        let (tokenizer, summary) = fit(&dataset, config.clone(), &options, &mut go).unwrap();
        assert_eq!((summary.clips, summary.failed.len()), (4, 0), "{summary:?}");

        let whole = tmp.path().join("whole");
        let mut failed = Vec::new();
        let mut progress = |e: BuildEvent<'_>| {
            if let BuildEvent::Failed { item, .. } = e {
                failed.push(item.name.clone());
            }
            ControlFlow::Continue(())
        };
        let (manifest, summary) = tokenize(&dataset, &tokenizer, &whole, &options, &mut progress).unwrap();
        assert_eq!(failed, ["walk3b"]);
        assert_eq!((manifest.count.clips, manifest.count.frames, summary.frames), (7, 42, 42));
        assert_eq!(manifest.failed[0].key, 4);
        assert!(manifest.failed[0].why.contains("walk3b.bvh"), "{}", manifest.failed[0].why);

        let corpus = Corpus::open(&whole).unwrap();
        let clip = ItemClip::load(&dataset.items[0], &options.read, tokenizer.config().into()).unwrap().clip;
        assert_eq!(corpus.clip_words(&corpus.clips()[0]).unwrap(), tokenizer.encode(&clip).unwrap().words);

        for of in [1, 3, 20] {
            let shards: Vec<PathBuf> = (0..of)
                .map(|index| {
                    let out = tmp.path().join(format!("shard-{index}-{of}"));
                    let options = BuildOptions { shard: Some(Shard { index, of }), ..options.clone() };
                    tokenize(&dataset, &tokenizer, &out, &options, &mut go).unwrap();
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
        let dataset = Dataset::find(&[dir], &[labels]).unwrap();
        let make = |threads: usize| {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build().unwrap();
            let out = tmp.path().join(format!("c{threads}"));
            pool.install(|| {
                let options = BuildOptions::default();
                let (t, _) = fit(&dataset, TokenizerConfig::default(), &options, &mut go).unwrap();
                tokenize(&dataset, &t, &out, &options, &mut go).unwrap();
            });
            bytes(&out)
        };
        assert_eq!(make(1), make(3));
    }

    #[test]
    fn strict_and_stopped_runs_write_nothing() {
        let (tmp, dir, labels) = data();
        let dataset = Dataset::find(&[dir], &[labels]).unwrap();
        let out = tmp.path().join("c");
        let before = fs::read_dir(tmp.path()).unwrap().count();
        let strict = BuildOptions { strict: true, ..BuildOptions::default() };
        let e = tokenize(&dataset, &samples::tokenizer(), &out, &strict, &mut go).unwrap_err().to_string();
        assert!(
            e.starts_with(
                "no readable motion in 1 of 8 files; nothing was written, since `strict` is set; the first is walk3b"
            ),
            "{e}"
        );
        let mut stop = |e: BuildEvent<'_>| match e {
            BuildEvent::Done { done: 2, .. } => ControlFlow::Break(()),
            _ => ControlFlow::Continue(()),
        };
        let e = tokenize(&dataset, &samples::tokenizer(), &out, &BuildOptions::default(), &mut stop).unwrap_err();
        assert!(e.to_string().contains("stopped after 2 of 8 files"), "{e}");
        assert_eq!(fs::read_dir(tmp.path()).unwrap().count(), before);
    }

    #[test]
    fn only_bad_files_are_an_error() {
        let tmp = tempfile::tempdir().unwrap();
        fs::write(tmp.path().join("a.bvh"), "").unwrap();
        let dataset = Dataset::find(&[tmp.path().into()], &[]).unwrap();
        let out = tmp.path().join("c");
        let e = tokenize(&dataset, &samples::tokenizer(), &out, &BuildOptions::default(), &mut go).unwrap_err();
        assert!(e.to_string().contains("1 of 1 files") && e.to_string().contains("a.bvh"), "{e}");
    }
}
