//! The drawable body of a skeleton: capsules for bones, spheres for joints, a head, and joints that leave trails.
//!
//! Only a head joint is found by its name. Trunk and limbs are distinguished by the tree and its lengths, so that any rig looks
//! like a body; one without a head joint gets a head beyond its neck or chest.

use crate::{Clip, GlobalPose, Skeleton, Vec3};
use serde::Serialize;

/// A tapered capsule between two points, with radii `ra` and `rb` in metres.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Capsule {
    /// The start, a joint: the one that rotates the bone.
    pub a: usize,
    /// The end point.
    pub b: usize,
    /// Radius at `a`.
    pub ra: f64,
    /// Radius at `b`.
    pub rb: f64,
    /// Whether the rotating joint is given.
    pub given: bool,
}

/// A sphere at a joint.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct JointSphere {
    /// The point.
    pub at: usize,
    /// Radius.
    pub r: f64,
    /// Whether the joint is given.
    pub given: bool,
}

/// A drawable body. Its points are the joints, the end sites, and the top of the head if the body has a chest or a head joint.
#[derive(Debug, Clone, PartialEq)]
pub struct CapsuleBody {
    /// The number of points.
    pub point_count: usize,
    /// Capsules between points.
    pub bones: Vec<Capsule>,
    /// Spheres at joints.
    pub balls: Vec<JointSphere>,
    /// Points with trails: wrists and ankles.
    pub tips: Vec<usize>,
    head: Option<Skull>,
}

/// A head: a capsule from `joint`, of radius `base`, to a point `further` metres beyond it, in the direction from the point
/// `from` to the point `to`.
#[derive(Debug, Clone, PartialEq)]
struct Skull {
    joint: usize,
    from: usize,
    to: usize,
    further: f64,
    base: f64,
}

impl CapsuleBody {
    /// The body of a skeleton of about `height` metres; `given` is (J) or empty.
    pub fn new(skeleton: &Skeleton, height: f64, given: &[bool]) -> Self {
        let tree = Tree::new(skeleton, height);
        let given = |joint: usize| given.get(joint).copied().unwrap_or(false);
        let joints = skeleton.joints();
        let mut bones: Vec<Capsule> = Vec::new();
        for (b, parent) in skeleton.parents().iter().enumerate() {
            let Some(a) = *parent else { continue };
            // a bone without length has no direction, and its capsule would be a ball within others
            if skeleton.offsets()[b].length() > 1e-4 * height {
                let (ra, rb) = tree.radii(a, b);
                bones.push(Capsule { a, b, ra, rb, given: given(a) });
            }
        }
        for (i, end) in skeleton.ends().iter().enumerate() {
            if end.offset.length() > 1e-4 * height {
                let ra = if tree.trunk[end.parent] { 0.024 * height } else { tree.thickness(end.parent) };
                bones.push(Capsule { a: end.parent, b: joints + i, ra, rb: 0.75 * ra, given: given(end.parent) });
            }
        }
        let balls: Vec<JointSphere> = (0..joints)
            .filter(|&j| !tree.trunk[j] && tree.reach[j] > 0.0 && bones.iter().any(|b| b.b == j))
            .map(|j| JointSphere { at: j, r: 1.12 * thickest(&bones, j), given: given(j) })
            .collect();
        let mut points = joints + skeleton.ends().len();
        let head = tree.head();
        if let Some(h) = &head {
            bones.push(Capsule { a: h.joint, b: points, ra: h.base, rb: SKULL * height, given: given(h.joint) });
            points += 1;
        }
        CapsuleBody { point_count: points, bones, balls, tips: tree.tips(), head }
    }

    /// Computes the positions of all points in a frame, metres.
    pub fn points(&self, clip: &Clip, frame: usize, pose: &mut GlobalPose, positions: &mut Vec<Vec3>) {
        pose.set(clip.skeleton(), clip.root()[frame], clip.pose(frame));
        positions.clear();
        positions.extend_from_slice(&pose.positions);
        positions.extend(pose.ends(clip.skeleton()));
        if let Some(h) = &self.head {
            let along = (positions[h.to] - positions[h.from]).normalize_or(Vec3::Y);
            positions.push(positions[h.joint] + along * h.further);
        }
    }

    /// The joint that the head moves with.
    pub fn head_joint(&self) -> Option<usize> {
        self.head.as_ref().map(|head| head.joint)
    }
}

