//! Two clips made comparable: one rate, one length, one rig, one heading.

use crate::filter::LOW_HZ;
use crate::{Error, Result};
use kinelm_motion::format::floor_height;
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::retarget::{self, Retarget};
use kinelm_motion::{Clip, Motion, Quat, Skeleton, Source, Vec3};

/// Which parts of two clips are compared, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct Alignment {
    /// N, frames; `None`: all that the shorter clip has.
    pub frames: Option<usize>,
    /// Frames per second.
    pub fps: f64,
    /// The beginning of the part in the first clip, and in the second, seconds.
    pub at_s: [f64; 2],
    /// Leave the second clip's heading as it is, instead of turning it so that both begin facing the same way.
    pub keep_heading: bool,
}

impl Default for Alignment {
    fn default() -> Self {
        Alignment { frames: Some(128), fps: 60.0, at_s: [0.0; 2], keep_heading: false }
    }
}

/// Frames of the shortest window that has a spectrum: one place of a short-time Fourier transform.
pub const MIN_FRAMES: usize = crate::Stft::WINDOW;
/// Frames of the longest.
pub const MAX_FRAMES: usize = 8192;

/// Two windows of one rate, length and rig.
#[derive(Debug, Clone)]
pub struct Aligned {
    /// The first clip's window.
    pub a: Clip,
    /// The second's, on the first's rig and facing as it does.
    pub b: Clip,
    /// Notes for the user on the changes.
    pub notes: Vec<String>,
}

impl Alignment {
    /// Coefficients of a cosine transform up to 3.5 Hz over a window of `frames`: 16 of 128 at 60 frames a second.
    pub fn low(&self, frames: usize) -> usize {
        crate::filter::coefficients(frames, self.fps, LOW_HZ).min(frames)
    }

    /// Aligns two clips.
    ///
    /// # Errors
    /// A window that is out of all bounds or that a clip is too short for; rigs of which one can't be put on the other.
    pub(crate) fn of(&self, a: &Motion, b: &Motion) -> Result<Aligned> {
        let mut notes = Vec::new();
        let at_rate = |motion: &Motion, notes: &mut Vec<String>| -> Result<Clip> {
            let (name, fps) = (motion.path.display(), motion.clip.fps());
            if fps != self.fps {
                notes.push(format!("{name}: from {} to {} fps", round(fps), round(self.fps)));
            }
            Ok(resample(&motion.clip, self.fps, Method::Auto)?)
        };
        let clips = [at_rate(a, &mut notes)?, at_rate(b, &mut notes)?];
        let frames = self.frames([a, b], [&clips[0], &clips[1]], &mut notes)?;
        let cut = |i: usize| {
            let start = self.start(i);
            clips[i].slice(start..start + frames)
        };
        let (first, second) = (cut(0), cut(1));
        let mut second = self.on_rig([a, b], &first, second, &mut notes)?;
        if !self.keep_heading {
            let turn = heading_between(&first, &second);
            if turn.abs().to_degrees() > 1.0 {
                let name = b.path.display();
                notes.push(format!("{name}: turned by {:.0} degrees, to begin facing as the first", turn.to_degrees()));
            }
            second = turned(&second, turn)?;
        }
        Ok(Aligned { a: first, b: second, notes })
    }

    fn start(&self, i: usize) -> usize {
        (self.at_s[i] * self.fps).round() as usize
    }

    /// N, if both clips have as many frames from their starts on.
    fn frames(&self, motions: [&Motion; 2], clips: [&Clip; 2], notes: &mut Vec<String>) -> Result<usize> {
        if self.at_s.iter().any(|s| !(s.is_finite() && *s >= 0.0)) {
            let found = format!("{:?} s", self.at_s);
            return Err(Error::invalid_parameter("at_s", found, "times from 0 on"));
        }
        let left = [0, 1].map(|i| clips[i].frames().saturating_sub(self.start(i)));
        let shorter = left[0].min(left[1]);
        let frames = self.frames.unwrap_or(shorter);
        if self.frames.is_none() && left[0] != left[1] {
            let longer = motions[usize::from(left[1] > left[0])].path.display();
            notes.push(format!("{longer}: cut to the other's {frames} frames"));
        }
        if self.frames.is_some() && !(MIN_FRAMES..=MAX_FRAMES).contains(&frames) {
            return Err(Error::invalid_parameter("window", frames, format!("{MIN_FRAMES} to {MAX_FRAMES} frames")));
        }
        // `None` takes what there is, which may be too short for a spectrum
        let needed = frames.max(MIN_FRAMES);
        if let Some(i) = [0, 1].into_iter().find(|&i| left[i] < needed) {
            let (has, start) = (clips[i].frames(), self.at_s[i]);
            let what = format!(
                "{has} frames at {} fps, of which {} lie from {start} s on; expected at least the {needed} of a window: \
                 begin earlier, or take a shorter window",
                round(self.fps),
                left[i]
            );
            return Err(kinelm_motion::Error::Clip { clip: motions[i].path.display().to_string(), what }.into());
        }
        if frames > MAX_FRAMES {
            let (needs, most) = (format!("{frames} frames"), format!("{MAX_FRAMES} frames"));
            return Err(Error::limit("interpolating whole clips", needs, most, "give `window`, or a lower `fps`"));
        }
        Ok(frames)
    }

