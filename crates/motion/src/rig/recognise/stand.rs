//! The reference pose of a recognised rig: its rest pose where a body stands in it, else one that is made from how the
//! joints stand to each other in the mean of a clip.

use crate::rig::SkeletonMap;
use crate::rotation::{Mat3, nearest_sign, quarter_axes, swing};
use crate::{Clip, GlobalPose, Quat, Skeleton, Vec3, smpl};

/// Frames of a clip that are examined, evenly spaced.
const FRAMES: usize = 300;
/// Up to these angles, radians, legs are straight and below the trunk, and both sides are alike.
const STRAIGHT: [f64; 2] = [0.2, 0.06];
/// The same of a rig that a built-in map fits, whose rest pose is taken for one if it can be.
const PLAUSIBLE: [f64; 2] = [1.0, 0.5];
/// Arms may be this far from halfway between out and down, radians.
const OUT_OR_DOWN: f64 = 1.0;
/// The mean sine of a bend from which on it shows its axis.
const BENT: f64 = 0.15;
/// Upper, middle and end of a limb by SMPL id, whether on the right.
const LIMBS: [([usize; 3], bool); 4] =
    [([1, 4, 7], false), ([2, 5, 8], true), ([16, 18, 20], false), ([17, 19, 21], true)];

/// Local rotations (J) of a reference pose of `rig`, in which a body with these joints by SMPL id stands with its arms out.
/// Empty: the rest pose is one.
pub(in crate::rig) fn reference(rig: &Skeleton, joints: &[Option<usize>; 24], clip: Option<&Clip>) -> Vec<Quat> {
    let rest = GlobalPose::new(rig, Vec3::ZERO, &vec![Quat::IDENTITY; rig.joints()]);
    if stands(&rest, joints, STRAIGHT) {
        return Vec::new();
    }
    made(rig, joints, clip)
}

/// Whether a body stands upright with straight legs in the reference pose of a map, with these joints by SMPL id, however
/// a program turned the file by quarters: the pose is given in axes with y up.
pub(in crate::rig) fn is_straight(rig: &Skeleton, map: &SkeletonMap, joints: &[Option<usize>; 24]) -> bool {
    let local = map.local_reference(rig);
    let stands_in = |turn: &Mat3| {
        let offsets = rig.offsets().iter().map(|&o| *turn * o).collect();
        let turned = Skeleton::new(rig.names().to_vec(), rig.parents().to_vec(), offsets, Vec::new());
        turned.is_ok_and(|turned| stands(&GlobalPose::new(&turned, Vec3::ZERO, &local), joints, STRAIGHT))
    };
    let turns = quarter_axes().map(|(x, y)| Mat3::from_cols(x, y, x.cross(y)));
    std::iter::once(Mat3::IDENTITY).chain(turns).any(|turn| stands_in(&turn))
}

/// As [`reference`], for a rig whose rest pose is replaced only if no body stands in it.
pub(in crate::rig) fn reference_if_none(rig: &Skeleton, joints: &[Option<usize>; 24], clip: &Clip) -> Vec<Quat> {
    let rest = GlobalPose::new(rig, Vec3::ZERO, &vec![Quat::IDENTITY; rig.joints()]);
    if stands(&rest, joints, PLAUSIBLE) { Vec::new() } else { made(rig, joints, Some(clip)) }
}

fn made(rig: &Skeleton, joints: &[Option<usize>; 24], clip: Option<&Clip>) -> Vec<Quat> {
    let mut poses = vec![GlobalPose::new(rig, Vec3::ZERO, &vec![Quat::IDENTITY; rig.joints()])];
    if let Some(clip) = clip.filter(|c| c.frames() > 0) {
        let step = clip.frames().div_ceil(FRAMES).max(1);
        poses = (0..clip.frames()).step_by(step).map(|f| clip.global_pose(f)).collect();
    }
    Mean { joints, poses: &poses }.standing(rig)
}

/// Whether a body stands in a pose: legs below the trunk, arms out or down, both sides alike.
fn stands(pose: &GlobalPose, joints: &[Option<usize>; 24], [upright, alike]: [f64; 2]) -> bool {
    let at = |id: usize| joints[id].map_or(Vec3::ZERO, |j| pose.positions[j]);
    let up = (at(16) + at(17) - at(1) - at(2)).normalize_or_zero();
    let across = (at(1) - at(2) + at(16) - at(17)).normalize_or_zero();
    let mirrored = |v: Vec3| v - across * 2.0 * v.dot(across);
    LIMBS.iter().step_by(2).all(|(ids, _)| {
        ids.windows(2).all(|bone| {
            let [left, right] = [0, 1].map(|side| at(bone[1] + side) - at(bone[0] + side));
            let fits = match ids[0] {
                1 => left.angle_between(-up) < upright,
                _ => left.angle_between(across - up) < OUT_OR_DOWN,
            };
            fits && left.angle_between(mirrored(right)) < alike
        })
    })
}

