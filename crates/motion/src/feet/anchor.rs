//! A body that glides over the floor, carried by the foot that stands.

use super::leg::Leg;
use crate::{Clip, Vec3};

/// A foot that is lower than this above its rest may stand, metres.
const LOW_M: f64 = 0.06;
/// The slower a foot is, the more it stands; this fast it counts a quarter, metres a second.
const SLOW_M_S: f64 = 0.1;
/// What is left of a anchor changes over so many seconds around.
const SMOOTH_S: f64 = 0.15;

/// (F) By how much the body is to be moved along the ground, metres, with the floor at `floor_m`: the way that the foot which
/// stands has gone, back. Of several foot joints near the floor the slow ones count. The first `given` frames stay.
pub fn offsets(clip: &Clip, legs: &[Leg; 2], floor_m: f64, given: usize) -> Vec<Vec3> {
    let (places, j, frames) = (clip.positions(), clip.joints(), clip.frames());
    let feet: Vec<(usize, f64)> = legs.iter().flat_map(|leg| leg.foot.iter().copied()).collect();
    let step = |f: usize| {
        let (mut sum, mut weight, mut sure) = (Vec3::ZERO, 0.0, 0.0f64);
        for &(joint, rest) in &feet {
            let [a, b] = [places[f * j + joint], places[(f + 1) * j + joint]];
            let low = (1.0 - (a.y.max(b.y) - floor_m - rest) / LOW_M).clamp(0.0, 1.0);
            let way = Vec3::new(b.x - a.x, 0.0, b.z - a.z);
            let slow = SLOW_M_S / (SLOW_M_S + way.length() * clip.fps());
            sum += way * (low * slow * slow);
            weight += low * slow * slow;
            sure = sure.max(low);
        }
        // near the floor all of it, higher up less: a jump glides on
        if weight > 0.0 { sum / weight * (2.0 * sure).min(1.0) } else { Vec3::ZERO }
    };
    let steps: Vec<Vec3> = (0..frames.saturating_sub(1)).map(step).collect();
    let half = (SMOOTH_S * clip.fps()).round() as usize;
    let around = |f: usize| {
        let around = &steps[f.saturating_sub(half)..(f + half + 1).min(steps.len())];
        around.iter().sum::<Vec3>() / around.len() as f64
    };
    let mut at = Vec3::ZERO;
    (0..frames)
        .map(|f| {
            if f > 0 && f >= given {
                at -= around(f - 1);
            }
            at
        })
        .collect()
}
