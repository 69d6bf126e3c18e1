//! The music files of a dataset: which one belongs to a clip, and where its beats are in the clip.

use super::tempo;
use super::track::Track;
use crate::item::Item;
use crate::{Error, Result};
use kinelm_music::beat::Beats;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// The label that names a clip's music.
pub const LABEL: &str = "music";
/// Extensions of music files, in any letter case.
pub const EXTENSIONS: [&str; 8] = ["wav", "flac", "ogg", "oga", "mp3", "m4a", "mp4", "aac"];
/// Seconds that a clip may outlast its music by.
const SLACK_S: f64 = 0.5;

/// The music of the clips of a dataset. Each file is analysed once.
#[derive(Debug, Default)]
pub(crate) struct MusicLibrary {
    /// Music files by the name of the clip.
    files: BTreeMap<String, PathBuf>,
    /// `None` for a file that can't be used.
    tracks: BTreeMap<PathBuf, Option<Track>>,
}

/// The music of a clip, in the time of the clip.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct AlignedMusic {
    /// Beats in seconds from the clip's first frame; some may be before it or after its last.
    pub beats_s: Vec<f64>,
    /// (N, 35) features at each frame and for one more second, as far as the music goes; empty at rates without features.
    pub features: Vec<f32>,
    /// The tempo as a label ([`super::tempo`]).
    pub tempo: Option<String>,
}

impl MusicLibrary {
    /// Finds and analyses the music of `items` in `folder`, for clips of `fps` frames per second ([`MusicFinder::find`]).
    ///
    /// # Errors
    /// A folder, or a file that a label names, that doesn't exist.
    pub fn find(items: &[&Item], folder: &Path, fps: f64) -> Result<MusicLibrary> {
        if !folder.is_dir() {
            return Err(Error::file(folder, "no folder", "one that holds music", "see docs/music.md"));
        }
        let (mut files, mut finder) = (BTreeMap::new(), MusicFinder::new(folder));
        for item in items {
            if let Some(path) = finder.find(item)? {
                files.insert(item.name.clone(), path);
            }
        }
        let mut paths: Vec<&PathBuf> = files.values().collect();
        // clips may share their music, which is analysed once
        paths.sort();
        paths.dedup();
        let analyse = |path: &PathBuf| (path.clone(), Track::analyse_if_possible(path, fps).ok());
        let tracks = paths.into_par_iter().map(analyse).collect();
        Ok(MusicLibrary { files, tracks })
    }

    /// The music of an item of `frames` frames at `fps`, from the music's time [`Item::music_from_s`] on, later for a
    /// segment; `None` if the item has no music.
    ///
    /// # Errors
    /// Music that can't be read, has no beats, or doesn't cover the clip.
    pub(crate) fn align(&self, item: &Item, frames: usize, fps: f64) -> Result<Option<AlignedMusic>> {
        let Some(path) = self.files.get(&item.name) else { return Ok(None) };
        let again;
        let track = match &self.tracks[path] {
            Some(track) => track,
            // every clip reports what is wrong with its music
            None => {
                again = Track::analyse_if_possible(path, fps).map_err(Error::in_clip(&item.name))?;
                &again
            }
        };
        let first = item.segment.map_or(0, |segment| segment.first(fps));
        let from_s = item.music_from_s.unwrap_or(0.0) + first as f64 / fps;
        let seconds = frames as f64 / fps;
        let beats_s = beats_in_dance(path, &track.beats, from_s, seconds).map_err(Error::in_clip(&item.name))?;
        let tempo = tempo::label(&beats_s, seconds);
        Ok(Some(AlignedMusic { beats_s, features: track.frame_rows(from_s, frames), tempo }))
    }
}

/// The beats of the music in `path`, in seconds from the beginning of a dance that lasts `seconds` and begins at the music's
/// time `from_s`. Beats before and after the dance are included.
///
/// # Errors
/// [`kinelm_store::Error::File`]: music with fewer than two beats, a beginning outside the music, a dance that outlasts it.
pub fn beats_in_dance(path: &Path, beats: &Beats, from_s: f64, seconds: f64) -> Result<Vec<f64>> {
    let wrong = |found: String, expected: String, help: &str| Err(Error::file(path, found, expected, help));
    let ends = beats.seconds;
    if beats.times_s.len() < 2 {
        let found = format!("{} beats in {ends:.2} s of music", beats.times_s.len());
        return wrong(found, "two or more".into(), "is it silent? kinelm music inspect shows its beats");
    }
    if !(0.0..ends).contains(&from_s) {
        let expected = format!("0 up to below {ends:.2} s, where the music ends");
        return wrong(format!("a beginning at {from_s} s"), expected, "the dance begins at this time of the music");
    }
    if from_s + seconds > ends + SLACK_S {
        let found = format!("{:.2} s of music after {from_s} s", ends - from_s);
        return wrong(found, format!("{seconds:.2} s, as long as the dance"), "take longer music, or a shorter dance");
    }
    Ok(beats.times_s.iter().map(|beat| ((beat - from_s) * 1e4).round() / 1e4).collect())
}

