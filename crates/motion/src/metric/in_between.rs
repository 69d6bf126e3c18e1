//! The metrics of published in-betweening, for a filled gap: L2P, L2Q and NPSS.
//!
//! Sources: Harvey, Yurick, Nowrouzezahrai and Pal, "Robust motion in-betweening" (2020), section 5.2, for L2P and L2Q;
//! Gopalakrishnan, Mali, Kifer, Giles and Ororbia, "A neural temporal model for human motion prediction" (2019), section 3.3,
//! for NPSS, with the power of the cosines alone, as the former's code has it.

use crate::rotation::heading;
use crate::{Clip, Quat, Vec3};
use std::f64::consts::TAU;
use std::ops::Range;

/// Standard deviations of joint positions in real clips with gaps: the unit of L2P.
///
/// All positions are relative to the frame before the gap: its root at the origin of the floor, its heading along z.
#[derive(Debug, Clone, PartialEq)]
pub struct PositionScale {
    joints: Vec<usize>,
    frames: f64,
    /// (3 J) each.
    sums: Vec<[f64; 2]>,
}

impl PositionScale {
    /// Of these joints, before any clip.
    pub fn of(joints: &[usize]) -> PositionScale {
        PositionScale { joints: joints.to_vec(), frames: 0.0, sums: vec![[0.0; 2]; 3 * joints.len()] }
    }

    /// The joints.
    pub fn joints(&self) -> &[usize] {
        &self.joints
    }

    /// Adds all frames of a clip with a gap.
    ///
    /// # Panics
    /// If the gap begins with the clip, or the clip lacks a joint.
    pub fn add(&mut self, clip: &Clip, gap: &Range<usize>) {
        let coordinates = places(clip, clip, gap, 0..clip.frames(), &self.joints);
        self.frames += clip.frames() as f64;
        for frame in coordinates.chunks_exact(self.sums.len().max(1)) {
            self.sums.iter_mut().zip(frame).for_each(|([sum, squares], x)| {
                *sum += x;
                *squares += x * x;
            });
        }
    }

    /// Standard deviations (3 J), metres; 0 before any clip.
    pub fn deviations(&self) -> Vec<f64> {
        let n = self.frames.max(1.0);
        // rounding can make the difference of squares slightly negative
        self.sums.iter().map(|[sum, squares]| (squares / n - (sum / n).powi(2)).max(0.0).sqrt()).collect()
    }
}

/// Sums over gaps of the errors of what was filled.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct InBetween {
    gaps: f64,
    l2p: f64,
    l2q: f64,
    /// Distances of the spectra, each times its feature's power, and the power.
    spectra: [f64; 2],
}

/// A gap of a real clip, prepared to measure fillings.
pub struct TrueGap<'a> {
    truth: &'a Clip,
    frames: Range<usize>,
    joints: &'a [usize],
    /// (3 J) The unit of each coordinate.
    deviations: Vec<f64>,
    /// (F, 3 J) In these units.
    places: Vec<f64>,
    /// (F, 4 J)
    turns: Vec<f64>,
    /// (F) A wave of the gap's length.
    wave: Vec<f64>,
    /// (4 J, F) Power of the turns.
    power: Vec<Vec<f64>>,
}

impl<'a> TrueGap<'a> {
    /// The frames `gap` of `truth`, with the joints of `scale` in its unit.
    ///
    /// # Panics
    /// If the gap begins with the clip, or the clip lacks a joint.
    pub fn new(truth: &'a Clip, gap: &Range<usize>, scale: &'a PositionScale) -> TrueGap<'a> {
        let (n, deviations) = (gap.len(), scale.deviations());
        let turns = turns(truth, gap, &scale.joints, None);
        let wave: Vec<f64> = (0..n).map(|t| (TAU * t as f64 / n as f64).cos()).collect();
        let power = power(&turns, 4 * scale.joints.len(), &wave);
        let places = in_units(places(truth, truth, gap, gap.clone(), &scale.joints), &deviations);
        TrueGap { truth, frames: gap.clone(), joints: &scale.joints, deviations, places, turns, wave, power }
    }

    /// Measures the gap's frames of `clip`.
    ///
    /// # Panics
    /// If the clips differ in frames or joints.
    pub fn measure(&self, clip: &Clip) -> InBetween {
        let found = places(clip, self.truth, &self.frames, self.frames.clone(), self.joints);
        let turns = turns(clip, &self.frames, self.joints, Some(&self.turns));
        let width = 4 * self.joints.len();
        InBetween {
            gaps: 1.0,
            l2p: distance(&in_units(found, &self.deviations), &self.places, 3 * self.joints.len()),
            l2q: distance(&turns, &self.turns, width),
            spectra: spectra(&power(&turns, width, &self.wave), &self.power),
        }
    }
}

