//! Ground position and turn of the root, in closed loop.
//!
//! The transform is applied to the ground velocity and the rate of turn. All basis functions but that of coefficient 0 sum to
//! zero over time, so coefficient 0 alone determines the displacement of a hop. The encoder adds the errors of earlier hops to
//! it: errors don't accumulate, and the path is smooth between hops.
//!
//! A hop's velocities are rotated by its heading: that of its middle, from the turn's coefficients 0 so far, or without a turn
//! that of the pelvis's mean rotation in the hop. So changing the turn rotates all later motion by a constant.

use super::{Lapped, Layout, Transform, lifted, limited};
use crate::channel::Channels;
use crate::scheme::pelvis::Split;
use kinelm_motion::rotation::{exp_map, heading};
use kinelm_motion::{Clip, Vec3};
use std::f64::consts::TAU;

/// Encodes and decodes the root.
pub(super) struct Root<'a> {
    scheme: &'a Lapped,
    layout: Layout,
    /// Whether the pelvis's rotation vector is the first of the open channels.
    vector: bool,
    transform: Transform,
    /// (N) quantisation steps by frequency, metres: for coefficient 0 of the hop's displacement, else of the coefficient.
    steps: Vec<f64>,
}

/// A vector on the ground, (x, z).
type Ground = (f64, f64);

impl<'a> Root<'a> {
    pub(super) fn new(scheme: &'a Lapped, channels: &Channels) -> Self {
        let layout = Layout::new(&scheme.config, channels);
        let step = scheme.config.step();
        let transform = Transform::of_differences(layout.hop);
        let steps = displacement_norms(layout.hop).into_iter().map(|reach| step / reach).collect();
        let vector = channels.joints().first() == Some(&0) && !layout.turn;
        Root { scheme, layout, vector, transform, steps }
    }

    /// The quantisation step of a displacement, metres: the position's error is at most half of it in each direction.
    pub(super) fn displacement_step(&self) -> f64 {
        self.steps[0]
    }

    /// The quantisation step of a velocity coefficient above 0, metres.
    pub(super) fn step(&self, frequency: usize) -> f64 {
        self.steps[frequency]
    }

    /// Velocities in a tile's coefficient 0; the first tile has one fewer.
    fn length(&self, tile: usize) -> f64 {
        (self.layout.hop - usize::from(tile == 0)) as f64
    }

    /// Sets the root's numbers.
    pub(super) fn encode(&self, clip: &Clip, numbers: &mut [i32], clipped: &mut u64) {
        let n = numbers.len() / self.layout.numbers() * self.layout.hop;
        let (turn, [x, z]) = self.layout.closed();
        if self.layout.turn {
            let turns = turns(clip);
            let step = self.displacement_step() / self.scheme.turn_arm;
            let facing = limited((turns[0] / step).round(), clipped);
            numbers[self.layout.facing()] = facing;
            // what rounding leaves is added to the next hop's displacement: closed loop
            let mut residual = turns[0] - f64::from(facing) * step;
            let rates = self.coefficients(&turns, n);
            for (k, tile) in numbers.chunks_exact_mut(self.layout.numbers()).enumerate() {
                let rates = &rates[k * self.layout.hop..];
                self.waves(tile, turn, |f| rates[f] * self.scheme.turn_arm, clipped);
                if self.length(k) > 0.0 {
                    // coefficient 0 is orthonormal: the sum over the hop is sqrt(length) times it
                    residual += rates[0] * self.length(k).sqrt();
                    let number = limited((residual / step).round(), clipped);
                    tile[self.layout.at(0, turn)] = number;
                    residual -= f64::from(number) * step;
                }
            }
        }
        let places = |f: fn(&Vec3) -> f64| clip.root().iter().map(f).collect::<Vec<_>>();
        let vx = self.coefficients(&places(|p| p.x), n);
        let vz = self.coefficients(&places(|p| p.z), n);
        let headings = self.headings(numbers);
        let mut residual = (0.0, 0.0);
        for (k, tile) in numbers.chunks_exact_mut(self.layout.numbers()).enumerate() {
            let at = |f: usize| (vx[k * self.layout.hop + f], vz[k * self.layout.hop + f]);
            self.waves(tile, x, |f| turned(at(f), -headings[k]).0, clipped);
            self.waves(tile, z, |f| turned(at(f), -headings[k]).1, clipped);
            if self.length(k) > 0.0 {
                let length = self.length(k).sqrt();
                residual = (residual.0 + at(0).0 * length, residual.1 + at(0).1 * length);
                let displacement = turned(residual, -headings[k]);
                let coded =
                    [displacement.0, displacement.1].map(|w| limited((w / self.displacement_step()).round(), clipped));
                (tile[self.layout.at(0, x)], tile[self.layout.at(0, z)]) = (coded[0], coded[1]);
                let displacement = coded.map(|c| f64::from(c) * self.displacement_step());
                let displacement = turned((displacement[0], displacement[1]), headings[k]);
                residual = (residual.0 - displacement.0, residual.1 - displacement.1);
            }
        }
    }

