//! Hips that flip: for some frames they are turned by about half a circle, then they are back. Trackers and models that take
//! one quaternion for another do so; no body does. docs/training.md, "Clips that are not clean".

use crate::Result;
use kinelm_motion::rotation::{angle_between, slerp};
use kinelm_motion::{Clip, Quat, Vec3};
use std::ops::Range;

/// Hips turn by more than this in the frame in which they flip, beyond what they turned by in the frame before, degrees.
pub const FLIP_DEG: f64 = 120.0;
/// The turns away and back are of one size and axis up to this angle, degrees: in between the body goes on turning.
const SAME_DEG: f64 = 45.0;
/// A turn that differs from half a circle about the vertical, or about an axis of the hips' own, by less is exactly that,
/// degrees.
const UPRIGHT_DEG: f64 = 20.0;
/// A joint on the hips that turns by more in the frame of the flip turns against it, degrees.
const AGAINST_DEG: f64 = 90.0;

/// A flip of the hips.
#[derive(Debug, Clone, PartialEq)]
pub struct Flip {
    /// The frames in which they are turned.
    pub frames: Range<usize>,
    /// Whether they are turned about an axis of their own, which goes with the body; else about one of the world.
    own: bool,
    /// By how much at the first and behind the last of them.
    turns: [Quat; 2],
}

impl Flip {
    /// The angle by which the hips are turned in the first frame, degrees.
    pub fn degrees(&self) -> f64 {
        angle_between(self.turns[0], Quat::IDENTITY).to_degrees()
    }
}

/// The flips of joint `hips` of a clip, in the order of time. One that lasts to the clip's end is a cut, and none.
///
/// # Panics
/// If the clip lacks the joint.
pub fn flips(clip: &Clip, hips: usize) -> Vec<Flip> {
    let world = world(clip, hips);
    let step = |f: usize| angle_between(world[f - 1], world[f]).to_degrees();
    let jumps: Vec<usize> = (1..world.len()).filter(|&f| step(f) > FLIP_DEG).collect();
    let (mut found, mut at) = (Vec::new(), 0);
    while let Some(&[first, end]) = jumps.get(at..at + 2) {
        let flip = flip(&world, first..end);
        at += if flip.is_some() { 2 } else { 1 };
        found.extend(flip);
    }
    found
}

/// The flip between two jumps of world rotations (F), if they are one.
fn flip(world: &[Quat], frames: Range<usize>) -> Option<Flip> {
    let Range { start: first, end } = frames;
    // as if the step before went on, and the step after had begun earlier: a dancer who spins as fast doesn't flip
    let ahead = |from: usize, before: usize| world[from] * world[before].conjugate() * world[from];
    let before = ahead(first - 1, first.saturating_sub(2));
    let after = ahead(end, (end + 1).min(world.len() - 1));
    // about an axis of the world, or of the hips
    let of_world = [world[first] * before.conjugate(), world[end - 1] * after.conjugate()];
    let of_own = [before.conjugate() * world[first], after.conjugate() * world[end - 1]];
    let degrees = |a: Quat, b: Quat| angle_between(a, b).to_degrees();
    if !of_world.iter().all(|turn| degrees(*turn, Quat::IDENTITY) > FLIP_DEG) {
        return None;
    }
    // of both kinds of axis the one that fits better
    let nearer = |fit: &dyn Fn(bool, [Quat; 2]) -> (f64, [Quat; 2])| {
        let [world, own] = [(false, of_world), (true, of_own)].map(|(own, turns)| (own, fit(own, turns)));
        let (own, (off, turns)) = if own.1.0 < world.1.0 { own } else { world };
        (off, Flip { frames: first..end, own, turns })
    };
    // the same half turn at both ends
    let (off, flip) = nearer(&|own, turns| {
        let half = nearest_half(turns[0], own);
        (degrees(turns[0], half).max(degrees(turns[1], half)), [half; 2])
    });
    if off < UPRIGHT_DEG {
        return Some(flip);
    }
    let (off, flip) = nearer(&|_, turns| (degrees(turns[0], turns[1]), turns));
    (off < SAME_DEG).then_some(flip)
}