    /// The second clip on the first's rig; joints that no joint of the second plays move as the first's.
    fn on_rig(&self, motions: [&Motion; 2], first: &Clip, second: Clip, notes: &mut Vec<String>) -> Result<Clip> {
        let [a, b] = motions.map(|m| m.path.display().to_string());
        let (to, from) = (first.skeleton(), second.skeleton());
        if to.names() == from.names() && to.parents() == from.parents() {
            // the same joints; bones of another length turn the same way
            return Ok(second);
        }
        let retargeted = || -> kinelm_motion::Result<Clip> {
            let source = match &motions[1].source {
                // numbers of the whole file don't belong to a window of it
                Source::Bvh(_) => Source::Plain,
                other => other.clone(),
            };
            let window = motions[1].clone().with_clip(second).with_source(source);
            let smpl = retarget::to_smpl(&window)?;
            let way = Retarget::new(motions[0].humanoid()?, smpl.skeleton().clone())?;
            let way = way.with_floor(floor_height(&window)?);
            way.to_rig_over(&smpl, Some(first))
        };
        let clip = retargeted().map_err(|e| {
            Error::unsupported(b.clone(), format!("it can't be put on the rig of {a}, which is another one: {e}"))
        })?;
        notes.push(format!("{b}: put on the rig of {a}"));
        Ok(clip)
    }
}

/// A rate without the digits that only its inverse made.
fn round(fps: f64) -> f64 {
    (fps * 1e3).round() / 1e3
}

/// The joint that carries the body: the root, or below it the first that has other than one child. The joints before it
/// are those above it.
pub(super) fn pelvis(skeleton: &Skeleton) -> usize {
    let mut at = 0;
    // parents come before children, so the only child in a chain from the root is the next joint
    while skeleton.children(at).count() == 1 {
        at += 1;
    }
    at
}

/// The angle about the vertical, radians, that turns the second clip's first pelvis nearest to the first's.
fn heading_between(first: &Clip, second: &Clip) -> f64 {
    let world = |clip: &Clip| clip.global_pose(0).rotations[pelvis(clip.skeleton())];
    let off = world(first) * world(second).conjugate();
    // the twist about the vertical of the rotation between the two: its nearest turn
    let half = off.y.atan2(off.w);
    kinelm_motion::rotation::euler::wrap(2.0 * half)
}

/// A clip turned about the vertical where it begins. The turn is made by the joint that carries the body, so that joints
/// above it, which are constant in some rigs, stay constant.
pub(crate) fn turned(clip: &Clip, angle: f64) -> Result<Clip> {
    let turn = Quat::from_rotation_y(angle);
    let (joint, j) = (pelvis(clip.skeleton()), clip.joints());
    let from = clip.root().first().copied().unwrap_or(Vec3::ZERO);
    let root = clip.root().iter().map(|&p| from + turn * (p - from)).collect();
    let mut rotations = clip.rotations().to_vec();
    for f in 0..clip.frames() {
        // a turn in the world, brought into the frame of the joints above
        let above = clip.skeleton().parents()[joint].map_or(Quat::IDENTITY, |p| clip.global_pose(f).rotations[p]);
        let local = &mut rotations[f * j + joint];
        // four products of rounded quaternions
        *local = (above.conjugate() * turn * above * *local).normalize();
    }
    Ok(Clip::new(clip.skeleton().clone(), clip.fps(), root, rotations)?)
}

#[cfg(test)]
mod tests;
