//! What is known about a rig: corresponding SMPL joints, reference pose, feet, floor.
//!
//! A [`SkeletonMap`] names the joints; [`find_map`] finds the one of a rig, which is [recognised](recognise()) by shape and
//! names where no built-in map fits, and [`MapFit`] says how well it fits a clip. A [`ReferencePose`] is the T-pose or A-pose
//! in which bodies are compared, and [`Feet`] find the [`Floor`] of a clip. A [`Humanoid`] holds all that for a rig. This
//! module knows clips and skeletons, but no files of motion.

pub mod feet;
mod find;
mod fit;
pub mod floor;
mod humanoid;
pub mod map;
pub mod recognise;
pub mod reference;

pub use feet::Feet;
pub(crate) use feet::MADE_UP_TIP;
pub use find::{FoundBy, FoundMap, find_map, map_for, map_searches};
pub(crate) use find::{map_if_any, unknown};
pub use fit::MapFit;
pub(crate) use fit::warnings;
pub use floor::Floor;
pub use humanoid::Humanoid;
pub use map::SkeletonMap;
pub use recognise::{Recognised, recognise};
pub use reference::ReferencePose;
