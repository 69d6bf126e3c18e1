//! The working state of a tile.

use super::config::{DctConfig, LONGEST};
use crate::channel::Channels;
use crate::scheme::mix::Mix;
use crate::scheme::series::{self, Anchor};
use crate::transform::dct::Dct;
use kinelm_motion::{Clip, Quat, Vec3};
use std::ops::Range;
use std::sync::OnceLock;

/// Working state of a tile: S closed series and components of L numbers each.
pub(super) struct Tile<'a> {
    channels: &'a Channels,
    mix: &'a Mix,
    turn_weight: f64,
    dct: &'static Dct,
    /// The last values of the basis functions, which give the last number of a series from its coefficients.
    last: Vec<f64>,
    /// Open series (C, L).
    pub(super) open: Vec<f64>,
    /// (S, L): the path, the turn, the components; numbers over time or coefficients.
    pub(super) series: Vec<f64>,
    scratch: Vec<f64>,
    pub(super) anchor: Anchor,
}

/// The transform of a tile's length.
fn plan(length: usize) -> &'static Dct {
    static PLANS: [OnceLock<Dct>; LONGEST + 1] = [const { OnceLock::new() }; LONGEST + 1];
    PLANS[length].get_or_init(|| Dct::new(length))
}

impl<'a> Tile<'a> {
    pub(super) fn new(config: &DctConfig, channels: &'a Channels, mix: &'a Mix, height: f64) -> Self {
        let n = config.tile as usize;
        let dct = plan(n);
        let mut scratch = vec![0.0; dct.scratch_len().max(n)];
        // the transform is orthonormal, so the transform of the last unit vector has the basis functions' last values
        let mut last = vec![0.0; n];
        last[n - 1] = 1.0;
        dct.forward(&mut last, &mut scratch);
        Tile {
            channels,
            mix,
            turn_weight: config.turn_weight(),
            dct,
            last,
            open: vec![0.0; series::open_count(channels) * n],
            series: vec![0.0; (series::closed_count(channels) + mix.components()) * n],
            scratch,
            anchor: config.anchor(height),
        }
    }

    fn length(&self) -> usize {
        self.dct.len()
    }

    /// Numbers of the closed series.
    fn closed(&self) -> usize {
        series::closed_count(self.channels) * self.length()
    }

    /// The coefficients of frames of a clip, relative to the anchor.
    pub(super) fn analyse(&mut self, clip: &Clip, start: Vec3, frames: Range<usize>) {
        let (n, closed) = (self.length(), self.closed());
        series::open(self.channels, clip, frames.clone(), n, &mut self.open);
        let (head, components) = self.series.split_at_mut(closed);
        self.mix.forward(n, &mut self.open, components);
        self.anchor.closed(self.channels, clip, start, frames, n, head);
        head[3 * n..].iter_mut().for_each(|x| *x *= self.turn_weight);
        self.series.chunks_exact_mut(n).for_each(|x| self.dct.forward(x, &mut self.scratch));
    }

    /// Inverts the transform of the coefficients, and the joint transform; moves the anchor to the tile's end.
    ///
    /// Returns the previous anchor, to which the closed series are relative.
    pub(super) fn synthesise(&mut self) -> Anchor {
        let before = self.anchor;
        self.advance();
        let (n, closed) = (self.length(), self.closed());
        // most series of a tile are all zeros
        for x in self.series.chunks_exact_mut(n).filter(|x| x.iter().any(|x| *x != 0.0)) {
            self.dct.inverse(x, &mut self.scratch);
        }
        let (head, components) = self.series.split_at_mut(closed);
        head[3 * n..].iter_mut().for_each(|x| *x /= self.turn_weight);
        self.mix.inverse(n, components, &mut self.open);
        before
    }

    /// Moves the anchor to the end of the tile of the quantised coefficients, by the same sums in encoder and decoder.
    pub(super) fn advance(&mut self) {
        let ends =
            |x: &[f64]| -> f64 { x.iter().zip(&self.last).filter(|(x, _)| **x != 0.0).map(|(x, w)| x * w).sum() };
        let mut at: Vec<f64> = self.series.chunks_exact(self.length()).map(ends).collect();
        let (head, components) = at.split_at_mut(series::closed_count(self.channels));
        head[3..].iter_mut().for_each(|x| *x /= self.turn_weight);
        let (place, turn) = self.anchor.apply(self.channels, head, 1, 0);
        let mut pose = [Quat::IDENTITY; 24];
        if self.channels.joints().first() == Some(&0) {
            let mut open = vec![0.0; series::open_count(self.channels)];
            self.mix.inverse(1, components, &mut open);
            series::set_pose(self.channels, turn, &open, 1, 0, &mut pose);
            self.anchor.move_to(place, turn, pose[0]);
        } else {
            self.anchor.move_to(place, turn, Quat::IDENTITY);
        }
    }
}