/// A body in the mean of some poses.
struct Mean<'a> {
    joints: &'a [Option<usize>; 24],
    poses: &'a [GlobalPose],
}

impl Mean<'_> {
    /// Mean over the poses of what `vector` gives, in the frame of a joint.
    fn vector(&self, joint: usize, vector: impl Fn(&dyn Fn(usize) -> Vec3) -> Vec3) -> Vec3 {
        let of = |pose: &GlobalPose| {
            let at = |id: usize| self.joints[id].map_or(Vec3::ZERO, |j| pose.positions[j]);
            pose.rotations[joint].inverse() * vector(&at)
        };
        self.poses.iter().map(of).sum::<Vec3>() / self.poses.len() as f64
    }

    /// Mean rotation of `joint` in the frame of `of`.
    fn rotation(&self, of: usize, joint: usize) -> Quat {
        let mut sum = Quat::from_xyzw(0.0, 0.0, 0.0, 0.0);
        let mut last = Quat::IDENTITY;
        for pose in self.poses {
            // q and -q are one rotation: unless their signs agree, a sum of quaternions cancels
            last = nearest_sign(pose.rotations[of].inverse() * pose.rotations[joint], last);
            sum += last;
        }
        // rotations all around: there is no mean, and normalising would give NaN
        if sum.length() < 1e-9 { last } else { sum.normalize() }
    }

    /// Local rotations (J) of the standing pose.
    fn standing(&self, rig: &Skeleton) -> Vec<Quat> {
        let mut global: Vec<Option<Quat>> = vec![None; rig.joints()];
        let Some(pelvis) = self.joints[0] else { return Vec::new() };
        let left =
            self.vector(pelvis, |at| (at(1) - at(2)).normalize_or_zero() + (at(16) - at(17)).normalize_or_zero());
        let up = self.vector(pelvis, |at| {
            let [hips, shoulders, ankles] = [[1, 2], [16, 17], [7, 8]].map(|[a, b]| 0.5 * (at(a) + at(b)));
            (shoulders - hips).normalize_or_zero() + (hips - ankles).normalize_or_zero()
        });
        // the second axis is up and the first as far left as it can be
        let upright = frame(Vec3::Y, Vec3::X) * frame(up, left).inverse();
        global[pelvis] = Some(upright);
        self.trunk(upright, pelvis, &mut global);
        for (ids, right) in LIMBS {
            self.limb(ids, right, upright, pelvis, &mut global);
        }
        let mut local = Vec::with_capacity(rig.joints());
        let mut whole: Vec<Quat> = Vec::with_capacity(rig.joints());
        for (j, own) in global.into_iter().enumerate() {
            // joints without an SMPL counterpart keep their mean local rotation; those above the pelvis go with it
            let parent = rig.parents()[j];
            let q = own.unwrap_or_else(|| match parent {
                _ if rig.descends(pelvis, j) => upright * self.rotation(pelvis, j),
                Some(p) => whole[p] * self.rotation(p, j),
                None => upright,
            });
            whole.push(q);
            local.push(parent.map_or(q, |p| whole[p].inverse() * q).normalize());
        }
        local
    }

    /// Trunk and neck, as straight as SMPL's at rest, so that a body that bows in the mean bows on SMPL too. The head keeps
    /// its mean rotation, since people look ahead in the mean.
    fn trunk(&self, upright: Quat, pelvis: usize, global: &mut [Option<Quat>]) {
        let body = smpl::neutral();
        let chain: Vec<(usize, usize)> =
            [3, 6, 9, 12, 15].into_iter().filter_map(|id| Some((id, self.joints[id]?))).collect();
        for (i, &(id, joint)) in chain.iter().enumerate() {
            let mean = upright * self.rotation(pelvis, joint);
            let straight = chain.get(i + 1).map(|&(next, _)| {
                let still = [6, 9, 12, 15].into_iter().filter(|n| (id + 1..=next).contains(n));
                let bone = self.vector(joint, |at| at(next) - at(id));
                swing(mean * bone, still.map(|n| body.offsets()[n]).sum())
            });
            global[joint] = Some(straight.unwrap_or_default() * mean);
        }
    }

    /// A limb, straight down or out, bending about the axis that it bends about in the poses.
    fn limb(&self, ids: [usize; 3], right: bool, upright: Quat, pelvis: usize, global: &mut [Option<Quat>]) {
        let [Some(upper), Some(lower), Some(end)] = ids.map(|id| self.joints[id]) else { return };
        // a shin goes back, a forearm ahead with the palm down
        let (along, hinge) = match (ids[0] < 3, right) {
            (true, _) => (Vec3::NEG_Y, Vec3::X),
            (false, false) => (Vec3::X, Vec3::NEG_Y),
            (false, true) => (Vec3::NEG_X, Vec3::Y),
        };
        let unit = |at: &dyn Fn(usize) -> Vec3, bone: usize| (at(ids[bone + 1]) - at(ids[bone])).normalize_or_zero();
        for (bone, joint) in [upper, lower].into_iter().enumerate() {
            let own = self.vector(joint, |at| unit(at, bone));
            // the sine of the bend is the cross product's length, so poses with straight limbs add nothing to the mean
            let axis = self.vector(joint, |at| unit(at, 0).cross(unit(at, 1)));
            // a limb that hardly bends has no hinge: it retains its mean roll, and only its direction corrected
            global[joint] = Some(if axis.length() > BENT {
                frame(along, hinge) * frame(own, axis).inverse()
            } else {
                let mean = upright * self.rotation(pelvis, joint);
                swing(mean * own, along) * mean
            });
        }
        let ahead = (ids[0] < 3).then(|| self.foot_ahead(ids[2], ids[2] + 3)).flatten();
        let last = ahead.unwrap_or_else(|| global[lower].unwrap_or_default() * self.rotation(lower, end));
        global[end] = Some(last);
    }
}

