//! Resampling to another frame rate.

use crate::error::compact;
use crate::rotation::{nearest_sign, slerp};
use crate::{Clip, Error, Quat, Result, Vec3};
use std::f64::consts::PI;
use std::ops::{Add, Mul, Sub};

/// A larger ratio of rates indicates a wrong rate, and its low pass would take hours.
const MOST_TIMES_SLOWER: f64 = 1e4;
/// The highest rate that is accepted, frames per second.
pub const MOST_FPS: f64 = 1e4;
/// The lowest rate that is accepted, frames per second: one frame in a quarter of an hour.
pub(crate) const FEWEST_FPS: f64 = 1e-3;
/// Most rotations of a resampled clip: 4 GB.
const MOST_ROTATIONS: f64 = 134e6;

/// How new frames are interpolated.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Method {
    /// [`Method::Filtered`] to a lower rate, [`Method::Slerp`] to a higher one.
    #[default]
    Auto,
    /// Every n-th frame, for whole ratios only; frequencies above half the new rate alias (the thesis reduces 60 to 20 so).
    Stride,
    /// Slerp between neighbouring frames, linear for the translation; no low pass.
    Slerp,
    /// A Lanczos-3 low pass with its cutoff at 0.45 of the new rate.
    Filtered,
    /// Natural cubic splines through all frames (C2 continuous), for rotations on the four quaternion components, then
    /// normalised; no low pass.
    Curve,
    /// [`Method::Filtered`] to a lower rate, [`Method::Curve`] to a higher one: for motion that is to be watched.
    Smooth,
}

impl Method {
    /// Resolves `Auto` and `Smooth` for a change from rate `a` to rate `b`.
    pub fn resolve(self, a: f64, b: f64) -> Method {
        match self {
            Method::Auto if b < a => Method::Filtered,
            Method::Auto => Method::Slerp,
            Method::Smooth if b < a => Method::Filtered,
            Method::Smooth => Method::Curve,
            m => m,
        }
    }
}

/// Resamples a clip to `fps` frames per second: `floor((F - 1) b / a + 1e-9) + 1` frames, frame `i` at time `i / fps`.
/// At its own rate the clip is returned unchanged.
///
/// # Errors
/// [`Invalid`](kinelm_store::Error::Invalid) for a rate that is not positive and finite or out of range, and for
/// [`Method::Stride`] with a ratio that isn't whole; [`Limit`](kinelm_store::Error::Limit) for too large a result.
///
/// ```
/// use kinelm_motion::resample::{Method, resample};
///
/// let dance = kinelm_motion::synth::corpus(1, 1, 2.0, 60.0)?.remove(0).clip;
/// let slow = resample(&dance, 20.0, Method::Auto)?;
/// assert_eq!((dance.frames(), slow.frames()), (120, 40));
/// # Ok::<(), kinelm_motion::Error>(())
/// ```
pub fn resample(clip: &Clip, fps: f64, method: Method) -> Result<Clip> {
    // 1e-9 of a frame, so that whole ratios don't lose their last frame to rounding
    let frames = (clip.frames().saturating_sub(1) as f64 * fps / clip.fps() + 1e-9).floor() + 1.0;
    resampled(clip, fps, method, frames)
}

/// Like [`resample`], but the clip lasts until the end of its last frame, which is held: [`held_frames`] frames, so that
/// durations stay the same. 240 frames at 20 per second become 720 at 60.
///
/// # Errors
/// Those of [`resample`].
pub fn resample_held(clip: &Clip, fps: f64, method: Method) -> Result<Clip> {
    resampled(clip, fps, method, held_frames(clip.frames(), clip.fps(), fps) as f64)
}

/// How many frames at `fps` start within the duration of `frames` frames at `own_fps`.
pub fn held_frames(frames: usize, own_fps: f64, fps: f64) -> usize {
    (frames as f64 * fps / own_fps - 1e-9).ceil().max(0.0) as usize
}

/// The clip's poses at `times_frames`, in frames and held beyond both ends, at the clip's rate: shortest-arc slerp between
/// neighbours, linear for the root. A clip without frames stays as it is.
///
/// # Errors
/// [`Invalid`](kinelm_store::Error::Invalid) for a time that is not finite.
pub fn at_frames(clip: &Clip, times_frames: &[f64]) -> Result<Clip> {
    if let Some(time) = times_frames.iter().find(|time| !time.is_finite()) {
        return Err(Error::invalid("a time of a clip", time, "finite numbers of frames"));
    }
    let Some(last) = clip.frames().checked_sub(1) else { return Ok(clip.clone()) };
    let times = times_frames.iter().map(|time| between(time.clamp(0.0, last as f64)));
    let (root, rotations) = interpolate(clip, times);
    Clip::new(clip.skeleton().clone(), clip.fps(), root, rotations)
}

