//! Clips with their music: rotations at the file's own rate, and 30 spectra a second.

use super::SPECTRUM;
use super::config::{Audio, Config};
use crate::data::{Hashes, Recording, Recordings, Sources};
use crate::form::{Coder, Form};
use crate::{Error, FPS, Result};
use kinelm_corpus::Split;
use kinelm_corpus::music::library::MusicFinder;
use kinelm_music::stft::stft;
use kinelm_store::hash;
use rayon::prelude::*;
use serde::{Deserialize, Serialize};
use sha2::{Digest, Sha256};
use std::collections::BTreeMap;
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Spectra that music may lack at its end; the last one is repeated.
const SLACK: usize = 15;
/// Spectra without a larger number are silence.
const SILENT: f32 = 1e-3;

/// Where a run's motion and music are.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MusicSources {
    /// The folder of the music.
    pub music: PathBuf,
    /// The motion.
    pub motion: Sources,
}

impl MusicSources {
    /// With other paths.
    pub(crate) fn with_paths(&self, path: impl Fn(&Path) -> PathBuf) -> MusicSources {
        MusicSources { music: path(&self.music), motion: self.motion.with_paths(&path) }
    }
}

/// A clip with its music.
pub struct MusicClip {
    /// The clip.
    pub recording: Recording,
    /// (F, 4J) unit quaternions as w, x, y, z, their signs continuous, at the clip's own rate.
    pub poses: Vec<f32>,
    /// The music's file.
    pub music: PathBuf,
    /// (n, N) spectra, FPS of them a second.
    pub spectra: Vec<f32>,
    /// The music's time at the clip's first frame, and that of the first spectrum, in spectra.
    from: f64,
    first: usize,
}

impl MusicClip {
    /// The spectrum at a frame of the clip.
    pub fn at(&self, frame: usize) -> &[f32] {
        let time = self.from + frame as f64 * FPS / self.recording.clip.fps();
        // music may end up to [`SLACK`] spectra early: the last one is repeated
        let at = (time.round() as usize).saturating_sub(self.first).min(self.spectra.len() / SPECTRUM - 1);
        &self.spectra[at * SPECTRUM..][..SPECTRUM]
    }

    /// (T, N) the spectra of the clip's frames at the network's rate.
    pub(crate) fn at_rate(&self) -> Vec<f32> {
        (0..self.recording.frames()).flat_map(|f| self.at(f * self.recording.stride)).copied().collect()
    }
}

/// The clips of a run that have music.
pub struct MusicClips {
    /// In the order of their names.
    pub all: Vec<MusicClip>,
    /// One hash of all motion and music files, and of the times at which clips begin.
    pub sha256: String,
    /// SHA-256 of each of these files.
    pub files: Hashes,
    /// What the user should know.
    pub notes: Vec<String>,
}

impl MusicClips {
    /// Reads the music of the clips that `is_used` selects.
    ///
    /// # Errors
    /// A missing folder, or file that a label names; music that can't be read, is silent, or ends before the dance; no clip
    /// with music.
    pub fn load(
        recordings: &Recordings,
        sources: &MusicSources,
        audio: Audio,
        margin: usize,
        is_used: impl Fn(&Recording) -> bool,
    ) -> Result<MusicClips> {
        let folder = &sources.music;
        if !folder.is_dir() {
            return Err(Error::file(folder, "no folder", "one that holds music", "see docs/baselines.md"));
        }
        let coder = Coder::new(Form::Quaternion, &recordings.rig)?;
        let (mut all, mut without, mut hash) = (Vec::new(), Vec::new(), Sha256::new());
        hash.update(recordings.sha256());
        let (mut hashes, mut finder): (BTreeMap<PathBuf, String>, _) = (BTreeMap::new(), MusicFinder::new(folder));
        for one in &recordings.all {
            let Some(music) = finder.find(&one.item)? else {
                without.push(one.name.clone());
                continue;
            };
            if !hashes.contains_key(&music) {
                hashes.insert(music.clone(), hash::of_file(&music)?);
            }
            let from_s = one.item.music_from_s.unwrap_or(0.0);
            // all clips are hashed, used or not: training and evaluation compare the same hash
            hash.update(format!("{}\0{from_s}\0{}\n", one.name, hashes[&music]));
            if !is_used(one) || one.clip.frames() == 0 {
                continue;
            }
            // the margin takes frames off the clip's start, so that its music begins later
            let from = (from_s + margin as f64 / one.clip.fps()) * FPS;
            if from < 0.0 {
                return Err(Error::invalid(format!("`music_from` of {}", one.name), from_s, "0 or more seconds"));
            }
            let frames = coder.frames(&one.clip);
            let rotations = frames.chunks_exact(coder.channels()).flat_map(|frame| &frame[3..]);
            all.push(MusicClip {
                recording: one.clone(),
                poses: rotations.map(|x| *x as f32).collect(),
                music,
                spectra: Vec::new(),
                from,
                first: from.round() as usize,
            });
        }
        if all.is_empty() {
            let help = "a column `music` of the labels names the file, or it has the clip's name";
            let help = format!("{} without: {help}", without.len());
            return Err(Error::missing(format!("clip with music in {}", folder.display()), help));
        }
        let notes = match without.is_empty() {
            true => Vec::new(),
            false => vec![format!("{} clips have no music and are left out", without.len())],
        };
        read_spectra(&mut all, audio)?;
        let music = hashes.into_iter().map(|(path, hash)| (path.display().to_string(), hash));
        let files = recordings.files().into_iter().chain(music).collect();
        Ok(MusicClips { all, sha256: kinelm_store::hash::hex(hash), files, notes })
    }

