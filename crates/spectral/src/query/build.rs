//! From motion files to an index, or to more of one.

use super::embedding::Models;
use super::extract::{Extracted, FeatureExtractor, fit_of};
use super::index::{BASIS, Index, MANIFEST};
use super::options::{FeatureKind, IndexOptions};
use super::record::{ClipEntry, Manifest, PartRecord, VERSION};
use super::writer::PartWriter;
use crate::pca::PcaFit;
use crate::{Error, PcaBasis, Result, WindowSpec};
pub use kinelm_corpus::build::{BuildEvent, BuildOptions, BuildProgress, Summary, for_each_clip};
use kinelm_corpus::load::ClipSpec;
use kinelm_corpus::{Dataset, Item};
use kinelm_store::FileRecord;
use kinelm_store::files::{self, PendingFolder};
use std::fs::{File, TryLockError};
use std::path::{Path, PathBuf};

/// The options of an index. Those left out are taken from the existing index, or from `IndexOptions::new`.
#[derive(Debug, Clone, Default)]
pub struct IndexRequest {
    /// The feature that windows are compared by; DCT unless said.
    pub transform: Option<FeatureKind>,
    /// Frames of a window.
    pub frames: Option<usize>,
    /// Frames from a window to the next.
    pub hop: Option<usize>,
    /// Frames per second.
    pub fps: Option<f64>,
    /// SMPL joints.
    pub joints: Option<Vec<usize>>,
    /// Canonical rotation vectors.
    pub raw: Option<bool>,
    /// How the model of the transform is opened.
    pub models: Models,
}

impl IndexRequest {
    /// The options, laid over those of an index that is there.
    pub fn over(&self, there: Option<&IndexOptions>) -> IndexOptions {
        let mut options = there.cloned().unwrap_or_else(|| IndexOptions::new(FeatureKind::dct()));
        let IndexRequest { transform, frames, hop, fps, joints, raw, .. } = self.clone();
        options.transform = transform.unwrap_or(options.transform);
        options.windows.frames = frames.unwrap_or(options.windows.frames);
        options.windows.hop = hop.unwrap_or(options.windows.hop);
        options.windows.fps = fps.unwrap_or(options.windows.fps);
        options.joints = joints.unwrap_or(options.joints);
        options.raw = raw.unwrap_or(options.raw);
        options
    }
}

/// The result of a build.
#[derive(Debug, Clone, PartialEq)]
pub struct BuildReport {
    /// Of the files that were read.
    pub summary: Summary,
    /// How windows are cut and what is held of them.
    pub options: IndexOptions,
    /// Clips and windows that were added.
    pub added: (usize, usize),
    /// Clips that were in the index already.
    pub known: usize,
    /// Clips that were in it, read in another way, and were added again.
    pub otherwise: usize,
    /// Clips shorter than a window.
    pub short: usize,
    /// Windows of the index now.
    pub windows: usize,
    /// Share of the windows' variance that a fitted basis holds.
    pub explained: Option<f64>,
}

impl BuildReport {
    /// Notes for the user, one line each.
    pub fn lines(&self) -> Vec<String> {
        let mut lines = self.summary.lines();
        let seconds = self.options.windows.seconds();
        for (count, what) in [
            (self.known, "clips are in the index already and are left as they are, their labels too".to_string()),
            (
                self.otherwise,
                "clips are in the index already, read at another rate or with other options: now twice".to_string(),
            ),
            (self.short, format!("clips are shorter than a window of {seconds:.3} s and are left out")),
        ] {
            if count > 0 {
                lines.push(format!("{count} {what}"));
            }
        }
        if let Some(share) = self.explained {
            lines.push(format!("the basis holds {:.2} % of the windows' variance", 100.0 * share));
        }
        lines
    }
}