/// A clip whose joint `hips` is turned back over its flips; joints on it that turned against a flip stay where they are. All
/// other rotations are unchanged.
///
/// # Errors
/// None in practice.
///
/// # Panics
/// If the clip lacks the joint.
pub fn turned_back(clip: &Clip, hips: usize, flips: &[Flip]) -> Result<Clip> {
    let (j, mut rotations) = (clip.joints(), clip.rotations().to_vec());
    let parents = clip.skeleton().parents();
    let above = |f: usize| parents[hips].map_or(Quat::IDENTITY, |parent| clip.global_pose(f).rotations[parent]);
    for Flip { frames, own: is_own, turns: [first, last] } in flips {
        let against = |joint: &usize| {
            let turn = angle_between(clip.pose(frames.start - 1)[*joint], clip.pose(frames.start)[*joint]);
            parents[*joint] == Some(hips) && turn.to_degrees() > AGAINST_DEG
        };
        let against: Vec<usize> = (0..j).filter(against).collect();
        for f in frames.clone() {
            let share = (f - frames.start) as f64 / (frames.len() - 1).max(1) as f64;
            let back = slerp(*first, *last, share).conjugate();
            let (above, own) = (above(f), clip.pose(f)[hips]);
            let mended = if *is_own { own * back } else { above.conjugate() * back * above * own };
            rotations[f * j + hips] = mended;
            for joint in &against {
                rotations[f * j + joint] = mended.conjugate() * own * clip.pose(f)[*joint];
            }
        }
    }
    Ok(Clip::new(clip.skeleton().clone(), clip.fps(), clip.root().to_vec(), rotations)?)
}

/// World rotations of a joint (F).
fn world(clip: &Clip, joint: usize) -> Vec<Quat> {
    match clip.skeleton().parents()[joint] {
        None => (0..clip.frames()).map(|f| clip.pose(f)[joint]).collect(),
        Some(_) => (0..clip.frames()).map(|f| clip.global_pose(f).rotations[joint]).collect(),
    }
}

