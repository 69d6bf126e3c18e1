//! The feet of a rig, and their clearance above the floor.
//!
//! A body's *feet* are its ankles and balls (SMPL's 7, 8 and 10, 11), each with its height in a standing pose, and the ends
//! of its toes. The toes' ends count where feet are locked and measured, not where the [floor](mod@super::floor) is detected.

use super::ReferencePose;
use crate::{Clip, EndSite, GlobalPose, Skeleton, Vec3, smpl};

/// Length of the end site that a BVH needs below a leaf, as a fraction of the leaf's bone.
pub(crate) const MADE_UP_TIP: f64 = 0.3;

/// A tip nearer to an ankle or ball is no end of a toe, metres.
const SHORTEST_M: f64 = 0.01;

/// The feet of a rig, and the heights of a standing body.
#[derive(Debug, Clone, PartialEq)]
pub struct Feet {
    /// Ankles and balls with their heights in a standing pose, metres.
    pub joints: Vec<(usize, f64)>,
    /// Ends of toes with their heights in a standing pose, metres: [points](GlobalPose::point) below ankles and balls (end
    /// sites and leaf joints) that are no higher than the ankle then. Empty where feet end at their balls.
    pub toes: Vec<(usize, f64)>,
    /// The pelvis joint.
    pub pelvis: usize,
    /// Height of the pelvis in a standing pose, metres.
    pub pelvis_m: f64,
    /// Height of the standing body up to its highest joint or end site, metres.
    pub body_m: f64,
    /// Which joints (J) are feet or descend from one.
    pub(super) of_foot: Vec<bool>,
}

impl Feet {
    /// The feet of `rig` in a reference pose; [`Humanoid::feet`](super::Humanoid::feet) has them.
    ///
    /// The floor of the reference pose is the lowest of ankles, balls and the tips below them. If a rig has ankles only, they
    /// are as high as those of the SMPL body (6 cm), scaled by the leg length.
    pub(crate) fn from_pose(rig: &Skeleton, pose: &ReferencePose) -> Self {
        let joints: Vec<usize> = [7, 8, 10, 11].iter().filter_map(|&id: &usize| pose.joints[id]).collect();
        let of_foot: Vec<bool> = (0..rig.joints()).map(|j| joints.iter().any(|&foot| rig.descends(j, foot))).collect();
        let at = |point: usize| pose.global.point(rig, point);
        let y = |point: usize| at(point).y;
        // tips, each with its joint, are end sites, and leaf joints in files without end sites
        let ends = (rig.joints()..).zip(rig.ends()).filter(|(_, end)| !is_made_up(rig, end));
        let ends: Vec<(usize, usize)> = ends.map(|(point, end)| (point, end.parent)).collect();
        let highest = (0..rig.joints()).chain(ends.iter().map(|end| end.0)).map(y).fold(f64::MIN, f64::max);
        let leaves =
            (0..rig.joints()).filter(|&j| of_foot[j] && !joints.contains(&j) && rig.children(j).next().is_none());
        let ends = ends.into_iter().filter(|&(_, joint)| of_foot[joint]);
        let tips: Vec<(usize, usize)> = ends.chain(leaves.map(|j| (j, j))).collect();
        let lowest = joints.iter().copied().chain(tips.iter().map(|tip| tip.0)).map(y).fold(f64::MAX, f64::min);
        // every map has both ankles, so two joints without tips are ankles: the rig's lowest point is no sole
        let ankles_alone = joints.len() == 2 && tips.is_empty();
        let under = if ankles_alone { smpl_ankle_m() * pose.leg_m() / smpl_leg_m() } else { 0.0 };
        let above = |y: f64| y - lowest + under;
        // `joints` begins with both ankles, which every map has
        let ankle = |joint: usize| joints.iter().take(2).find(|&&ankle| rig.descends(joint, ankle));
        let is_toe = |&(point, joint): &(usize, usize)| {
            ankle(joint).is_some_and(|&ankle| y(point) <= y(ankle))
                && joints.iter().all(|&foot| at(point).distance(at(foot)) > SHORTEST_M)
        };
        let toes = tips.iter().filter(|tip| is_toe(tip)).map(|&(point, _)| (point, above(y(point)))).collect();
        let pelvis = pose.joints[0].unwrap_or(0);
        Feet {
            toes,
            joints: joints.iter().map(|&j| (j, above(y(j)))).collect(),
            pelvis,
            pelvis_m: above(y(pelvis)),
            body_m: above(highest),
            of_foot,
        }
    }

