//! The joints between and beyond the limbs: pelvis, spine, neck, head, collars, balls of the feet, hands.

use super::body::{Evidence, NAME, median, normal};
use super::limbs::LimbPair;
use crate::{Skeleton, smpl};

/// Neck to head over the leg: mean of the logarithm and deviation.
const NECK: (f64, f64) = (-2.0, 0.5);
/// Most joints from the neck up.
const MOST_ABOVE: usize = 12;

impl Evidence<'_> {
    /// The pelvis: where legs and trunk part, or a joint just above it whose name says so.
    pub(super) fn pelvis(&self, trunk_root: usize, scale: f64) -> usize {
        let says = |j: usize| self.hints[j].agreement(0);
        let mut found = trunk_root;
        for j in self.tree.upwards(trunk_root).skip(1).take(2) {
            if says(j) >= 0.7 && says(found) < 0.3 && self.tree.way(j, trunk_root) < 0.25 * scale {
                found = j;
            }
        }
        found
    }

    /// Spine, neck and head.
    pub(super) fn trunk(&self, joints: &mut [Option<usize>; 24], trunk_root: usize, arm: &LimbPair, scale: f64) {
        let tree = &self.tree;
        let pelvis = joints[0].unwrap_or(trunk_root);
        let mut spine: Vec<usize> = tree.upwards(arm.parent).take_while(|&j| j != pelvis).collect();
        spine.reverse();
        // joints that never rotate are helpers; in a clip where none does, nothing shows which
        if spine.iter().any(|&j| self.turns[j]) {
            spine.retain(|&j| self.turns[j]);
        }
        let arms = [arm.paths[0][0], arm.paths[1][0]];
        let upwards = tree.children[arm.parent].iter().copied().filter(|c| !arms.contains(c));
        let score = |c: usize| {
            let name = self.hints[c].agreement(12).max(self.hints[c].agreement(15));
            NAME * name + self.above(c, arm) + (self.tree.bone(c) + self.tree.reach[c]).min(0.4 * scale) / (0.2 * scale)
        };
        let first = best(upwards, score);
        let mut above = first.map(|c| self.upper_path(c)).unwrap_or_default();
        // a neck or head may not rotate in a whole clip: its name retains it
        let named = |j: usize| self.hints[j].agreement(12).max(self.hints[j].agreement(15)) > 0.5;
        if above.iter().any(|&j| self.turns[j]) {
            above.retain(|&j| self.turns[j] || named(j));
        }
        // 3ds Max Biped parents its collars to the neck, so the joint where the arms part is the neck, not the chest
        let neck_below = above.first().is_some_and(|&c| self.hints[c].agreement(15) > 0.5)
            && self.hints[arm.parent].agreement(12) > 0.5
            && spine.last() == Some(&arm.parent);
        if neck_below {
            spine.pop();
            above.insert(0, arm.parent);
        }
        // the half point per joint prefers the lowest where names say the same or nothing
        let neck = best(0..above.len(), |i| self.agreement(above[i], 12) - 0.5 * i as f64);
        if let Some(n) = neck {
            let says_head = self.hints[above[n]].agreement(15) > 0.5;
            spine.extend_from_slice(&above[..n]);
            if says_head {
                joints[15] = Some(above[n]);
            } else {
                joints[12] = Some(above[n]);
                joints[15] = self.head(&above[n..], scale);
            }
        }
        match spine[..] {
            [] => {}
            [only] => joints[id_of_one(tree.rig, pelvis, only, joints[12].unwrap_or(arm.parent))] = Some(only),
            [first, .., last] => {
                (joints[3], joints[9]) = (Some(first), Some(last));
                joints[6] = self.middle(&spine);
            }
        }
    }

    /// The joint between the first and last of the spine that is nearest to the position of SMPL's spine2.
    fn middle(&self, spine: &[usize]) -> Option<usize> {
        let offsets = smpl::neutral();
        let [lower, upper] = [6, 9].map(|id| offsets.offsets()[id].length());
        let share = lower / (lower + upper);
        let whole = self.tree.way(spine[0], *spine.last()?);
        let off = |j: usize| (self.tree.way(spine[0], j) / whole - share).abs();
        spine[1..spine.len() - 1].iter().copied().min_by(|a, b| off(*a).total_cmp(&off(*b)))
    }

    /// The way up from the neck: at each joint the child that is called head or neck, else the one that leads straight on.
    fn upper_path(&self, from: usize) -> Vec<usize> {
        let mut path = vec![from];
        let mut at = from;
        loop {
            let score = |c: usize| {
                let hint = &self.hints[c];
                NAME * hint.agreement(12).max(hint.agreement(15))
                    + (self.tree.bone(c) + self.tree.reach[c]) / (self.tree.bone(at) + 1e-9)
            };
            match best(self.tree.children[at].iter().copied(), score) {
                Some(next) if path.len() < MOST_ABOVE => path.push(next),
                _ => return path,
            }
            at = path[path.len() - 1];
        }
    }

    /// The head on the way up from the neck.
    fn head(&self, above: &[usize], scale: f64) -> Option<usize> {
        let score = |i: usize| {
            let j = above[i];
            let branches = if self.tree.children[j].len() > 1 { 1.0 } else { 0.0 };
            let tip = if self.tree.reach[j] <= 0.0 { -1.0 } else { 0.0 };
            self.agreement(j, 15) + normal((self.tree.way(above[0], j) / scale).ln(), NECK) + branches + tip
        };
        let head = above[best(1..above.len(), score)?];
        (self.hints[head].agreement(15) >= 0.0).then_some(head)
    }

    /// How far a joint is above the shoulders, along the trunk, -1 to 1.
    fn above(&self, joint: usize, arm: &LimbPair) -> f64 {
        let mut cosines: Vec<f64> = self
            .poses
            .iter()
            .map(|p| {
                let shoulders = 0.5 * (p[arm.joints(0)[0]] + p[arm.joints(1)[0]]);
                let trunk = shoulders - p[self.tree.rig.parents()[arm.parent].unwrap_or(0)];
                let path = self.tree.path(joint);
                (p[path[path.len() - 1]] - shoulders).normalize_or_zero().dot(trunk.normalize_or_zero())
            })
            .collect();
        median(&mut cosines).unwrap_or(0.0)
    }

    pub(super) fn collar(&self, arm: &LimbPair, side: usize, id: usize) -> Option<usize> {
        let before = &arm.paths[side][..arm.at[0]];
        let score = |i: usize| self.agreement(before[i], id) - 0.1 * i as f64;
        best(0..before.len(), score).map(|i| before[i])
    }

    /// The ball of a foot: the joint after the ankle, or after that one if its name says so.
    pub(super) fn toe(&self, leg: &LimbPair, side: usize, id: usize) -> Option<usize> {
        let ankle = leg.joints(side)[2];
        let usual = leg.next(side);
        let near = self.tree.children[ankle].iter().copied();
        let far = usual.into_iter().flat_map(|j| self.tree.children[j].iter().copied());
        let score = |c: usize| self.hints[c].agreement(id) + if Some(c) == usual { 0.3 } else { 0.0 };
        best(near.chain(far), score).filter(|&ball| self.hints[ball].agreement(id) >= 0.0)
    }

    /// SMPL's hand, where the fingers begin: only where a name says so.
    pub(super) fn hand(&self, arm: &LimbPair, side: usize, id: usize) -> Option<usize> {
        let wrist = arm.joints(side)[2];
        let children = &self.tree.children[wrist];
        let named =
            children.iter().copied().find(|&c| self.hints[c].parts.iter().any(|(part, w)| *part == 22 && *w >= 0.5));
        named.filter(|&c| self.hints[c].agreement(id) > 0.0)
    }
}

/// The SMPL joint of the only joint of a trunk: spine1 (3) or spine3 (9), whichever is nearer as a fraction of the way
/// from pelvis to neck.
pub(in crate::rig) fn id_of_one(rig: &Skeleton, pelvis: usize, joint: usize, neck: usize) -> usize {
    let body = smpl::neutral();
    let length = |ids: &[usize]| ids.iter().map(|&id| body.offsets()[id].length()).sum::<f64>();
    let way = |to: usize| {
        let up = std::iter::successors(Some(to), |&j| rig.parents()[j]).take_while(|&j| j != pelvis);
        up.map(|j| rig.offsets()[j].length()).sum::<f64>()
    };
    let middle = 0.5 * (length(&[3]) + length(&[3, 6, 9])) / length(&[3, 6, 9, 12]);
    if way(joint) < middle * way(neck) { 3 } else { 9 }
}

/// The item with the highest score, the first of equals.
fn best(items: impl Iterator<Item = usize>, score: impl Fn(usize) -> f64) -> Option<usize> {
    // `max_by` returns the last of equals, so the lower index has to count as greater
    items.max_by(|&a, &b| score(a).total_cmp(&score(b)).then(b.cmp(&a)))
}
