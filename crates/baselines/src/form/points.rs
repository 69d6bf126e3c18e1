//! Positions of joints and end sites.

use kinelm_motion::{Clip, GlobalPose, Quat, Vec3};

pub fn frames(clip: &Clip) -> Vec<f64> {
    let mut pose = GlobalPose::default();
    let mut frames = Vec::new();
    for f in 0..clip.frames() {
        let hip = clip.root()[f];
        pose.set(clip.skeleton(), hip, clip.pose(f));
        frames.extend(hip.to_array());
        // joint 0 is the hip itself
        let others = pose.positions[1..].iter().copied().chain(pose.ends(clip.skeleton()));
        frames.extend(others.flat_map(|p| (p - hip).to_array()));
    }
    frames
}

pub fn turn(frame: &mut [f64], by: Quat) {
    for point in frame.chunks_exact_mut(3) {
        (by * Vec3::from_slice(point)).write_to_slice(point);
    }
}

pub fn places(frames: &[f64], channels: usize) -> Vec<Vec3> {
    let of = |frame: &[f64]| {
        let hip = Vec3::from_slice(frame);
        let others = frame[3..].chunks_exact(3).map(|p| hip + Vec3::from_slice(p));
        std::iter::once(hip).chain(others).collect::<Vec<_>>()
    };
    frames.chunks_exact(channels).flat_map(of).collect()
}
