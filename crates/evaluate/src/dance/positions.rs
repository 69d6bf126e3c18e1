//! Positions of joints as the measures of a dance see them.

use kinelm_motion::smpl::heading_of;
use kinelm_motion::{Clip, Quat, Vec3};

/// Positions of chosen joints, frame after frame.
#[derive(Debug, Clone, PartialEq)]
pub struct JointPositions {
    /// (F, J) metres.
    pub positions: Vec<Vec3>,
    /// J.
    pub joints: usize,
    /// Frames per second.
    pub fps: f64,
}

impl JointPositions {
    /// Of these joints of a clip, in the world.
    ///
    /// # Panics
    /// If the clip lacks one of the joints.
    pub(crate) fn of(clip: &Clip, joints: &[usize]) -> JointPositions {
        let all = clip.positions();
        let positions = all.chunks(clip.joints()).flat_map(|frame| joints.iter().map(|&j| frame[j])).collect();
        JointPositions { positions, joints: joints.len(), fps: clip.fps() }
    }

    /// The same of a clip on SMPL-24 with the pelvis held at 0 and every frame's heading removed: the pose alone.
    ///
    /// # Panics
    /// As [`JointPositions::of`].
    pub(crate) fn of_pose(clip: &Clip, joints: &[usize]) -> JointPositions {
        let all = clip.positions();
        let mut heading = 0.0;
        let positions = all.chunks(clip.joints()).flat_map(|frame| {
            heading = heading_of(frame).unwrap_or(heading);
            let back = Quat::from_rotation_y(-heading);
            joints.iter().map(move |&j| back * (frame[j] - frame[0]))
        });
        JointPositions { positions: positions.collect(), joints: joints.len(), fps: clip.fps() }
    }

    /// F.
    pub fn frames(&self) -> usize {
        self.positions.len() / self.joints.max(1)
    }

    /// Mean speed of the joints from every frame to the next, (F - 1), m/s.
    pub(crate) fn speeds(&self) -> Vec<f64> {
        let frames: Vec<&[Vec3]> = self.positions.chunks(self.joints.max(1)).collect();
        let step = |pair: &[&[Vec3]]| {
            let moved: f64 = pair[0].iter().zip(pair[1]).map(|(p, q)| (*q - *p).length()).sum();
            moved / self.joints as f64 * self.fps
        };
        frames.windows(2).map(step).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::smpl;

    /// A body that stands and turns at a rate while it glides.
    pub fn gliding(frames: usize, speed: f64, turn: f64) -> Clip {
        let mut rotations = vec![Quat::IDENTITY; frames * 24];
        (0..frames).for_each(|f| rotations[f * 24] = Quat::from_rotation_y(turn * f as f64 / 20.0));
        let root = (0..frames).map(|f| Vec3::new(speed * f as f64 / 20.0, 1.0, 0.0)).collect();
        Clip::new(smpl::neutral(), 20.0, root, rotations).unwrap()
    }

    #[test]
    fn a_body_at_rest_faces_z_and_a_turned_one_where_it_is_turned() {
        for turn in [0.0, 1.0, -2.0, 3.0] {
            let mut pose = vec![Quat::IDENTITY; 24];
            pose[0] = Quat::from_rotation_y(turn);
            let clip = Clip::new(smpl::neutral(), 20.0, vec![Vec3::Y], pose).unwrap();
            assert!((heading_of(&clip.positions()).unwrap() - turn).abs() < 1e-12, "{turn}");
        }
        let mut lying = vec![Quat::IDENTITY; 24];
        lying[0] = Quat::from_rotation_z(std::f64::consts::FRAC_PI_2);
        let clip = Clip::new(smpl::neutral(), 20.0, vec![Vec3::Y], lying).unwrap();
        assert_eq!(heading_of(&clip.positions()), None);
    }

    #[test]
    fn a_statue_that_glides_moves_in_the_world_and_not_in_its_pose() {
        let clip = gliding(10, 2.0, 0.0);
        let joints: Vec<usize> = (0..24).collect();
        assert!(JointPositions::of(&clip, &joints).speeds().iter().all(|s| (s - 2.0).abs() < 1e-12));
        let turning = gliding(10, 2.0, 3.0);
        assert!(JointPositions::of_pose(&turning, &joints).speeds().iter().all(|s| *s < 1e-12));
        assert_eq!(JointPositions::of_pose(&turning, &joints).speeds().len(), 9);
        assert_eq!(
            (
                JointPositions::of(&clip.slice(0..0), &joints).frames(),
                JointPositions::of(&clip, &[3, 5]).positions.len()
            ),
            (0, 20)
        );
    }
}
