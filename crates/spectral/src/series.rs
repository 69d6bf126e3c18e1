//! The rotations of a clip as series of numbers.

use crate::{Error, Result};
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::rotation::exp_map;
use kinelm_motion::{Clip, Quat, Vec3};
use std::f64::consts::{FRAC_PI_2, PI};

/// Angles that differ by less count as equal, radians: far more than a file's last decimals change.
const SAME_RAD: f64 = 1e-5;

/// Rotation vectors of chosen joints over time, at one rate.
#[derive(Debug, Clone, PartialEq)]
pub struct Series {
    /// Frames per second.
    pub fps: f64,
    /// F.
    pub frames: usize,
    /// The joints, by their number in the clip's skeleton.
    pub joints: Vec<usize>,
    /// (C) names, three a joint: `left_knee.x`.
    pub channels: Vec<String>,
    /// (C, F) radians, channel by channel.
    pub numbers: Vec<f64>,
    /// Whether windows have `numbers` as they are. Otherwise these are canonical, and every window is made continuous.
    pub raw: bool,
}

impl Series {
    /// The local rotations of `joints` (all of them if empty, in their order) at `fps` frames per second: low-passed downwards,
    /// by slerp upwards. The root's rotation is one of them, its translation is not.
    ///
    /// The vectors are canonical (angle up to PI) and jump where the angle passes PI. Unless `raw` (compat),
    /// [`Series::window`] takes the jumps out.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Invalid`] for a joint that the clip doesn't have or that is given twice; [`Error::Motion`] for a rate that
    /// can't be had.
    pub fn of(clip: &Clip, joints: &[usize], fps: f64, raw: bool) -> Result<Series> {
        let joints = if joints.is_empty() { (0..clip.joints()).collect() } else { joints.to_vec() };
        check(&joints, clip)?;
        let clip = resample(clip, fps, Method::Auto)?;
        let frames = clip.frames();
        let mut numbers = Vec::with_capacity(joints.len() * 3 * frames);
        for &joint in &joints {
            let vectors: Vec<Vec3> = (0..frames).map(|f| exp_map::to_vector(clip.pose(f)[joint])).collect();
            for axis in 0..3 {
                numbers.extend(vectors.iter().map(|v| v[axis]));
            }
        }
        let names = clip.skeleton().names();
        let channels =
            joints.iter().flat_map(|&j| ["x", "y", "z"].map(|axis| format!("{}.{axis}", names[j]))).collect();
        Ok(Series { fps, frames, joints, channels, numbers, raw })
    }

    /// (F) one channel.
    ///
    /// # Panics
    /// If there is no such channel.
    pub(crate) fn channel(&self, channel: usize) -> &[f64] {
        assert!(channel < self.channels.len(), "channel {channel} of {}", self.channels.len());
        &self.numbers[channel * self.frames..][..self.frames]
    }

    /// (C, N): `frames` frames from `start` on, unless `raw` without jumps at half a turn.
    ///
    /// A joint's vector is canonical in the frame of its smallest angle. From there on, forwards and backwards, each is the
    /// one of `v` and `v - 2 PI v/|v|` that is nearer to its neighbour. So the numbers depend on the window's own poses
    /// alone. See docs/query.md, "Windows and features".
    ///
    /// # Panics
    /// If the window leaves the series.
    pub fn window(&self, start: usize, frames: usize) -> Vec<f64> {
        assert!(start + frames <= self.frames, "frames {start} to {} of {}", start + frames, self.frames);
        let channels = (0..self.channels.len()).flat_map(|c| &self.channel(c)[start..start + frames]);
        let mut window: Vec<f64> = channels.copied().collect();
        if !self.raw && frames > 0 {
            window.chunks_exact_mut(3 * frames).for_each(make_continuous);
        }
        window
    }

