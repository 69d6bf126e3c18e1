//! The music of a page: what is played, and which of its beats a dance hits.

use crate::baselines::music_lstm;
use crate::cli::named::Named;
use crate::cli::{Say, WrongCall};
use crate::evaluate::dance::beats::BeatPair;
use crate::generate::provenance;
use crate::view::music::{EMBEDDED, Music};
use anyhow::Result;
use kinelm_motion::metric::beat::BeatHits;
use kinelm_motion::{Motion, retarget};
use kinelm_store::output::{Outputs, is_same};
use std::ops::Range;
use std::path::{Path, PathBuf};

/// Joints of the model's body whose beats are looked for: all but the hands.
const BODY: Range<usize> = 0..22;

/// The music that the first dance was generated to, and its time when the dance starts, if the file exists.
pub fn own_music(clips: &[Named], say: Say) -> Option<(PathBuf, f64)> {
    let of = |clip: &Named| {
        let provenance = provenance::find(&clip.path).ok()?;
        music_lstm::dance::music_of(provenance.as_ref(), &clip.path).map_err(|e| say.line(e)).ok()?
    };
    let music = clips.iter().find_map(of)?;
    if !music.path.is_file() {
        say.line(format_args!(
            "{}: the music of the dance isn't there; --music plays it from elsewhere",
            music.path.display()
        ));
        return None;
    }
    if let Err(e) = music.check() {
        say.line(format_args!("{e}; --music plays it all the same"));
        return None;
    }
    Some((music.path, music.from_s))
}

/// The beats that a dance hits; `None` for a rig that can't be retargeted.
pub fn hits(motion: &Motion, music: &Music, lag: Option<f64>, say: Say) -> Option<BeatHits> {
    let found = || -> crate::Result<BeatHits> {
        let beats: Vec<f64> = music.beats_s.iter().map(|beat| beat - music.from_s).collect();
        Ok(BeatPair::new(&retarget::to_smpl(motion)?, &BODY.collect::<Vec<_>>(), &beats)?.hits(lag))
    };
    let why = |e| say.line(format_args!("{}: no beat is lit as hit: {e}", motion.path.display()));
    found().map_err(why).ok().filter(|_| !music.beats_s.is_empty())
}

/// The music of a page: embedded, or next to the page where the file is large, copied there if necessary.
pub fn beside(file: &Path, from_s: f64, seconds: f64, page: &Path, outputs: &Outputs, say: Say) -> Result<Music> {
    let beats = kinelm_music::beat::beats(file).map_err(crate::Error::from)?;
    let sounds = beats.seconds.min(from_s + seconds) - from_s.max(0.0);
    if from_s >= beats.seconds {
        let what = format!("--music-from {from_s}: {} ends at {:.2} s; give less", file.display(), beats.seconds);
        return Err(WrongCall(what).into());
    }
    say.line(format_args!("{}: {} beats, sounds for {sounds:.1} s of the dance", file.display(), beats.times_s.len()));
    let bytes = kinelm_store::input::bytes(file).map_err(crate::Error::io(file))?;
    if bytes.len() as u64 <= EMBEDDED {
        return Ok(Music::embedded(file, &bytes, from_s, beats.times_s));
    }
    if let Some(name) = file.file_name() {
        let copy = page.with_file_name(name);
        if !is_same(file, &copy) {
            outputs.write(&copy, &bytes)?;
            say.line(format_args!("{}: has to stay beside the page", copy.display()));
        }
    }
    Ok(Music::beside(file, from_s, beats.times_s))
}