/// The radius of a head's top, and how far its middle is from where the arms branch, as fractions of the height.
const SKULL: f64 = 0.05;
const ABOVE_CHEST: f64 = 0.23;

fn thickest(bones: &[Capsule], joint: usize) -> f64 {
    let at = |b: &Capsule| if b.a == joint { b.ra } else { b.rb };
    bones.iter().filter(|b| b.a == joint || b.b == joint).map(at).fold(0.0, f64::max)
}

/// The first joint below the root whose name ends in "head".
fn head_of(skeleton: &Skeleton) -> Option<usize> {
    (1..skeleton.joints()).find(|&j| skeleton.names()[j].to_lowercase().ends_with("head"))
}

/// Bone length from the head to the root plus the longest chain from the root that avoids the head; `None` without a head.
pub fn standing_height_m(skeleton: &Skeleton) -> Option<f64> {
    let head = head_of(skeleton)?;
    let mut from_root = vec![0.0; skeleton.joints()];
    let (mut neck_side, mut leg) = (vec![false; skeleton.joints()], 0.0f64);
    for j in 1..skeleton.joints() {
        let parent = skeleton.parents()[j].unwrap_or(0);
        from_root[j] = from_root[parent] + skeleton.offsets()[j].length();
        // only the branch of the root that leads to the head; arms on it would else count as legs
        neck_side[j] = neck_side[parent] || (parent == 0 && skeleton.descends(head, j));
        if !neck_side[j] {
            leg = leg.max(from_root[j]);
        }
    }
    (leg > 0.0).then_some(from_root[head] + leg)
}

/// Measures of a skeleton's tree.
struct Tree<'a> {
    skeleton: &'a Skeleton,
    height: f64,
    /// Length of the longest chain from a joint down to a tip, end sites included (J).
    reach: Vec<f64>,
    /// Whether a joint is between pelvis and chest (J): the joints where long limbs branch, and those between.
    trunk: Vec<bool>,
    /// Whether long limbs branch at a joint (J): pelvis and chest.
    parts: Vec<bool>,
}

impl<'a> Tree<'a> {
    fn new(skeleton: &'a Skeleton, height: f64) -> Self {
        let joints = skeleton.joints();
        let mut reach = vec![0.0f64; joints];
        for end in skeleton.ends() {
            reach[end.parent] = reach[end.parent].max(end.offset.length());
        }
        let mut limbs = vec![0; joints];
        // children come after their parents, so backwards a joint's reach is final when its parent takes it
        for j in (1..joints).rev() {
            if let Some(p) = skeleton.parents()[j] {
                let through = reach[j] + skeleton.offsets()[j].length();
                limbs[p] += usize::from(through > 0.2 * height);
                reach[p] = reach[p].max(through);
            }
        }
        // a joint is trunk if limbs branch at it, or at it and below it: children come after their parents
        let parts: Vec<bool> = limbs.iter().map(|&n| n > 1).collect();
        let mut trunk = parts.clone();
        for j in (1..joints).rev() {
            if let (true, Some(p)) = (trunk[j], skeleton.parents()[j]) {
                trunk[p] = true;
            }
        }
        Tree { skeleton, height, reach, trunk, parts }
    }

    /// The radii of the bone from `a` to `b`.
    fn radii(&self, a: usize, b: usize) -> (f64, f64) {
        let h = self.height;
        let (ra, rb) = (self.thickness(a), self.thickness(b));
        match (self.trunk[a], self.trunk[b]) {
            (true, true) => (ra, rb),
            // shoulders and hips, or the neck
            (true, false) if self.reach[b] > 0.2 * h => (0.034 * h, rb.max(0.027 * h)),
            (true, false) => (0.024 * h, 0.02 * h),
            _ if self.reach[b] == 0.0 => (ra, 0.75 * ra),
            _ => (ra, rb),
        }
    }

    /// The radius at a joint: for limbs by the length below it, so that they taper; larger for the trunk where limbs branch.
    fn thickness(&self, joint: usize) -> f64 {
        let along = (self.reach[joint] / self.height).sqrt();
        match (self.trunk[joint], self.parts[joint]) {
            (true, true) => 0.05 * self.height,
            (true, false) => 0.041 * self.height,
            _ => (0.0035 + 0.0357 * along).clamp(0.006, 0.034) * self.height,
        }
    }

