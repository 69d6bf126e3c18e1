//! How well a map fits a clip: which joints it finds, whether the body stands in its reference pose, where the trunk goes
//! on SMPL's body, and whether the feet point ahead.

use super::find::{self, trunk};
use super::{Humanoid, ReferencePose};
use crate::series::linear_quantile;
use crate::{Clip, GlobalPose, Quat, Skeleton, Vec3, Warning, smpl};

/// Frames of a clip that are examined, evenly spaced.
const FRAMES: usize = 300;
/// The mean error of the trunk's direction above which a map is doubted, degrees.
const TRUNK_DEG: f64 = 5.0;
/// A foot shows its direction if it is at least this long across the body's upright axis, as a fraction of its shin.
const FOOT: f64 = 0.15;
/// A foot shows its direction only below an upright shin: least cosine of the shin with the body's upright axis.
const UPRIGHT_SHIN: f64 = 0.5;
/// The median cosine of the toes with the facing of the hips below which a body is mirrored; recorded
/// people are above 0.5.
const MIRRORED: f64 = -0.5;

/// How well a map fits a clip.
#[derive(Debug, Clone)]
pub struct MapFit {
    /// The rig's joint by SMPL id.
    pub joints: [Option<usize>; 24],
    /// Whether the rig has all required joints and the body stands in the reference pose; else why not.
    pub stands: Result<(), String>,
    /// The mean angle, degrees, between the direction from pelvis to neck on the rig and on SMPL's body that the clip is
    /// retargeted to. `None` for a map without a neck, one that can't be retargeted by, and a clip without frames.
    pub trunk_error_deg: Option<f64>,
    /// The median over the frames of the cosine between the toes and the facing of the hips: near 1 for people, near -1 for
    /// a mirrored body. `None` for a map without legs or shoulders, for feet that always point down or have no
    /// length, and for a clip without frames.
    pub toes_ahead: Option<f64>,
}

impl Humanoid {
    /// How well the map fits a clip on this rig. In long clips 300 frames are examined, evenly spaced.
    pub fn fit(&self, clip: &Clip) -> MapFit {
        let (joints, reference) = (self.map().joints_of(self.rig()), self.pose());
        let step = clip.frames().div_ceil(FRAMES).max(1);
        let poses: Vec<GlobalPose> = (0..clip.frames()).step_by(step).map(|f| clip.global_pose(f)).collect();
        let trunk_error_deg = reference.as_ref().ok().and_then(|reference| trunk_error_deg(&poses, reference));
        let stands = reference.map(|_| ()).map_err(|e| e.to_string());
        MapFit { joints, stands, trunk_error_deg, toes_ahead: toes_ahead(self.rig(), &poses, &joints) }
    }
}

/// What reading a clip says of its map: that it was recognised or needed a reference pose, and doubts of the body.
pub(crate) fn warnings(clip: &Clip, humanoid: &Humanoid) -> Vec<Warning> {
    find::warning(humanoid.found()).into_iter().chain(humanoid.fit(clip).doubts(clip.skeleton())).collect()
}

impl MapFit {
    /// What is doubtful, for a clip on `rig`.
    fn doubts(&self, rig: &Skeleton) -> impl Iterator<Item = Warning> {
        let trunk = self.trunk_error_deg.filter(|e| *e > TRUNK_DEG).map(|e| {
            let list = |joints: &mut dyn Iterator<Item = usize>| {
                joints.map(|j| rig.names()[j].as_str()).collect::<Vec<_>>().join(", ")
            };
            let has = list(&mut trunk(rig, &self.joints).into_iter());
            let mapped = list(&mut [3, 6, 9].into_iter().filter_map(|id| self.joints[id]));
            let what = format!(
                "on SMPL's body the neck is {e:.1} degrees off its direction from the pelvis in the mean: of the trunk's \
                 joints {has} the map has {}; `kinelm inspect FILE --map-out my.toml` writes it, to take others for spine1 \
                 (the lowest), spine2 and spine3 (the highest), and to give it as `map`",
                if mapped.is_empty() { "none" } else { &mapped }
            );
            Warning { kind: "trunk_off", what }
        });
        let mirrored = self.toes_ahead.filter(|cosine| *cosine < MIRRORED).map(|cosine| {
            let what = format!(
                "the toes point where the hips face away from (cosine {cosine:.2} in the median): the body is mirrored, or \
                 its left and right are exchanged; for the first give `mirror_axis` (x, y or z: a program that flips an axis \
                 made it), for the second a `map` in which left and right are exchanged too"
            );
            Warning { kind: "mirrored", what }
        });
        trunk.into_iter().chain(mirrored)
    }
}

