//! Root anchoring: removes horizontal sliding of the body by holding the stance foot in place.

use super::track::FootTrack;
use crate::Vec3;

/// A foot lower than this above its standing height may be the stance foot, metres.
const LOW_M: f64 = 0.06;
/// Slow feet get more weight: at this speed a quarter, metres per second.
const SLOW_M_S: f64 = 0.1;
/// The correction is averaged over this time on both sides, seconds.
const SMOOTH_S: f64 = 0.15;

/// Horizontal displacements of the body (F), metres, that cancel the movement of the stance foot, with the floor at
/// `floor_m`. Points of the feet near the floor are weighted by how slow they are. The first `given` frames stay.
pub fn offsets(tracks: &[FootTrack; 2], floor_m: f64, given: usize) -> Vec<Vec3> {
    let (frames, fps) = (tracks[0].frames(), tracks[0].fps);
    let step = |f: usize| {
        let (mut sum, mut weight, mut sure) = (Vec3::ZERO, 0.0, 0.0f64);
        let feet = tracks.iter().flat_map(|track| track.leg.points().map(move |foot| (track, foot)));
        for (track, (point, rest)) in feet {
            let [a, b] = [track.at(f, point), track.at(f + 1, point)];
            let low = (1.0 - (a.y.max(b.y) - floor_m - rest) / LOW_M).clamp(0.0, 1.0);
            let displacement = Vec3::new(b.x - a.x, 0.0, b.z - a.z);
            let slow = SLOW_M_S / (SLOW_M_S + displacement.length() * fps);
            sum += displacement * (low * slow * slow);
            weight += low * slow * slow;
            sure = sure.max(low);
        }
        // fully near the floor, less above it: a jump keeps its horizontal velocity
        if weight > 0.0 { sum / weight * (2.0 * sure).min(1.0) } else { Vec3::ZERO }
    };
    let steps: Vec<Vec3> = (0..frames.saturating_sub(1)).map(step).collect();
    let half = (SMOOTH_S * fps).round() as usize;
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