    fn head(&self) -> Option<Skull> {
        let Some(joint) = head_of(self.skeleton).filter(|&j| !self.trunk[j]) else { return self.unnamed_head() };
        let from = self.skeleton.parents()[joint]?;
        Some(Skull { joint, from, to: joint, further: 0.052 * self.height, base: 0.04 * self.height })
    }

    /// The head of a body without a head joint: beyond the last joint of its neck, else beyond its chest.
    fn unnamed_head(&self) -> Option<Skull> {
        let (skeleton, h) = (self.skeleton, self.height);
        // the last joint above another one where long limbs branch
        let is_chest =
            |&j: &usize| self.parts[j] && (0..j).any(|above| self.parts[above] && skeleton.descends(j, above));
        let chest = (0..skeleton.joints()).rev().find(is_chest)?;
        let from = skeleton.parents()[chest]?;
        let neck = self.neck(chest);
        let mut joint = neck.unwrap_or(chest);
        while let Some(next) = only(skeleton.children(joint)).filter(|_| neck.is_some()) {
            joint = next;
        }
        let way = if joint == chest { 0.0 } else { self.offset_from(chest, joint).length() };
        let least = if neck.is_some() { 0.052 } else { ABOVE_CHEST };
        let further = (ABOVE_CHEST * h - way).clamp(least * h, ABOVE_CHEST * h);
        let skull = Skull { joint, from, to: chest, further, base: 0.024 * h };
        let Some(above) = skeleton.parents()[joint].filter(|_| neck.is_some()) else { return Some(skull) };
        let end = only(skeleton.ends().iter().enumerate().filter(|(_, end)| end.parent == joint));
        let Some((i, end)) = end.filter(|(_, end)| end.offset.length() > 0.05 * h) else {
            return Some(Skull { from: above, to: joint, ..skull });
        };
        let further = (end.offset.length() - SKULL * h).max(0.052 * h);
        Some(Skull { from: joint, to: skeleton.joints() + i, further, ..skull })
    }

    /// The first joint of the neck: of the chest's children that are shorter than its arms, the one most in line with
    /// the trunk.
    fn neck(&self, chest: usize) -> Option<usize> {
        let skeleton = self.skeleton;
        let through = |j: usize| self.reach[j] + skeleton.offsets()[j].length();
        let arm = skeleton.children(chest).map(through).fold(0.0, f64::max);
        let up = self.offset_from(0, chest).normalize_or(Vec3::Y);
        let onward = |j: usize| skeleton.offsets()[j].normalize_or_zero().dot(up);
        let short = skeleton.children(chest).filter(|&j| through(j) < 0.6 * arm && onward(j) > 0.3);
        short.max_by(|&a, &b| onward(a).total_cmp(&onward(b)))
    }

    /// The position of a joint from one above it, in the rest pose.
    fn offset_from(&self, above: usize, joint: usize) -> Vec3 {
        let (mut at, mut offset) = (joint, Vec3::ZERO);
        while at != above {
            offset += self.skeleton.offsets()[at];
            let Some(parent) = self.skeleton.parents()[at] else { break };
            at = parent;
        }
        offset
    }

    /// The last joint of each long limb that has a child: wrists and ankles.
    fn tips(&self) -> Vec<usize> {
        let skeleton = self.skeleton;
        let limb = |j: &usize| {
            let from_trunk = skeleton.parents()[*j].is_some_and(|p| self.trunk[p]);
            from_trunk && !self.trunk[*j] && self.reach[*j] > 0.2 * self.height
        };
        let mut tips = Vec::new();
        for start in (0..skeleton.joints()).filter(limb) {
            let mut at = start;
            while let Some(next) = skeleton.children(at).find(|&c| self.reach[c] > 0.035 * self.height) {
                at = next;
            }
            tips.push(at);
        }
        tips
    }
}

