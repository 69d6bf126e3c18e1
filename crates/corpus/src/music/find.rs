//! Which music belongs to a clip of a folder of dances, and where its beats are in the clip.

use super::piece::Piece;
use super::tempo;
use crate::gather::Item;
use crate::{Error, Result};
use kinelm_music::beat::Beats;
use rayon::prelude::*;
use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// The label that names a clip's music.
pub const LABEL: &str = "music";
/// What names of music files end in, in any letter case.
pub const EXTENSIONS: [&str; 7] = ["wav", "flac", "ogg", "oga", "mp3", "m4a", "mp4"];
/// Seconds that a clip may go on behind its music.
const SLACK_S: f64 = 0.5;

/// The music of clips, every file heard once.
#[derive(Debug, Default)]
pub struct Heard {
    /// Per clip, by its name.
    of: BTreeMap<String, PathBuf>,
    pieces: BTreeMap<PathBuf, std::result::Result<Piece, String>>,
}

/// The music of a clip, as the clip has it.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct OfClip {
    /// Beats, seconds from its first frame; some may lie before it and behind its last.
    pub beats_s: Vec<f64>,
    /// (N, 35) What it sounds like at each frame and for a second more, as far as the music goes; empty at rates without features.
    pub sound: Vec<f32>,
    /// Its tempo as a label ([`super::tempo`]).
    pub tempo: Option<String>,
}

impl OfClip {
    /// Without music: the beats of its own steps.
    pub fn steps(beats_s: Vec<f64>) -> OfClip {
        OfClip { beats_s, ..OfClip::default() }
    }
}

impl Heard {
    /// Finds and hears the music of `items` in `folder`, for clips of `fps` frames a second: the file that the label `music`
    /// names, else one of the clip's own name, there or beside the motion.
    ///
    /// # Errors
    /// A folder, or a file that a label names, that isn't there.
    pub fn of(items: &[&Item], folder: &Path, fps: f64) -> Result<Heard> {
        if !folder.is_dir() {
            return Err(Error::file(folder, "no folder", "one that holds music", "see docs/music.md"));
        }
        let (mut of, mut finder) = (BTreeMap::new(), Finder::new(folder));
        for item in items {
            if let Some(path) = finder.find(item)? {
                of.insert(item.name.clone(), path);
            }
        }
        let mut files: Vec<&PathBuf> = of.values().collect();
        files.sort();
        files.dedup();
        let hear = |path: &PathBuf| (path.clone(), Piece::hear_if_possible(path, fps).map_err(|e| e.to_string()));
        let pieces = files.into_par_iter().map(hear).collect();
        Ok(Heard { of, pieces })
    }

    /// Clips that have music.
    pub fn clips(&self) -> usize {
        self.of.len()
    }

    /// The music of a clip of so many frames at `fps`, or of a piece of one, whose own first frame is at the music's time
    /// `Item::music_from_s`; `None`: it has none.
    ///
    /// # Errors
    /// Music that can't be read, has no beats, ends before the clip, or isn't there yet when it begins.
    pub fn of_clip(&self, item: &Item, (frames, fps): (usize, f64)) -> Result<Option<OfClip>> {
        let Some(path) = self.of.get(&item.name) else { return Ok(None) };
        let piece =
            self.pieces[path].as_ref().map_err(|why| Error::call(format!("{}: its music: {why}", item.name)))?;
        let first = item.piece.map_or(0, |cut| cut.first(fps));
        let from_s = item.music_from_s.unwrap_or(0.0) + first as f64 / fps;
        let seconds = frames as f64 / fps;
        let what = |e| Error::call(format!("{}: {e}", item.name));
        let beats_s = in_dance(path, &piece.beats, (from_s, seconds)).map_err(what)?;
        let tempo = tempo::label(&beats_s, seconds);
        Ok(Some(OfClip { beats_s, sound: piece.rows_of(from_s, frames), tempo }))
    }
}