    /// A window as series of its own.
    ///
    /// # Panics
    /// As [`Series::window`].
    pub(crate) fn slice(&self, start: usize, frames: usize) -> Series {
        let (joints, channels) = (self.joints.clone(), self.channels.clone());
        Series { fps: self.fps, frames, joints, channels, numbers: self.window(start, frames), raw: true }
    }

    /// (F, joints) the rotations again; vectors of any length are good.
    pub fn rotations(&self) -> Vec<Quat> {
        let at = |channel: usize, frame: usize| self.numbers[channel * self.frames + frame];
        let joint = |f: usize, j: usize| Vec3::new(at(3 * j, f), at(3 * j + 1, f), at(3 * j + 2, f));
        let frames = 0..self.frames;
        frames
            .flat_map(|f| (0..self.joints.len()).map(move |j| (f, j)))
            .map(|(f, j)| exp_map::from_vector(joint(f, j)))
            .collect()
    }

    /// `clip`, brought to the series' rate, with the series' rotations in place of its own; other joints and the
    /// translation stay.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Invalid`] for a clip of another length or of fewer joints, or for numbers that are not finite.
    pub(crate) fn apply_to(&self, clip: &Clip) -> Result<Clip> {
        check(&self.joints, clip)?;
        let clip = resample(clip, self.fps, Method::Auto)?;
        if clip.frames() != self.frames {
            let (has, series) = (clip.frames(), self.frames);
            return Err(Error::invalid(
                "the clip",
                format!("{has} frames long"),
                format!("the {series} frames of the series"),
            ));
        }
        if let Some(i) = self.numbers.iter().position(|x| !x.is_finite()) {
            let (channel, frame) = (&self.channels[i / self.frames], i % self.frames);
            return Err(Error::invalid(format!("{channel}, frame {frame}"), self.numbers[i], "a finite angle"));
        }
        let (all, mut rotations) = (clip.joints(), clip.rotations().to_vec());
        for (i, q) in self.rotations().into_iter().enumerate() {
            let (frame, joint) = (i / self.joints.len(), self.joints[i % self.joints.len()]);
            rotations[frame * all + joint] = q;
        }
        Ok(Clip::new(clip.skeleton().clone(), self.fps, clip.root().to_vec(), rotations)?)
    }
}

fn check(joints: &[usize], clip: &Clip) -> Result<()> {
    for (i, &joint) in joints.iter().enumerate() {
        if joint >= clip.joints() {
            return Err(Error::invalid("a joint", joint, format!("below {}, the skeleton's joints", clip.joints())));
        }
        if joints[..i].contains(&joint) {
            let name = &clip.skeleton().names()[joint];
            return Err(Error::invalid_parameter("joints", format!("{joint} ({name}) twice"), "each joint once"));
        }
    }
    Ok(())
}

/// Takes the jumps out of a joint's canonical vectors (3, N).
fn make_continuous(numbers: &mut [f64]) {
    let frames = numbers.len() / 3;
    let (x, yz) = numbers.split_at_mut(frames);
    let (y, z) = yz.split_at_mut(frames);
    let vector = |f: usize| Vec3::new(x[f], y[f], z[f]);
    // two vectors up to a quarter turn are nearer to each other than to their twins
    if (0..frames).all(|f| vector(f).length_squared() < (FRAC_PI_2 - SAME_RAD).powi(2)) {
        return;
    }
    let mut vectors: Vec<Vec3> = (0..frames).map(vector).collect();
    outwards(&mut vectors, nearer);
    for (f, v) in vectors.into_iter().enumerate() {
        (x[f], y[f], z[f]) = (v.x, v.y, v.z);
    }
}

/// Of a vector and its twin the one nearer to `to`; of equal distances the vector itself.
fn nearer(v: Vec3, to: Vec3) -> Vec3 {
    exp_map::twin(v).filter(|twin| (*twin - to).length_squared() < (v - to).length_squared()).unwrap_or(v)
}

