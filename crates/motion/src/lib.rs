//! Files of motion to [`Clip`]s and back.
//!
//! The conventions, stated once and kept everywhere:
//!
//! - right-handed, **y up**, **metres**, **radians**, **seconds**; at rest a body faces +z and its left side is +x;
//! - column vectors, `p' = R p`; quaternions are written (w, x, y, z), unit, and `q` and `-q` are one rotation;
//! - frame `f` of a clip of rate `s` is at time `f / s`; frames and joints count from 0;
//! - F frames, J joints, C channels; the last index runs fastest: `(F, J)` is `frame * joints + joint`.
//!
//! A [`Clip`] holds what motion *is*; what a file *says* and a clip has no place for (channel orders, units, names,
//! line ends) travels in a [`Source`] beside it, and the two make a [`Motion`].
//!
//! The rooms know each other in one direction, from the bottom up: [`rotation`], [`skeleton`], [`clip`] and [`pose`];
//! [`rig`] (which joints are whose, how a body stands, where its feet and the floor are); [`resample`] and [`mod@format`]
//! (files); [`retarget`], [`metric`], [`feet`], [`inspect`], [`mirror`], [`synth`]; [`convert`].
//!
//! **Features**: `amass` (`.npz`: AMASS, body models, places of joints) and `aist` (`.pkl`: AIST++) are on by default;
//! `fbx` (`.fbx`, which needs a C compiler) is not; `ndarray` gives views of rotations and places.
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

/// The examples of the README are tested with those of the code.
#[cfg(doctest)]
#[doc = include_str!("../README.md")]
struct Readme;