/// Coordinates (F, 3 J) in units of their deviations; 0 for a coordinate that never varies.
fn in_units(mut coordinates: Vec<f64>, deviations: &[f64]) -> Vec<f64> {
    let units = deviations.iter().cycle();
    coordinates.iter_mut().zip(units).for_each(|(x, s)| *x = if *s > 0.0 { *x / s } else { 0.0 });
    coordinates
}

impl InBetween {
    /// Adds other gaps.
    pub fn add(&mut self, other: &InBetween) {
        self.gaps += other.gaps;
        self.l2p += other.l2p;
        self.l2q += other.l2q;
        self.spectra.iter_mut().zip(other.spectra).for_each(|(sum, x)| *sum += x);
    }

    /// Mean over frames of the distance of all places, in standard deviations; `None` without a gap.
    pub fn l2p(&self) -> Option<f64> {
        (self.gaps > 0.0).then(|| self.l2p / self.gaps)
    }

    /// Mean over frames of the distance of all world rotations, as quaternions.
    pub fn l2q(&self) -> Option<f64> {
        (self.gaps > 0.0).then(|| self.l2q / self.gaps)
    }

    /// Normalised power spectrum similarity of the world rotations; 0 is alike. `None` where the truth has no power.
    pub fn npss(&self) -> Option<f64> {
        (self.spectra[1] > 0.0).then(|| self.spectra[0] / self.spectra[1])
    }
}

/// Coordinates (F, 3 J) of joints in some frames, relative to the truth's frame before the gap.
fn places(clip: &Clip, truth: &Clip, gap: &Range<usize>, frames: Range<usize>, joints: &[usize]) -> Vec<f64> {
    let before = gap.start - 1;
    let origin = truth.root()[before].with_y(0.0);
    let back = Quat::from_rotation_y(-heading(truth.pose(before)[0]).unwrap_or(0.0));
    let place = |all: &[Vec3], joint: usize| (back * (all[joint] - origin)).to_array();
    frames
        .flat_map(|f| {
            let all = clip.global_pose(f).positions;
            joints.iter().flat_map(|&joint| place(&all, joint)).collect::<Vec<_>>()
        })
        .collect()
}

/// World rotations (F, 4 J) of joints in the gap. Of the two quaternions of each rotation the one nearer to that of the frame
/// before is taken, in the first frame the one nearer to `first`'s.
fn turns(clip: &Clip, gap: &Range<usize>, joints: &[usize], first: Option<&[f64]>) -> Vec<f64> {
    let mut all: Vec<f64> = Vec::with_capacity(4 * joints.len() * gap.len());
    for f in gap.clone() {
        let rotations = clip.global_pose(f).rotations;
        for (k, &joint) in joints.iter().enumerate() {
            let turn = rotations[joint].to_array();
            let beside = match all.len().checked_sub(4 * joints.len()) {
                Some(at) => Some(&all[at..at + 4]),
                None => first.map(|first| &first[4 * k..4 * k + 4]),
            };
            let along = beside.map_or(1.0, |beside| beside.iter().zip(turn).map(|(a, b)| a * b).sum::<f64>());
            all.extend(turn.map(|x| if along < 0.0 { -x } else { x }));
        }
    }
    all
}

/// Mean over rows of `width` numbers of the Euclidean distance.
fn distance(a: &[f64], b: &[f64], width: usize) -> f64 {
    let rows = a.chunks_exact(width.max(1)).zip(b.chunks_exact(width.max(1)));
    let n = rows.len().max(1) as f64;
    rows.map(|(a, b)| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt()).sum::<f64>() / n
}

/// Squared cosine transforms of the columns of `x` (F, `width`), by a `wave` (F) of their length: (`width`, F).
fn power(x: &[f64], width: usize, wave: &[f64]) -> Vec<Vec<f64>> {
    let frames = wave.len();
    // cos(TAU k t / n) repeats after n, so one period of samples serves all frequencies
    let cosine =
        |column: usize, k: usize| -> f64 { (0..frames).map(|t| x[t * width + column] * wave[k * t % frames]).sum() };
    (0..width).map(|column| (0..frames).map(|k| cosine(column, k).powi(2)).collect()).collect()
}