/// Resamples a clip to `frames` frames at `fps`.
fn resampled(clip: &Clip, fps: f64, method: Method, frames: f64) -> Result<Clip> {
    let (a, b) = (clip.fps(), fps);
    if !(b.is_finite() && b > 0.0) {
        return Err(rate(b, "a positive number".into()));
    }
    if a == b || clip.frames() == 0 {
        return clip.clone().with_fps(b);
    }
    if b > a && b > MOST_FPS {
        return Err(rate(b, format!("at most {MOST_FPS}")));
    }
    if a / b > MOST_TIMES_SLOWER {
        let found = format!("from {} to {} frames per second", compact(a), compact(b));
        let expected =
            format!("at most {MOST_TIMES_SLOWER} times slower; if the file states a wrong rate, give `fps_source`");
        return Err(Error::invalid("the change of rate", found, expected));
    }
    if frames * clip.joints() as f64 > MOST_ROTATIONS {
        let needs = format!("{frames} frames of {} joints", clip.joints());
        return Err(Error::limit("a clip at the new rate", needs, format!("{MOST_ROTATIONS} rotations"), ""));
    }
    let last = (clip.frames() - 1) as f64;
    let times = (0..frames as usize).map(|i| (i as f64 * a / b).min(last));
    let (root, rotations) = match method.resolve(a, b) {
        Method::Stride => {
            let step = (a / b).round();
            if (a / b - step).abs() > 1e-6 * step || step < 1.0 {
                return Err(Error::invalid("the ratio of the rates", a / b, "a whole number to take every n-th frame"));
            }
            interpolate(clip, times.map(|t| (t.round() as usize, 0.0)))
        }
        Method::Slerp => interpolate(clip, times.map(between)),
        Method::Curve => curve(clip, times.map(between)),
        Method::Filtered | Method::Auto | Method::Smooth => filtered(clip, 0.45 * b / a, times),
    };
    Clip::new(clip.skeleton().clone(), b, root, rotations)
}

/// Refuses a rate outside `FEWEST_FPS` to `MOST_FPS`, and one that is no number.
///
/// # Errors
/// [`Invalid`](kinelm_store::Error::Invalid) of the parameter `fps`.
pub fn check_fps(fps: f64) -> Result<()> {
    match (FEWEST_FPS..=MOST_FPS).contains(&fps) {
        true => Ok(()),
        false => {
            Err(Error::invalid_parameter("fps", compact(fps), format!("frames per second, {FEWEST_FPS} to {MOST_FPS}")))
        }
    }
}

fn rate(fps: f64, expected: String) -> Error {
    Error::invalid("the new rate", format!("{} frames per second", compact(fps)), expected)
}

/// Splits a time in frames into the frame before it and the fraction of the way to the next.
fn between(time: f64) -> (usize, f64) {
    // a time that is a whole frame but for rounding is that frame, bit for bit
    let frame = (time + 1e-9).floor();
    (frame as usize, (time - frame).max(0.0))
}

/// Interpolates linearly at times `i + t` between frames `i` and `i + 1`.
fn interpolate(clip: &Clip, samples: impl Iterator<Item = (usize, f64)>) -> (Vec<Vec3>, Vec<Quat>) {
    let last = clip.frames() - 1;
    let (mut root, mut rotations) = (Vec::new(), Vec::new());
    for (i, t) in samples {
        let (i, next) = (i.min(last), (i + 1).min(last));
        root.push(clip.root()[i].lerp(clip.root()[next], t));
        rotations.extend(clip.pose(i).iter().zip(clip.pose(next)).map(|(&p, &q)| slerp(p, q, t)));
    }
    (root, rotations)
}

