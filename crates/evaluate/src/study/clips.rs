//! The motion that a study is about: read once to know it, then as often as it is needed.

use crate::{Error, Result};
pub use kinelm_corpus::build::{BLOCK_PER_THREAD, BuildOptions};
use kinelm_corpus::load::load_at_own_rate;
use kinelm_corpus::record::Split;
use kinelm_corpus::{Dataset, Item};
use kinelm_motion::format::{FileRate, RateDoubts, ReadOptions};
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::{Clip, FaultKind, Quat, Vec3, smpl};
use kinelm_store::hash::hex;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::HashMap;
use std::sync::{Arc, Mutex, PoisonError};

/// Bytes of clips that stay in memory between rows; beyond that, files are read again.
const HELD_BYTES: usize = 512 << 20;

/// A file that holds motion.
#[derive(Debug, Clone)]
pub struct StudyClip {
    item: Item,
    /// Frames per second of the file.
    pub fps: f64,
    /// Its frames, without those that are skipped.
    pub frames: usize,
    /// SHA-256 of the clip's numbers on the model's rig.
    pub sha256: String,
}

impl StudyClip {
    /// The clip's name.
    pub fn name(&self) -> &str {
        &self.item.name
    }
}

/// How much motion a part of the data holds.
#[derive(Debug, Clone, Copy, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Extent {
    /// Clips.
    pub clips: usize,
    /// Frames at the files' own rates.
    pub frames: u64,
    /// Seconds.
    pub seconds: f64,
}

impl Extent {
    fn of(known: &[StudyClip]) -> Self {
        let seconds = known.iter().map(|k| k.frames as f64 / k.fps).sum();
        Extent { clips: known.len(), frames: known.iter().map(|k| k.frames as u64).sum(), seconds }
    }
}

/// The train and test clips, on the 24 SMPL joints of the neutral skeleton.
#[derive(Debug)]
pub struct Clips {
    /// What tokenizers are fitted on.
    pub train: Vec<StudyClip>,
    /// What figures are measured on.
    pub test: Vec<StudyClip>,
    /// Doubts of their rates.
    pub doubts: RateDoubts,
    read: ReadOptions,
    held: Mutex<ClipCache>,
}

#[derive(Debug, Default)]
struct ClipCache {
    bytes: usize,
    clips: HashMap<(usize, u64), Arc<Clip>>,
}

impl Clips {
    /// Reads every train and test file once. What can't be taken is given to `left_out` and passed over.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Missing`] when no clip of train or none of test could be taken, or any file is bad and `strict` is given.
    pub fn scan(dataset: &Dataset, options: &BuildOptions, left_out: &mut dyn FnMut(&Item, &Error)) -> Result<Clips> {
        let mut clips = Clips {
            train: vec![],
            test: vec![],
            doubts: RateDoubts::default(),
            read: options.read.clone(),
            held: Mutex::default(),
        };
        let items: Vec<&Item> = dataset.items.iter().filter(|i| i.split != Split::Valid).collect();
        let mut failed = 0;
        for block in items.chunks(block()) {
            let known: Vec<_> = block.par_iter().map(|item| know(item, &options.read)).collect();
            for (item, known) in block.iter().zip(known) {
                if let Ok((_, rate)) = &known {
                    clips.doubts.add(&item.file_name(), rate.clone());
                }
                match known.map(|(known, _)| known) {
                    Ok(known) if item.split == Split::Train => clips.train.push(known),
                    Ok(known) => clips.test.push(known),
                    // the file is sound and holds no motion: no failure, even when strict
                    Err(Error::Motion(e)) if e.fault() == Some(FaultKind::NoMotion) => {}
                    Err(e) => {
                        failed += 1;
                        left_out(item, &e);
                    }
                }
            }
        }
        if failed > 0 && options.strict {
            let of = items.len();
            return Err(Error::invalid_parameter(
                "strict",
                true,
                format!("no bad file; {failed} of {of} could not be read"),
            ));
        }
        for (split, known) in [(Split::Train, &clips.train), (Split::Test, &clips.test)] {
            if known.is_empty() {
                let help = "a study fits on train and measures on test; labels state splits";
                return Err(Error::missing(format!("clip in the {split} split"), help));
            }
        }
        Ok(clips)
    }

    /// The slowest rate among the files.
    pub fn slowest(&self) -> f64 {
        self.train.iter().chain(&self.test).map(|k| k.fps).fold(f64::INFINITY, f64::min)
    }