    /// Coefficients (n) of the differences of a series, which is constant after its end.
    fn coefficients(&self, series: &[f64], n: usize) -> Vec<f64> {
        let mut rates = vec![0.0; n];
        for t in 1..series.len() {
            rates[t] = series[t] - series[t - 1];
        }
        self.transform.forward(&mut rates, &mut vec![0.0; self.transform.scratch_len()]);
        rates
    }

    /// Sets the numbers of a series from frequency 1 on.
    fn waves(&self, tile: &mut [i32], series: usize, coefficient: impl Fn(usize) -> f64, clipped: &mut u64) {
        for f in 1..self.layout.hop {
            let at = self.layout.at(f, series);
            tile[at] = self.scheme.round(at, coefficient(f) / self.steps[f], clipped);
        }
    }

    /// The decoded turn (n; empty without one) and ground positions (n).
    pub(super) fn decode(&self, numbers: &[i32]) -> (Vec<f64>, Vec<Ground>) {
        let (turn, [x, z]) = self.layout.closed();
        let tiles = || numbers.chunks_exact(self.layout.numbers()).enumerate();
        let n = tiles().len() * self.layout.hop;
        let turns = if self.layout.turn {
            let mut rates = vec![0.0; n];
            for (k, tile) in tiles() {
                let rates = &mut rates[k * self.layout.hop..];
                (0..self.layout.hop).for_each(|f| rates[f] = self.coefficient(k, tile, f, turn) / self.scheme.turn_arm);
            }
            self.added_up(rates, |k| self.facing(&numbers[k * self.layout.numbers()..]))
        } else {
            Vec::new()
        };
        let headings = self.headings(numbers);
        let (mut vx, mut vz) = (vec![0.0; n], vec![0.0; n]);
        for (k, tile) in tiles() {
            for f in 0..self.layout.hop {
                let v = (self.coefficient(k, tile, f, x), self.coefficient(k, tile, f, z));
                (vx[k * self.layout.hop + f], vz[k * self.layout.hop + f]) = turned(v, headings[k]);
            }
        }
        let (vx, vz) = (self.added_up(vx, |_| 0.0), self.added_up(vz, |_| 0.0));
        (turns, vx.into_iter().zip(vz).collect())
    }

    /// A coefficient of a tile's velocities, metres.
    fn coefficient(&self, k: usize, tile: &[i32], frequency: usize, series: usize) -> f64 {
        let number = tile[self.layout.at(frequency, series)];
        match frequency {
            // with a hop of 1 the first tile has no velocity
            0 if self.length(k) == 0.0 => 0.0,
            0 => f64::from(number) * self.displacement_step() / self.length(k).sqrt(),
            f => lifted(number) * self.steps[f],
        }
    }

    /// The series with these coefficients of its differences, plus a jump at the first frame of each tile.
    fn added_up(&self, mut rates: Vec<f64>, jump: impl Fn(usize) -> f64) -> Vec<f64> {
        self.transform.inverse(&mut rates, &mut vec![0.0; self.transform.scratch_len()]);
        let mut sum = 0.0;
        for (t, x) in rates.iter_mut().enumerate() {
            if t % self.layout.hop == 0 {
                sum += jump(t / self.layout.hop);
            }
            sum += *x;
            *x = sum;
        }
        rates
    }

    /// The jump of the turn at a tile's first frame, radians.
    fn facing(&self, tile: &[i32]) -> f64 {
        f64::from(tile[self.layout.facing()]) * self.displacement_step() / self.scheme.turn_arm
    }

