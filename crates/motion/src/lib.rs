//! Motion capture: files to [`Clip`]s and back, and what can be done with clips.
//!
//! Conventions:
//!
//! - right-handed, **y up**, **metres**, **radians**, **seconds**; at rest a body faces +z and its left side is +x;
//! - column vectors, `p' = R p`; quaternions are written (w, x, y, z), unit, and `q` and `-q` are one rotation;
//! - frame `f` of a clip with rate `s` is at time `f / s`; frames and joints count from 0;
//! - F frames, J joints, C channels; the last index runs fastest: `(F, J)` is `frame * joints + joint`.
//!
//! A [`Clip`] holds the motion. What a file contains beyond that (channel orders, units, names, line ends) is in a
//! [`Source`]; clip and source make a [`Motion`].
//!
//! Modules, each using only those before it: [`rotation`], [`skeleton`], [`clip`] and [`pose`]; [`rig`] (skeleton maps,
//! reference poses, feet, floor); [`resample`] and [`mod@format`] (files); [`retarget`], [`metric`], [`feet`], [`inspect`],
//! [`mirror`], [`synth`]; [`convert`].
//!
//! **Features**: `amass` (`.npz`: AMASS, body models, joint positions), `aist` (`.pkl`: AIST++) and `ndarray` (rotations and
//! positions as its arrays) are on by default; `fbx` (`.fbx`, which needs a C compiler) is not.
#![forbid(unsafe_code)]

#[cfg(feature = "ndarray")]
mod arrays;
pub mod capsules;
pub mod clip;
pub mod convert;
pub mod error;
pub mod feet;
pub mod format;
pub mod inspect;
pub mod joints;
pub mod metric;
pub mod mirror;
pub mod moment;
pub mod pose;
pub mod resample;
pub mod retarget;
pub mod rig;
pub mod rotation;
mod series;
pub mod skeleton;
pub mod smpl;
pub mod synth;

pub use clip::Clip;
pub use error::{Error, FaultKind, FileError, Result, Warning};
pub use format::{Motion, Source};
pub use pose::GlobalPose;
pub use rotation::{Quat, Vec3};
pub use skeleton::{EndSite, Skeleton};

/// Runs the examples of the README with the doc tests.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
