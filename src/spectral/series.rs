//! The rotations of a clip as series of numbers.

use crate::{Error, Result};
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::rotation::exp_map;
use kinelm_motion::{Clip, Quat, Vec3};

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
}

impl Series {
    /// The local rotations of `joints` (all of them if empty, in their order) at `fps` frames per second: low-passed downwards,
    /// by slerp upwards. The root's rotation is one of them, its translation is not.
    ///
    /// Canonical vectors (angle up to PI) jump where the angle passes PI. Unless `raw` (compat), a frame's vector is the one
    /// of `v` and `v - 2 PI v/|v|` that is nearer to that of the frame before; the first is canonical. See
    /// docs/query.md, "Windows and features".
    ///
    /// # Errors
    /// [`Error::Call`] for a joint that the clip doesn't have or that is given twice; [`Error::Motion`] for a rate that
    /// can't be had.
    pub fn of(clip: &Clip, joints: &[usize], fps: f64, raw: bool) -> Result<Series> {
        let joints = if joints.is_empty() { (0..clip.joints()).collect() } else { joints.to_vec() };
        check(&joints, clip)?;
        let clip = resample(clip, fps, Method::Auto)?;
        let frames = clip.frames();
        let mut numbers = Vec::with_capacity(joints.len() * 3 * frames);
        for &joint in &joints {
            let mut vectors: Vec<Vec3> = (0..frames).map(|f| exp_map::to_vector(clip.pose(f)[joint])).collect();
            if !raw {
                make_continuous(&mut vectors);
            }
            for axis in 0..3 {
                numbers.extend(vectors.iter().map(|v| v[axis]));
            }
        }
        let names = clip.skeleton().names();
        let channels =
            joints.iter().flat_map(|&j| ["x", "y", "z"].map(|axis| format!("{}.{axis}", names[j]))).collect();
        Ok(Series { fps, frames, joints, channels, numbers })
    }

    /// (F) one channel.
    ///
    /// # Panics
    /// If there is no such channel.
    pub fn channel(&self, channel: usize) -> &[f64] {
        assert!(channel < self.channels.len(), "channel {channel} of {}", self.channels.len());
        &self.numbers[channel * self.frames..][..self.frames]
    }

    /// (C, N): `frames` frames from `start` on.
    ///
    /// # Panics
    /// If the window leaves the series.
    pub fn window(&self, start: usize, frames: usize) -> Vec<f64> {
        assert!(start + frames <= self.frames, "frames {start} to {} of {}", start + frames, self.frames);
        (0..self.channels.len()).flat_map(|c| &self.channel(c)[start..start + frames]).copied().collect()
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
    /// [`Error::Call`] for a clip of another length or of fewer joints, or for numbers that are not finite.
    pub fn onto(&self, clip: &Clip) -> Result<Clip> {
        check(&self.joints, clip)?;
        let clip = resample(clip, self.fps, Method::Auto)?;
        if clip.frames() != self.frames {
            let (has, series) = (clip.frames(), self.frames);
            return Err(Error::Call(format!("a clip of {has} frames for series of {series}; expected as many")));
        }
        if let Some(i) = self.numbers.iter().position(|x| !x.is_finite()) {
            let (channel, frame) = (&self.channels[i / self.frames], i % self.frames);
            return Err(Error::Call(format!("{channel}, frame {frame}: {} is no angle", self.numbers[i])));
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
            return Err(Error::Call(format!("joint {joint} of a skeleton of {} joints", clip.joints())));
        }
        if joints[..i].contains(&joint) {
            let name = &clip.skeleton().names()[joint];
            return Err(Error::Call(format!("joint {joint} ({name}) is given twice; give it once")));
        }
    }
    Ok(())
}

/// Of each vector and its twin the one nearer to the vector before; of equal distances the canonical one.
fn make_continuous(vectors: &mut [Vec3]) {
    for f in 1..vectors.len() {
        let (before, v) = (vectors[f - 1], vectors[f]);
        if let Some(twin) = exp_map::twin(v)
            && (twin - before).length_squared() < (v - before).length_squared()
        {
            vectors[f] = twin;
        }
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
        // from 2.6 to 3.7 radians: the canonical vector jumps at PI
        let clip = turning(60.0, 112, |f| 2.6 + 0.01 * f as f64);
        let steps = |s: &Series| s.channel(2).windows(2).map(|w| (w[1] - w[0]).abs()).fold(0.0, f64::max);
        let smooth = Series::of(&clip, &[], 60.0, false).unwrap();
        assert_eq!(smooth.channels, ["hip.x", "hip.y", "hip.z"]);
        assert!(steps(&smooth) < 0.01, "{}", steps(&smooth));
        assert!((smooth.channel(2)[111] - 0.8 * 3.71).abs() < 1e-9);
        let raw = Series::of(&clip, &[], 60.0, true).unwrap();
        assert!((steps(&raw) - 0.8 * 2.0 * PI).abs() < 0.02, "{}", steps(&raw));
        for (a, b) in smooth.rotations().iter().zip(raw.rotations()) {
            assert!(angle_between(*a, b) < 1e-9);
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
        let back = s.onto(&clip).unwrap();
        assert_eq!(back.root(), clip.root());
        for (a, b) in back.rotations().iter().zip(clip.rotations()) {
            assert!(angle_between(*a, *b) < 1e-9);
        }
        let turned = Series { numbers: vec![0.25; s.numbers.len()], ..s.clone() }.onto(&clip).unwrap();
        for j in 0..24 {
            let moved = angle_between(turned.pose(7)[j], exp_map::from_vector(Vec3::splat(0.25))) < 1e-9;
            assert!(if joints.contains(&j) { moved } else { turned.pose(7)[j] == clip.pose(7)[j] });
        }
    }

    #[test]
    fn what_does_not_fit_is_said() {
        let clip = turning(60.0, 5, |_| 0.0);
        let error = |joints: &[usize]| Series::of(&clip, joints, 60.0, false).unwrap_err().to_string();
        assert!(error(&[3]).contains("joint 3 of a skeleton of 1"));
        assert!(error(&[0, 0]).contains("joint 0 (hip) is given twice"));
        let s = Series::of(&clip, &[], 60.0, false).unwrap();
        assert!(s.onto(&clip.slice(0..4)).unwrap_err().to_string().contains("4 frames for series of 5"));
        let broken = Series { numbers: vec![f64::NAN; 15], ..s };
        assert!(broken.onto(&clip).unwrap_err().to_string().contains("hip.x, frame 0"));
        assert_eq!(Series::of(&clip.slice(0..0), &[], 60.0, false).unwrap().frames, 0);
    }
}
