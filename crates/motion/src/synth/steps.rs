//! Feet: footprints, the steps between them, and the weight on each foot.

use crate::Vec3;

/// A footprint: the toe joint (x, z in `toe`, y 0) and the heading, radians to the left of +z.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Footprint {
    pub toe: Vec3,
    pub heading: f64,
}

/// A step of a foot to its next footprint.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Step {
    pub foot: usize,
    pub start_s: f64,
    pub land_s: f64,
    pub height_m: f64,
    pub to: Footprint,
}

/// A foot at one moment.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Foot {
    /// The toe joint, metres; never below 0.
    pub toe: Vec3,
    /// Radians to the left of +z.
    pub heading: f64,
    /// How far the heel is raised about the toe, radians.
    pub pitch: f64,
}

/// All steps of a dance.
pub struct Steps {
    first: [Footprint; 2],
    steps: Vec<Step>,
}

/// Shortest flight that looks like a step, seconds.
const SHORTEST_S: f64 = 0.22;

impl Steps {
    /// Both feet start at `first`.
    pub fn new(first: [Footprint; 2]) -> Self {
        Steps { first, steps: Vec::new() }
    }

    /// Adds a step that lands after those before it. One foot is always down: a step starts when the previous one has landed,
    /// and is skipped if too little time is left.
    pub fn push(&mut self, mut step: Step) {
        if let Some(last) = self.steps.last() {
            step.start_s = step.start_s.max(last.land_s);
        }
        if step.land_s - step.start_s >= SHORTEST_S {
            self.steps.push(step);
        }
    }

    /// The footprint of a foot before step `upto`, counted over both feet.
    fn print_before(&self, foot: usize, upto: usize) -> Footprint {
        self.steps[..upto].iter().rev().find(|s| s.foot == foot).map_or(self.first[foot], |s| s.to)
    }

    /// The number of steps begun at a time.
    fn begun(&self, time_s: f64) -> usize {
        self.steps.partition_point(|s| s.start_s <= time_s)
    }

    /// The foot at a time, from the steps only.
    pub fn foot(&self, foot: usize, time_s: f64) -> Foot {
        let begun = self.begun(time_s);
        let Some(n) = self.steps[..begun].iter().rposition(|s| s.foot == foot) else {
            let Footprint { toe, heading } = self.first[foot];
            return Foot { toe, heading, pitch: 0.0 };
        };
        let (from, step) = (self.print_before(foot, n), self.steps[n]);
        let t = ((time_s - step.start_s) / (step.land_s - step.start_s)).clamp(0.0, 1.0);
        // the horizontal path starts and ends smoothly; the height peaks a little late, so that feet fall
        let progress = t * t * t * (10.0 - 15.0 * t + 6.0 * t * t);
        let late = t.powf(1.15);
        let arch = 16.0 * (late * (1.0 - late)).powi(2);
        let toe = from.toe.lerp(step.to.toe, progress) + Vec3::Y * (step.height_m * arch);
        let heading = from.heading + (step.to.heading - from.heading) * progress;
        Foot { toe, heading, pitch: (2.0 + 4.0 * step.height_m).min(2.6) * 0.25 * arch }
    }

    /// Fraction of the weight on the left foot, unsmoothed: nearly none in flight, more than half after landing.
    pub fn weight(&self, time_s: f64) -> f64 {
        let left = |foot: usize, share: f64| if foot == 0 { share } else { 1.0 - share };
        match self.steps[..self.begun(time_s)].last() {
            None => 0.5,
            Some(s) if time_s < s.land_s => left(s.foot, 0.04),
            Some(s) => left(s.foot, 0.6),
        }
    }

    /// Whether the foot is down at a time.
    #[cfg(test)]
    pub fn stands(&self, foot: usize, time_s: f64) -> bool {
        !self.steps.iter().any(|s| s.foot == foot && s.start_s < time_s && time_s < s.land_s)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn print(x: f64) -> Footprint {
        Footprint { toe: Vec3::new(x, 0.0, 0.0), heading: 0.0 }
    }

    fn step(foot: usize, start_s: f64, land_s: f64, x: f64) -> Step {
        Step { foot, start_s, land_s, height_m: 0.1, to: print(x) }
    }

    #[test]
    fn a_foot_flies_from_print_to_print() {
        let mut s = Steps::new([print(0.1), print(-0.1)]);
        s.push(step(0, 1.0, 2.0, 0.5));
        s.push(step(1, 1.5, 3.0, 0.3));
        assert_eq!(s.foot(0, 0.5).toe.x, 0.1);
        assert!((s.foot(0, 1.5).toe.x - 0.3).abs() < 1e-12 && s.foot(0, 1.5).toe.y > 0.08);
        assert_eq!(s.foot(0, 2.5).toe, Vec3::new(0.5, 0.0, 0.0));
        // the second step waits for the first
        assert_eq!(s.foot(1, 1.9).toe.x, -0.1);
        assert_eq!(s.foot(1, 3.0).toe.x, 0.3);
        assert!(s.weight(1.5) < 0.1 && s.weight(2.5) > 0.9 && s.weight(0.2) == 0.5);
        assert!(s.stands(0, 0.9) && !s.stands(0, 1.1));
    }

    #[test]
    fn no_step_without_time_for_it() {
        let mut s = Steps::new([print(0.1), print(-0.1)]);
        s.push(step(0, 0.0, 1.0, 0.5));
        s.push(step(1, 0.5, 1.1, 0.9));
        assert_eq!(s.foot(1, 2.0).toe.x, -0.1);
    }
}
