//! The music of a clip in the time of the clip: its beats and features.

use kinelm_music::feature::CHANNELS;
use std::borrow::Cow;

/// The music of a clip in the time of the clip; empty if it has none.
#[derive(Debug, Clone, Default)]
pub struct ClipMusic<'a> {
    /// Beats in seconds from the clip's first frame, ascending.
    pub beats_s: &'a [f64],
    /// Features.
    pub rows: FeatureRows<'a>,
}

/// Features of a stretch of music at equally spaced times ([`kinelm_music::feature`]).
#[derive(Debug, Clone, Default)]
pub struct FeatureRows<'a> {
    /// Rows a second.
    pub fps: f64,
    /// Time of the first row in seconds.
    pub from_s: f64,
    /// (N, 35) the rows.
    pub numbers: Cow<'a, [f32]>,
}

impl FeatureRows<'_> {
    /// Writes the features at a time, interpolated linearly between two rows; returns `false` and writes nothing outside the
    /// rows.
    pub fn at(&self, time_s: f64, to: &mut [f32]) -> bool {
        // a computed time may be off its row by rounding
        let place = ((time_s - self.from_s) * self.fps * 1e6).round() / 1e6;
        let rows = self.numbers.len() / CHANNELS;
        if rows == 0 || !(0.0..=(rows - 1) as f64).contains(&place) {
            return false;
        }
        let (first, share) = (place as usize, place.fract() as f32);
        let row = |row: usize| &self.numbers[row * CHANNELS..][..CHANNELS];
        // at the last row the share is 0, so that its neighbour doesn't count
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
    fn rounding_does_not_put_the_last_row_outside() {
        let rows = FeatureRows { fps: 30.0, from_s: 0.7, numbers: vec![2.0; 4 * CHANNELS].into() };
        let mut to = [0.0; CHANNELS];
        assert!(rows.at(0.7 + 3.0 / 30.0, &mut to) && to[0] == 2.0);
        assert!(!rows.at(0.7 + 3.1 / 30.0, &mut to) && !rows.at(0.699, &mut to));
    }
}
