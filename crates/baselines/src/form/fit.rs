//! Rotations from joint positions, to write the output of a positional model as BVH.
//!
//! Each joint gets the rotation that brings its bones at rest closest to their directions: Wahba's problem. One bone leaves
//! its twist undetermined, no bone the whole rotation; what is undetermined follows the parent. Source: Davenport's
//! q-method, as in Horn, "Closed-form solution of absolute orientation using unit quaternions" (1987).
//!
//! Limits: each joint is fitted by itself, and bones have the skeleton's lengths; positions that contradict these are
//! missed.

use kinelm_linalg::symmetric_eigen;
use kinelm_motion::{Quat, Skeleton, Vec3};

/// Weight of the parent's rotation beside the bones: enough to decide what these leave undetermined.
const PARENT: f64 = 1e-6;

/// (J) local rotations of one frame from the positions (J + E) of joints and end sites, metres.
///
/// # Panics
/// Another number of positions.
pub fn rotations(skeleton: &Skeleton, places: &[Vec3]) -> Vec<Quat> {
    let j = skeleton.joints();
    assert_eq!(places.len(), j + skeleton.ends().len(), "a place of every joint and end site");
    let mut bones: Vec<Vec<(Vec3, Vec3)>> = vec![Vec::new(); j];
    for (child, parent) in skeleton.parents().iter().enumerate() {
        if let Some(parent) = parent {
            bones[*parent].push((skeleton.offsets()[child], places[child] - places[*parent]));
        }
    }
    for (end, place) in skeleton.ends().iter().zip(&places[j..]) {
        bones[end.parent].push((end.offset, *place - places[end.parent]));
    }
    let mut world: Vec<Quat> = Vec::with_capacity(j);
    let mut local = Vec::with_capacity(j);
    for (joint, parent) in skeleton.parents().iter().enumerate() {
        let above = parent.map_or(Quat::IDENTITY, |p| world[p]);
        let own = nearest(&bones[joint], above);
        local.push((above.conjugate() * own).normalize());
        world.push(own);
    }
    local
}

/// The rotation that brings bones at rest closest to their directions; what they leave undetermined is as in `above`.
fn nearest(bones: &[(Vec3, Vec3)], above: Quat) -> Quat {
    let weight: f64 = bones.iter().map(|(rest, there)| rest.length() * there.length()).sum();
    if weight < 1e-12 {
        return above;
    }
    // the parent's axes as three weak bones: they decide only what the real ones leave open
    let axes = [Vec3::X, Vec3::Y, Vec3::Z].map(|axis| (axis * (PARENT * weight), above * axis));
    // b[r][c]: sums of where (r) times rest (c)
    let mut b = [[0.0; 3]; 3];
    for (rest, there) in bones.iter().chain(&axes) {
        for (r, row) in b.iter_mut().enumerate() {
            for (c, sum) in row.iter_mut().enumerate() {
                *sum += there[r] * rest[c];
            }
        }
    }
    let trace = b[0][0] + b[1][1] + b[2][2];
    let z = [b[2][1] - b[1][2], b[0][2] - b[2][0], b[1][0] - b[0][1]];
    let s = |r: usize, c: usize| b[r][c] + b[c][r] - if r == c { trace } else { 0.0 };
    // Horn's matrix: its eigenvector of the largest eigenvalue, the first, is the quaternion w, x, y, z
    #[rustfmt::skip]
    let k = [
        trace, z[0], z[1], z[2],
        z[0], s(0, 0), s(0, 1), s(0, 2),
        z[1], s(1, 0), s(1, 1), s(1, 2),
        z[2], s(2, 0), s(2, 1), s(2, 2),
    ];
    match symmetric_eigen(4, &k) {
        Some((_, v)) => Quat::from_xyzw(v[1], v[2], v[3], v[0]).normalize(),
        None => above,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::rotation::angle_between;

    #[test]
    fn two_bones_determine_a_rotation_and_one_leaves_its_twist() {
        let turn = Quat::from_axis_angle(Vec3::new(1.0, 2.0, -2.0).normalize(), 2.5);
        let (a, b) = (Vec3::new(0.0, 0.3, 0.0), Vec3::new(0.1, 0.0, 0.2));
        let found = nearest(&[(a, turn * a), (b, turn * b)], Quat::IDENTITY);
        assert!(angle_between(found, turn) < 1e-5, "{}", angle_between(found, turn));
        let above = Quat::from_rotation_y(0.7);
        let found = nearest(&[(a, turn * a)], above);
        assert!((found * a - turn * a).length() < 1e-6);
        let swing = kinelm_motion::rotation::swing(above * a, turn * a) * above;
        assert!(angle_between(found, swing) < 1e-4, "no twist beside the swing");
        assert_eq!(nearest(&[(Vec3::ZERO, Vec3::ZERO)], above), above);
    }
}
