//! Poses without place and heading, and how far apart two of them are.

use kinelm_motion::{Clip, GlobalPose, Quat};

/// Joints whose distances are summed side by side.
const LANES: usize = 8;

/// The joints of each frame relative to the pelvis, turned so that the pelvis faces +z: (F, 3, K / 8, 8) metres, x, y
/// and z apart. K is rounded up; the joints that are added have no distance.
#[derive(Debug, Clone)]
pub(super) struct BodyPoses {
    numbers: Vec<[f32; LANES]>,
    joints: usize,
    blocks: usize,
}

impl BodyPoses {
    /// The `joints` of a clip whose joint 0 is the pelvis.
    pub fn of(clip: &Clip, joints: &[usize]) -> BodyPoses {
        let blocks = joints.len().div_ceil(LANES);
        let mut numbers = vec![[0.0; LANES]; clip.frames() * 3 * blocks];
        let mut pose = GlobalPose::default();
        for (frame, out) in numbers.chunks_exact_mut(3 * blocks).enumerate() {
            pose.set(clip.skeleton(), clip.root()[frame], clip.pose(frame));
            let pelvis = pose.rotations[0];
            // the twist about the vertical: unlike the direction that the pelvis faces, no bow turns it round
            let back = Quat::from_rotation_y(-2.0 * pelvis.y.atan2(pelvis.w));
            for (k, &joint) in joints.iter().enumerate() {
                let place = back * (pose.positions[joint] - pose.positions[0]);
                for axis in 0..3 {
                    out[axis * blocks + k / LANES][k % LANES] = place[axis] as f32;
                }
            }
        }
        BodyPoses { numbers, joints: joints.len(), blocks }
    }

    /// F.
    pub fn frames(&self) -> usize {
        self.numbers.len() / (3 * self.blocks)
    }

    fn frame(&self, frame: usize) -> &[[f32; LANES]] {
        &self.numbers[frame * 3 * self.blocks..][..3 * self.blocks]
    }

    /// The mean distance of the joints between a frame of this clip and one of another, metres.
    pub fn distance(&self, frame: usize, other: &BodyPoses, other_frame: usize) -> f64 {
        let (a, b, n) = (self.frame(frame), other.frame(other_frame), self.blocks);
        let mut sums = [0.0f32; LANES];
        for k in 0..n {
            for (lane, sum) in sums.iter_mut().enumerate() {
                *sum += length([0, 1, 2].map(|axis| a[axis * n + k][lane] - b[axis * n + k][lane]));
            }
        }
        f64::from(sums.iter().sum::<f32>()) / self.joints as f64
    }

    /// (K) the distance of each joint, metres.
    pub fn distances(&self, frame: usize, other: &BodyPoses, other_frame: usize) -> impl Iterator<Item = f64> {
        let (a, b, n) = (self.frame(frame), other.frame(other_frame), self.blocks);
        (0..self.joints).map(move |k| {
            let at = |axis: usize| a[axis * n + k / LANES][k % LANES] - b[axis * n + k / LANES][k % LANES];
            f64::from(length([0, 1, 2].map(at)))
        })
    }
}

fn length([x, y, z]: [f32; 3]) -> f32 {
    (x * x + y * y + z * z).sqrt()
}