impl Mean<'_> {
    /// How a foot stands that points ahead, flat on the floor: its mean rotation in the tenth of the poses in which it is
    /// lowest, heel and ball together. `None` for a foot without a ball.
    fn foot_ahead(&self, ankle: usize, ball: usize) -> Option<Quat> {
        let (ankle, ball) = (self.joints[ankle]?, self.joints[ball]?);
        // the floor's normal is needed here, and the axis of up isn't known before the reference pose is
        let level = self.to_y_up();
        let height = |pose: &GlobalPose| (level * (pose.positions[ball] + pose.positions[ankle])).y;
        let mut low: Vec<&GlobalPose> = self.poses.iter().collect();
        low.sort_by(|a, b| height(a).total_cmp(&height(b)));
        // feet in the air point anywhere; those on the floor are flat
        low.truncate(self.poses.len().div_ceil(10));
        let mut sum = Quat::from_xyzw(0.0, 0.0, 0.0, 0.0);
        let mut last = Quat::IDENTITY;
        for pose in low {
            let foot = level * (pose.positions[ball] - pose.positions[ankle]);
            let flat = Vec3::new(foot.x, 0.0, foot.z);
            last = nearest_sign(swing(flat, Vec3::Z) * level * pose.rotations[ankle], last);
            sum += last;
        }
        (sum.length() > 1e-9).then(|| sum.normalize())
    }

    /// The rotation by quarter turns of the axis that bodies stand along in the poses to +y.
    fn to_y_up(&self) -> Quat {
        let at = |pose: &GlobalPose, id: usize| self.joints[id].map_or(Vec3::ZERO, |j| pose.positions[j]);
        let up: Vec3 = self.poses.iter().map(|p| at(p, 16) + at(p, 17) - at(p, 7) - at(p, 8)).sum();
        let axes = [Vec3::Y, Vec3::Z, Vec3::X, Vec3::NEG_Z, Vec3::NEG_X, Vec3::NEG_Y];
        // the margin makes ties go to the earlier axis, whatever the last bit of a sum is
        let nearest = axes.into_iter().fold(Vec3::Y, |best, a| if up.dot(a) > up.dot(best) + 1e-9 { a } else { best });
        swing(nearest, Vec3::Y)
    }
}

/// The frame whose first axis is along `x` and whose second is as near to `y` as it can be.
fn frame(x: Vec3, y: Vec3) -> Quat {
    let x = x.normalize_or(Vec3::X);
    // Gram-Schmidt; with y along x any perpendicular will do, since nothing shows the roll
    let y = (y - x * x.dot(y)).normalize_or(x.any_orthonormal_vector());
    Quat::from_mat3(&Mat3::from_cols(x, y, x.cross(y)))
}
