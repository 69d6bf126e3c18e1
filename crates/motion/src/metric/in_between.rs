//! What papers on in-betweening print of a filled gap: L2P, L2Q and NPSS.
//!
//! Sources: Harvey, Yurick, Nowrouzezahrai and Pal, "Robust motion in-betweening" (2020), section 5.2, for L2P and L2Q;
//! Gopalakrishnan, Mali, Kifer, Giles and Ororbia, "A neural temporal model for human motion prediction" (2019), section 3.3,
//! for NPSS, with the power of the cosines alone, as the former's code has it.

use crate::rotation::heading;
use crate::{Clip, Quat, Vec3};
use std::f64::consts::TAU;
use std::ops::Range;

/// How much the places of joints vary in real gaps: what L2P is measured in.
///
/// All places are seen from the frame before the gap: its root at the origin of the floor, its heading along z.
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
        self.sums.iter().map(|[sum, squares]| (squares / n - (sum / n).powi(2)).max(0.0).sqrt()).collect()
    }
}

/// Sums over gaps of what was filled beside the truth.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct InBetween {
    gaps: f64,
    l2p: f64,
    l2q: f64,
    /// Distances of the spectra, each times its feature's power, and the power.
    spectra: [f64; 2],
}

impl InBetween {
    /// Measures the frames `gap` of `clip` beside those of `truth`: the joints of `scale`, in its unit.
    ///
    /// # Panics
    /// If the clips differ in frames or joints, or the gap begins with them.
    pub fn of(clip: &Clip, truth: &Clip, gap: &Range<usize>, scale: &PositionScale) -> InBetween {
        let [found, wanted] = [clip, truth].map(|clip| places(clip, truth, gap, gap.clone(), &scale.joints));
        let deviations = scale.deviations();
        let unit = |x: Vec<f64>| -> Vec<f64> {
            // what never varies has no unit
            x.iter().zip(deviations.iter().cycle()).map(|(x, s)| if *s > 0.0 { x / s } else { 0.0 }).collect()
        };
        let wanted_turns = turns(truth, gap, &scale.joints, None);
        let found_turns = turns(clip, gap, &scale.joints, Some(&wanted_turns));
        let width = 4 * scale.joints.len();
        InBetween {
            gaps: 1.0,
            l2p: distance(&unit(found), &unit(wanted), 3 * scale.joints.len()),
            l2q: distance(&found_turns, &wanted_turns, width),
            spectra: spectra(&found_turns, &wanted_turns, width),
        }
    }

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

/// Coordinates (F, 3 J) of joints in some frames, seen from the truth's frame before the gap.
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

/// Over the columns of `a` and `b` (F, `width`): the earth mover's distance of their normalised spectra times b's power, summed,
/// and b's power.
fn spectra(a: &[f64], b: &[f64], width: usize) -> [f64; 2] {
    let frames = b.len() / width.max(1);
    let power = |x: &[f64], column: usize| -> Vec<f64> {
        let wave = |k: usize, t: usize| (TAU * (k * t % frames) as f64 / frames as f64).cos();
        let cosine = |k: usize| (0..frames).map(|t| x[t * width + column] * wave(k, t)).sum::<f64>();
        (0..frames).map(|k| cosine(k).powi(2)).collect()
    };
    let mut sums = [0.0; 2];
    for column in 0..width {
        let [found, wanted] = [a, b].map(|x| power(x, column));
        let [total, of_wanted] = [&found, &wanted].map(|power| power.iter().sum::<f64>());
        let share = |x: f64, total: f64| if total > 0.0 { x / total } else { 0.0 };
        let (mut apart, mut moved) = (0.0, 0.0f64);
        for (x, y) in found.iter().zip(&wanted) {
            apart += share(*x, total) - share(*y, of_wanted);
            moved += apart.abs();
        }
        sums[0] += moved * of_wanted;
        sums[1] += of_wanted;
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
            let [sum, power] = spectra(&a, &b, width);
            assert!((sum / power - npss).abs() < 1e-9, "{} beside {npss}", sum / power);
        }
    }

    #[test]
    fn the_truth_is_no_error_wherever_it_stands_and_a_held_frame_is() {
        let truth = synth::corpus(4, 1, 3.0, 20.0).unwrap().remove(0).clip;
        let (gap, joints) = (20..30, [0, 4, 18]);
        let mut scale = PositionScale::of(&joints);
        scale.add(&truth, &gap);
        let own = InBetween::of(&truth, &truth, &gap, &scale);
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
            InBetween::of(&moved(&root, &rotations), &truth, &gap, &scale)
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
        let found = InBetween::of(&clip, &truth, &(20..30), &scale);
        assert!(found.l2q().unwrap() < 1e-9 && found.npss().unwrap() < 1e-9, "{found:?}");
    }
}