/// Sums over columns: the earth mover's distance of the normalised spectra times the power of `truth`, and that power.
fn spectra(found: &[Vec<f64>], truth: &[Vec<f64>]) -> [f64; 2] {
    let mut sums = [0.0; 2];
    for (found, truth) in found.iter().zip(truth) {
        let [total, of_truth] = [found, truth].map(|power| power.iter().sum::<f64>());
        let share = |x: f64, total: f64| if total > 0.0 { x / total } else { 0.0 };
        // on a line, the distance is the sum of the absolute differences of the cumulative spectra
        let (mut surplus, mut moved) = (0.0, 0.0f64);
        for (x, y) in found.iter().zip(truth) {
            surplus += share(*x, total) - share(*y, of_truth);
            moved += surplus.abs();
        }
        sums[0] += moved * of_truth;
        sums[1] += of_truth;
    }
    sums
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synth;
    use serde::Deserialize;

    /// What numpy makes of arrays by a formula: scripts/reference/in_between.py.
    #[derive(Deserialize)]
    struct Case {
        frames: usize,
        width: usize,
        distance: f64,
        npss: f64,
    }

    #[test]
    fn distances_and_spectra_are_numpys() {
        let cases: Vec<Case> = serde_json::from_str(include_str!("../../tests/golden/in_between.json")).unwrap();
        assert_eq!(cases.len(), 3);
        for Case { frames, width, distance: wanted, npss } in cases {
            let array = |phase: f64| -> Vec<f64> {
                let at = |i: usize| (i / width, i % width);
                let x = |(t, d): (usize, usize)| (0.3 * (t * (d + 1)) as f64 + d as f64 + phase).sin() / (d + 1) as f64;
                (0..frames * width).map(|i| x(at(i))).collect()
            };
            let (a, b) = (array(0.4), array(0.0));
            assert!((distance(&a, &b, width) - wanted).abs() < 1e-12);
            let wave: Vec<f64> = (0..frames).map(|t| (TAU * t as f64 / frames as f64).cos()).collect();
            let [a, b] = [&a, &b].map(|x| power(x, width, &wave));
            let [sum, power] = spectra(&a, &b);
            assert!((sum / power - npss).abs() < 1e-9, "{} beside {npss}", sum / power);
        }
    }

    #[test]
    fn the_truth_is_no_error_wherever_it_stands_and_a_held_frame_is() {
        let truth = synth::corpus(4, 1, 3.0, 20.0).unwrap().remove(0).clip;
        let (gap, joints) = (20..30, [0, 4, 18]);
        let mut scale = PositionScale::of(&joints);
        scale.add(&truth, &gap);
        let own = TrueGap::new(&truth, &gap, &scale).measure(&truth);
        assert_eq!((own.l2p(), own.l2q()), (Some(0.0), Some(0.0)));
        assert!(own.npss().unwrap() < 1e-12);
        let (mut root, mut rotations) = (truth.root().to_vec(), truth.rotations().to_vec());
        for f in gap.clone() {
            root[f] = root[19];
            rotations.copy_within(19 * 24..20 * 24, f * 24);
        }
        let held = |by: Vec3| {
            let moved = |root: &[Vec3], rotations: &[Quat]| {
                let root = root.iter().map(|p| *p + by).collect();
                Clip::new(truth.skeleton().clone(), 20.0, root, rotations.to_vec()).unwrap()
            };
            let truth = moved(truth.root(), truth.rotations());
            let mut scale = PositionScale::of(&joints);
            scale.add(&truth, &gap);
            TrueGap::new(&truth, &gap, &scale).measure(&moved(&root, &rotations))
        };
        let (here, there) = (held(Vec3::ZERO), held(Vec3::new(3.0, 0.0, -2.0)));
        assert!(here.l2p().unwrap() > 0.1 && here.l2q().unwrap() > 0.01 && here.npss().unwrap() > 0.0, "{here:?}");
        assert!((here.l2p().unwrap() - there.l2p().unwrap()).abs() < 1e-9, "the place of a clip doesn't count");
        let mut two = here;
        two.add(&own);
        assert!((two.l2p().unwrap() - here.l2p().unwrap() / 2.0).abs() < 1e-12);
        assert_eq!(InBetween::default().npss(), None);
    }

    #[test]
    fn both_quaternions_of_a_rotation_are_one() {
        let truth = synth::corpus(4, 1, 3.0, 20.0).unwrap().remove(0).clip;
        let negated: Vec<Quat> =
            truth.rotations().iter().enumerate().map(|(i, q)| if i % 3 == 0 { -*q } else { *q }).collect();
        let clip = Clip::new(truth.skeleton().clone(), 20.0, truth.root().to_vec(), negated).unwrap();
        let scale = PositionScale::of(&[0, 4, 18]);
        let found = TrueGap::new(&truth, &(20..30), &scale).measure(&clip);
        assert!(found.l2q().unwrap() < 1e-9 && found.npss().unwrap() < 1e-9, "{found:?}");
    }
}