impl Index {
    /// Builds an index at `out`, or adds to the one that is there the clips that it doesn't have: those of other files, or of
    /// the same files read otherwise. The basis of a fitted transform is that of the index's beginning.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Invalid`] where `request` differs from the index that is there, when no clip is as long as a window, or any file is bad
    /// and `strict` is given, or `watch` broke off; those of reading, of a run, and of writing. Nothing is changed then.
    pub fn build(
        dataset: &Dataset,
        request: &IndexRequest,
        options: &BuildOptions,
        out: &Path,
        watch: &mut BuildProgress<'_>,
    ) -> Result<BuildReport> {
        let (there, _alone) = match std::fs::symlink_metadata(out) {
            Ok(_) => {
                if !out.join(MANIFEST).is_file() {
                    return Err(Error::taken(out, "exists and is no index; give another folder"));
                }
                let alone = alone(out)?;
                (Some(Index::open(out)?), alone)
            }
            Err(_) => (None, None),
        };
        let held = request.over(there.as_ref().map(Index::options));
        held.validate()?;
        if let Some(index) = &there {
            same_options(out, index.options(), &held)?;
        }
        let basis = match (&there, &held.transform) {
            // never fitted again: the features that are there are coordinates in it
            (Some(index), _) => index.basis().cloned(),
            (None, FeatureKind::Pca { keep }) => Some(fit(dataset, &held, *keep, options, watch)?),
            _ => None,
        };
        let mut work = Work::begin(out, there.as_ref())?;
        let mut built = BuildReport {
            summary: Summary::default(),
            options: held.clone(),
            added: (0, 0),
            known: 0,
            otherwise: 0,
            short: 0,
            windows: 0,
            explained: basis
                .as_ref()
                .map(|b| b.variances.iter().sum::<f64>() / b.total_variance.max(f64::MIN_POSITIVE)),
        };
        let extractor = FeatureExtractor::new(&held, basis.as_ref(), request.models)?;
        let part = write_part(dataset, &extractor, options, &work, &mut built, watch)?;
        let Some(part) = part else {
            // all clips known is no error: an addition that is repeated changes nothing
            if built.known == 0 {
                return Err(no_window(&held.windows));
            }
            built.windows = there.map_or(0, |index| index.database().windows());
            return Ok(built);
        };
        let basis = basis.map(|b| serde_json::to_vec(&b).expect("a basis has text keys"));
        let manifest = match there {
            Some(index) => {
                let mut manifest = index.manifest().clone();
                manifest.parts.push(part);
                manifest
            }
            None => Manifest {
                version: VERSION,
                program: env!("CARGO_PKG_VERSION").into(),
                options: held,
                numbers: extractor.numbers(),
                basis: basis.as_deref().map(FileRecord::of),
                parts: vec![part],
            },
        };
        built.windows = manifest.parts.iter().map(|p| p.windows).sum();
        work.finish(&manifest, basis.as_deref())?;
        Ok(built)
    }
}

/// Locks an existing index against other builds, while the returned file lives.
///
/// # Errors
/// Another build that adds to it; a folder that can't be opened.
fn alone(out: &Path) -> Result<Option<File>> {
    if cfg!(not(unix)) {
        return Ok(None); // only there folders are locked
    }
    let folder = File::open(out).map_err(Error::io(out))?;
    match folder.try_lock() {
        Err(TryLockError::WouldBlock) => {
            let why = "another build adds to it; build again when that is done";
            Err(Error::io(out)(std::io::Error::new(std::io::ErrorKind::ResourceBusy, why)))
        }
        // file systems without locks can't tell
        _ => Ok(Some(folder)),
    }
}

fn same_options(out: &Path, there: &IndexOptions, requested: &IndexOptions) -> Result<()> {
    let differ = there.differences(requested);
    if differ.is_empty() {
        return Ok(());
    }
    let list = |of: fn(&(&str, String, String)) -> String| differ.iter().map(of).collect::<Vec<_>>().join(", ");
    let found = format!("an index of {}", list(|(name, there, _)| format!("{name} {there}")));
    let expected = list(|(name, _, requested)| format!("{name} {requested}"));
    let help = "leave these options out to add to it, or give another folder";
    Err(Error::file(out, found, format!("{expected}, as requested"), help))
}

/// A basis for all windows of the clips.
fn fit(
    dataset: &Dataset,
    held: &IndexOptions,
    keep: usize,
    options: &BuildOptions,
    watch: &mut BuildProgress<'_>,
) -> Result<PcaBasis> {
    let items: Vec<&Item> = dataset.items.iter().collect();
    let mut all = PcaFit::new(held.windows.frames);
    let mut windows = 0;
    for_each_clip(
        &items,
        options,
        ClipSpec::in_world(held.windows.fps),
        watch,
        |_, loaded| {
            let starts: Vec<usize> = held.windows.starts(loaded.clip.frames(), 0).collect();
            Ok((fit_of(&loaded.clip, &starts, held)?, starts.len(), loaded.clip.frames()))
        },
        |_, _, (one, count, frames), _| -> Result<_> {
            all.merge(&one);
            windows += count;
            Ok(frames)
        },
    )?;
    if windows == 0 {
        return Err(no_window(&held.windows));
    }
    all.finish(keep)
}

