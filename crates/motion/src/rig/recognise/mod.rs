//! Recognising a humanoid rig by what it is: hierarchy, proportions and symmetry, how it stands and moves, and its names.
//!
//! `names` reads each name by itself, `limbs` finds the pairs of chains that could be legs and arms, `body` and `trunk` put
//! them together and score each body, `stand` makes the reference pose. Here the scores become a [`SkeletonMap`] with a
//! confidence for each joint. Nothing depends on the unit, the up axis or the floor.

mod body;
mod limbs;
mod names;
pub(super) mod stand;
pub(super) mod trunk;

use super::SkeletonMap;
use super::map::REQUIRED;
use crate::rotation::angle_between;
use crate::{Clip, GlobalPose, Quat, Skeleton, Vec3, smpl};
use body::{Body, Evidence};
use limbs::Tree;
use names::side_of;

/// More joints than any humanoid has.
const MOST_JOINTS: usize = 2048;
/// Frames of a clip that are examined, evenly spaced.
const FRAMES: usize = 60;
/// The score of hierarchy and proportions at which a rig is as likely a body as not.
const EVEN: f64 = -6.0;
/// Scores this far from [`EVEN`] have odds of one to e.
const SPREAD: f64 = 0.6;
/// The most that names add to that score.
const NAMED: f64 = 2.0;
/// The fraction of the proportions' penalty that names cancel, if they identify every required joint.
const BUILD_BY_NAME: f64 = 0.6;
/// Below this posture names cancel nothing: four-legged animals have thighs and forearms too.
const UPRIGHT: f64 = -2.0;
/// Two bodies whose scores differ by this have odds of one to e.
const SOFTNESS: f64 = 1.2;
/// Spine, neck, head, collars and balls of the feet: where one ends and the next begins, lengths say little.
const VAGUE: [usize; 9] = [3, 6, 9, 10, 11, 12, 13, 14, 15];
/// The highest confidence of such a joint without a name.
const UNNAMED: f64 = 0.8;
/// Below this a rig is no humanoid.
const NONE: f64 = 0.02;
/// The confidence from which a map is used without the caller's consent.
pub const SURE: f64 = 0.9;

/// A body recognised in a rig.
#[derive(Debug, Clone)]
pub struct Recognised {
    /// The map, with a reference pose if the rest pose is none.
    pub map: SkeletonMap,
    /// The rig's joint by SMPL id.
    pub joints: [Option<usize>; 24],
    /// How sure each is, 0 to 1, by SMPL id; 0 where there is none.
    pub confidence: [f64; 24],
    /// The second likeliest joint, by SMPL id.
    pub second: [Option<usize>; 24],
}

impl Recognised {
    /// The lowest confidence of the joints that every map must have.
    pub fn confidence(&self) -> f64 {
        REQUIRED.iter().map(|&id| self.confidence[id]).fold(1.0, f64::min)
    }

    /// Whether the map may be used without the caller's consent.
    pub fn is_sure(&self) -> bool {
        self.confidence() >= SURE
    }

    /// What is doubtful, for messages.
    pub(super) fn doubts(&self, names: &[String]) -> String {
        let doubtful: Vec<String> = REQUIRED
            .iter()
            .filter(|&&id| self.confidence[id] < SURE)
            .map(|&id| match self.joints[id] {
                Some(j) => format!("{} ({}, {:.0} %)", smpl::NAMES[id], names[j], 100.0 * self.confidence[id]),
                None => format!("{} (none)", smpl::NAMES[id]),
            })
            .collect();
        format!("no skeleton map fits, and the rig is not recognised for sure: {}", doubtful.join(", "))
    }

    /// The joints as lines of a skeleton TOML; doubtful ones with the second likeliest as a comment.
    pub(super) fn stub(&self, names: &[String]) -> String {
        let line = |id: usize| {
            let joint = self.joints[id]?;
            let or = self.second[id].filter(|_| self.confidence[id] < SURE);
            let or = or.map(|j| format!("  # or {:?}", names[j])).unwrap_or_default();
            Some(format!("\n  {} = {:?}{or}", smpl::NAMES[id], names[joint]))
        };
        (0..24).filter_map(line).collect()
    }
}

