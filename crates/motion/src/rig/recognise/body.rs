//! The likeliest body: which pairs of limbs are legs and arms, which joints are between and above them, which side is
//! left.
//!
//! Scores are sums of log likelihoods, so that a deviation counts by its square. Limits: a body has one pair of legs
//! and one of arms; further pairs are ignored. Left and right come from names, feet, and the bend of knees and elbows: an
//! unnamed rig with straight limbs and no feet has no certain side.

use super::limbs::{LimbPair, Tree, pairs};
use super::names::{Hint, Side};
use crate::Vec3;

/// What one joint's name counts for, in the unit of the scores: minus half of a squared deviation.
pub(super) const NAME: f64 = 3.0;
/// The number of pairs of limbs that are tried as legs, and as arms.
const CANDIDATES: usize = 40;
/// No single measurement counts for more.
const MOST: f64 = 8.0;
/// Lengths of an adult over the leg, hip to ankle: mean of the logarithm and deviation.
const ARM: (f64, f64) = (-0.46, 0.15);
const TRUNK: (f64, f64) = (-0.65, 0.35);
/// Logarithms of lower over upper bone.
const SHIN: (f64, f64) = (0.0, 0.13);
const FOREARM: (f64, f64) = (-0.05, 0.18);

/// A body found in a rig.
#[derive(Debug, Clone)]
pub(super) struct Body {
    /// The rig's joint by SMPL id.
    pub joints: [Option<usize>; 24],
    /// The score of hierarchy and proportions.
    pub build: f64,
    /// The score of how the body holds itself in the poses.
    pub posture: f64,
    /// And of names.
    pub names: f64,
    /// How sure left and right are, 0.5 to 1.
    pub sides: f64,
}

impl Body {
    /// The score without names.
    pub fn shape(&self) -> f64 {
        self.build + self.posture
    }

    pub fn score(&self) -> f64 {
        self.shape() + self.names
    }
}

/// What is known of a rig.
pub(super) struct Evidence<'a> {
    pub tree: Tree<'a>,
    /// What the names (J) say.
    pub hints: Vec<Hint>,
    /// Positions (J) of the joints in some poses.
    pub poses: Vec<Vec<Vec3>>,
    /// Whether each joint (J) rotates in its parent's frame; all, without a clip that shows it.
    pub turns: Vec<bool>,
}

/// Minus half the squared deviation of `x`, at most [`MOST`].
pub(super) fn normal(x: f64, (mean, deviation): (f64, f64)) -> f64 {
    // NaN comes from bones without length, as ln(0 / 0): the worst fit
    if x.is_nan() { -MOST } else { (-0.5 * ((x - mean) / deviation).powi(2)).max(-MOST) }
}