    /// The heading of each tile's middle, radians.
    fn headings(&self, numbers: &[i32]) -> Vec<f64> {
        let tiles = numbers.chunks_exact(self.layout.numbers());
        if !self.layout.turn {
            return tiles.map(|tile| if self.vector { self.mean_heading(tile) } else { 0.0 }).collect();
        }
        let (turn, _) = self.layout.closed();
        let mut now = 0.0;
        let heading = |(k, tile): (usize, &[i32])| {
            let turn = if self.length(k) > 0.0 { f64::from(tile[self.layout.at(0, turn)]) } else { 0.0 };
            let turn = turn * self.displacement_step() / self.scheme.turn_arm;
            now += self.facing(tile) + turn;
            // the middle of the hop: half of its turn is still to come
            now - 0.5 * turn
        };
        tiles.enumerate().map(heading).collect()
    }

    /// The heading of the pelvis's mean rotation vector in a tile, from its coefficients 0; 0 when it points straight up.
    fn mean_heading(&self, tile: &[i32]) -> f64 {
        let s = self.scheme;
        let scale = s.config.step() / (self.layout.hop as f64).sqrt();
        let v: [f64; 3] = std::array::from_fn(|i| {
            let row = &s.inverse[i * self.layout.open..][..self.layout.open];
            let off: f64 = row.iter().enumerate().map(|(c, w)| w * lifted(tile[self.layout.at(0, c)])).sum();
            s.mean[i] + scale * off
        });
        heading(exp_map::from_vector(Vec3::from_array(v))).unwrap_or(0.0)
    }
}

/// A vector on the ground after a turn about the vertical.
fn turned((x, z): Ground, turn: f64) -> Ground {
    let (s, c) = turn.sin_cos();
    (x * c + z * s, z * c - x * s)
}

/// The pelvis's continuous turn in every frame; upside down that of the previous frame.
fn turns(clip: &Clip) -> Vec<f64> {
    let mut now = 0.0;
    let turn = |f| {
        if let Some(split) = Split::of(clip.pose(f)[0]) {
            // the first turn stays as it is: the rounding below would make -PI of PI
            let off: f64 = split.turn - now;
            now += if f == 0 { off } else { off - (off / TAU).round() * TAU };
        }
        now
    };
    (0..clip.frames()).map(turn).collect()
}

/// The norm of the displacement caused by a unit of each velocity coefficient, by frequency. A displacement by coefficient 0
/// lasts for the whole hop.
fn displacement_norms(hop: usize) -> Vec<f64> {
    let transform = Transform::new(hop);
    let mut scratch = vec![0.0; transform.scratch_len()];
    let wave = |f: usize| {
        let mut x = vec![0.0; 3 * hop];
        x[hop + f] = 1.0;
        transform.inverse(&mut x, &mut scratch);
        let mut sum = 0.0;
        let squares = x.iter().map(|v| {
            sum += v;
            sum * sum
        });
        squares.sum::<f64>().sqrt()
    };
    let mut displacement_norms: Vec<f64> = (0..hop).map(wave).collect();
    // its displacement never ends; it counts for its own hop
    displacement_norms[0] = (hop as f64).sqrt();
    displacement_norms
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn low_frequencies_move_further() {
        assert_eq!(displacement_norms(1), [1.0]);
        for hop in [2, 9, 30] {
            let r = displacement_norms(hop);
            assert!((r[0] - (hop as f64).sqrt()).abs() < 1e-12);
            // fast ones by one quarter of a tile more or less, as their sign falls
            assert!((1..hop).all(|f| (f + 2..hop).all(|g| r[f] > 0.98 * r[g])), "{r:?}");
            // a sine of f half turns a tile sums to tile / (pi f) of it
            let f = hop / 2;
            let about = hop as f64 / (std::f64::consts::PI * f as f64);
            assert!((r[f] / about - 1.0).abs() < 0.25, "{hop}: {} {about}", r[f]);
        }
    }

    #[test]
    fn a_quarter_turn_takes_ahead_to_the_left() {
        let (x, z) = turned((0.0, 1.0), 0.25 * TAU);
        assert!((x - 1.0).abs() < 1e-15 && z.abs() < 1e-15, "facing +x, as heading says");
    }
}
