//! The music of a clip by the clip's time: its beats, and what it sounds like.

use kinelm_music::feature::CHANNELS;
use std::borrow::Cow;

/// What is known of the music of a clip, by the clip's time.
#[derive(Debug, Clone, Default)]
pub struct Sound<'a> {
    /// Its beats, seconds from the clip's first frame, rising.
    pub beats_s: &'a [f64],
    /// What it sounds like.
    pub rows: Rows<'a>,
}

/// The 35 numbers of a stretch of music, at even times.
#[derive(Debug, Clone, Default)]
pub struct Rows<'a> {
    /// Rows a second.
    pub fps: f64,
    /// The first row's time, seconds.
    pub from_s: f64,
    /// (N, 35) The rows.
    pub numbers: Cow<'a, [f32]>,
}

impl Rows<'_> {
    /// Writes the numbers at a time, between two rows in proportion; `false`: outside, nothing is written.
    pub fn at(&self, time_s: f64, to: &mut [f32]) -> bool {
        // a time that was computed may lie a rounding beside its row
        let place = ((time_s - self.from_s) * self.fps * 1e6).round() / 1e6;
        let rows = self.numbers.len() / CHANNELS;
        if rows == 0 || !(0.0..=(rows - 1) as f64).contains(&place) {
            return false;
        }
        let (first, share) = (place as usize, place.fract() as f32);
        let row = |row: usize| &self.numbers[row * CHANNELS..][..CHANNELS];
        let next = row((first + 1).min(rows - 1));
        for ((to, a), b) in to.iter_mut().zip(row(first)).zip(next) {
            *to = a + share * (b - a);
        }
        true
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_last_row_s_time_is_inside_whatever_rounding_says() {
        let rows = Rows { fps: 30.0, from_s: 0.7, numbers: vec![2.0; 4 * CHANNELS].into() };
        let mut to = [0.0; CHANNELS];
        assert!(rows.at(0.7 + 3.0 / 30.0, &mut to) && to[0] == 2.0);
        assert!(!rows.at(0.7 + 3.1 / 30.0, &mut to) && !rows.at(0.699, &mut to));
    }
}
