//! The beats that dances are measured against: those of a file, of music, or of the music a dance was generated to.

use crate::baselines::music_lstm;
use crate::cli::WrongCall;
use crate::corpus::music::library::beats_in_dance;
use crate::corpus::music::track::Track;
use crate::generate::provenance::Provenance;
use anyhow::Result;
use kinelm_music::beat::Beats;
use kinelm_store::input;
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

/// Which beats.
#[derive(Debug, clap::Args)]
pub struct MusicArgs {
    /// Measure alignment to these beats, a time in seconds per line [default: the beats of --music, or of the music
    /// that each dance was generated to]
    #[arg(long, value_name = "FILE", conflicts_with = "music")]
    beats: Option<PathBuf>,
    /// Measure alignment to the beats of this music; may be repeated, once per dance in their order
    #[arg(long, value_name = "FILE")]
    music: Vec<PathBuf>,
    /// The time in the music, or of the beats, at which the dances start, such as 12.5s [default: 0s]
    #[arg(long, value_name = "SECONDS", value_parser = crate::cli::values::seconds)]
    music_from: Option<f64>,
}

/// The beats of --beats or --music in seconds from the first frame: one list for all dances, or one for each. Every piece is
/// analysed once.
pub fn beats(args: &MusicArgs, dances: usize, pieces: &mut BTreeMap<PathBuf, Beats>) -> Result<Option<Vec<Vec<f64>>>> {
    let from_s = args.music_from.unwrap_or(0.0);
    if let Some(path) = &args.beats {
        let text = input::text(path).map_err(crate::Error::io(path))?;
        let beats = crate::corpus::music::beats::parse(path, &text)?;
        if beats.len() < 2 {
            let what = format!("--beats {}: {} beats; expected two or more", path.display(), beats.len());
            return Err(WrongCall(what).into());
        }
        return Ok(Some(vec![beats.iter().map(|beat| beat - from_s).collect()]));
    }
    let music = args.music.len();
    if music > 1 && music != dances {
        let what = format!("--music names {music} files for {dances} dances; give one for all, or one for each");
        return Err(WrongCall(what).into());
    }
    let beats_of = |path: &PathBuf| -> Result<Vec<f64>> {
        if !pieces.contains_key(path) {
            pieces.insert(path.clone(), Track::beats_only(path)?.beats);
        }
        Ok(beats_in_dance(path, &pieces[path], from_s, 0.0)?)
    };
    let all: Vec<Vec<f64>> = args.music.iter().map(beats_of).collect::<Result<_>>()?;
    Ok(Some(all).filter(|all| !all.is_empty()))
}

/// The beats of the music that a dance was generated to, if any.
pub fn own_beats(
    path: &Path,
    provenance: Option<&Provenance>,
    pieces: &mut BTreeMap<PathBuf, Beats>,
) -> crate::Result<Option<Vec<f64>>> {
    let Some(music) = music_lstm::dance::music_of(provenance, path)? else { return Ok(None) };
    // another dance may have had another file of this name
    music.check()?;
    if !pieces.contains_key(&music.path) {
        pieces.insert(music.path.clone(), Track::beats_only(&music.path)?.beats);
    }
    Ok(Some(beats_in_dance(&music.path, &pieces[&music.path], music.from_s, 0.0)?))
}