/// The only one of some things.
fn only<T>(mut all: impl Iterator<Item = T>) -> Option<T> {
    all.next().filter(|_| all.next().is_none())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{EndSite, Quat, smpl};
    use std::sync::Arc;

    /// SMPL's body up to some joints, which have other names, with end sites.
    fn without(left_out: &[usize], ends: &[(usize, Vec3)]) -> Skeleton {
        let body = smpl::neutral();
        let kept: Vec<usize> = (0..24).filter(|j| !left_out.contains(j)).collect();
        let now = |j: usize| kept.iter().position(|&k| k == j);
        let names = kept.iter().map(|j| format!("b{j}")).collect();
        let parents = kept.iter().map(|&j| body.parents()[j].and_then(now)).collect();
        let offsets = kept.iter().map(|&j| body.offsets()[j]).collect();
        let ends = ends.iter().map(|&(j, offset)| EndSite { parent: now(j).unwrap(), offset }).collect();
        Skeleton::new(names, parents, offsets, ends).unwrap()
    }

    /// The top of a body's head at rest.
    fn top(skeleton: Skeleton) -> Vec3 {
        let body = CapsuleBody::new(&skeleton, 1.7, &[]);
        let joints = skeleton.joints();
        let clip = Clip::new(Arc::new(skeleton), 1.0, vec![Vec3::ZERO], vec![Quat::IDENTITY; joints]).unwrap();
        let mut points = Vec::new();
        body.points(&clip, 0, &mut GlobalPose::default(), &mut points);
        assert_eq!(points.len(), body.point_count);
        let skull = body.bones.iter().find(|bone| bone.b == body.point_count - 1).unwrap();
        assert_eq!(Some(skull.a), body.head_joint());
        points[body.point_count - 1]
    }

    #[test]
    fn a_body_without_a_head_joint_has_a_head_where_others_have_it() {
        let usual = top((*smpl::neutral()).clone());
        let up = Vec3::new(0.0, 0.2, 0.02);
        for (what, body) in [
            ("another name", without(&[], &[])),
            ("a neck", without(&[15], &[])),
            ("a neck with an end", without(&[15], &[(12, up)])),
            ("no neck", without(&[12, 15], &[])),
        ] {
            let found = top(body);
            assert!(found.distance(usual) < 0.08, "{what}: {found}, usually {usual}");
        }
        // what has no chest has no head
        let legs = without(&[9, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23], &[]);
        assert_eq!(CapsuleBody::new(&legs, 1.0, &[]).head_joint(), None);
    }

    #[test]
    fn the_model_rig_looks_like_a_body() {
        let s = smpl::neutral();
        let mut given = vec![false; 24];
        given[17] = true;
        let b = CapsuleBody::new(&s, 1.7, &given);
        assert_eq!((b.point_count, b.bones.len()), (25, 24));
        let mut tips = b.tips.clone();
        tips.sort_unstable();
        assert_eq!(tips, [7, 8, 20, 21], "ankles and wrists");
        let given: Vec<_> = b.bones.iter().filter(|b| b.given).map(|b| (b.a, b.b)).collect();
        assert_eq!(given, [(17, 19)], "a given joint turns the bone below it");
        let bone = |a, z| b.bones.iter().find(|b| (b.a, b.b) == (a, z)).unwrap();
        assert!(bone(3, 6).ra > bone(1, 4).ra && bone(1, 4).ra > bone(18, 20).ra);
        assert!(bone(12, 15).ra < bone(9, 13).ra, "the neck is thinner than the shoulders");
    }

    #[test]
    fn hands_with_fingers_are_no_trunk() {
        let mut names: Vec<String> = smpl::NAMES.iter().map(|n| n.to_string()).collect();
        let s = smpl::neutral();
        let (mut parents, mut offsets) = (s.parents().to_vec(), s.offsets().to_vec());
        let mut ends = Vec::new();
        for finger in 0..5 {
            names.push(format!("finger{finger}"));
            parents.push(Some(22));
            offsets.push(Vec3::new(0.08, 0.0, 0.01 * f64::from(finger)));
            ends.push(EndSite { parent: 24 + finger as usize, offset: Vec3::new(0.05, 0.0, 0.0) });
        }
        let s = Skeleton::new(names, parents, offsets, ends).unwrap();
        let b = CapsuleBody::new(&s, 1.7, &[]);
        assert_eq!(b.point_count, 24 + 5 + 5 + 1);
        assert!(b.bones.iter().filter(|b| b.a >= 22).all(|b| b.ra < 0.03));
    }

    #[test]
    fn a_single_joint_is_drawn_without_complaint() {
        let s = Skeleton::new(vec!["a".into()], vec![None], vec![Vec3::ZERO], vec![]).unwrap();
        let b = CapsuleBody::new(&s, 1.0, &[]);
        assert_eq!((b.point_count, b.bones.len(), b.tips.len()), (1, 0, 0));
    }
}
