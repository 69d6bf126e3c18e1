//! The rate of keyframes, for formats that state seconds: GLB and FBX.

use super::bvh::USUAL_FPS;

/// Keys nearer together than this are one, seconds.
const SAME_S: f64 = 2e-4;
/// Rounding of a time in single precision, as a fraction of it.
const SINGLE: f64 = 1e-7;
/// Rates of film and television whose true rate is 1000/1001 of these.
const FILM_FPS: [f64; 5] = [24.0, 30.0, 48.0, 60.0, 120.0];

/// The times of the keys of some tracks, once where tracks that follow each other have the same: a baked take has a key a frame
/// on hundreds of tracks, and [`rate`] sorts them.
pub(super) fn times(tracks: impl Iterator<Item = impl AsRef<[f64]>>) -> Vec<f64> {
    let mut all = Vec::new();
    for track in tracks {
        if !all.ends_with(track.as_ref()) {
            all.extend_from_slice(track.as_ref());
        }
    }
    all
}

/// The rate of keys at these times, seconds, if nearly all steps are multiples of the shortest: of the rates that the
/// times allow as they are rounded, a usual one, else one of film, a whole one, one of up to three decimals. `None` for
/// keys that are not evenly spaced, and for fewer than two.
pub(super) fn rate(mut times: Vec<f64>) -> Option<f64> {
    times.sort_by(f64::total_cmp);
    times.dedup_by(|later, earlier| *later - *earlier <= SAME_S);
    let steps: Vec<f64> = times.windows(2).map(|w| w[1] - w[0]).collect();
    let shortest = steps.iter().copied().fold(f64::INFINITY, f64::min);
    let even = |d: &&f64| (*d / shortest - (*d / shortest).round()).abs() < 0.1;
    if steps.is_empty() || (steps.iter().filter(even).count() as f64) < 0.95 * steps.len() as f64 {
        return None;
    }
    // the frame of each key; each time is rounded, the mean step is not
    let frames: Vec<f64> = std::iter::once(0.0)
        .chain(steps.iter().scan(0.0, |at, d| {
            *at += (d / shortest).round();
            Some(*at)
        }))
        .collect();
    let (first, last) = (times[0], times[times.len() - 1]);
    let exact = frames[frames.len() - 1] / (last - first);
    let off = |fps: f64| times.iter().zip(&frames).map(|(t, f)| (t - first - f / fps).abs()).fold(0.0, f64::max);
    // some exporters print times with three decimals, which allows far more rates than single precision
    let printed = |t: &f64| (t * 1e3 - (t * 1e3).round()).abs() < 1e-3;
    let rounding = if times.iter().all(printed) { 1e-3 } else { SINGLE * first.abs().max(last.abs()) };
    // `exact` rests on two rounded times itself, so another rate may be off by twice as much
    let allowed = 2.0 * off(exact) + rounding;
    let usual = || USUAL_FPS.iter().map(|n| *n as f64);
    let rounded = |k: f64| (exact * k).round() / k;
    let nearest = |all: &mut dyn Iterator<Item = f64>| {
        let fits = all.filter(|n| *n > 0.0 && off(*n) <= allowed);
        fits.min_by(|a, b| (a - exact).abs().total_cmp(&(b - exact).abs()))
    };
    let film = || FILM_FPS.iter().map(|n| n * 1000.0 / 1001.0);
    let decimals = || [1.0, 10.0, 100.0, 1000.0].map(rounded).into_iter();
    nearest(&mut usual())
        .or_else(|| nearest(&mut film()))
        .or_else(|| decimals().find_map(|n| nearest(&mut std::iter::once(n))))
        .or(Some(exact))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn keys(fps: f64, frames: impl Iterator<Item = usize>, round: impl Fn(f64) -> f64) -> Vec<f64> {
        frames.map(|f| round(f as f64 / fps)).collect()
    }

    #[test]
    fn rates_that_times_in_single_precision_allow() {
        let single = |t: f64| f64::from(t as f32);
        for fps in [1.0, 12.5, 23.976, 24000.0 / 1001.0, 24.0, 29.97, 30.0, 59.94, 60.0, 119.0, 120.0, 239.0, 240.0] {
            for frames in [40, 300, 3000] {
                let found = rate(keys(fps, 0..frames, single)).unwrap();
                assert!((found / fps - 1.0).abs() < 2e-6, "{fps}, {frames} frames: {found}");
            }
        }
        assert_eq!(rate(keys(30.0, 0..2, single)), Some(30.0));
        assert_eq!(rate(keys(239.0, 500..700, single)), Some(239.0), "a take that begins later");
    }

    #[test]
    fn times_in_milliseconds_and_left_out_keys() {
        let milliseconds = |t: f64| (t * 1e3).round() / 1e3;
        for fps in [24.0, 30.0, 50.0, 60.0] {
            assert_eq!(rate(keys(fps, 0..2, milliseconds)), Some(fps));
            assert_eq!(rate(keys(fps, 0..900, milliseconds)), Some(fps));
        }
        assert_eq!(rate(keys(24.0, [0, 1, 2, 6, 12].into_iter(), |t| t)), Some(24.0));
        assert_eq!(rate(vec![0.0, 0.1, 0.25, 0.31, 0.5]), None);
        assert_eq!((rate(vec![]), rate(vec![1.0, 1.0])), (None, None));
    }
}
