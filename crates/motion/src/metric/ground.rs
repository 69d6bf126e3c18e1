//! Floor penetration and floating of a motion.

use crate::feet::aloft::{Aloft, aloft};

/// Tolerated penetration, metres: soles give, and standing heights are no more exact.
const DEPTH_M: f64 = 0.02;
/// Longer than this, both feet up count as floating, seconds.
const UP_S: f64 = 0.25;
/// Sums over frames, which can be merged over clips.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Ground {
    frames: usize,
    inside: usize,
    depth_m: f64,
    floating: usize,
}

impl Ground {
    /// Measures one clip: the foot clearance (F) above the floor ([`Feet::clearance`](crate::rig::Feet::clearance) minus the
    /// floor) and the heights of the pelvis (F), metres.
    ///
    /// A frame floats if both feet are more than 5 cm up for more than 0.25 s around it, unless the pelvis is in free fall:
    /// its acceleration over 0.1 s is within 3 m/s^2 of gravity. Source: docs/measures.md, "Floor and feet".
    ///
    /// # Panics
    /// If the lengths differ.
    pub fn of(least: &[f64], pelvis: &[f64], fps: f64) -> Ground {
        assert_eq!(least.len(), pelvis.len(), "a height of the pelvis for each frame");
        let depth = |h: &f64| (-h - DEPTH_M).max(0.0);
        let mut ground = Ground {
            frames: least.len(),
            inside: least.iter().filter(|h| depth(h) > 0.0).count(),
            depth_m: least.iter().map(depth).sum(),
            floating: 0,
        };
        for Aloft { frames, falls } in aloft(least, pelvis, fps) {
            if frames.len() as f64 > UP_S * fps {
                // frame by frame, so that only the part of a jump that isn't free fall counts
                ground.floating += frames.len() - falls;
            }
        }
        ground
    }

    /// Adds another clip.
    pub fn add(&mut self, other: &Ground) {
        self.frames += other.frames;
        self.inside += other.inside;
        self.depth_m += other.depth_m;
        self.floating += other.floating;
    }

    /// Mean penetration of the lowest foot beyond 2 cm, centimetres; `None` without frames.
    pub fn penetration_cm(&self) -> Option<f64> {
        self.of_frames(100.0 * self.depth_m)
    }

    /// The fraction of frames with such penetration.
    pub fn penetration_share(&self) -> Option<f64> {
        self.of_frames(self.inside as f64)
    }

    /// The fraction of frames that float.
    pub fn floating_share(&self) -> Option<f64> {
        self.of_frames(self.floating as f64)
    }

    fn of_frames(&self, sum: f64) -> Option<f64> {
        (self.frames > 0).then(|| sum / self.frames as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::feet::aloft::UP_M;

    const FPS: f64 = 60.0;

    fn near(found: Option<f64>, expected: f64) -> bool {
        found.is_some_and(|x| (x - expected).abs() < 1e-9)
    }

    #[test]
    fn by_hand() {
        // standing, and 5 cm below the floor for a quarter of the time
        let least: Vec<f64> = (0..200).map(|f| if f < 150 { 0.01 } else { -0.05 }).collect();
        let ground = Ground::of(&least, &[1.0; 200], FPS);
        assert!(near(ground.penetration_cm(), 0.75) && near(ground.penetration_share(), 0.25), "{ground:?}");
        assert!(near(ground.floating_share(), 0.0));
        let mut two = ground;
        two.add(&Ground::of(&[0.0; 200], &[1.0; 200], FPS));
        assert!(near(two.penetration_share(), 0.125));
        assert_eq!(Ground::default().floating_share(), None);
    }

    #[test]
    fn hanging_floats_and_jumps_do_not() {
        let up = |from: usize, to: usize| (0..120).map(|f| if (from..to).contains(&f) { 0.3 } else { 0.0 }).collect();
        let hung: Vec<f64> = up(40, 80);
        assert!(near(Ground::of(&hung, &[1.3; 120], FPS).floating_share(), 40.0 / 120.0));
        let short: Vec<f64> = up(40, 55);
        assert!(near(Ground::of(&short, &[1.3; 120], FPS).floating_share(), 0.0), "a quarter of a second");
        // a jump of 0.6 s
        let t = |f: usize| f as f64 / FPS;
        let height = |f: usize| (4.905 * (t(f) - 0.5) * (1.1 - t(f))).max(0.0);
        let least: Vec<f64> = (0..120).map(height).collect();
        let pelvis: Vec<f64> = least.iter().map(|h| 0.95 + h).collect();
        assert!(least.iter().filter(|h| **h > UP_M).count() > 20, "a real jump");
        assert!(near(Ground::of(&least, &pelvis, FPS).floating_share(), 0.0));
        // the same feet with a pelvis at constant height, as on a swing
        assert!(Ground::of(&least, &[1.0; 120], FPS).floating_share().unwrap() > 0.15);
    }
}
