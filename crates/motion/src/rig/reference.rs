//! Reference poses: the T-pose or A-pose facing +z in which two bodies are compared.

use super::{Recognised, SkeletonMap};
use crate::rotation::{Mat3, quarter_axes};
use crate::{Error, GlobalPose, Quat, Result, Skeleton, Vec3, smpl};

/// A rig in its reference pose, with its joints by SMPL id.
#[derive(Debug, Clone)]
pub struct ReferencePose {
    /// The rig's joint, by SMPL id.
    pub joints: [Option<usize>; 24],
    /// Local rotations (J); the root's includes the quarter turns that make the body face +z with +y up.
    pub local: Vec<Quat>,
    /// World positions and rotations (J), with the root at its own offset.
    pub global: GlobalPose,
}

/// How far from +z a body may face for want of symmetry, radians.
const FACING: f64 = 0.05;

/// Limb bones as the SMPL ids of both ends: upper leg, lower leg, upper arm, lower arm; left, then right.
pub const LIMBS: [(usize, usize); 8] = [(1, 4), (4, 7), (16, 18), (18, 20), (2, 5), (5, 8), (17, 19), (19, 21)];

impl ReferencePose {
    /// Puts `rig` into the reference pose of `map`: the local rotations of the map, identity for the other joints. A rig that
    /// is upright along other axes (facing -z, or with z up) is rotated by quarter turns, and one that faces between them,
    /// below a turned armature, about the vertical.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) or [`Unsupported`](kinelm_store::Error::Unsupported) when the rig lacks a
    /// required joint, a limb is no chain or has no length, or the pose is no T-pose or A-pose: legs not below the hips,
    /// shoulders not above them, left and right exchanged.
    pub fn new(rig: &Skeleton, map: &SkeletonMap) -> Result<Self> {
        let joints = bind(rig, map)?;
        let mut local = map.local_reference(rig);
        let mut global = GlobalPose::new(rig, rig.offsets()[0], &local);
        // quarter turns first: they are exact, and only a body with y up has a heading for `facing` to correct
        let turn = upright(&global, &joints).ok_or_else(|| no_stand(map, "it has no up or no left"))?;
        if turn != Quat::IDENTITY {
            local[0] = turn * local[0];
            global.set(rig, rig.offsets()[0], &local);
        }
        if let Some(turn) = facing(&global, &joints) {
            local[0] = turn * local[0];
            global.set(rig, rig.offsets()[0], &local);
        }
        let pose = ReferencePose { joints, local, global };
        pose.check(map)?;
        Ok(pose)
    }

    /// World position of the joint that corresponds to an SMPL joint.
    pub fn position(&self, smpl_id: usize) -> Option<Vec3> {
        self.joints[smpl_id].map(|j| self.global.positions[j])
    }

    /// The vector from one SMPL joint's counterpart to another's, metres, world.
    fn bone(&self, from: usize, to: usize) -> Vec3 {
        self.position(to).unwrap_or_default() - self.position(from).unwrap_or_default()
    }

    /// Leg length, hip to knee to ankle, metres; the mean of both legs.
    pub(crate) fn leg_m(&self) -> f64 {
        let bones = [(1, 4), (4, 7), (2, 5), (5, 8)];
        0.5 * bones.iter().map(|&(a, b)| self.bone(a, b).length()).sum::<f64>()
    }

    fn check(&self, map: &SkeletonMap) -> Result<()> {
        for (a, b) in LIMBS {
            let length = self.bone(a, b).length();
            if !(length.is_finite() && length > 1e-6) {
                let (a, b) = (smpl::NAMES[a], smpl::NAMES[b]);
                let what = format!("skeleton map {}: the bone from {a} to {b}", map.name);
                return Err(Error::invalid(what, format!("{length} m long"), "a length"));
            }
            let down = -self.bone(a, b).normalize().y;
            let leg = matches!(a, 1 | 2 | 4 | 5);
            // a leg within 60 degrees of straight down; an arm anywhere but straight up, where its twist is undefined
            if leg && down < 0.5 || !leg && down < -0.9 {
                let (a, b) = (smpl::NAMES[a], smpl::NAMES[b]);
                let where_to = if leg { "does not point down" } else { "points up" };
                return Err(no_stand(map, &format!("the bone from {a} to {b} {where_to}")));
            }
        }
        // `upright` put the mean left at +x, so arms whose sides disagree with the hips' point inward
        for side in [[1, 16, 18, 20], [2, 17, 19, 21]] {
            let out = self.bone(side[1], side[3]).normalize() * if side[0] == 1 { 1.0 } else { -1.0 };
            if out.x < -0.5 || out.z < -0.8 {
                return Err(no_stand(map, &format!("the arm from {} points inward or back", smpl::NAMES[side[1]])));
            }
        }
        Ok(())
    }
}

