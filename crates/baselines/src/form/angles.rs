//! Angles in each joint's own order.

use kinelm_motion::rotation::EulerOrder;
use kinelm_motion::{Clip, Quat};

pub fn frames(clip: &Clip, orders: &[EulerOrder]) -> Vec<f64> {
    let mut frames: Vec<f64> = Vec::with_capacity(clip.frames() * 3 * (1 + orders.len()));
    let mut third = vec![0.0; orders.len()];
    for f in 0..clip.frames() {
        frames.extend(clip.root()[f].to_array());
        for ((q, order), third) in clip.pose(f).iter().zip(orders).zip(&mut third) {
            // at gimbal lock the last frame's third angle decides, so that angles stay continuous
            let angles = order.from_quat(*q, *third);
            *third = angles[2];
            frames.extend(angles);
        }
    }
    frames
}

pub fn turn(root: &mut [f64], order: EulerOrder, by: Quat) {
    let turned = order.from_quat(by * order.to_quat([root[0], root[1], root[2]]), root[2]);
    root.copy_from_slice(&turned);
}

pub fn rotations(frames: &[f64], channels: usize, orders: &[EulerOrder]) -> Vec<Quat> {
    let of = |(angles, order): (&[f64], &EulerOrder)| order.to_quat([angles[0], angles[1], angles[2]]);
    let joints = |frame: &[f64]| frame[3..].chunks_exact(3).zip(orders).map(of).collect::<Vec<_>>();
    frames.chunks_exact(channels).flat_map(joints).collect()
}