/// Goes from the canonical vector of smallest angle, the earliest of equal ones, to both ends; `nearest` says what becomes of
/// a vector beside its neighbour.
///
/// At half a turn, where both directions of an axis are canonical, one that depends on no rounding is taken.
pub(crate) fn outwards(vectors: &mut [Vec3], nearest: impl Fn(Vec3, Vec3) -> Vec3) {
    let least = vectors.iter().map(|v| v.length()).fold(f64::INFINITY, f64::min);
    // within SAME_RAD: among equal angles rounding must not choose the frame
    let Some(start) = vectors.iter().position(|v| v.length() <= least + SAME_RAD) else { return };
    // no axis through corners, edges or faces of a cube is square to this one
    let is_behind = vectors[start].dot(Vec3::new(1.0, 1.0 / 3.0, 1.0 / 9.0)) < 0.0;
    if least > PI - SAME_RAD && is_behind {
        vectors[start] = exp_map::twin(vectors[start]).unwrap_or(vectors[start]);
    }
    for f in start + 1..vectors.len() {
        vectors[f] = nearest(vectors[f], vectors[f - 1]);
    }
    for f in (0..start).rev() {
        vectors[f] = nearest(vectors[f], vectors[f + 1]);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::rotation::angle_between;
    use kinelm_motion::synth;
    use std::f64::consts::PI;
    use std::sync::Arc;

    /// A joint that turns about an axis by `angle(frame)`.
    fn turning(fps: f64, frames: usize, angle: impl Fn(usize) -> f64) -> Clip {
        let s = kinelm_motion::Skeleton::new(vec!["hip".into()], vec![None], vec![Vec3::ZERO], vec![]).unwrap();
        let axis = Vec3::new(0.6, 0.0, 0.8);
        let rotations = (0..frames).map(|f| Quat::from_axis_angle(axis, angle(f))).collect();
        Clip::new(Arc::new(s), fps, vec![Vec3::ZERO; frames], rotations).unwrap()
    }

    #[test]
    fn a_half_turn_is_passed_without_a_jump() {
        // from 2.5 to 3.61 radians: the canonical vector jumps at PI
        let clip = turning(60.0, 112, |f| 2.5 + 0.01 * f as f64);
        let steps = |s: &Series| s.channel(2).windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
        let smooth = Series::of(&clip, &[], 60.0, false).unwrap().slice(0, 112);
        assert_eq!(smooth.channels, ["hip.x", "hip.y", "hip.z"]);
        assert!(steps(&smooth) < 0.01, "{}", steps(&smooth));
        assert!((smooth.channel(2)[111] - 0.8 * 3.61).abs() < 1e-9);
        let raw = Series::of(&clip, &[], 60.0, true).unwrap();
        assert_eq!(raw.slice(0, 112), raw);
        assert!((steps(&raw) - 0.8 * 2.0 * PI).abs() < 0.02, "{}", steps(&raw));
        for (a, b) in smooth.rotations().iter().zip(raw.rotations()) {
            assert!(angle_between(*a, b) < 1e-9);
        }
    }

    /// The vector about the joint's axis in each frame of a window.
    fn angles(series: &Series, start: usize, frames: usize) -> Vec<f64> {
        series.window(start, frames)[2 * frames..].iter().map(|z| z / 0.8).collect()
    }

    #[test]
    fn a_window_starts_at_its_smallest_angle_wherever_it_lies() {
        // two turns and a half, and back
        let clip = turning(60.0, 400, |f| 8.0 * (0.02 * f as f64).sin() + 8.0);
        let series = Series::of(&clip, &[], 60.0, false).unwrap();
        for start in 0..=400 - 64 {
            let alone = Series::of(&clip.slice(start..start + 64), &[], 60.0, false).unwrap();
            assert!(alone.window(0, 64) == series.window(start, 64), "{start}");
            assert!(angles(&series, start, 64).iter().any(|a| a.abs() <= PI), "{start}");
        }
        // from 185 degrees down to 155, which is the smallest angle
        let falling = turning(60.0, 31, |f| (185.0 - f as f64).to_radians());
        let found = angles(&Series::of(&falling, &[], 60.0, false).unwrap(), 0, 31);
        assert!((found[0] - 185.0f64.to_radians()).abs() < 1e-9 && (found[30] - 155.0f64.to_radians()).abs() < 1e-9);
    }

    /// Equal angles on both sides of half a turn, or half a turn alone: the last decimals decide nothing.
    #[test]
    fn rounding_does_not_choose_the_branch() {
        let there_and_back = |f: usize| if f <= 20 { 170.0 + f as f64 } else { 210.0 - f as f64 };
        let through = |f: usize| 170.0 + f as f64;
        let still = |_: usize| 180.0;
        for (degrees, frames) in [(&there_and_back as &dyn Fn(usize) -> f64, 41), (&through, 21), (&still, 32)] {
            let off = |size: f64| {
                let clip = turning(60.0, frames, |f| (degrees(f) + size * (7.0 * f as f64).sin()).to_radians());
                angles(&Series::of(&clip, &[], 60.0, false).unwrap(), 0, frames)
            };
            let exact = off(0.0);
            assert!((exact[0] - degrees(0).to_radians()).abs() < 1e-9, "{exact:?}");
            for size in [1e-6, -1e-6, 1e-9, -1e-9, 1e-13] {
                let apart = exact.iter().zip(off(size)).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
                assert!(apart < 1e-7, "{size} {apart}");
            }
        }
    }

    #[test]
    fn rates_and_windows() {
        let clip = turning(30.0, 31, |f| 0.02 * f as f64);
        let s = Series::of(&clip, &[0], 60.0, false).unwrap();
        assert_eq!((s.frames, s.fps, s.numbers.len()), (61, 60.0, 183));
        assert!((s.channel(0)[33] - 0.6 * 0.01 * 33.0).abs() < 1e-12, "slerp is even about one axis");
        let w = s.window(10, 4);
        assert_eq!((&w[..4], &w[8..]), (&s.channel(0)[10..14], &s.channel(2)[10..14]));
    }

    #[test]
    fn there_and_back_on_a_dance() {
        let clip = synth::corpus(3, 1, 3.0, 60.0).unwrap().remove(0).clip;
        let joints = [0, 5, 16];
        let s = Series::of(&clip, &joints, 60.0, false).unwrap();
        let back = s.apply_to(&clip).unwrap();
        assert_eq!(back.root(), clip.root());
        for (a, b) in back.rotations().iter().zip(clip.rotations()) {
            assert!(angle_between(*a, *b) < 1e-9);
        }
        let turned = Series { numbers: vec![0.25; s.numbers.len()], ..s.clone() }.apply_to(&clip).unwrap();
        for j in 0..24 {
            let moved = angle_between(turned.pose(7)[j], exp_map::from_vector(Vec3::splat(0.25))) < 1e-9;
            assert!(if joints.contains(&j) { moved } else { turned.pose(7)[j] == clip.pose(7)[j] });
        }
    }

    #[test]
    fn what_does_not_fit_is_said() {
        let clip = turning(60.0, 5, |_| 0.0);
        let error = |joints: &[usize]| Series::of(&clip, joints, 60.0, false).unwrap_err().to_string();
        assert!(error(&[3]).contains("a joint is 3; expected below 1"));
        assert!(error(&[0, 0]).contains("`joints` is 0 (hip) twice"));
        let s = Series::of(&clip, &[], 60.0, false).unwrap();
        assert!(s.apply_to(&clip.slice(0..4)).unwrap_err().to_string().contains("4 frames long; expected the 5"));
        let broken = Series { numbers: vec![f64::NAN; 15], ..s };
        assert!(broken.apply_to(&clip).unwrap_err().to_string().contains("hip.x, frame 0"));
        assert_eq!(Series::of(&clip.slice(0..0), &[], 60.0, false).unwrap().frames, 0);
    }
}