/// No clip has a window.
pub(super) fn no_window(windows: &WindowSpec) -> Error {
    let what = format!("clip as long as a window of {} frames ({:.3} s)", windows.frames, windows.seconds());
    Error::missing(what, "give longer clips or a shorter window")
}

/// Writes the windows of the clips that are new; `None` where there are none.
fn write_part(
    dataset: &Dataset,
    extractor: &FeatureExtractor,
    options: &BuildOptions,
    work: &Work,
    built: &mut BuildReport,
    watch: &mut BuildProgress<'_>,
) -> Result<Option<PartRecord>> {
    let spec = built.options.windows;
    let mut writer = PartWriter::create(&work.part()?, extractor.numbers())?;
    let items: Vec<&Item> = dataset.items.iter().collect();
    let (mut known, mut otherwise, mut short, mut clips) = (0, 0, 0, 0);
    built.summary = for_each_clip(
        &items,
        options,
        ClipSpec::in_world(spec.fps),
        watch,
        |_, loaded| {
            let starts: Vec<usize> = spec.starts(loaded.clip.frames(), 0).collect();
            Ok((extractor.extract(&loaded.clip, &starts)?, starts, loaded.clip.frames()))
        },
        |item, sha256, (made, starts, frames): (Extracted, Vec<usize>, usize), _| -> Result<_> {
            let read = item.read_options(&options.read);
            otherwise += usize::from(work.known.iter().any(|c| c.sha256 == sha256));
            if work.known.iter().any(|c| c.is_of(&sha256, &read, frames)) {
                (known, otherwise) = (known + 1, otherwise - 1);
            } else if starts.is_empty() {
                short += 1;
            } else {
                clips += 1;
                let path = std::path::absolute(&item.path).map_err(Error::io(&item.path))?;
                let Item { name, take, labels, .. } = item.clone();
                let entry = ClipEntry { name, path, sha256, read, take, labels, frames, starts };
                writer.push(&entry, &extractor.embed(made)?)?;
            }
            Ok(frames)
        },
    )?;
    (built.known, built.otherwise, built.short) = (known, otherwise, short);
    built.added = (clips, writer.windows());
    if clips == 0 {
        return Ok(None);
    }
    Ok(Some(writer.finish()?))
}

/// Where a build writes: into the index that is there, or into a new folder that is renamed at the end.
struct Work {
    out: PathBuf,
    /// The new folder, until it has its name.
    folder: Option<PendingFolder>,
    /// `index.json` when the work began.
    there: Option<Manifest>,
    known: Vec<ClipEntry>,
}

impl Work {
    fn begin(out: &Path, there: Option<&Index>) -> Result<Work> {
        let mut work = Work { out: out.to_owned(), folder: None, there: None, known: Vec::new() };
        match there {
            Some(index) => {
                work.there = Some(index.manifest().clone());
                work.known = index.database().clips().to_vec();
            }
            None => work.folder = Some(PendingFolder::create(out)?),
        }
        Ok(work)
    }

    /// The folder of the next part.
    fn part(&self) -> Result<PathBuf> {
        let number = 1 + self.there.as_ref().map_or(0, |m| m.parts.len());
        let place = self.folder.as_ref().map_or(&*self.out, PendingFolder::path).join(format!("part-{number:04}"));
        if place.exists() {
            // a build ended after it renamed this part and before index.json named it
            std::fs::remove_dir_all(&place).map_err(Error::io(&place))?;
        }
        Ok(place)
    }

    /// Names the parts, and puts a new index in its place.
    fn finish(&mut self, manifest: &Manifest, basis: Option<&[u8]>) -> Result<()> {
        let text = serde_json::to_string_pretty(manifest).expect("a manifest has text keys") + "\n";
        let Some(folder) = self.folder.take() else {
            // where the folder can't be locked, another build may have been quicker
            if Some(super::index::read_manifest(&self.out)?) != self.there {
                let help = "another build added to it meanwhile: build again";
                return Err(Error::file(
                    self.out.join(MANIFEST),
                    "another index",
                    "the one the build began with",
                    help,
                ));
            }
            return Ok(files::write_whole(&self.out.join(MANIFEST), text.as_bytes())?);
        };
        if let Some(basis) = basis {
            folder.write(BASIS, basis)?;
        }
        // last: a folder with it is an index
        folder.write(MANIFEST, text.as_bytes())?;
        Ok(folder.commit("build again to add to it")?)
    }
}