/// The half circle nearest to a turn, about the vertical of the world or about an axis of the hips' `own`. The step of the
/// body itself is in a turn that was found.
fn nearest_half(turn: Quat, own: bool) -> Quat {
    let axes: &[Vec3] = if own { &[Vec3::X, Vec3::Y, Vec3::Z] } else { &[Vec3::Y] };
    let halves = axes.iter().map(|axis| Quat::from_xyzw(axis.x, axis.y, axis.z, 0.0));
    let nearer = |a: &Quat, b: &Quat| angle_between(turn, *a).total_cmp(&angle_between(turn, *b));
    halves.min_by(nearer).unwrap_or(Quat::IDENTITY)
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::{Skeleton, smpl, synth};
    use std::sync::Arc;

    fn largest_deg(a: &Clip, b: &Clip) -> f64 {
        a.rotations().iter().zip(b.rotations()).map(|(a, b)| angle_between(*a, *b).to_degrees()).fold(0.0, f64::max)
    }

    /// The clip with `turn` before the root's rotation in some frames, and before it again at the joints of `against`.
    fn flipped(clip: &Clip, frames: Range<usize>, turn: Quat, against: &[usize]) -> Clip {
        let mut rotations = clip.rotations().to_vec();
        for f in frames {
            let own = rotations[f * clip.joints()];
            rotations[f * clip.joints()] = turn * own;
            for joint in against {
                let local = &mut rotations[f * clip.joints() + joint];
                *local = (turn * own).conjugate() * own * *local;
            }
        }
        Clip::new(clip.skeleton().clone(), clip.fps(), clip.root().to_vec(), rotations).unwrap()
    }

    fn half(axis: Vec3) -> Quat {
        Quat::from_axis_angle(axis, std::f64::consts::PI)
    }

    #[test]
    fn half_a_turn_about_the_vertical_is_found_and_turned_back_exactly() {
        for fps in [20.0, 30.0, 120.0] {
            let clip = synth::corpus(3, 1, 8.0, fps).unwrap().remove(0).clip;
            for frames in [1..2, 40..41, 33..90, 50..clip.frames() - 1] {
                let odd = flipped(&clip, frames.clone(), half(Vec3::Y), &[]);
                let found = flips(&odd, 0);
                assert_eq!(found.iter().map(|flip| flip.frames.clone()).collect::<Vec<_>>(), [frames], "{fps} fps");
                assert!((found[0].degrees() - 180.0).abs() < 1e-6);
                let mended = turned_back(&odd, 0, &found).unwrap();
                assert!(largest_deg(&mended, &clip) < 1e-6, "{}", largest_deg(&mended, &clip));
                assert_eq!(flips(&mended, 0), []);
            }
            assert_eq!(flips(&clip, 0), []);
        }
    }

    #[test]
    fn two_flips_are_two_and_one_to_the_end_is_none() {
        let clip = synth::corpus(3, 1, 8.0, 20.0).unwrap().remove(0).clip;
        let twice = flipped(&flipped(&clip, 20..30, half(Vec3::Y), &[]), 60..99, half(Vec3::Y), &[]);
        assert_eq!(flips(&twice, 0).iter().map(|flip| flip.frames.clone()).collect::<Vec<_>>(), [20..30, 60..99]);
        assert_eq!(flips(&flipped(&clip, 70..clip.frames(), half(Vec3::Y), &[]), 0), [], "a cut");
    }

    /// About another axis the body's own step can't be told from the turn: it is found up to how a step differs from the one
    /// before.
    #[test]
    fn another_axis_is_turned_back_up_to_the_change_of_a_step() {
        let clip = synth::corpus(3, 1, 8.0, 60.0).unwrap().remove(0).clip;
        let odd = flipped(&clip, 100..140, half(Vec3::new(0.6, 0.0, 0.8)), &[]);
        let found = flips(&odd, 0);
        assert_eq!(found.len(), 1);
        let mended = turned_back(&odd, 0, &found).unwrap();
        assert!(largest_deg(&mended, &clip) < 1.0, "{}", largest_deg(&mended, &clip));
    }

    #[test]
    fn joints_that_turn_against_the_flip_stay() {
        let clip = synth::corpus(3, 1, 8.0, 30.0).unwrap().remove(0).clip;
        let odd = flipped(&clip, 60..80, half(Vec3::Y), &[1, 2, 3]);
        let mended = turned_back(&odd, 0, &flips(&odd, 0)).unwrap();
        assert!(largest_deg(&mended, &clip) < 1e-6, "{}", largest_deg(&mended, &clip));
    }

    /// 2.5 turns a second at 5 frames a second: 180 degrees in every frame.
    #[test]
    fn a_pirouette_is_no_flip_even_where_a_frame_is_half_a_turn() {
        for (turns_s, fps) in [(6.0, 20.0), (2.3, 5.0), (2.0, 5.0), (1.0, 20.0)] {
            let turned = |f: usize| Quat::from_rotation_y(std::f64::consts::TAU * turns_s * f as f64 / fps);
            let rotations = (0..60).flat_map(|f| [vec![turned(f)], vec![Quat::IDENTITY; 23]].concat()).collect();
            let clip = Clip::new(smpl::neutral(), fps, vec![Vec3::Y; 60], rotations).unwrap();
            assert_eq!(flips(&clip, 0), [], "{turns_s} turns a second");
        }
    }

    #[test]
    fn hips_below_another_joint_are_turned_back_in_its_frame() {
        let names = ["world", "hips", "spine"].map(String::from).to_vec();
        let rig = Skeleton::new(names, vec![None, Some(0), Some(1)], vec![Vec3::Y; 3], vec![]).unwrap();
        let pose = |f: usize| [half(Vec3::X), Quat::from_rotation_z(0.02 * f as f64), Quat::IDENTITY];
        let clip = Clip::new(Arc::new(rig), 30.0, vec![Vec3::ZERO; 50], (0..50).flat_map(pose).collect()).unwrap();
        let mut rotations = clip.rotations().to_vec();
        (20..30).for_each(|f| rotations[f * 3 + 1] = half(Vec3::Y) * rotations[f * 3 + 1]);
        let odd = Clip::new(clip.skeleton().clone(), 30.0, clip.root().to_vec(), rotations).unwrap();
        let mended = turned_back(&odd, 1, &flips(&odd, 1)).unwrap();
        assert!(largest_deg(&mended, &clip) < 1e-6, "{}", largest_deg(&mended, &clip));
        assert!(flips(&clip.slice(0..0), 1).is_empty() && flips(&clip.slice(0..1), 1).is_empty());
    }

    #[test]
    fn a_flip_about_the_hips_own_axis_goes_with_the_body() {
        let dance = synth::corpus(7, 1, 8.0, 60.0).unwrap().remove(0).clip;
        // a dancer who leans and turns by 60 degrees a second, so that an axis of the body is none of the world's
        let lean = Quat::from_rotation_x(0.5);
        let mut rotations = dance.rotations().to_vec();
        for f in 0..dance.frames() {
            let own = &mut rotations[f * dance.joints()];
            *own = Quat::from_rotation_y(f as f64 / 60.0 * 60f64.to_radians()) * lean * *own;
        }
        let clip = Clip::new(dance.skeleton().clone(), 60.0, dance.root().to_vec(), rotations.clone()).unwrap();
        assert_eq!(flips(&clip, 0), []);
        for axis in [Vec3::X, Vec3::Y, Vec3::Z] {
            for frames in [100..105, 100..130, 100..200] {
                let mut odd = rotations.clone();
                frames.clone().for_each(|f| odd[f * clip.joints()] = odd[f * clip.joints()] * half(axis));
                let odd = Clip::new(clip.skeleton().clone(), 60.0, clip.root().to_vec(), odd).unwrap();
                let found = flips(&odd, 0);
                assert_eq!(found.iter().map(|flip| flip.frames.clone()).collect::<Vec<_>>(), [frames], "{axis}");
                let mended = turned_back(&odd, 0, &found).unwrap();
                let off = largest_deg(&mended, &clip);
                assert!(off < 1e-5, "{axis}: {off} degrees");
            }
        }
    }
}
