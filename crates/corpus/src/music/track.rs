//! A piece of music, analysed: its beats and features.

use crate::Result;
use crate::music::clip_music::FeatureRows;
use kinelm_music::beat::{Beats, beats};
use kinelm_music::feature::{CHANNELS, Features, features, rate_of};
use std::borrow::Cow;
use std::path::Path;

/// A piece of music.
#[derive(Debug, Clone, PartialEq)]
pub struct Track {
    /// Beats in seconds from its beginning.
    pub beats: Beats,
    /// Features, if requested.
    pub features: Option<Features>,
}

impl Track {
    /// Finds the beats of a file, and its features at `fps` frames per second.
    ///
    /// # Errors
    /// Those of reading; a rate without features ([`rate_of`]).
    pub fn analyse(path: &Path, fps: f64) -> Result<Track> {
        let features = features(path, fps)?;
        Ok(Track { beats: features.beats.clone(), features: Some(features) })
    }

    /// As [`Track::analyse`], for the beats alone.
    ///
    /// # Errors
    /// Those of reading.
    pub fn beats_only(path: &Path) -> Result<Track> {
        Ok(Track { beats: beats(path)?, features: None })
    }

    /// As [`Track::analyse`] at rates that have features, else the beats alone.
    ///
    /// # Errors
    /// Those of reading.
    pub(crate) fn analyse_if_possible(path: &Path, fps: f64) -> Result<Track> {
        if rate_of(fps).is_ok() { Track::analyse(path, fps) } else { Track::beats_only(path) }
    }

    /// The features in the time of a dance that begins at the music's second `from_s`.
    pub fn rows(&self, from_s: f64) -> FeatureRows<'_> {
        let Some(features) = &self.features else { return FeatureRows::default() };
        FeatureRows { fps: features.fps, from_s: -from_s, numbers: Cow::Borrowed(&features.numbers) }
    }

    /// (N, 35) features at each frame of a dance of `frames` frames that begins at the music's second `from_s`, and for one
    /// more second, as far as the music goes.
    pub(crate) fn frame_rows(&self, from_s: f64, frames: usize) -> Vec<f32> {
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

    fn numbered(rows: usize) -> Track {
        let numbers = (0..rows * CHANNELS).map(|i| (i / CHANNELS) as f32).collect();
        let beats = Beats { times_s: vec![0.5, 1.0], seconds: rows as f64 / 20.0, ..Beats::default() };
        Track { features: Some(Features { fps: 20.0, numbers, beats: beats.clone() }), beats }
    }

    #[test]
    fn frame_rows_last_one_second_longer_than_the_dance() {
        let firsts = |rows: Vec<f32>| rows.iter().step_by(CHANNELS).copied().collect::<Vec<_>>();
        let track = numbered(100);
        let found = firsts(track.frame_rows(1.025, 10));
        assert_eq!((found.len(), found[0], found[29]), (30, 20.5, 49.5));
        // the music ends
        assert_eq!(firsts(track.frame_rows(4.5, 10)), (90..100).map(|i| i as f32).collect::<Vec<_>>());
        assert!(
            track.frame_rows(9.0, 10).is_empty() && Track { features: None, ..track }.frame_rows(0.0, 10).is_empty()
        );
    }

    #[test]
    fn beats_exist_at_any_rate_and_features_at_some() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("clicks.wav");
        let rate = kinelm_music::beat::RATE;
        let click = |i: usize| if i % (rate as usize / 2) < 400 { (i as f32 * 0.3).sin() } else { 0.0 };
        let sound: Vec<f32> = (0..8 * rate as usize).map(click).collect();
        std::fs::write(&path, kinelm_music::wav::bytes(&sound, rate)).unwrap();
        let (at_20, at_5) =
            (Track::analyse_if_possible(&path, 20.0).unwrap(), Track::analyse_if_possible(&path, 5.0).unwrap());
        assert_eq!(at_20.beats, at_5.beats);
        assert!(at_20.beats.times_s.len() > 10 && at_5.features.is_none());
        let rows = at_20.frame_rows(0.0, 150);
        assert_eq!(rows.len() % CHANNELS, 0);
        assert!((155..=170).contains(&(rows.len() / CHANNELS)), "{}", rows.len() / CHANNELS);
        assert!(Track::analyse(&path, 5.0).unwrap_err().to_string().contains("expected 17 to 240"));
    }
}