    /// The clips of a split.
    pub fn split(&self, split: Split) -> impl Iterator<Item = &MusicClip> {
        self.all.iter().filter(move |one| one.recording.split == split)
    }
}

/// Reads every file once.
fn read_spectra(all: &mut [MusicClip], audio: Audio) -> Result<()> {
    let mut of: BTreeMap<PathBuf, Vec<&mut MusicClip>> = BTreeMap::new();
    // several clips may have one file, which is decoded once
    all.iter_mut().for_each(|one| of.entry(one.music.clone()).or_default().push(one));
    let files: Vec<(PathBuf, Vec<&mut MusicClip>)> = of.into_iter().collect();
    files.into_par_iter().try_for_each(|(path, mut dances)| {
        let range = |one: &MusicClip| {
            let last = one.from + (one.recording.clip.frames() - 1) as f64 * FPS / one.recording.clip.fps();
            one.first..last.round() as usize + 1
        };
        let mut at = 0;
        let mut take = |frame: &[f32]| {
            for one in &mut dances {
                if range(one).contains(&at) {
                    one.spectra.extend_from_slice(frame);
                }
            }
            at += 1;
            Ok(())
        };
        let frames = stft(&path, audio.form(), FPS, &mut take)?;
        for one in &mut dances {
            check(&path, frames, &range(one), &one.spectra)?;
        }
        Ok(())
    })
}

/// Refuses music of `frames` spectra that is shorter than a dance over this range of them, or silent in it.
///
/// # Errors
/// [`kinelm_store::Error::File`] with what was found and expected.
pub fn check(path: &Path, frames: usize, range: &Range<usize>, spectra: &[f32]) -> Result<()> {
    let s = |n: usize| n as f64 / FPS;
    if range.end > frames + SLACK || spectra.is_empty() {
        let found = format!("{:.2} s of music after {:.2} s", s(frames.saturating_sub(range.start)), s(range.start));
        let expected = format!("{:.2} s, as long as the dance", s(range.len()));
        return Err(Error::file(path, found, expected, "take longer music, or a shorter dance"));
    }
    if spectra.iter().all(|x| x.abs() < SILENT) {
        let found = format!("silence from {:.2} s to {:.2} s", s(range.start), s(range.end));
        return Err(Error::file(path, found, "music", "see kinelm music inspect"));
    }
    Ok(())
}

/// Mean and deviation of each number over the spectra of some clips, for [`Audio::Fixed`]; else 0 and 1.
pub fn scale(clips: &[&MusicClip], audio: Audio) -> [Vec<f32>; 2] {
    if audio == Audio::Compat {
        return [vec![0.0; SPECTRUM], vec![1.0; SPECTRUM]];
    }
    // nearly constant numbers must not be amplified
    const LEAST: f64 = 0.05;
    let frames = || clips.iter().flat_map(|one| one.spectra.chunks_exact(SPECTRUM));
    let n = frames().count() as f64;
    let mut mean = vec![0.0f64; SPECTRUM];
    frames().for_each(|frame| mean.iter_mut().zip(frame).for_each(|(m, x)| *m += f64::from(*x) / n));
    // a second pass: mean squares less the squared mean would cancel
    let mut square = vec![0.0f64; SPECTRUM];
    for frame in frames() {
        square.iter_mut().zip(&mean).zip(frame).for_each(|((s, m), x)| *s += (f64::from(*x) - m).powi(2) / n);
    }
    let narrow = |x: Vec<f64>| x.into_iter().map(|x| x as f32).collect::<Vec<f32>>();
    [narrow(mean), narrow(square.into_iter().map(|s| s.sqrt().max(LEAST)).collect())]
}

/// Clips that are long enough for a sequence: those to train on, and those to measure on; and the names of training clips that
/// aren't.
///
/// # Errors
/// [`kinelm_store::Error::Missing`] when no training clip is.
pub(crate) fn sequence_clips(clips: MusicClips, config: &Config) -> Result<([Vec<MusicClip>; 2], Vec<String>)> {
    // one more: the first frame is only the previous one of the second
    let needed = config.length + 1;
    let of = |one: &MusicClip, split| one.recording.split == split;
    let (long, short): (Vec<MusicClip>, Vec<MusicClip>) =
        clips.all.into_iter().partition(|one| one.recording.frames() >= needed);
    let short = short.into_iter().filter(|one| of(one, Split::Train));
    let short: Vec<String> = short.map(|one| one.recording.name).collect();
    let (training, others): (Vec<MusicClip>, Vec<MusicClip>) = long.into_iter().partition(|one| of(one, Split::Train));
    let valid = others.into_iter().filter(|one| of(one, Split::Valid)).collect();
    if training.is_empty() {
        let what = format!("training clip with music and {needed} frames at {FPS} a second");
        let help = format!("{} are shorter: take a shorter length, or other clips", short.len());
        return Err(Error::missing(what, help));
    }
    Ok(([training, valid], short))
}