    /// Foot clearance (F): the lowest height of ankles, balls and ends of toes above their standing heights in each frame,
    /// metres, world. Above the floor it is 0 while standing, the height of the lower foot in a jump, and negative if a foot
    /// penetrates the floor.
    ///
    /// # Panics
    /// If the clip is not on a rig with these joints.
    pub fn clearance(&self, clip: &Clip) -> Vec<f64> {
        let mut pose = GlobalPose::default();
        let frame = |f: usize| {
            pose.set(clip.skeleton(), clip.root()[f], clip.pose(f));
            let heights = self.points().map(|(point, rest)| pose.point(clip.skeleton(), point).y - rest);
            heights.min_by(f64::total_cmp).unwrap_or(0.0)
        };
        (0..clip.frames()).map(frame).collect()
    }

    /// [Points](GlobalPose::point) of the feet with their standing heights, metres: ankles, balls, ends of toes.
    pub fn points(&self) -> impl Iterator<Item = (usize, f64)> + '_ {
        self.joints.iter().chain(&self.toes).copied()
    }

    /// Height (F) of the lowest joint in each frame that doesn't belong to a foot, metres, world. It is near the floor when a
    /// body lies, kneels or stands on its hands.
    ///
    /// # Panics
    /// If the clip is not on a rig with these joints.
    pub fn other_heights(&self, clip: &Clip) -> Vec<f64> {
        let lowest = |frame: &[Vec3]| {
            let others = frame.iter().zip(&self.of_foot).filter(|(_, of_foot)| !**of_foot);
            others.map(|(p, _)| p.y).fold(f64::MAX, f64::min)
        };
        clip.positions().chunks_exact(clip.joints()).map(lowest).collect()
    }

    /// The lowest height (F) of ankles and balls above their standing heights, metres, world, each with its joint, at these
    /// positions (F, J).
    pub(super) fn lowest(&self, positions: &[Vec3]) -> Vec<(f64, usize)> {
        let frame = |frame: &[Vec3]| {
            let heights = self.joints.iter().map(|&(j, rest)| (frame[j].y - rest, j));
            heights.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap_or((0.0, 0))
        };
        positions.chunks_exact(self.of_foot.len()).map(frame).collect()
    }
}

/// Whether an end site was added by [`crate::format::bvh::BvhSource::for_skeleton`], because a BVH needs one. It is no part
/// of the foot and must not change the floor.
fn is_made_up(rig: &Skeleton, end: &EndSite) -> bool {
    let bone = rig.offsets()[end.parent];
    // within the precision of a file
    rig.parents()[end.parent].is_some() && end.offset.distance(bone * MADE_UP_TIP) < 1e-4 * bone.length()
}

fn smpl_ankle_m() -> f64 {
    -smpl::neutral().offsets()[10].y
}

fn smpl_leg_m() -> f64 {
    smpl::neutral().offsets()[4].length() + smpl::neutral().offsets()[7].length()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Quat;
    use crate::rig::{Humanoid, SkeletonMap};

    const FPS: f64 = 60.0;
    const STAND: f64 = smpl::STANDING_PELVIS_M;

    fn smpl_map() -> SkeletonMap {
        SkeletonMap::builtin("smpl").unwrap()
    }

    fn near(a: f64, b: f64, tolerance: f64) -> bool {
        (a - b).abs() <= tolerance
    }

    #[test]
    fn the_feet_of_the_neutral_body() {
        let feet = Humanoid::with_map(&smpl::neutral(), &smpl_map()).feet().unwrap();
        let want = [(7, 0.06), (8, 0.06), (10, 0.0), (11, 0.0)];
        for ((joint, rest), (j, r)) in feet.joints.iter().zip(want) {
            assert!(*joint == j && near(*rest, r, 1e-12), "{joint} {rest}");
        }
        assert!(near(feet.pelvis_m, STAND, 1e-12) && near(feet.body_m, 1.58, 0.03), "{feet:?}");
        let root = (0..120).map(|f| Vec3::new(0.0, STAND + 0.3 * f as f64 / FPS, 0.0)).collect();
        let stand = Clip::new(smpl::neutral(), FPS, root, vec![Quat::IDENTITY; 24 * 120]).unwrap();
        for (f, least) in feet.clearance(&stand).iter().enumerate() {
            assert!(near(*least, 0.3 * f as f64 / FPS, 1e-12));
        }
    }

    #[test]
    fn end_sites_are_the_soles() {
        let body = smpl::neutral();
        let ends = [10, 11].map(|parent| EndSite { parent, offset: Vec3::new(0.0, -0.03, 0.08) }).to_vec();
        let parents = body.parents().to_vec();
        let rig = Skeleton::new(body.names().to_vec(), parents, body.offsets().to_vec(), ends).unwrap();
        let feet = Humanoid::with_map(&rig, &smpl_map()).feet().unwrap();
        for ((_, rest), want) in feet.joints.iter().zip([0.09, 0.09, 0.03, 0.03]) {
            assert!(near(*rest, want, 1e-12), "{feet:?}");
        }
    }
}