/// Evaluates natural cubic splines at times `i + t`.
fn curve(clip: &Clip, samples: impl Iterator<Item = (usize, f64)>) -> (Vec<Vec3>, Vec<Quat>) {
    let (last, j) = (clip.frames() - 1, clip.joints());
    let signed = continuous(clip);
    let bends = second_derivatives(clip.root(), 1, Vec3::ZERO);
    let turns = second_derivatives(&signed, j, Quat::from_xyzw(0.0, 0.0, 0.0, 0.0));
    let (mut root, mut rotations) = (Vec::new(), Vec::new());
    for (i, t) in samples {
        let (i, next) = (i.min(last), (i + 1).min(last));
        // weights of the second derivatives at both ends of the cubic segment
        let (a, b) = (1.0 - t, t);
        let (p, q) = ((a * a * a - a) / 6.0, (b * b * b - b) / 6.0);
        if t == 0.0 || i == next {
            root.push(clip.root()[i]);
            rotations.extend_from_slice(clip.pose(i));
            continue;
        }
        root.push(clip.root()[i] * a + clip.root()[next] * b + bends[i] * p + bends[next] * q);
        for k in 0..j {
            let (i, next) = (i * j + k, next * j + k);
            let turn = signed[i] * a + signed[next] * b + turns[i] * p + turns[next] * q;
            // a spline through rotations that are far from each other cuts through the middle of the sphere
            let far = turn.length_squared() < 0.25;
            rotations.push(if far { slerp(signed[i], signed[next], t) } else { turn.normalize() });
        }
    }
    (root, rotations)
}

/// Second derivatives (F, J) of natural cubic splines through `values` (F, J) at unit steps: solves the tridiagonal
/// system m[i-1] + 4 m[i] + m[i+1] = 6 (y[i+1] - 2 y[i] + y[i-1]), with 0 at both ends.
fn second_derivatives<T>(values: &[T], joints: usize, zero: T) -> Vec<T>
where
    T: Copy + Add<Output = T> + Sub<Output = T> + Mul<f64, Output = T>,
{
    let frames = values.len() / joints;
    let mut bends = vec![zero; values.len()];
    let mut shares = vec![0.0; frames];
    for f in 1..frames.saturating_sub(1) {
        // Thomas algorithm; the matrix is diagonally dominant, so no pivot is needed and shares stay below 1/3
        shares[f] = 1.0 / (4.0 - shares[f - 1]);
        for k in f * joints..(f + 1) * joints {
            let right = (values[k + joints] - values[k] * 2.0 + values[k - joints]) * 6.0;
            bends[k] = (right - bends[k - joints]) * shares[f];
        }
    }
    for f in (1..frames.saturating_sub(1)).rev() {
        for k in f * joints..(f + 1) * joints {
            bends[k] = bends[k] - bends[k + joints] * shares[f];
        }
    }
    bends
}

/// Rotations (F, J) with each sign chosen to be nearer to the frame before.
fn continuous(clip: &Clip) -> Vec<Quat> {
    let j = clip.joints();
    let mut signed = clip.rotations().to_vec();
    for i in j..signed.len() {
        signed[i] = nearest_sign(signed[i], signed[i - j]);
    }
    signed
}

/// Low-passed values at `times` in source frames; `cutoff` in cycles per source frame.
///
/// The four quaternion components are convolved after their signs are made continuous in time, then normalised. The clip
/// is reflected about its first and last frame.
fn filtered(clip: &Clip, cutoff: f64, times: impl Iterator<Item = f64>) -> (Vec<Vec3>, Vec<Quat>) {
    let (f, j) = (clip.frames() as i64, clip.joints());
    let smooth = continuous(clip);
    // three lobes on either side, each as wide as half a period at the cutoff
    let reach = 3.0 / (2.0 * cutoff);
    let (mut root, mut rotations) = (Vec::new(), Vec::new());
    let mut taps: Vec<(usize, f64)> = Vec::new();
    let zero = Quat::from_xyzw(0.0, 0.0, 0.0, 0.0);
    let mut sums = vec![zero; j];
    for t in times {
        taps.clear();
        for k in (t - reach).ceil() as i64..=(t + reach).floor() as i64 {
            taps.push((reflect(k, f), lanczos3(2.0 * cutoff * (k as f64 - t))));
        }
        let sum: f64 = taps.iter().map(|(_, w)| w).sum();
        // a sampled Lanczos kernel doesn't sum to 1, which would scale the path with the phase of the frame
        taps.iter_mut().for_each(|(_, w)| *w /= sum);
        root.push(taps.iter().fold(Vec3::ZERO, |p, &(k, w)| p + clip.root()[k] * w));
        // frame by frame, as they lie in memory
        sums.fill(zero);
        for &(k, w) in &taps {
            sums.iter_mut().zip(&smooth[k * j..][..j]).for_each(|(sum, &q)| *sum += q * w);
        }
        let middle = &smooth[reflect(t.round() as i64, f) * j..][..j];
        rotations.extend(sums.iter().zip(middle).map(|(sum, &middle)| {
            // rotations of more than half a turn within the kernel cancel out: take the middle frame
            if sum.length_squared() > 1e-6 { sum.normalize() } else { middle }
        }));
    }
    (root, rotations)
}

