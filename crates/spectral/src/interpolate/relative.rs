//! Blending by turns and small rotations instead of rotation vectors: nobody flips, and nobody shakes more.
//!
//! Two things go wrong where rotation vectors are blended as they are. A body that turns has vectors longer than half a
//! turn, and the mean of two of these is no rotation half way between. So each joint has a [`Chart`], and the
//! body, up to the joint that carries it, turns about the vertical. And fast, small movements fit together: what shakes
//! the hips is taken back by the spine and the root's path. In another pose it no longer is, and the hands shake. So
//! only slow rotations are blended, and each bone takes along, in its own frame, how its fast movement turns it in the
//! world; the root's path likewise.

use super::align::pelvis;
use super::chart::Chart;
use crate::{LowDct, Result};
use kinelm_motion::pose::GlobalPose;
use kinelm_motion::{Clip, Quat, Skeleton, Vec3};
use std::sync::Arc;

/// A chart for each joint of a skeleton.
#[derive(Debug, Clone)]
pub struct Relative {
    skeleton: Arc<Skeleton>,
    frames: usize,
    /// The joint that carries the body: it and those above it have charts of their rotations in the world.
    pelvis: usize,
    charts: Vec<Chart>,
}

impl Relative {
    /// Charts of clips, and of each clip the numbers (C, N), radians, with the whole turns that bring them nearest to the
    /// first one's.
    ///
    /// # Panics
    /// When the clips differ in frames or joints.
    pub(crate) fn of<const K: usize>(clips: [&Clip; K]) -> (Relative, [Vec<f64>; K]) {
        let (skeleton, frames) = (clips[0].skeleton().clone(), clips[0].frames());
        assert!(clips.iter().all(|c| (c.frames(), c.joints()) == (frames, skeleton.joints())), "clips of one shape");
        let pelvis = pelvis(&skeleton);
        let mut charts = Vec::new();
        let mut numbers = clips.map(|_| Vec::with_capacity(3 * skeleton.joints() * frames));
        for joint in 0..skeleton.joints() {
            let paths = clips.map(|clip| (0..frames).map(|f| carried(clip, f, joint, pelvis)).collect::<Vec<Quat>>());
            let slices: Vec<&[Quat]> = paths.iter().map(|path| &**path).collect();
            // the joints that carry the body turn about the vertical; the others have no axis that all clips share
            let chart = Chart::fit(&slices, (joint <= pelvis).then_some(Vec3::Y));
            let mut vectors = paths.map(|path| chart.vectors(&path));
            let (first, others) = vectors.split_at_mut(1);
            others.iter_mut().for_each(|other| chart.nearest_turns(other, &first[0]));
            for (numbers, vectors) in numbers.iter_mut().zip(&vectors) {
                (0..3).for_each(|axis| numbers.extend(vectors.iter().map(|v| v[axis])));
            }
            charts.push(chart);
        }
        (Relative { skeleton, frames, pelvis, charts }, numbers)
    }

    /// `clip`, one of those of [`Relative::of`], its numbers moved from `from` to `to` (both (C, N)): its slow rotations,
    /// the `slow` lowest coefficients of a cosine transform of the numbers, move as far, and carry the fast ones.
    ///
    /// # Errors
    /// Numbers that are not finite.
    ///
    /// # Panics
    /// When numbers have another shape, or `slow` is more than N.
    pub(crate) fn moved(&self, clip: &Clip, from: &[f64], to: &[f64], slow: usize) -> Result<Clip> {
        let dct = LowDct::new(self.frames, slow);
        let low = |series: &[f64]| dct.low_back(&dct.low(series));
        let before: Vec<f64> = from.chunks_exact(self.frames).flat_map(low).collect();
        let after: Vec<f64> = before.iter().zip(from).zip(to).map(|((b, from), to)| b + (to - from)).collect();
        let [x, y, z] = [0, 1, 2].map(|i| low(&clip.root().iter().map(|p| p[i]).collect::<Vec<f64>>()));
        let path = x.into_iter().zip(y).zip(z).map(|((x, y), z)| Vec3::new(x, y, z));
        let (mut root, mut rotations) = (Vec::new(), Vec::new());
        for (f, slow) in path.enumerate() {
            let world = |numbers: &[f64]| GlobalPose::new(&self.skeleton, Vec3::ZERO, &self.pose(numbers, f)).rotations;
            let (before, after, mut pose) = (world(&before), world(&after), clip.global_pose(f));
            for (own, (before, after)) in pose.rotations.iter_mut().zip(before.iter().zip(&after)) {
                // the slow rotation is exchanged in the world, and the fast one stays on the bone's own side
                *own = *after * before.conjugate() * *own;
            }
            rotations.extend(pose.to_local(&self.skeleton));
            root.push(slow + after[0] * (before[0].conjugate() * (clip.root()[f] - slow)));
        }
        Ok(Clip::new(clip.skeleton().clone(), clip.fps(), root, rotations)?)
    }