/// The mean angle between pelvis to neck on the rig and on SMPL's body, degrees. As in retargeting, pelvis and spine have
/// their rotation relative to the reference pose, and what the rig lacks goes along.
fn trunk_error_deg(poses: &[GlobalPose], reference: &ReferencePose) -> Option<f64> {
    let (pelvis, neck) = (reference.joints[0]?, reference.joints[12]?);
    let body = smpl::neutral();
    let angle = |pose: &GlobalPose| {
        let mut turn = Quat::IDENTITY;
        let mut way = Vec3::ZERO;
        for (id, next) in [(0, 3), (3, 6), (6, 9), (9, 12)] {
            // without a counterpart SMPL's joint goes with the one before, as after retargeting
            if let Some(j) = reference.joints[id] {
                turn = pose.rotations[j] * reference.global.rotations[j].conjugate();
            }
            way += turn * body.offsets()[next];
        }
        let own = pose.positions[neck] - pose.positions[pelvis];
        if own.length() > 0.0 { own.angle_between(way).to_degrees() } else { 0.0 }
    };
    (!poses.is_empty()).then(|| poses.iter().map(angle).sum::<f64>() / poses.len() as f64)
}

fn toes_ahead(rig: &Skeleton, poses: &[GlobalPose], joints: &[Option<usize>; 24]) -> Option<f64> {
    let [left_hip, right_hip, left_shoulder, right_shoulder] = [joints[1]?, joints[2]?, joints[16]?, joints[17]?];
    let feet = [(joints[4]?, joints[7]?, joints[10]), (joints[5]?, joints[8]?, joints[11])];
    let cosine = |pose: &GlobalPose| {
        let at = |j: usize| pose.positions[j];
        let up = (at(left_shoulder) + at(right_shoulder) - at(left_hip) - at(right_hip)).normalize_or_zero();
        // left x up = front in right-handed axes, so a mirrored body gets the opposite sign
        let ahead = (at(left_hip) - at(right_hip)).cross(up);
        // the lower foot carries the body; a swinging foot may point anywhere
        let (knee, ankle, ball) = feet.into_iter().min_by(|a, b| up.dot(at(a.1)).total_cmp(&up.dot(at(b.1))))?;
        // in a kneeling body the tops of the feet may be down, toes to the back
        if up.dot((at(knee) - at(ankle)).normalize_or_zero()) < UPRIGHT_SHIN {
            return None;
        }
        let toes = foot(rig, pose, ankle, ball);
        let toes = toes - up * toes.dot(up);
        let is_long = toes.length() > FOOT * at(knee).distance(at(ankle));
        (ahead.length() > 1e-6 && is_long).then(|| ahead.normalize().dot(toes.normalize()))
    };
    let cosines: Vec<f64> = poses.iter().filter_map(cosine).collect();
    (!cosines.is_empty()).then(|| linear_quantile(cosines, 0.5))
}

/// The vector from an ankle to the ball of its foot, else to the furthest of the ankle's children and end sites.
fn foot(rig: &Skeleton, pose: &GlobalPose, ankle: usize, ball: Option<usize>) -> Vec3 {
    let here = pose.positions[ankle];
    if let Some(ball) = ball {
        return pose.positions[ball] - here;
    }
    let children = rig.children(ankle).map(|c| pose.positions[c] - here);
    let ends = rig.ends().iter().filter(|e| e.parent == ankle).map(|e| pose.rotations[ankle] * e.offset);
    children.chain(ends).max_by(|a, b| a.length().total_cmp(&b.length())).unwrap_or_default()
}
