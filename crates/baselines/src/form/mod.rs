//! Motion as channels, in three forms, and back.
//!
//! A frame's first three channels are the position of the hip. In *frames* these are metres in the world. In *steps*, the
//! input of the network, x and z are the displacement to the next frame, so that they don't depend on the place of a dance.

mod angles;
mod fit;
mod points;
mod quaternions;
#[cfg(test)]
mod tests;

use crate::rig::Rig;
use crate::{Error, Result};
use kinelm_motion::rotation::EulerOrder;
use kinelm_motion::{Clip, Quat, Skeleton, Vec3};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// The representation of a pose.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Form {
    /// C = 3 (J + E): the hip's position, and the offsets from it to every other joint and end site, metres, world axes.
    Positional,
    /// C = 3 + 3 J: the hip's position and each joint's Euler angles, radians, in its own order, the middle one within
    /// +-pi/2.
    Euler,
    /// C = 3 + 4 J: the hip's position and each joint's rotation as w, x, y, z.
    #[default]
    Quaternion,
}

/// A form on a rig.
#[derive(Debug, Clone, PartialEq)]
pub struct Coder {
    form: Form,
    joints: usize,
    points: usize,
    orders: Vec<EulerOrder>,
}

impl Coder {
    /// For a rig.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Invalid`] for orders of angles that are none.
    pub(crate) fn new(form: Form, rig: &Rig) -> Result<Coder> {
        Ok(Coder { form, joints: rig.joints(), points: rig.points(), orders: rig.angles()? })
    }

    /// Its form.
    pub fn form(&self) -> Form {
        self.form
    }

    /// J.
    pub fn joints(&self) -> usize {
        self.joints
    }

    /// C.
    pub fn channels(&self) -> usize {
        match self.form {
            Form::Positional => 3 * self.points,
            Form::Euler => 3 + 3 * self.joints,
            Form::Quaternion => 3 + 4 * self.joints,
        }
    }

    /// (F, C) the frames of a clip on the rig.
    ///
    /// # Panics
    /// A clip of another number of joints or end sites.
    pub fn frames(&self, clip: &Clip) -> Vec<f64> {
        assert_eq!(clip.joints() + clip.skeleton().ends().len(), self.points, "a clip on the rig");
        match self.form {
            Form::Positional => points::frames(clip),
            Form::Euler => angles::frames(clip, &self.orders),
            Form::Quaternion => quaternions::frames(clip),
        }
    }

    /// Turns a frame by `angle` radians about the world's y axis.
    pub(crate) fn turn(&self, frame: &mut [f64], angle: f64) {
        let by = Quat::from_rotation_y(angle);
        let hip = by * Vec3::from_slice(frame);
        hip.write_to_slice(frame);
        // rotations are local: of these only the root's knows where a body faces
        match self.form {
            Form::Positional => points::turn(&mut frame[3..], by),
            Form::Euler => angles::turn(&mut frame[3..6], self.orders[0], by),
            Form::Quaternion => quaternions::turn(&mut frame[3..7], by),
        }
    }

    /// (F, C) frames as a clip on a skeleton of the rig. Positions lack the twist and the lengths of bones: rotations are
    /// fitted to them (`fit`).
    ///
    /// # Errors
    /// [`Error::NotFinite`] with the frame.
    pub fn clip(&self, frames: &[f64], skeleton: &Arc<Skeleton>, fps: f64) -> Result<Clip> {
        let c = self.channels();
        check_finite(frames, c)?;
        let root = frames.chunks_exact(c).map(Vec3::from_slice).collect();
        let rotations = match self.form {
            Form::Positional => {
                let places = self.places(frames, skeleton);
                places.chunks_exact(self.points).flat_map(|frame| fit::rotations(skeleton, frame)).collect()
            }
            Form::Euler => angles::rotations(frames, c, &self.orders),
            Form::Quaternion => quaternions::rotations(frames, c),
        };
        Ok(Clip::new(skeleton.clone(), fps, root, rotations)?)
    }

    /// (F, J + E) positions of joints and end sites, metres, world; of rotations, on this skeleton.
    pub fn places(&self, frames: &[f64], skeleton: &Arc<Skeleton>) -> Vec<Vec3> {
        let c = self.channels();
        let rotations = match self.form {
            Form::Positional => return points::places(frames, c),
            Form::Euler => angles::rotations(frames, c, &self.orders),
            Form::Quaternion => quaternions::rotations(frames, c),
        };
        let mut pose = kinelm_motion::GlobalPose::default();
        let mut places = Vec::with_capacity(frames.len() / c * self.points);
        for (frame, local) in frames.chunks_exact(c).zip(rotations.chunks_exact(self.joints)) {
            pose.set(skeleton, Vec3::from_slice(frame), local);
            places.extend_from_slice(&pose.positions);
            places.extend(pose.ends(skeleton));
        }
        places
    }
}

/// (F - 1, C) steps of (F, C) frames: in channels 0 and 2, the root's x and z, the difference to the next frame.
///
/// ```
/// # use kinelm_baselines::form::{frames_of_steps, steps};
/// let frames = [1.0, 0.9, 2.0, 1.5, 0.8, 2.25, 3.0, 0.9, 2.0];
/// let steps = steps(&frames, 3);
/// assert_eq!(steps, [0.5, 0.9, 0.25, 1.5, 0.8, -0.25]);
/// assert_eq!(frames_of_steps(&steps, 3, [1.0, 2.0]), frames[..6]);
/// ```
pub fn steps(frames: &[f64], channels: usize) -> Vec<f64> {
    let whole = frames.len().saturating_sub(channels);
    let mut steps = frames[..whole].to_vec();
    for (step, next) in
        steps.chunks_exact_mut(channels).zip(frames[frames.len().min(channels)..].chunks_exact(channels))
    {
        for axis in [0, 2] {
            step[axis] = next[axis] - step[axis];
        }
    }
    steps
}

/// (F, C) frames of (F, C) steps, the first one at `x` and `z`: the inverse of [`steps`].
pub fn frames_of_steps(steps: &[f64], channels: usize, [mut x, mut z]: [f64; 2]) -> Vec<f64> {
    let mut frames = steps.to_vec();
    for frame in frames.chunks_exact_mut(channels) {
        let by = [frame[0], frame[2]];
        (frame[0], frame[2]) = (x, z);
        (x, z) = (x + by[0], z + by[1]);
    }
    frames
}

/// Refuses numbers that are not finite.
///
/// # Errors
/// [`Error::NotFinite`] with the frame and the channel.
pub(crate) fn check_finite(frames: &[f64], channels: usize) -> Result<()> {
    match frames.iter().position(|x| !x.is_finite()) {
        None => Ok(()),
        Some(at) => {
            let (frame, channel) = (at / channels, at % channels);
            Err(Error::NotFinite(format!("frame {frame}, channel {channel}: found {}, expected a number", frames[at])))
        }
    }
}