    /// The local rotations (J) of numbers (C, N) in one frame.
    fn pose(&self, numbers: &[f64], frame: usize) -> Vec<Quat> {
        let at = |channel: usize| numbers[channel * self.frames + frame];
        let rotation = |j: usize| self.charts[j].rotation(Vec3::new(at(3 * j), at(3 * j + 1), at(3 * j + 2)));
        let mut pose: Vec<Quat> = (0..self.charts.len()).map(rotation).collect();
        // from below, while the parent's rotation is still that of the world
        for joint in (1..=self.pelvis).rev() {
            pose[joint] = pose[joint - 1].conjugate() * pose[joint];
        }
        pose
    }
}

/// A joint's rotation in the world up to the pelvis, its local one below.
fn carried(clip: &Clip, frame: usize, joint: usize, pelvis: usize) -> Quat {
    let pose = clip.pose(frame);
    if joint > pelvis { pose[joint] } else { pose[..=joint].iter().copied().product() }
}

#[cfg(test)]
mod tests {
    use super::super::descent::{Method, descend};
    use super::*;
    use crate::Transform;
    use kinelm_motion::rotation::angle_between;
    use kinelm_motion::synth;

    const N: usize = 96;

    /// Two dances, each turning about the vertical at its own speed.
    fn dances() -> [Clip; 2] {
        let mut dances = synth::corpus(4, 2, 3.0, 60.0).unwrap().into_iter();
        [3.0, -4.0].map(|speed| {
            let clip = dances.next().unwrap().clip.slice(20..20 + N);
            let turned = |f: usize| {
                let mut pose = clip.pose(f).to_vec();
                pose[0] = Quat::from_rotation_y(speed * f as f64 / 60.0) * pose[0];
                pose
            };
            let rotations = (0..N).flat_map(turned).collect();
            Clip::new(clip.skeleton().clone(), 60.0, clip.root().to_vec(), rotations).unwrap()
        })
    }

    fn apart(a: &Clip, b: &Clip) -> f64 {
        a.rotations().iter().zip(b.rotations()).map(|(p, q)| angle_between(*p, *q)).fold(0.0, f64::max)
    }

    #[test]
    fn nothing_moved_is_the_first_and_everything_moved_the_second() {
        let [a, b] = dances();
        let (relative, [of_a, of_b]) = Relative::of([&a, &b]);
        for slow in [1, 16, N] {
            let same = relative.moved(&a, &of_a, &of_a, slow).unwrap();
            assert!(apart(&same, &a) < 1e-7, "{slow}");
            assert!(same.root().iter().zip(a.root()).all(|(p, q)| p.distance(*q) < 1e-9), "{slow}");
        }
        let second = relative.moved(&a, &of_a, &of_b, N).unwrap();
        assert!(apart(&second, &b) < 1e-7);
    }

    /// The hips shake and the spine takes it back: the chest stays still, also in a blend with one who bends the spine.
    #[test]
    fn fast_movements_that_fit_together_still_do_in_another_pose() {
        let [a, b] = dances();
        let shake =
            |f: usize| Quat::from_axis_angle(Vec3::new(0.6, 0.0, 0.8), if f.is_multiple_of(2) { 0.02 } else { -0.02 });
        let shaken = |clip: &Clip| {
            let rotations = (0..N).flat_map(|f| {
                let mut pose = clip.global_pose(f);
                pose.rotations[0] *= shake(f);
                pose.to_local(clip.skeleton())
            });
            Clip::new(clip.skeleton().clone(), 60.0, clip.root().to_vec(), rotations.collect()).unwrap()
        };
        // how far a joint of the chest turns from one frame to the next beyond what it does in the frames around
        let shaking = |clip: &Clip, joint: usize| {
            let at = |f: usize| clip.global_pose(f).rotations[joint];
            let step = |f: usize| at(f + 1) * at(f).conjugate();
            (0..N - 2).map(|f| angle_between(step(f), step(f + 1))).sum::<f64>() / (N - 2) as f64
        };
        let (spine, chest) = (3, 9);
        let bend = |clip: &Clip| {
            let mut rotations = clip.rotations().to_vec();
            rotations.chunks_exact_mut(clip.joints()).for_each(|pose| pose[spine] *= Quat::from_rotation_x(1.2));
            Clip::new(clip.skeleton().clone(), 60.0, clip.root().to_vec(), rotations).unwrap()
        };
        let (a, b) = (shaken(&a), bend(&b));
        let (relative, [of_a, of_b]) = Relative::of([&a, &b]);
        let low = Transform::Dct(LowDct::new(N, 16));
        let to = descend(&low, 72, &of_a, &of_b, Method::Closed { amount: 0.5 }).unwrap().window;
        let between = relative.moved(&a, &of_a, &to, 16).unwrap();
        assert!(shaking(&between, 0) > 0.05, "the hips still shake: {}", shaking(&between, 0));
        let (before, after) = (shaking(&a, chest), shaking(&between, chest));
        assert!(before < 0.005 && after < 0.005, "the chest doesn't: {before} {after}");
    }
}