/// Recognises the body of a rig from its skeleton and, if there is one, a clip on it. `None` if it has no two pairs of limbs
/// or is no humanoid.
pub fn recognise(rig: &Skeleton, clip: Option<&Clip>) -> Option<Recognised> {
    if rig.joints() > MOST_JOINTS {
        return None;
    }
    let (poses, turns) = (poses(rig, clip), turns(rig, clip));
    let evidence = Evidence { tree: Tree::new(rig), hints: names::hints(rig.names()), poses, turns };
    let bodies = evidence.bodies();
    let best = bodies.first()?;
    let named = evidence.named(best);
    // `build` is a sum of penalties, at most 0: subtracting a share of it raises the score
    let shape = best.shape() - BUILD_BY_NAME * named * best.build;
    let humanoid = logistic((shape + (0.5 * best.names).min(NAMED) - EVEN) / SPREAD);
    // a rig whose names identify every required joint is reported with its doubts, not with a built-in map's names
    if humanoid < NONE && named < 1.0 {
        return None;
    }
    // relative to the best score, so that `exp` can't underflow for all bodies and the sum is at least 1
    let weight = |b: &Body| ((b.score() - best.score()) / SOFTNESS).exp();
    let all: f64 = bodies.iter().map(weight).sum();
    let mut confidence = [0.0; 24];
    for (id, c) in confidence.iter_mut().enumerate() {
        if best.joints[id].is_some() {
            let share = bodies.iter().filter(|b| b.joints[id] == best.joints[id]).map(weight).sum::<f64>() / all;
            *c = humanoid * share * if side_of(id).1.is_some() { best.sides } else { 1.0 };
            let named = best.joints[id].is_some_and(|j| evidence.is_named(j, id));
            // a joint above the one where legs and trunk part may be the pelvis too, if it rotates in the clip
            let below = |j: usize| evidence.tree.upwards(j).skip(1).any(|above| evidence.turns[above]);
            let vague = VAGUE.contains(&id) || (id == 0 && best.joints[0].is_some_and(below));
            if vague && !named {
                *c = c.min(UNNAMED);
            }
        }
    }
    let second = std::array::from_fn(|id| {
        let others = bodies.iter().map(|b| b.joints[id]).filter(|j| j.is_some() && *j != best.joints[id]);
        others.flatten().next()
    });
    let reference = stand::reference(rig, &best.joints, clip);
    let map = SkeletonMap::of_joints(rig, &best.joints, &reference);
    Some(Recognised { map, joints: best.joints, confidence, second })
}

impl Evidence<'_> {
    /// The share of the required joints whose names say what they are; 0 for a body that isn't upright.
    fn named(&self, body: &Body) -> f64 {
        let agrees = |id: &usize| body.joints[*id].is_some_and(|j| self.hints[j].agreement(*id) > 0.0);
        let named = REQUIRED.iter().filter(|id| agrees(id)).count() as f64 / REQUIRED.len() as f64;
        if body.posture < UPRIGHT { 0.0 } else { named }
    }

    /// Whether a joint's name says that it is the SMPL joint `id`. Of two joints of a collar or foot that follow each other,
    /// with names that say the same, neither says it.
    fn is_named(&self, joint: usize, id: usize) -> bool {
        let own = self.hints[joint].agreement(id);
        let near = self.tree.upwards(joint).skip(1).take(1).chain(self.tree.children[joint].iter().copied());
        let paired = side_of(id).1.is_some();
        own > 0.0 && !(paired && near.into_iter().any(|j| self.hints[j].agreement(id) == own))
    }
}

fn logistic(x: f64) -> f64 {
    1.0 / (1.0 + (-x).exp())
}

/// Whether each joint (J) turns in the clip by more than a degree; all, if none does or there is no clip.
pub(super) fn turns(rig: &Skeleton, clip: Option<&Clip>) -> Vec<bool> {
    let all = vec![true; rig.joints()];
    let Some(clip) = clip.filter(|c| c.frames() > 1) else { return all };
    let step = clip.frames().div_ceil(FRAMES).max(1);
    let turns = |j: usize| {
        let frames = (0..clip.frames()).step_by(step);
        frames.map(|f| angle_between(clip.pose(0)[j], clip.pose(f)[j])).fold(0.0, f64::max) > 0.02
    };
    let found: Vec<bool> = (0..rig.joints()).map(turns).collect();
    if found.iter().any(|t| *t) { found } else { all }
}

/// Positions (J) of the joints in some frames of the clip, else in the rest pose.
fn poses(rig: &Skeleton, clip: Option<&Clip>) -> Vec<Vec<Vec3>> {
    match clip.filter(|c| c.frames() > 0) {
        Some(clip) => {
            let step = clip.frames().div_ceil(FRAMES).max(1);
            (0..clip.frames()).step_by(step).map(|f| clip.global_pose(f).positions).collect()
        }
        None => vec![GlobalPose::new(rig, Vec3::ZERO, &vec![Quat::IDENTITY; rig.joints()]).positions],
    }
}
