//! Quaternions, their signs continuous over time.

use kinelm_motion::rotation::nearest_sign;
use kinelm_motion::{Clip, Quat};

/// Shorter outputs of a network have no direction.
const SHORTEST: f64 = 1e-9;

/// The first frame has the signs nearest to the identity.
pub fn frames(clip: &Clip) -> Vec<f64> {
    let mut frames = Vec::with_capacity(clip.frames() * (3 + 4 * clip.joints()));
    let mut before = vec![Quat::IDENTITY; clip.joints()];
    for f in 0..clip.frames() {
        frames.extend(clip.root()[f].to_array());
        for (q, before) in clip.pose(f).iter().zip(&mut before) {
            // q and -q are one rotation, and the network must not learn jumps between them
            *before = nearest_sign(*q, *before);
            frames.extend([before.w, before.x, before.y, before.z]);
        }
    }
    frames
}

pub fn turn(root: &mut [f64], by: Quat) {
    let q = by * of(root);
    root.copy_from_slice(&[q.w, q.x, q.y, q.z]);
}

/// Normalised. One too short for a direction is that of the previous frame, in the first frame the identity.
pub fn rotations(frames: &[f64], channels: usize) -> Vec<Quat> {
    let joints = (channels - 3) / 4;
    let mut all: Vec<Quat> = Vec::with_capacity(frames.len() / channels * joints);
    for frame in frames.chunks_exact(channels) {
        for q in frame[3..].chunks_exact(4).map(of) {
            let before = all.len().checked_sub(joints).map_or(Quat::IDENTITY, |at| all[at]);
            all.push(if q.length() > SHORTEST { q.normalize() } else { before });
        }
    }
    all
}

fn of(wxyz: &[f64]) -> Quat {
    Quat::from_xyzw(wxyz[1], wxyz[2], wxyz[3], wxyz[0])
}
