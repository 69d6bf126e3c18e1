//! The most that joints do: how fast they are, how far they turn from frame to frame, how far knees and elbows bend.

use crate::rotation::angle_between;
use crate::{Clip, Quat};
use std::ops::Range;

/// Joints whose bend has an end: knees and elbows, SMPL ids.
pub const HINGES: [usize; 4] = [4, 5, 18, 19];
/// A joint that turns faster snaps, degrees per second.
const SNAP_DEG_S: f64 = 1000.0;

/// The most that joints of clips on SMPL-24 do, and how often one snaps: turns by more than 1,000 degrees a second, 50 from
/// frame to frame at 20 frames a second. The greatest values and the sum of the snaps, which can be merged over clips.
///
/// All grow with the rate, so only clips of one rate are comparable. See docs/measures.md, "Floor and feet".
#[derive(Debug, Clone, PartialEq)]
pub struct Extremes {
    /// Frames into which a joint snaps.
    pub snaps: usize,
    /// The frames that were looked at, in seconds.
    pub seconds: f64,
    /// (24) the greatest speed of each joint, m/s; 0 of those that weren't looked at.
    pub fastest_m_s: Vec<f64>,
    /// (24) the greatest turn of each joint from frame to frame, degrees.
    pub turn_deg: Vec<f64>,
    /// The greatest bend of each of [`HINGES`], degrees.
    pub bend_deg: [f64; 4],
}

impl Default for Extremes {
    fn default() -> Extremes {
        let none = vec![0.0; 24];
        Extremes { snaps: 0, seconds: 0.0, fastest_m_s: none.clone(), turn_deg: none, bend_deg: [0.0; 4] }
    }
}

impl Extremes {
    /// Looks at these joints in `frames` of a clip. The step into the first of them counts where a frame is before it.
    ///
    /// # Panics
    /// If the clip has no such frames or joints.
    pub fn of(clip: &Clip, joints: &[usize], frames: Range<usize>) -> Extremes {
        let (places, count, fps) = (clip.positions(), clip.joints(), clip.fps());
        let mut found = Extremes { seconds: frames.len() as f64 / fps, ..Extremes::default() };
        for f in frames {
            let mut snaps = false;
            for &joint in joints {
                let turned = clip.pose(f)[joint];
                if let Some(hinge) = HINGES.iter().position(|hinge| *hinge == joint) {
                    let bend = angle_between(Quat::IDENTITY, turned).to_degrees();
                    found.bend_deg[hinge] = found.bend_deg[hinge].max(bend);
                }
                let Some(before) = f.checked_sub(1) else { continue };
                let step = (places[f * count + joint] - places[before * count + joint]).length() * fps;
                let turn = angle_between(clip.pose(before)[joint], turned).to_degrees();
                found.fastest_m_s[joint] = found.fastest_m_s[joint].max(step);
                found.turn_deg[joint] = found.turn_deg[joint].max(turn);
                snaps |= turn * fps > SNAP_DEG_S;
            }
            found.snaps += usize::from(snaps);
        }
        found
    }

    /// Adds another clip.
    pub fn add(&mut self, other: &Extremes) {
        self.snaps += other.snaps;
        self.seconds += other.seconds;
        let most = |all: &mut [f64], other: &[f64]| all.iter_mut().zip(other).for_each(|(a, b)| *a = a.max(*b));
        most(&mut self.fastest_m_s, &other.fastest_m_s);
        most(&mut self.turn_deg, &other.turn_deg);
        most(&mut self.bend_deg, &other.bend_deg);
    }

    /// Frames with a snap a minute; `None` without frames.
    pub fn snaps_per_min(&self) -> Option<f64> {
        (self.seconds > 0.0).then(|| 60.0 * self.snaps as f64 / self.seconds)
    }

    /// The greatest speed of any joint, m/s; `None` without frames.
    pub fn fastest(&self) -> Option<f64> {
        (self.seconds > 0.0).then(|| self.fastest_m_s.iter().copied().fold(0.0, f64::max))
    }

    /// The greatest bend of a knee and of an elbow, degrees.
    pub fn bends(&self) -> [f64; 2] {
        let [a, b, c, d] = self.bend_deg;
        [a.max(b), c.max(d)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Vec3, smpl};

    /// A body that moves by 10 cm per frame, whose left knee and right shoulder have these angles in degrees.
    fn moving(knee: &[f64], shoulder: &[f64]) -> Clip {
        let root = (0..knee.len()).map(|f| Vec3::new(0.1 * f as f64, 1.0, 0.0)).collect();
        let mut rotations = vec![Quat::IDENTITY; 24 * knee.len()];
        for (f, (knee, shoulder)) in knee.iter().zip(shoulder).enumerate() {
            rotations[f * 24 + 4] = Quat::from_rotation_x(knee.to_radians());
            rotations[f * 24 + 17] = Quat::from_rotation_z(shoulder.to_radians());
        }
        Clip::new(smpl::neutral(), 20.0, root, rotations).unwrap()
    }

    #[test]
    fn by_hand() {
        let clip = moving(&[0.0, 49.0, 98.0, 100.0], &[0.0, 0.0, 51.0, -30.0]);
        let found = Extremes::of(&clip, &[0, 4, 17], 0..4);
        assert_eq!((found.snaps, found.seconds, found.snaps_per_min()), (2, 0.2, Some(600.0)));
        assert!((found.turn_deg[4] - 49.0).abs() < 1e-6 && (found.turn_deg[17] - 81.0).abs() < 1e-6, "{found:?}");
        assert!((found.bends()[0] - 100.0).abs() < 1e-6 && found.bends()[1] == 0.0, "{found:?}");
        assert!((found.fastest().unwrap() - 2.0).abs() < 1e-9 && found.fastest_m_s[7] == 0.0, "{found:?}");
        // the step into the first frame, where there is one
        assert_eq!(Extremes::of(&clip, &[17], 2..3).snaps, 1);
        assert_eq!(Extremes::of(&clip.slice(2..3), &[17], 0..1).snaps, 0);
        let mut both = Extremes::of(&clip, &[0, 4, 17], 0..2);
        both.add(&Extremes::of(&clip, &[0, 4, 17], 2..4));
        assert_eq!(both, found);
        assert_eq!((Extremes::default().snaps_per_min(), Extremes::default().fastest()), (None, None));
    }
}