/// Finds the music of clips; every folder is listed once.
pub struct MusicFinder<'a> {
    folder: &'a Path,
    /// Music files of folders, by their names without extension.
    listed: BTreeMap<PathBuf, BTreeMap<OsString, PathBuf>>,
}

impl MusicFinder<'_> {
    /// A finder in a folder of music.
    pub fn new(folder: &Path) -> MusicFinder<'_> {
        MusicFinder { folder, listed: BTreeMap::new() }
    }

    /// The music file of an item, if it has one: the file in the folder that its label `music` names, else one of the
    /// clip's name, there or beside the motion. Of several extensions the first of [`EXTENSIONS`] counts, lower case
    /// before others.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Missing`] for a file that the label names and that doesn't exist.
    pub fn find(&mut self, item: &Item) -> Result<Option<PathBuf>> {
        let folder = self.folder;
        if let Some(name) = item.labels.get(LABEL) {
            let path = folder.join(name);
            let mut found = Some(path.clone()).filter(|path| path.is_file()).or_else(|| self.with_extension(&path));
            // the label may spell the extension in another case
            if let (None, Some(extension)) = (&found, path.extension()) {
                let is_same =
                    |found: &PathBuf| found.extension().is_some_and(|other| other.eq_ignore_ascii_case(extension));
                found = self.with_extension(&path.with_extension("")).filter(is_same);
            }
            return found.map(Some).ok_or_else(|| {
                let what = format!("music file `{name}` of clip {} in {}", item.name, folder.display());
                let extensions = EXTENSIONS.join(", ");
                Error::missing(what, format!("add it (a label may leave out {extensions}), or drop the label `music`"))
            });
        }
        let stem = item.path.file_stem().map(|stem| folder.join(stem));
        Ok(self
            .with_extension(&folder.join(item.clip_name()))
            .or_else(|| self.with_extension(&stem?))
            .or_else(|| self.with_extension(&item.path.with_extension(""))))
    }

    /// The music file of this path and an extension.
    fn with_extension(&mut self, base: &Path) -> Option<PathBuf> {
        let (folder, name) = (base.parent()?, base.file_name()?);
        let listed = self.listed.entry(folder.into()).or_insert_with(|| list(folder));
        listed.get(name).cloned()
    }
}

/// The music files of a folder by their names without extension; none of a folder that can't be read.
fn list(folder: &Path) -> BTreeMap<OsString, PathBuf> {
    let here = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let entries = std::fs::read_dir(here).into_iter().flatten().flatten();
    let ranked = |name: OsString| {
        let extension = Path::new(&name).extension()?.to_str()?;
        let rank = EXTENSIONS.iter().position(|known| extension.eq_ignore_ascii_case(known))?;
        Some((rank, extension != EXTENSIONS[rank], name))
    };
    let mut all: Vec<_> = entries.filter_map(|entry| ranked(entry.file_name())).collect();
    // by rank, then lower case, then name: the first of a stem counts, whatever the folder's order
    all.sort();
    let mut listed = BTreeMap::new();
    for (_, _, name) in all {
        let path = folder.join(&name);
        if let (Some(stem), true) = (path.file_stem(), path.is_file()) {
            listed.entry(stem.to_owned()).or_insert_with(|| path.clone());
        }
    }
    listed
}

#[cfg(test)]
mod tests {
    use super::*;

    fn beats() -> Beats {
        Beats { times_s: vec![0.5, 1.0, 1.5, 2.0, 2.5], seconds: 3.0, ..Beats::default() }
    }