/// Index of frame `k` when a clip of `f` frames is reflected about its end frames.
fn reflect(k: i64, f: i64) -> usize {
    if f == 1 {
        return 0;
    }
    let k = k.rem_euclid(2 * (f - 1));
    k.min(2 * (f - 1) - k) as usize
}

fn lanczos3(x: f64) -> f64 {
    let sinc = |x: f64| if x.abs() < 1e-9 { 1.0 } else { (PI * x).sin() / (PI * x) };
    if x.abs() < 3.0 { sinc(x) * sinc(x / 3.0) } else { 0.0 }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Skeleton;
    use crate::rotation::{angle_between, exp_map};
    use std::sync::Arc;

    fn swinging(fps: f64, seconds: f64, angle: impl Fn(f64) -> f64) -> Clip {
        let s = Skeleton::new(vec!["a".into()], vec![None], vec![Vec3::ZERO], vec![]).unwrap();
        let n = (seconds * fps) as usize + 1;
        let at = |f: usize| angle(f as f64 / fps);
        let rotations = (0..n).map(|f| exp_map::from_vector(Vec3::new(at(f), 0.0, 0.0))).collect();
        Clip::new(Arc::new(s), fps, (0..n).map(|f| Vec3::new(at(f), 1.0, 0.0)).collect(), rotations).unwrap()
    }

    fn sine(hz: f64) -> impl Fn(f64) -> f64 {
        move |t| 0.5 * (2.0 * PI * hz * t).sin()
    }

    #[test]
    fn the_same_rate_is_the_identity() {
        let c = swinging(30.0, 1.0, sine(2.0));
        for m in [Method::Auto, Method::Slerp, Method::Stride, Method::Filtered, Method::Curve, Method::Smooth] {
            assert_eq!(resample(&c, 30.0, m).unwrap(), c);
        }
    }

    #[test]
    fn frame_counts_and_ends() {
        let c = swinging(120.0, 1.0, |_| 0.3);
        for fps in [20.0, 24.0, 30.0, 59.94, 60.0, 240.0] {
            let r = resample(&c, fps, Method::Auto).unwrap();
            assert_eq!(r.frames(), (120.0 * fps / 120.0 + 1e-9) as usize + 1);
            assert!(
                r.rotations().iter().all(|q| angle_between(*q, c.rotations()[0]) < 1e-9),
                "constant stays constant"
            );
        }
        assert_eq!(resample(&swinging(60.0, 0.0, |_| 0.1), 20.0, Method::Auto).unwrap().frames(), 1);
        assert!(resample(&c, 50.0, Method::Stride).is_err());
        assert!(resample(&c, 0.0, Method::Auto).is_err());
        assert!(resample(&c, f64::INFINITY, Method::Auto).is_err());
        assert!(resample(&c, 1e9, Method::Auto).is_err(), "too large for memory");
        assert!(resample(&c.clone().with_fps(1e9).unwrap(), 20.0, Method::Auto).is_err(), "a rate that is none");
    }

    #[test]
    fn held_to_the_end_seconds_stay_seconds() {
        let c = swinging(20.0, 12.0, sine(1.0)).slice(0..240);
        for (fps, frames) in [(60.0, 720), (24.0, 288), (30.0, 360), (59.94, 720), (20.0, 240), (10.0, 120), (7.0, 84)]
        {
            let held = resample_held(&c, fps, Method::Smooth).unwrap();
            assert_eq!((held.frames(), held_frames(240, 20.0, fps)), (frames, frames), "{fps}");
            let plain = resample(&c, fps, Method::Smooth).unwrap();
            assert_eq!(held.slice(0..plain.frames()), plain, "{fps}");
        }
        let held = resample_held(&c, 60.0, Method::Smooth).unwrap();
        for frame in 717..720 {
            assert_eq!((held.root()[frame], held.pose(frame)), (c.root()[239], c.pose(239)), "frame {frame}");
        }
        assert_eq!(resample_held(&c.slice(0..1), 60.0, Method::Smooth).unwrap().frames(), 3);
        assert_eq!(resample_held(&c.slice(0..0), 60.0, Method::Smooth).unwrap().frames(), 0);
    }

    #[test]
    fn poses_at_times_between_frames() {
        let c = swinging(20.0, 1.0, |t| t);
        let at = at_frames(&c, &[-3.0, 0.0, 7.5, 20.0, 99.0]).unwrap();
        for (f, frame) in [0.0, 0.0, 7.5, 20.0, 20.0].into_iter().enumerate() {
            let angle = exp_map::to_vector(at.pose(f)[0]).x;
            assert!((angle - frame / 20.0).abs() < 1e-12 && (at.root()[f].x - frame / 20.0).abs() < 1e-12, "{f}");
        }
        assert!(at_frames(&c, &[f64::NAN]).is_err());
        assert_eq!(at_frames(&c.slice(0..0), &[1.0]).unwrap().frames(), 0);
    }

    #[test]
    fn slow_movement_is_kept() {
        let r = resample(&swinging(120.0, 4.0, sine(2.0)), 20.0, Method::Filtered).unwrap();
        for f in 10..r.frames() - 10 {
            let want = sine(2.0)(f as f64 / 20.0);
            let got = exp_map::to_vector(r.rotations()[f]).x;
            assert!((got - want).abs() < 0.005, "frame {f}: {got} {want}");
            assert!((r.root()[f].x - want).abs() < 0.005);
        }
    }

    #[test]
    fn fast_movement_does_not_alias() {
        let largest = |c: &Clip| {
            let n = c.frames();
            c.rotations()[10..n - 10].iter().map(|q| exp_map::to_vector(*q).x.abs()).fold(0.0, f64::max)
        };
        // 15 Hz sampled at 20 frames per second aliases to 5 Hz at full amplitude
        let c = swinging(120.0, 4.0, sine(15.0));
        assert!(largest(&resample(&c, 20.0, Method::Filtered).unwrap()) < 0.05 * 0.5);
        assert!(largest(&resample(&c, 20.0, Method::Stride).unwrap()) > 0.45);
    }

    #[test]
    fn upward_and_back() {
        let c = swinging(30.0, 2.0, sine(1.0));
        let up = resample(&c, 60.0, Method::Auto).unwrap();
        let back = resample(&up, 30.0, Method::Stride).unwrap();
        for (a, b) in c.rotations().iter().zip(back.rotations()) {
            assert!(angle_between(*a, *b) < 1e-9);
        }
    }

    #[test]
    fn a_curve_meets_its_frames_and_has_no_kinks() {
        let slow = swinging(20.0, 3.0, sine(1.3));
        let [curve, chords] = [Method::Smooth, Method::Auto].map(|m| resample(&slow, 120.0, m).unwrap());
        for f in 0..slow.frames() {
            assert_eq!((curve.root()[6 * f], curve.pose(6 * f)), (slow.root()[f], slow.pose(f)));
        }
        let value = |c: &Clip, f: usize| (c.root()[f].x, exp_map::to_vector(c.rotations()[f]).x);
        // second differences of a finely sampled sine are small everywhere; those of linear segments peak at the frames
        let most = |c: &Clip, of: &dyn Fn((f64, f64)) -> f64| {
            let at = |f: usize| of(value(c, f));
            (12..c.frames() - 12).map(|f| (at(f + 1) - 2.0 * at(f) + at(f - 1)).abs()).fold(0.0, f64::max)
        };
        for of in [|v: (f64, f64)| v.0, |v: (f64, f64)| v.1] {
            let (curve, chords) = (most(&curve, &of), most(&chords, &of));
            assert!(curve < 0.003 && chords > 4.0 * curve, "{curve} {chords}");
        }
        let off = (18..curve.frames() - 18).map(|f| (value(&curve, f).1 - sine(1.3)(f as f64 / 120.0)).abs());
        assert!(off.fold(0.0, f64::max) < 2e-3);
        // two frames are interpolated linearly
        let two = resample(&slow.slice(0..2), 60.0, Method::Curve).unwrap();
        assert!((two.root()[1].x - (2.0 * slow.root()[0].x + slow.root()[1].x) / 3.0).abs() < 1e-12);
    }
}
