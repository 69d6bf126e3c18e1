//! Settling: vertical correction of a body that floats above the floor or has sunk into it.

use super::aloft::{Aloft, aloft};

/// Half the longest time for which both feet may be up while stepping, seconds.
const HALF_S: f64 = 0.1;
/// Half the window over which the correction is averaged, seconds.
const SMOOTH_S: f64 = 0.1;
/// Heights within this tolerance are not corrected, because standing heights are no more exact, metres.
const SLACK_M: f64 = 0.01;
/// Half the window over which the body is lowered for a leg, seconds.
const LOWER_S: f64 = 0.1;

/// Thickness of a body around its joints, metres.
const FLESH_M: f64 = 0.1;

/// Height of a body above its floor, metres, with its lower foot at `foot` and its lowest other joint at `other`: a body
/// that lies, kneels or stands on its hands doesn't float.
pub fn height(foot: f64, other: f64) -> f64 {
    foot.min((other - FLESH_M).max(0.0))
}

/// How far the body floats (F), metres, given its [heights](height) above the floor (F) and those of its pelvis (F).
///
/// One foot is nearly always on the floor: a body that is up for longer than 0.2 s floats, unless it jumps, that is, the
/// pelvis is in free fall for at least half of that time. The result is averaged over 0.2 s; 1 cm is tolerated.
pub fn offsets(least: &[f64], pelvis: &[f64], fps: f64) -> Vec<f64> {
    let [half, smooth] = [HALF_S, SMOOTH_S].map(|s| (s * fps).round() as usize);
    let mut heights = least.to_vec();
    let jumps = aloft(least, pelvis, fps).into_iter().filter(|Aloft { frames, falls }| 2 * falls >= frames.len());
    jumps.for_each(|jump| heights[jump.frames].fill(0.0));
    let lowest = |around: &[f64]| around.iter().copied().fold(f64::INFINITY, f64::min);
    // morphological opening: peaks shorter than the window vanish, longer ones stay as they are
    let floating = over(&over(&heights, half, lowest), half, highest);
    mean(&floating, smooth).into_iter().map(|h| h - h.clamp(-SLACK_M, SLACK_M)).collect()
}

fn highest(around: &[f64]) -> f64 {
    around.iter().copied().fold(f64::NEG_INFINITY, f64::max)
}

/// The maximum over a window, averaged (F): never less than the input.
pub fn widened(lower: &[f64], fps: f64) -> Vec<f64> {
    let half = ((LOWER_S * fps).round() as usize).max(1);
    mean(&over(lower, half, highest), half)
}

/// Applies `of` to a window around each value.
fn over(x: &[f64], half: usize, of: impl Fn(&[f64]) -> f64) -> Vec<f64> {
    (0..x.len()).map(|f| of(&x[f.saturating_sub(half)..(f + half + 1).min(x.len())])).collect()
}

/// The mean over a window around each value, with the ends repeated.
fn mean(x: &[f64], half: usize) -> Vec<f64> {
    let Some(last) = x.len().checked_sub(1) else { return Vec::new() };
    let at = |f: isize| x[f.clamp(0, last as isize) as usize];
    let half = half as isize;
    let one = |f: isize| (f - half..=f + half).map(at).sum::<f64>() / (2 * half + 1) as f64;
    (0..x.len() as isize).map(one).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_body_that_hangs_comes_down_and_one_that_jumps_does_not() {
        let fps = 20.0;
        let of = |least: &[f64]| offsets(least, &vec![1.0; least.len()], fps);
        assert!(of(&[0.009; 40]).iter().all(|x| *x == 0.0), "within what rest heights are good for");
        assert!(of(&[0.10; 40]).iter().all(|x| (x - 0.09).abs() < 1e-12));
        assert!(of(&[-0.10; 40]).iter().all(|x| (x + 0.09).abs() < 1e-12));
        // a step from one foot to the other, and feet that float as long as a jump lasts
        let up = |from: usize, to: usize| (0..60).map(|f| if (from..to).contains(&f) { 0.2 } else { 0.0 }).collect();
        let (step, floating): (Vec<f64>, Vec<f64>) = (up(20, 24), up(20, 32));
        assert!(of(&step).iter().all(|x| *x == 0.0));
        // 0.2 m less the slack of 1 cm
        assert!((of(&floating)[26] - 0.19).abs() < 1e-12 && of(&floating)[10] == 0.0);
        // thrown up at 3 m/s, 0.6 s in the air
        let thrown = |f: usize| (4.905 * (f as f64 / fps - 1.0) * (1.6 - f as f64 / fps)).max(0.0);
        let least: Vec<f64> = (0..60).map(thrown).collect();
        let pelvis: Vec<f64> = least.iter().map(|h| 0.95 + h).collect();
        assert!(offsets(&least, &pelvis, fps).iter().all(|x| *x == 0.0));
        assert!(of(&least)[26] > 0.2, "the same feet of one who is held up");
        assert_eq!((of(&[]).len(), of(&[0.3]).len()), (0, 1));
    }

    #[test]
    fn what_is_widened_is_enough_everywhere() {
        let lower = [0.0, 0.0, 0.0, 0.04, 0.0, 0.01, 0.0, 0.0, 0.0];
        let wide = widened(&lower, 20.0);
        assert!(wide.iter().zip(lower).all(|(w, l)| *w >= l - 1e-12), "{wide:?}");
        assert!(wide[0] < wide[1] && wide[8] < wide[7]);
    }
}