/// Beats of the music in `path` as a dance has them that begins at the music's time `from_s` and has so many seconds. Those
/// around it, of the whole piece, stay, so that they may lie before its first frame and behind its last.
///
/// # Errors
/// [`kinelm_store::Error::File`]: music without beats, a beginning outside of it, an end before that of the dance.
pub fn in_dance(path: &Path, beats: &Beats, (from_s, seconds): (f64, f64)) -> Result<Vec<f64>> {
    let wrong = |found: String, expected: String, help: &str| Err(Error::file(path, found, expected, help));
    let ends = beats.seconds;
    if beats.times_s.len() < 2 {
        let found = format!("{} beats in {ends:.2} s of music", beats.times_s.len());
        return wrong(found, "two or more".into(), "is it silent? kinelm music inspect shows what is heard");
    }
    if !(0.0..ends).contains(&from_s) {
        let expected = format!("0 up to below {ends:.2} s, where the music ends");
        return wrong(format!("a beginning at {from_s} s"), expected, "the dance begins at this time of the music");
    }
    if from_s + seconds > ends + SLACK_S {
        let found = format!("{:.2} s of music behind {from_s} s", ends - from_s);
        return wrong(found, format!("{seconds:.2} s, as long as the dance"), "take longer music, or a shorter dance");
    }
    Ok(beats.times_s.iter().map(|beat| ((beat - from_s) * 1e4).round() / 1e4).collect())
}

/// Finds the music of clips; every folder is read once.
pub struct Finder<'a> {
    folder: &'a Path,
    /// Music files of folders, by their names without the ending.
    listed: BTreeMap<PathBuf, BTreeMap<OsString, PathBuf>>,
}

impl Finder<'_> {
    /// In a folder of music.
    pub fn new(folder: &Path) -> Finder<'_> {
        Finder { folder, listed: BTreeMap::new() }
    }

    /// The music file of a clip, if it has one: the file in the folder that its label names, else one of its own name, there
    /// or beside the motion. Of several endings that of [`EXTENSIONS`] that stands first counts, in small letters before
    /// others.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Call`] for a file that its label names and that isn't there.
    pub fn find(&mut self, item: &Item) -> Result<Option<PathBuf>> {
        let folder = self.folder;
        if let Some(name) = item.labels.get(LABEL) {
            let path = folder.join(name);
            let mut found = Some(path.clone()).filter(|path| path.is_file()).or_else(|| self.with_ending(&path));
            // a name with an ending may mean one in other letters
            if let (None, Some(ending)) = (&found, path.extension()) {
                let is_asked =
                    |found: &PathBuf| found.extension().is_some_and(|other| other.eq_ignore_ascii_case(ending));
                found = self.with_ending(&path.with_extension("")).filter(is_asked);
            }
            let endings = EXTENSIONS.join(", ");
            return found.map(Some).ok_or_else(|| {
                let what = format!("{}: music `{name}`: no such file, nor one that ends in {endings}", item.name);
                Error::call(format!("{what}, in {}; put it there, or leave the label out", folder.display()))
            });
        }
        let stem = item.path.file_stem().map(|stem| folder.join(stem));
        Ok(self
            .with_ending(&folder.join(item.clip_name()))
            .or_else(|| self.with_ending(&stem?))
            .or_else(|| self.with_ending(&item.path.with_extension(""))))
    }

    /// The music file of this path and an ending.
    fn with_ending(&mut self, base: &Path) -> Option<PathBuf> {
        let (folder, name) = (base.parent()?, base.file_name()?);
        let listed = self.listed.entry(folder.into()).or_insert_with(|| listed(folder));
        listed.get(name).cloned()
    }
}

