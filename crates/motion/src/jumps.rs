//! Steps from frame to frame that no body takes: where a capture jumped.

use crate::Clip;

/// A root step is a jump if it is longer than this and stands out (three times the steps two frames before and after it:
/// a fast movement has fast neighbours, a glitch has not), metres.
pub const ROOT_JUMP_M: f64 = 0.05;

/// Frames `f` after whose step from `f - 1` the root has jumped, with the length in metres.
pub(crate) fn root_jumps(clip: &Clip) -> Vec<(usize, f64)> {
    jumps(clip.root().windows(2).map(|w| w[0].distance(w[1])).collect(), ROOT_JUMP_M).collect()
}

/// Frames whose step from the frame before is above `limit` and three times what is two steps away; `steps[0]` leads to
/// frame 1.
pub(crate) fn jumps(steps: Vec<f64>, limit: f64) -> impl Iterator<Item = (usize, f64)> {
    let around = steps.clone();
    let far = move |i: usize| {
        let before = i.checked_sub(2).map_or(0.0, |k| around[k]);
        before.max(around.get(i + 2).copied().unwrap_or(0.0))
    };
    steps.into_iter().enumerate().filter(move |&(i, s)| s > limit && s > 3.0 * far(i)).map(|(i, s)| (i + 1, s))
}
