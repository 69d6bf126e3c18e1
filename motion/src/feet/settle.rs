//! A body that hangs above its floor, or has sunk into it, slowly brought back.

/// Half the time for a quarter of which a foot is on the floor at least, seconds.
const HALF_S: f64 = 0.5;
/// Half the time over which that is averaged, seconds.
const SMOOTH_S: f64 = 0.25;
/// So high or low a body may stand: rest heights are no more exact, metres.
const SLACK_M: f64 = 0.01;
/// Half the time over which a body that has to go down for a leg does so, seconds.
const LOWER_S: f64 = 0.1;

/// How thick a body is around its joints, metres.
const FLESH_M: f64 = 0.1;

/// How high a body is above its floor whose lower foot is at `foot` and whose lowest other joint at `other`: one who lies,
/// kneels or stands on the hands doesn't hang, however high the feet are. Metres.
pub fn height(foot: f64, other: f64) -> f64 {
    foot.min((other - FLESH_M).max(0.0))
}

/// (F) How far the body is too high, metres, of (F) [heights](height) above the floor.
///
/// One foot stands nearly always, so that the first quartile of the heights within half a second is where the floor seems to be;
/// it is averaged over a quarter of a second. Jumps, which are shorter, stay. A centimetre is left.
pub fn offsets(least: &[f64], fps: f64) -> Vec<f64> {
    let [half, smooth] = [HALF_S, SMOOTH_S].map(|s| (s * fps).round() as usize);
    let quartile = |around: &[f64]| {
        let mut sorted = around.to_vec();
        sorted.sort_by(f64::total_cmp);
        sorted[(sorted.len() - 1) / 4]
    };
    let floor = mean(&over(least, half, quartile), smooth);
    floor.into_iter().map(|h| h - h.clamp(-SLACK_M, SLACK_M)).collect()
}

/// (F) The largest of what is around, averaged: never less than what it is of.
pub fn widened(lower: &[f64], fps: f64) -> Vec<f64> {
    let half = ((LOWER_S * fps).round() as usize).max(1);
    mean(&over(lower, half, |around| around.iter().copied().fold(0.0, f64::max)), half)
}

/// Something of what is around each number.
fn over(x: &[f64], half: usize, of: impl Fn(&[f64]) -> f64) -> Vec<f64> {
    (0..x.len()).map(|f| of(&x[f.saturating_sub(half)..(f + half + 1).min(x.len())])).collect()
}

/// The mean of what is around, the ends repeated, so that it ends as it should.
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
        assert!(offsets(&[0.009; 40], fps).iter().all(|x| *x == 0.0), "within what rest heights are good for");
        assert!(offsets(&[0.10; 40], fps).iter().all(|x| (x - 0.09).abs() < 1e-12));
        assert!(offsets(&[-0.10; 40], fps).iter().all(|x| (x + 0.09).abs() < 1e-12));
        let jump: Vec<f64> = (0..60).map(|f| if (20..29).contains(&f) { 0.4 } else { 0.0 }).collect();
        assert!(offsets(&jump, fps).iter().all(|x| *x == 0.0));
        assert_eq!((offsets(&[], fps).len(), offsets(&[0.3], fps).len()), (0, 1));
    }

    #[test]
    fn what_is_widened_is_enough_everywhere() {
        let lower = [0.0, 0.0, 0.0, 0.04, 0.0, 0.01, 0.0, 0.0, 0.0];
        let wide = widened(&lower, 20.0);
        assert!(wide.iter().zip(lower).all(|(w, l)| *w >= l - 1e-12), "{wide:?}");
        assert!(wide[0] < wide[1] && wide[8] < wide[7]);
    }
}
