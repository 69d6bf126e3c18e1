//! A piece of music, heard.

use crate::Result;
use crate::music::sound::Rows;
use kinelm_music::beat::{Beats, beats};
use kinelm_music::feature::{CHANNELS, Features, features, rate_of};
use std::borrow::Cow;
use std::path::Path;

/// A piece: where its beats are, and what it sounds like.
#[derive(Debug, Clone, PartialEq)]
pub struct Piece {
    /// Its beats, seconds from its beginning.
    pub beats: Beats,
    /// What it sounds like, where that was asked for.
    pub features: Option<Features>,
}

impl Piece {
    /// Hears a file: its beats, and what it sounds like at `fps` frames a second.
    ///
    /// # Errors
    /// Those of reading; a rate at which there are no features ([`rate_of`]).
    pub fn hear(path: &Path, fps: f64) -> Result<Piece> {
        let features = features(path, fps)?;
        Ok(Piece { beats: features.beats.clone(), features: Some(features) })
    }

    /// As [`Piece::hear`], beats alone.
    ///
    /// # Errors
    /// Those of reading.
    pub fn beats_of(path: &Path) -> Result<Piece> {
        Ok(Piece { beats: beats(path)?, features: None })
    }

    /// As [`Piece::hear`] at rates that have features, else beats alone.
    ///
    /// # Errors
    /// Those of reading.
    pub fn hear_if_possible(path: &Path, fps: f64) -> Result<Piece> {
        if rate_of(fps).is_ok() { Piece::hear(path, fps) } else { Piece::beats_of(path) }
    }

    /// What it sounds like, by the time of a dance that begins at its second `from_s`.
    pub fn rows(&self, from_s: f64) -> Rows<'_> {
        let Some(features) = &self.features else { return Rows::default() };
        Rows { fps: features.fps, from_s: -from_s, numbers: Cow::Borrowed(&features.numbers) }
    }

    /// What it sounds like at each frame of a dance that begins at its second `from_s`, (N, 35): of as many frames, and of a
    /// second more, as it goes on for.
    pub fn rows_of(&self, from_s: f64, frames: usize) -> Vec<f32> {
        let rows = self.rows(from_s);
        let mut all = Vec::new();
        for frame in 0..frames + rows.fps.ceil() as usize {
            let mut row = [0.0; CHANNELS];
            if !rows.at(frame as f64 / rows.fps, &mut row) {
                break;
            }
            all.extend(row);
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counted(rows: usize) -> Piece {
        let numbers = (0..rows * CHANNELS).map(|i| (i / CHANNELS) as f32).collect();
        let beats = Beats { times_s: vec![0.5, 1.0], seconds: rows as f64 / 20.0, ..Beats::default() };
        Piece { features: Some(Features { fps: 20.0, numbers, beats: beats.clone() }), beats }
    }

    #[test]
    fn rows_are_those_of_the_dance_s_frames_and_of_a_second_more() {
        let firsts = |rows: Vec<f32>| rows.iter().step_by(CHANNELS).copied().collect::<Vec<_>>();
        let piece = counted(100);
        let found = firsts(piece.rows_of(1.025, 10));
        assert_eq!((found.len(), found[0], found[29]), (30, 20.5, 49.5));
        // the music ends
        assert_eq!(firsts(piece.rows_of(4.5, 10)), (90..100).map(|i| i as f32).collect::<Vec<_>>());
        assert!(piece.rows_of(9.0, 10).is_empty() && Piece { features: None, ..piece }.rows_of(0.0, 10).is_empty());
    }

    #[test]
    fn what_is_heard_has_beats_at_any_rate_and_a_sound_at_most() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("clicks.wav");
        let rate = kinelm_music::beat::RATE;
        let click = |i: usize| if i % (rate as usize / 2) < 400 { (i as f32 * 0.3).sin() } else { 0.0 };
        let sound: Vec<f32> = (0..8 * rate as usize).map(click).collect();
        std::fs::write(&path, kinelm_music::wav::bytes(&sound, rate)).unwrap();
        let (at_20, at_5) =
            (Piece::hear_if_possible(&path, 20.0).unwrap(), Piece::hear_if_possible(&path, 5.0).unwrap());
        assert_eq!(at_20.beats, at_5.beats);
        assert!(at_20.beats.times_s.len() > 10 && at_5.features.is_none());
        let rows = at_20.rows_of(0.0, 150);
        assert_eq!(rows.len() % CHANNELS, 0);
        assert!((155..=170).contains(&(rows.len() / CHANNELS)), "{}", rows.len() / CHANNELS);
        assert!(Piece::hear(&path, 5.0).unwrap_err().to_string().contains("expected 17 to 240"));
    }
}