    /// The rates of the files, each once, slowest first.
    pub fn rates(&self) -> Vec<f64> {
        let mut rates: Vec<f64> = self.train.iter().chain(&self.test).map(|k| k.fps).collect();
        rates.sort_by(f64::total_cmp);
        rates.dedup();
        rates
    }

    /// How much motion there is to fit on and to measure on.
    pub fn extents(&self) -> [Extent; 2] {
        [Extent::of(&self.train), Extent::of(&self.test)]
    }

    /// SHA-256 of all clips' numbers, in their order.
    pub fn sha256(&self) -> String {
        let mut hash = Sha256::new();
        // names of one length: a clip that changes its part changes the hash
        for (part, known) in [(b"train", &self.train), (b"test_", &self.test)] {
            hash.update(part);
            known.iter().for_each(|k| hash.update(k.sha256.as_bytes()));
        }
        hex(hash)
    }

    /// A clip at `fps` frames per second, beginning above x = z = 0.
    ///
    /// # Errors
    /// What reading, retargeting and resampling fail with.
    pub fn get(&self, known: &StudyClip, fps: f64) -> Result<Arc<Clip>> {
        let key = (known.item.key, fps.to_bits());
        let held = || self.held.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(clip) = held().clips.get(&key) {
            return Ok(clip.clone());
        }
        let clip = Arc::new(resample(&load(&known.item, &self.read)?.0, fps, Method::Auto)?);
        let bytes = clip.frames() * (clip.joints() * size_of::<Quat>() + size_of::<Vec3>());
        let mut held = held();
        // two threads may load the same clip at once; only the first counts
        if held.bytes + bytes <= HELD_BYTES && held.clips.insert(key, clip.clone()).is_none() {
            held.bytes += bytes;
        }
        Ok(clip)
    }
}

/// Files of a block: as in [`kinelm_corpus::build`].
fn block() -> usize {
    BLOCK_PER_THREAD * rayon::current_num_threads()
}

/// Works on clips side by side and takes the results in order, few at a time.
///
/// # Errors
/// The first that `work` or `take` fails with.
pub fn each<T: Send>(
    known: &[StudyClip],
    work: impl Fn(&StudyClip) -> Result<T> + Sync,
    mut take: impl FnMut(T) -> Result<()>,
) -> Result<()> {
    for block in known.chunks(block()) {
        let made: Vec<Result<T>> = block.par_iter().map(|k| work(k).map_err(|e| named(k, e))).collect();
        made.into_iter().try_for_each(|one| take(one?))?;
    }
    Ok(())
}

/// An error of the tokenizer with the file it is about.
fn named(known: &StudyClip, error: Error) -> Error {
    match error {
        Error::Tokenizer(e) => Error::unsupported(known.item.path.display().to_string(), e.to_string()),
        other => other,
    }
}

/// A clip on the neutral skeleton at its own rate, its floor at y = 0, beginning above x = z = 0; and what the file says of
/// that rate.
fn load(item: &Item, read: &ReadOptions) -> Result<(Clip, FileRate)> {
    let (clip, rate) = load_at_own_rate(item, read, true)?;
    let Some(first) = clip.root().first() else {
        return Err(Error::file(&item.path, "no frames", "at least one", ""));
    };
    let away = Vec3::new(first.x, 0.0, first.z);
    let root = clip.root().iter().map(|p| *p - away).collect();
    Ok((Clip::new(smpl::neutral(), clip.fps(), root, clip.rotations().to_vec())?, rate))
}

fn know(item: &Item, read: &ReadOptions) -> Result<(StudyClip, FileRate)> {
    let (clip, rate) = load(item, read)?;
    let mut hash = Sha256::new();
    hash.update(clip.fps().to_le_bytes());
    let mut bytes = Vec::with_capacity(clip.joints() * 32);
    for f in 0..clip.frames() {
        bytes.clear();
        bytes.extend(clip.root()[f].to_array().iter().flat_map(|x| x.to_le_bytes()));
        bytes.extend(clip.pose(f).iter().flat_map(|q| q.to_array()).flat_map(f64::to_le_bytes));
        hash.update(&bytes);
    }
    let (fps, frames) = (clip.fps(), clip.frames());
    Ok((StudyClip { item: item.clone(), fps, frames, sha256: hex(hash) }, rate))
}