impl Evidence<'_> {
    /// The bodies of a rig, likeliest first; empty if it has no two pairs of limbs.
    pub fn bodies(&self) -> Vec<Body> {
        let pairs = pairs(&self.tree);
        let likeliest = |score: &dyn Fn(&LimbPair) -> f64| {
            let mut scored: Vec<(f64, &LimbPair)> = pairs.iter().map(|p| (score(p), p)).collect();
            scored.sort_by(|a, b| b.0.total_cmp(&a.0));
            scored.truncate(CANDIDATES);
            scored
        };
        // long pairs first: two fingers of a hand are like chains with well-proportioned bones too
        let longest = pairs.iter().map(LimbPair::length).fold(0.0, f64::max);
        let legs = likeliest(&|p| self.leg(p) + (p.length() / longest).ln());
        let arms = likeliest(&|p| self.arm(p) + (p.length() / longest).ln());
        let mut bodies = Vec::new();
        for (_, leg) in &legs {
            for (_, arm) in &arms {
                bodies.extend(self.body(leg, arm));
            }
        }
        bodies.sort_by(|a: &Body, b| b.score().total_cmp(&a.score()));
        bodies
    }

    fn leg(&self, pair: &LimbPair) -> f64 {
        self.limb(pair, SHIN) + self.named_pair(pair, [1, 4, 7])
    }

    fn arm(&self, pair: &LimbPair) -> f64 {
        self.limb(pair, FOREARM) + self.named_pair(pair, [16, 18, 20])
    }

    /// A pair by itself: the ratio of its bones, whether both sides are alike, and whether the bones are stiff.
    fn limb(&self, pair: &LimbPair, ratio: (f64, f64)) -> f64 {
        normal((pair.bones[1] / pair.bones[0]).ln(), ratio) - pair.uneven.min(MOST) + self.stiff(pair)
    }

    /// How straight the bones are in the poses: a joint that bends between two ends makes their distance less than the
    /// length along the chain.
    fn stiff(&self, pair: &LimbPair) -> f64 {
        let mut sum = 0.0;
        for side in 0..2 {
            let joints = pair.joints(side);
            for bone in 0..2 {
                let (a, b) = (joints[bone], joints[bone + 1]);
                let way = self.tree.way(a, b);
                let straight =
                    self.poses.iter().map(|p| p[a].distance(p[b])).sum::<f64>() / self.poses.len().max(1) as f64;
                sum += normal(1.0 - straight / way, (0.0, 0.02));
            }
        }
        0.5 * sum
    }

    pub(super) fn agreement(&self, joint: usize, id: usize) -> f64 {
        NAME * self.hints[joint].agreement(id)
    }

    /// The agreement of a pair's names with the left joints `ids` and their right ones, the sides as they fit best.
    fn named_pair(&self, pair: &LimbPair, ids: [usize; 3]) -> f64 {
        let way = |left: usize| -> f64 {
            let of = |side: usize, right: usize| -> f64 {
                pair.joints(side).iter().zip(ids).map(|(&j, id)| self.agreement(j, id + right)).sum()
            };
            of(left, 0) + of(1 - left, 1)
        };
        // sides are settled later, in `left`; here the names only have to agree with each other
        way(0).max(way(1))
    }

    /// The body with these legs and arms, if they can belong together.
    fn body(&self, leg: &LimbPair, arm: &LimbPair) -> Option<Body> {
        let tree = &self.tree;
        let arm = &if self.crossed(leg, arm) { arm.swapped() } else { arm.clone() };
        let limbs = |pair: &LimbPair| [pair.paths[0][0], pair.paths[1][0]];
        let separate = limbs(leg).iter().all(|&l| !tree.rig.descends(arm.parent, l))
            && limbs(arm).iter().all(|&a| !tree.rig.descends(leg.parent, a))
            && limbs(leg).iter().all(|l| !limbs(arm).contains(l));
        if !separate {
            return None;
        }
        let trunk_root = tree.common(leg.parent, arm.parent);
        let scale = leg.length();
        let to_shoulders = tree.way(trunk_root, arm.parent) + 0.5 * tree.way(arm.parent, arm.joints(0)[0]);
        let mut build = self.limb(leg, SHIN)
            + self.limb(arm, FOREARM)
            + normal((arm.length() / scale).ln(), ARM)
            + normal((to_shoulders / scale).ln(), TRUNK);
        // a foot goes on for a quarter of the leg at most, and is there
        let beyond = |pair: &LimbPair| (0..2).map(|s| tree.reach[pair.joints(s)[2]]).sum::<f64>() / (2.0 * scale);
        build += if (0.02..0.6).contains(&beyond(leg)) { 0.0 } else { -1.5 };
        build += if beyond(arm) < 0.5 { 0.0 } else { -2.0 };
        // the way from trunk to limb, a pelvis's or a collar's width, is short
        let before = |pair: &LimbPair| tree.way(pair.parent, pair.joints(0)[0]) / scale;
        build += normal(before(leg).max(0.2) - 0.2, (0.0, 0.1)) + normal(before(arm).max(0.35) - 0.35, (0.0, 0.1));

        let (left, sides) = self.left(leg, arm);
        let mut joints = [None; 24];
        for (pair, ids) in [(leg, [1, 4, 7]), (arm, [16, 18, 20])] {
            for (right, side) in [left, 1 - left].into_iter().enumerate() {
                for (joint, id) in pair.joints(side).into_iter().zip(ids) {
                    joints[id + right] = Some(joint);
                }
            }
        }
        joints[0] = Some(self.pelvis(trunk_root, scale));
        self.trunk(&mut joints, trunk_root, arm, scale);
        for (right, side) in [left, 1 - left].into_iter().enumerate() {
            joints[13 + right] = self.collar(arm, side, 13 + right);
            joints[10 + right] = self.toe(leg, side, 10 + right);
            joints[22 + right] = self.hand(arm, side, 22 + right);
        }
        build += if joints[12].is_some() { 0.0 } else { -3.0 };
        let named = joints.iter().enumerate().filter_map(|(id, j)| Some(self.agreement((*j)?, id))).sum::<f64>();
        Some(Body { joints, build, posture: self.posture(leg, arm), names: named, sides })
    }

    /// How well legs and trunk go opposite ways, in the median of the poses.
    fn posture(&self, leg: &LimbPair, arm: &LimbPair) -> f64 {
        let mut cosines: Vec<f64> = self
            .poses
            .iter()
            .map(|p| {
                let mid = |pair: &LimbPair, i: usize| 0.5 * (p[pair.joints(0)[i]] + p[pair.joints(1)[i]]);
                let hips = mid(leg, 0);
                let down = (mid(leg, 2) - hips).normalize_or_zero();
                down.dot((mid(arm, 0) - hips).normalize_or_zero())
            })
            .collect();
        let Some(middle) = median(&mut cosines) else { return 0.0 };
        // not limited to MOST: a body on all fours is no humanoid, whatever else fits
        -0.5 * ((middle + 0.85).max(0.0) / 0.2).powi(2)
    }

    /// Whether the first arm is on the second leg's side, by names and by where they are.
    fn crossed(&self, leg: &LimbPair, arm: &LimbPair) -> bool {
        let says = |pair: &LimbPair, side: usize, joint: Side| {
            pair.joints(side).iter().filter(|&&j| self.hints[j].side == Some(joint)).count() as f64
        };
        let names = |pair: &LimbPair| {
            says(pair, 0, Side::Left) + says(pair, 1, Side::Right)
                - says(pair, 1, Side::Left)
                - says(pair, 0, Side::Right)
        };
        let across = |pair: &LimbPair, p: &[Vec3]| (p[pair.joints(0)[0]] - p[pair.joints(1)[0]]).normalize_or_zero();
        let seen: f64 = self.poses.iter().map(|p| across(leg, p).dot(across(arm, p))).sum();
        let seen = seen / self.poses.len().max(1) as f64;
        // 6 joints of a pair have at most 6 votes: both pairs fully named outweigh the positions, 4 to 2
        names(leg) * names(arm) / 9.0 + 2.0 * seen < 0.0
    }

    /// Which side of the pairs is left (0 or 1), and how sure that is.
    fn left(&self, leg: &LimbPair, arm: &LimbPair) -> (usize, f64) {
        let mut named = 0.0;
        for pair in [leg, arm] {
            for side in 0..2 {
                for joint in pair.joints(side) {
                    named += match (self.hints[joint].side, side) {
                        (None, _) => 0.0,
                        (Some(Side::Left), 0) | (Some(Side::Right), 1) => 1.0,
                        _ => -1.0,
                    };
                }
            }
        }
        let seen = self.facing(leg, arm);
        let total = 1.5 * named + 4.0 * seen;
        let sure = 1.0 / (1.0 + (-total.abs()).exp());
        (usize::from(total < 0.0), sure)
    }

    /// Whether the first side is the left one by how feet, knees and elbows point, -1 to 1.
    fn facing(&self, leg: &LimbPair, arm: &LimbPair) -> f64 {
        let mut sum = 0.0;
        let mut size = 1e-9;
        for p in &self.poses {
            let at = |pair: &LimbPair, side: usize| pair.joints(side).map(|j| p[j]);
            let mid = |pair: &LimbPair| 0.5 * (at(pair, 0)[0] + at(pair, 1)[0]);
            let up = (mid(arm) - mid(leg)).normalize_or_zero();
            let mut front = Vec3::ZERO;
            for side in 0..2 {
                let [hip, knee, ankle] = at(leg, side);
                if let Some(toe) = leg.next(side) {
                    // across the shin: the part of a foot along it, as on tiptoe, says nothing about the front
                    let along = (ankle - knee).normalize_or_zero();
                    let foot = p[toe] - ankle;
                    front += foot - along * foot.dot(along);
                }
                front += off_line(hip, knee, ankle);
                let [shoulder, elbow, wrist] = at(arm, side);
                // an elbow points back where a knee points ahead; arms rotate about their own axis, so it counts half
                front -= 0.5 * off_line(shoulder, elbow, wrist);
            }
            front -= up * front.dot(up);
            let across = (at(leg, 0)[0] - at(leg, 1)[0]).normalize_or_zero()
                + (at(arm, 0)[0] - at(arm, 1)[0]).normalize_or_zero();
            sum += up.cross(front).dot(across) / leg.length();
            size += front.length() / leg.length();
        }
        // the second factor fades evidence from bends under 5 % of the leg, which may be noise or a T-pose
        (sum / (2.0 * size)).clamp(-1.0, 1.0) * (size / (0.05 * self.poses.len().max(1) as f64)).min(1.0)
    }
}

/// From the straight line between `a` and `c` to `b`.
fn off_line(a: Vec3, b: Vec3, c: Vec3) -> Vec3 {
    let along = (c - a).normalize_or_zero();
    let to = b - a;
    to - along * to.dot(along)
}

pub(super) fn median(values: &mut [f64]) -> Option<f64> {
    if values.is_empty() {
        return None;
    }
    let middle = values.len() / 2;
    Some(*values.select_nth_unstable_by(middle, f64::total_cmp).1)
}