fn no_stand(map: &SkeletonMap, why: &str) -> Error {
    let why = format!(
        "the rig's reference pose is no T-pose or A-pose: {why}; give the local rotations of such a pose under \
         [reference] in a skeleton TOML (docs/skeletons.md), for instance from a frame in which the body stands so"
    );
    Error::unsupported(format!("skeleton map {}", map.name), why)
}

/// The rig's joints by SMPL id.
fn bind(rig: &Skeleton, map: &SkeletonMap) -> Result<[Option<usize>; 24]> {
    let missing = map.missing(rig.names());
    if !missing.is_empty() {
        return Err(unknown_rig(rig.names(), Some(map), None));
    }
    let joints = map.joints_of(rig);
    for (upper, lower) in LIMBS {
        let (Some(u), Some(l)) = (joints[upper], joints[lower]) else { continue };
        if !rig.descends(l, u) {
            let joint = |j: usize, id: usize| format!("{} ({})", rig.names()[j], smpl::NAMES[id]);
            let what = format!("skeleton map {}: {}", map.name, joint(l, lower));
            let found = format!("no descendant of {}", joint(u, upper));
            return Err(Error::invalid(what, found, "one, so that the limb is one chain"));
        }
    }
    Ok(joints)
}

/// The error of a rig that no map fits, with what the map or the nearest one lacks, or what is doubtful in what was
/// recognised, and a TOML to start from.
pub(super) fn unknown_rig(names: &[String], map: Option<&SkeletonMap>, found: Option<&Recognised>) -> Error {
    let shown = names.iter().take(12).cloned().collect::<Vec<_>>().join(", ");
    let more = if names.len() > 12 { format!(" and {} more", names.len() - 12) } else { String::new() };
    let (lacks, stub) = match (map, found) {
        (Some(map), _) => by_names(names, map, &format!("the skeleton map {}", map.name)),
        (None, Some(found)) => (found.doubts(names), found.stub(names)),
        (None, None) => {
            let nearest = SkeletonMap::names().filter_map(SkeletonMap::builtin).min_by_key(|m| m.missing(names).len());
            match nearest {
                Some(map) => by_names(names, &map, &format!("no skeleton map fits; the nearest, {},", map.name)),
                None => (String::new(), String::new()),
            }
        }
    };
    let why = format!(
        "{lacks}; write a skeleton TOML and give it as `map` (docs/skeletons.md):\n  name = \"my-rig\"\n  [joints]{stub}"
    );
    Error::unsupported(format!("a rig of the joints {shown}{more}"), why)
}

/// What a map doesn't find among the names, and the joints that it must have with those it does.
fn by_names(names: &[String], map: &SkeletonMap, what: &str) -> (String, String) {
    let bound = map.bind_any(names);
    let line = |&id: &usize| {
        let known = bound.joint(id).map_or_else(|| "\"?\"".into(), |j| format!("{j:?}"));
        format!("\n  {} = {known}", smpl::NAMES[id])
    };
    let stub = super::map::REQUIRED.iter().map(line).collect();
    (format!("{what} finds no {}", map.missing(names).join(", ")), stub)
}

/// Of the 24 rotations by quarter turns, the one that takes the body's up to +y and its left to +x most nearly.
fn upright(pose: &GlobalPose, joints: &[Option<usize>; 24]) -> Option<Quat> {
    let at = |id: usize| joints[id].map(|j| pose.positions[j]);
    let up = (at(16)? + at(17)? - at(1)? - at(2)?).try_normalize()?;
    let left = (at(1)? - at(2)? + at(16)? - at(17)?).try_normalize()?;
    // orthogonal to up, so that a body that leans isn't matched to a tilted pair of axes
    let left = (left - up * up.dot(left)).try_normalize()?;
    let mut best = (f64::MIN, Quat::IDENTITY);
    for (x, y) in quarter_axes() {
        // the columns are the body's left, up and front; the transpose rotates back
        let turn = Mat3::from_cols(x, y, x.cross(y)).transpose();
        let fit = (turn * left).x + (turn * up).y;
        // identity if two fit equally well, so that the numbers of an upright rig don't change by a bit
        if fit > best.0 + 1e-9 || (x == Vec3::X && y == Vec3::Y && fit > best.0 - 1e-9) {
            best = (fit, if (x, y) == (Vec3::X, Vec3::Y) { Quat::IDENTITY } else { Quat::from_mat3(&turn) });
        }
    }
    Some(best.1)
}

/// The rotation about y that makes an upright body face +z, if it faces elsewhere by more than [`FACING`].
fn facing(pose: &GlobalPose, joints: &[Option<usize>; 24]) -> Option<Quat> {
    let at = |id: usize| joints[id].map(|j| pose.positions[j]);
    let left = at(1)? - at(2)? + at(16)? - at(17)?;
    // a body that faces +z has its left along +x; a rotation by `off` about y takes +x to (cos, 0, -sin)
    let off = (-left.z).atan2(left.x);
    (off.abs() > FACING).then(|| Quat::from_rotation_y(-off))
}
