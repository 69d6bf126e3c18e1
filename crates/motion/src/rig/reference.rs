//! The pose in which two bodies are compared: a T or A stand facing +z.

use super::SkeletonMap;
use crate::rotation::Mat3;
use crate::{Error, GlobalPose, Quat, Result, Skeleton, Vec3, smpl};

/// A rig that stands in its reference pose, and which of its joints play which SMPL joints.
#[derive(Debug, Clone)]
pub struct ReferencePose {
    /// By SMPL id, the rig's joint.
    pub joints: [Option<usize>; 24],
    /// (J) local rotations; the root's includes the whole-quarter turns that make the body face +z with +y up.
    pub local: Vec<Quat>,
    /// World positions and rotations (J), the root at its own offset.
    pub global: GlobalPose,
}

/// Limb bones, by the SMPL ids of their two ends: upper leg, lower leg, upper arm, lower arm; left and right.
pub const LIMBS: [(usize, usize); 8] = [(1, 4), (4, 7), (16, 18), (18, 20), (2, 5), (5, 8), (17, 19), (19, 21)];

impl ReferencePose {
    /// Stands `rig` in the reference pose of `map`: the local rotations that the map states, identity where it
    /// states none. A rig that stands upright but along other axes (facing -z, or with z up) is turned by whole
    /// quarters.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) when the rig lacks a joint that every map must have, a limb is broken off or without length, or
    /// the pose is no stand: legs not below the hips, shoulders not above them, left and right exchanged.
    pub fn new(rig: &Skeleton, map: &SkeletonMap) -> Result<Self> {
        let joints = bind(rig, map)?;
        let mut local = vec![Quat::IDENTITY; rig.joints()];
        for (name, rotation) in map.reference() {
            // a map serves rigs with and without fingers or toes, so a name that a rig lacks is no fault
            if let Some(j) = rig.find(name) {
                local[j] = rotation;
            }
        }
        let mut global = GlobalPose::new(rig, rig.offsets()[0], &local);
        let turn = upright(&global, &joints).ok_or_else(|| no_stand(map, "it has no up or no left"))?;
        if turn != Quat::IDENTITY {
            local[0] = turn * local[0];
            global.set(rig, rig.offsets()[0], &local);
        }
        let pose = ReferencePose { joints, local, global };
        pose.check(map)?;
        Ok(pose)
    }

    /// World place of an SMPL joint's counterpart.
    pub fn position(&self, smpl_id: usize) -> Option<Vec3> {
        self.joints[smpl_id].map(|j| self.global.positions[j])
    }

    /// From one SMPL joint's counterpart to another's, metres, world.
    fn bone(&self, from: usize, to: usize) -> Vec3 {
        self.position(to).unwrap_or_default() - self.position(from).unwrap_or_default()
    }

    /// Hip to knee to ankle, metres, the mean of both legs.
    pub fn leg_m(&self) -> f64 {
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
            // a leg within 60 degrees of straight down; an arm anywhere but straight up, where twist means nothing
            if leg && down < 0.5 || !leg && down < -0.9 {
                let (a, b) = (smpl::NAMES[a], smpl::NAMES[b]);
                let where_to = if leg { "does not point down" } else { "points up" };
                return Err(no_stand(map, &format!("the bone from {a} to {b} {where_to}")));
            }
        }
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

/// The rig's joint of each SMPL joint.
fn bind(rig: &Skeleton, map: &SkeletonMap) -> Result<[Option<usize>; 24]> {
    let missing = map.missing(rig.names());
    if !missing.is_empty() {
        return Err(unknown_rig(rig.names(), Some(map)));
    }
    let bound = map.bind_any(rig.names());
    let joints = std::array::from_fn(|id| bound.joint(id).and_then(|name| rig.find(name)));
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

/// What to tell a user whose rig no map fits: what the nearest one lacks, and a TOML to begin with.
pub(super) fn unknown_rig(names: &[String], map: Option<&SkeletonMap>) -> Error {
    let nearest = match map {
        Some(map) => Some(map.clone()),
        None => SkeletonMap::names().filter_map(SkeletonMap::builtin).min_by_key(|m| m.missing(names).len()),
    };
    let shown = names.iter().take(12).cloned().collect::<Vec<_>>().join(", ");
    let more = if names.len() > 12 { format!(" and {} more", names.len() - 12) } else { String::new() };
    let mut why = String::new();
    let bound = nearest.map(|m| (m.name.clone(), m.missing(names), m.bind_any(names)));
    if let Some((name, missing, _)) = &bound {
        let nearest = if map.is_some() { "the skeleton map" } else { "no skeleton map fits; the nearest," };
        let comma = if map.is_some() { "" } else { "," };
        why += &format!("{nearest} {name}{comma} finds no {}; ", missing.join(", "));
    }
    why += "write a skeleton TOML and give it as `map` (docs/skeletons.md):\n  name = \"my-rig\"\n  [joints]";
    for id in super::map::REQUIRED {
        let known = bound.as_ref().and_then(|(_, _, b)| b.joint(id)).map(|j| format!("{j:?}"));
        why += &format!("\n  {} = {}", smpl::NAMES[id], known.unwrap_or_else(|| "\"?\"".into()));
    }
    Error::unsupported(format!("a rig of the joints {shown}{more}"), why)
}

/// The turn, one of the 24 by whole quarters, that brings a body's up to +y and its left to +x as nearly as may be.
fn upright(pose: &GlobalPose, joints: &[Option<usize>; 24]) -> Option<Quat> {
    let at = |id: usize| joints[id].map(|j| pose.positions[j]);
    let up = (at(16)? + at(17)? - at(1)? - at(2)?).try_normalize()?;
    let left = (at(1)? - at(2)? + at(16)? - at(17)?).try_normalize()?;
    let left = (left - up * up.dot(left)).try_normalize()?;
    let mut best = (f64::MIN, Quat::IDENTITY);
    for (x, y) in quarter_axes() {
        // columns: where the body's left, up and front lie; the turn back is the transpose
        let turn = Mat3::from_cols(x, y, x.cross(y)).transpose();
        let fit = (turn * left).x + (turn * up).y;
        // identity where two fit alike, so that a rig that stands straight keeps its bits
        if fit > best.0 + 1e-9 || (x == Vec3::X && y == Vec3::Y && fit > best.0 - 1e-9) {
            best = (fit, if (x, y) == (Vec3::X, Vec3::Y) { Quat::IDENTITY } else { Quat::from_mat3(&turn) });
        }
    }
    Some(best.1)
}

/// The 24 pairs of signed axes that stand across each other.
fn quarter_axes() -> impl Iterator<Item = (Vec3, Vec3)> {
    let axes = [Vec3::X, Vec3::NEG_X, Vec3::Y, Vec3::NEG_Y, Vec3::Z, Vec3::NEG_Z];
    axes.into_iter().flat_map(move |x| axes.into_iter().filter(move |y| x.dot(*y) == 0.0).map(move |y| (x, y)))
}