/// The music files of a folder by their names without the ending; none of one that can't be read.
fn listed(folder: &Path) -> BTreeMap<OsString, PathBuf> {
    let here = if folder.as_os_str().is_empty() { Path::new(".") } else { folder };
    let entries = std::fs::read_dir(here).into_iter().flatten().flatten();
    let ranked = |name: OsString| {
        let ending = Path::new(&name).extension()?.to_str()?;
        let rank = EXTENSIONS.iter().position(|known| ending.eq_ignore_ascii_case(known))?;
        Some((rank, ending != EXTENSIONS[rank], name))
    };
    let mut all: Vec<_> = entries.filter_map(|entry| ranked(entry.file_name())).collect();
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
    fn a_piece_of_a_clip_has_the_beats_of_its_own_time() {
        use crate::timed::{Timed, in_pieces};
        let timed = |from_s, to_s| Timed { from_s, to_s, labels: BTreeMap::new(), line: 2 };
        let item = Item {
            name: "a/b".into(),
            music_from_s: Some(0.25),
            timed: vec![timed(0.0, 0.5), timed(0.5, f64::INFINITY)],
            ..Item::default()
        };
        let path = PathBuf::from("song.wav");
        let pieces: Vec<Item> = in_pieces(&[item]).into_iter().filter(|i| i.piece.is_some()).collect();
        let of = pieces.iter().map(|piece| (piece.name.clone(), path.clone())).collect();
        let heard = Heard { of, pieces: BTreeMap::from([(path, Ok(Piece { beats: beats(), features: None }))]) };
        let found = |i: usize, frames: usize| heard.of_clip(&pieces[i], (frames, 20.0)).unwrap().unwrap().beats_s[0];
        assert_eq!((pieces.len(), found(0, 10), found(1, 30)), (2, 0.25, -0.25));
        assert!(pieces.iter().all(|piece| piece.clip_name() == "a/b"));
        assert_eq!(Item { name: "c@d".into(), ..Item::default() }.clip_name(), "c@d");
    }

    #[test]
    fn beats_are_counted_from_the_dance_s_beginning() {
        let path = Path::new("song.wav");
        assert_eq!(in_dance(path, &beats(), (0.0, 3.0)).unwrap(), [0.5, 1.0, 1.5, 2.0, 2.5]);
        assert_eq!(in_dance(path, &beats(), (1.25, 2.0)).unwrap(), [-0.75, -0.25, 0.25, 0.75, 1.25]);
    }

    #[test]
    fn music_that_doesnt_reach_is_refused_with_what_was_found_and_expected() {
        let said = |beats: &Beats, at| in_dance(Path::new("song.wav"), beats, at).unwrap_err().to_string();
        let short = said(&beats(), (1.0, 2.6));
        assert!(short.contains("song.wav: found 2.00 s of music behind 1 s, expected 2.60 s"), "{short}");
        let outside = said(&beats(), (3.0, 1.0));
        assert!(outside.contains("found a beginning at 3 s, expected 0 up to below 3.00 s"), "{outside}");
        assert!(said(&beats(), (-1.0, 1.0)).contains("a beginning at -1 s"));
        let silent = Beats { times_s: vec![], seconds: 3.0, ..Beats::default() };
        assert!(said(&silent, (0.0, 1.0)).contains("found 0 beats in 3.00 s of music, expected two or more"));
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
        let found = |name: &str, label| Finder::new(&music).find(&item(name, label)).unwrap();
        assert_eq!(found("a", Some("mKR2")), Some(music.join("mKR2.wav")));
        assert_eq!(found("a", Some("named.song")), Some(music.join("named.song.ogg")));
        assert_eq!(found("a", Some("mKR2.WAV")), Some(music.join("mKR2.wav")));
        assert_eq!(found("b", None), Some(music.join("b.mp3")));
        assert_eq!(found("c", None), Some(dances.join("c.flac")));
        assert_eq!(found("d", None), None);
        // in any letters, and of several always the same
        assert_eq!(found("e", None), Some(music.join("e.WAV")));
        assert_eq!(found("a", Some("f")), Some(music.join("f.mp3")));
        let said = Finder::new(&music).find(&item("a", Some("mBR0"))).unwrap_err().to_string();
        assert!(said.starts_with("a: music `mBR0`: no such file"), "{said}");
    }
}
