//! A mesh of tapered capsules around the bones of a skeleton, each moved by one joint.

use crate::capsules::{CapsuleBody, standing_height_m};
use crate::{Clip, GlobalPose, Quat, Result, Skeleton, Vec3};
use std::f64::consts::TAU;
use std::sync::Arc;

/// Vertices around a capsule.
const SIDES: usize = 10;
/// The rings of a cap: distance from the bone's end and radius, as multiples of the bone's radius.
const CAP: [(f64, f64); 2] = [(0.71, 0.71), (0.0, 1.0)];

/// A triangle mesh in the rest pose, metres, y up.
#[derive(Debug, Default)]
pub struct Mesh {
    /// Positions (V).
    pub positions: Vec<Vec3>,
    /// Unit normals (V).
    pub normals: Vec<Vec3>,
    /// The joint of each vertex (V).
    pub joints: Vec<usize>,
    /// Triangles (T, 3), counterclockwise from outside.
    pub corners: Vec<[u32; 3]>,
}

impl Mesh {
    /// The mesh of a skeleton with its root at 0.
    ///
    /// # Errors
    /// None for a valid skeleton.
    pub fn of(skeleton: &Arc<Skeleton>) -> Result<Mesh> {
        let rest = Clip::new(skeleton.clone(), 1.0, vec![Vec3::ZERO], vec![Quat::IDENTITY; skeleton.joints()])?;
        let height = standing_height_m(skeleton).unwrap_or_else(|| extent(&rest));
        let body = CapsuleBody::new(skeleton, height, &[]);
        let mut positions = Vec::new();
        body.points(&rest, 0, &mut GlobalPose::default(), &mut positions);
        let mut mesh = Mesh::default();
        for bone in &body.bones {
            mesh.add_capsule(positions[bone.a], positions[bone.b], bone.ra, bone.rb, bone.a);
        }
        Ok(mesh)
    }

    fn add_capsule(&mut self, a: Vec3, b: Vec3, ra: f64, rb: f64, joint: usize) {
        let along = (b - a).normalize_or(Vec3::Y);
        let across = along.any_orthonormal_vector();
        let other = along.cross(across);
        let first = self.positions.len() as u32;
        let mut rings = 0;
        let before = CAP.into_iter().map(|(back, wide)| (a - along * back * ra, wide * ra, -back));
        let after = CAP.into_iter().rev().map(|(back, wide)| (b + along * back * rb, wide * rb, back));
        self.add(a - along * ra, -along, joint);
        for (middle, radius, tilt) in before.chain(after) {
            for side in 0..SIDES {
                let (sin, cos) = (TAU * side as f64 / SIDES as f64).sin_cos();
                let out = across * cos + other * sin;
                self.add(middle + out * radius, (out + along * tilt).normalize_or(out), joint);
            }
            rings += 1;
        }
        self.add(b + along * rb, along, joint);
        let sides = SIDES as u32;
        // `% sides` closes each ring: the last side shares its vertices with the first
        let at = |ring: u32, side: u32| first + 1 + ring * sides + side % sides;
        let last = first + 1 + rings * sides;
        for side in 0..sides {
            self.corners.push([first, at(0, side + 1), at(0, side)]);
            for ring in 0..rings - 1 {
                let [p, q, r, s] = [at(ring, side), at(ring, side + 1), at(ring + 1, side), at(ring + 1, side + 1)];
                self.corners.extend([[p, q, s], [p, s, r]]);
            }
            self.corners.push([last, at(rings - 1, side), at(rings - 1, side + 1)]);
        }
    }

    fn add(&mut self, place: Vec3, normal: Vec3, joint: usize) {
        self.positions.push(place);
        self.normals.push(normal);
        self.joints.push(joint);
    }
}

/// Height of the rest pose, metres, for a body without a head.
fn extent(rest: &Clip) -> f64 {
    let heights = || rest.positions().into_iter().map(|p| p.y);
    let (low, high) = (heights().fold(f64::INFINITY, f64::min), heights().fold(f64::NEG_INFINITY, f64::max));
    (high - low).max(0.1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::smpl;

    #[test]
    fn a_capsule_is_closed_and_looks_outward() {
        let mut mesh = Mesh::default();
        let (a, b) = (Vec3::new(0.1, 0.2, 0.3), Vec3::new(0.1, 0.8, 0.5));
        mesh.add_capsule(a, b, 0.1, 0.05, 3);
        assert_eq!((mesh.positions.len(), mesh.corners.len()), (2 + 4 * SIDES, 2 * SIDES + 2 * 3 * SIDES));
        // each edge occurs once in each direction
        let mut edges: Vec<(u32, u32)> = mesh.corners.iter().flat_map(|&[a, b, c]| [(a, b), (b, c), (c, a)]).collect();
        edges.sort_unstable();
        assert!(edges.windows(2).all(|pair| pair[0] != pair[1]));
        assert!(edges.iter().all(|&(a, b)| edges.binary_search(&(b, a)).is_ok()));
        let middle = (a + b) / 2.0;
        for corners in &mesh.corners {
            let [p, q, r] = corners.map(|at| mesh.positions[at as usize]);
            let out = (q - p).cross(r - p);
            assert!(out.dot((p + q + r) / 3.0 - middle) > 0.0);
            assert!(corners.iter().all(|&at| out.dot(mesh.normals[at as usize]) > 0.0));
        }
    }

    #[test]
    fn every_bone_of_a_body_has_its_joint() {
        let mesh = Mesh::of(&smpl::neutral()).unwrap();
        assert_eq!(mesh.positions.len(), 24 * (2 + 4 * SIDES));
        assert!(mesh.joints.iter().all(|&joint| joint < 24) && mesh.joints.contains(&18));
        assert!(mesh.normals.iter().all(|n| (n.length() - 1.0).abs() < 1e-9));
    }
}