    #[test]
    fn a_segment_has_the_beats_of_its_own_time() {
        use crate::item::TimedLabels;
        use crate::segments::split_items;
        let timed = |from_s, to_s| TimedLabels { from_s, to_s, labels: BTreeMap::new(), line: 2 };
        let item = Item {
            name: "a/b".into(),
            music_from_s: Some(0.25),
            timed: vec![timed(0.0, 0.5), timed(0.5, f64::INFINITY)],
            ..Item::default()
        };
        let path = PathBuf::from("song.wav");
        let segments: Vec<Item> = split_items(&[item]).into_iter().filter(|i| i.segment.is_some()).collect();
        let files = segments.iter().map(|item| (item.name.clone(), path.clone())).collect();
        let tracks = BTreeMap::from([(path, Some(Track { beats: beats(), features: None }))]);
        let library = MusicLibrary { files, tracks };
        let first = |i: usize, frames: usize| library.align(&segments[i], frames, 20.0).unwrap().unwrap().beats_s[0];
        assert_eq!((segments.len(), first(0, 10), first(1, 30)), (2, 0.25, -0.25));
        assert!(segments.iter().all(|item| item.clip_name() == "a/b"));
        assert_eq!(Item { name: "c@d".into(), ..Item::default() }.clip_name(), "c@d");
    }

    #[test]
    fn beats_are_counted_from_the_dance_s_beginning() {
        let path = Path::new("song.wav");
        assert_eq!(beats_in_dance(path, &beats(), 0.0, 3.0).unwrap(), [0.5, 1.0, 1.5, 2.0, 2.5]);
        assert_eq!(beats_in_dance(path, &beats(), 1.25, 2.0).unwrap(), [-0.75, -0.25, 0.25, 0.75, 1.25]);
    }

    #[test]
    fn music_that_does_not_cover_the_dance_is_refused() {
        let said = |beats: &Beats, from_s, seconds| {
            beats_in_dance(Path::new("song.wav"), beats, from_s, seconds).unwrap_err().to_string()
        };
        let short = said(&beats(), 1.0, 2.6);
        assert!(short.contains("song.wav: found 2.00 s of music after 1 s, expected 2.60 s"), "{short}");
        let outside = said(&beats(), 3.0, 1.0);
        assert!(outside.contains("found a beginning at 3 s, expected 0 up to below 3.00 s"), "{outside}");
        assert!(said(&beats(), -1.0, 1.0).contains("a beginning at -1 s"));
        let silent = Beats { times_s: vec![], seconds: 3.0, ..Beats::default() };
        assert!(said(&silent, 0.0, 1.0).contains("found 0 beats in 3.00 s of music, expected two or more"));
    }

    #[test]
    fn files_are_found_by_label_by_name_and_beside_the_motion() {
        let dir = tempfile::tempdir().unwrap();
        let (music, dances) = (dir.path().join("music"), dir.path().join("dances"));
        for folder in [&music, &dances] {
            std::fs::create_dir(folder).unwrap();
        }
        for file in ["mKR2.wav", "b.mp3", "named.song.ogg", "e.WAV", "e.Mp3", "f.MP3", "f.mp3", "f.Mp3"] {
            std::fs::write(music.join(file), "").unwrap();
        }
        std::fs::create_dir(music.join("d.wav")).unwrap();
        std::fs::write(dances.join("c.flac"), "").unwrap();
        let item = |name: &str, label: Option<&str>| Item {
            name: name.into(),
            path: dances.join(name).with_extension("bvh"),
            labels: label.map(|label| (LABEL.into(), label.into())).into_iter().collect(),
            ..Item::default()
        };
        let found = |name: &str, label| MusicFinder::new(&music).find(&item(name, label)).unwrap();
        assert_eq!(found("a", Some("mKR2")), Some(music.join("mKR2.wav")));
        assert_eq!(found("a", Some("named.song")), Some(music.join("named.song.ogg")));
        assert_eq!(found("a", Some("mKR2.WAV")), Some(music.join("mKR2.wav")));
        assert_eq!(found("b", None), Some(music.join("b.mp3")));
        assert_eq!(found("c", None), Some(dances.join("c.flac")));
        assert_eq!(found("d", None), None);
        // in any letter case, and of several always the same one
        assert_eq!(found("e", None), Some(music.join("e.WAV")));
        assert_eq!(found("a", Some("f")), Some(music.join("f.mp3")));
        let said = MusicFinder::new(&music).find(&item("a", Some("mBR0"))).unwrap_err().to_string();
        assert!(said.starts_with("no music file `mBR0` of clip a in "), "{said}");
    }
}
