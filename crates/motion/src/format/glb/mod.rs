//! GLB (binary glTF 2.0): written for game engines and browsers, [read](read()), and given one more animation.
//!
//! - `file`: what a file has: its chunks, document, nodes and animations;
//! - `read`: the clip of one figure;
//! - `write`: new files, each clip with a body of capsules;
//! - `onto`: an animation added to a file, of which all else stays as it is;
//! - `vrma`: a VRM animation.
//!
//! Source: Khronos Group, glTF 2.0 Specification (2021), sections 3.5 to 3.7, 3.11, 4.4.

mod file;
mod onto;
mod read;
mod vrma;
mod write;

pub use read::{read, read_vrma};
pub(super) use vrma::motion_to_bytes as motion_to_vrma;
pub use write::{Named, to_bytes};

use super::source::glb::GlbSource;
use super::{Changed, Motion, Source};
use crate::Result;
use std::path::Path;

/// Checks whether a motion on this rig can go to `path`: before it is made.
///
/// # Errors
/// A name that an animation of its character's file has, and a character on which none can be put.
pub(super) fn check_place(path: &Path, source: &GlbSource) -> Result<()> {
    onto::check(source, &path.file_stem().unwrap_or_default().to_string_lossy())
}

/// The bytes of a motion that goes to `path`, whose stem names it: into the file of its character, if it has one, else a new
/// file. `changed`: of the clip that the character's file has, what is new; `None`: all of it.
///
/// # Errors
/// Those of [`to_bytes`]; a name that an animation of the character's file has.
pub(super) fn motion_to_bytes(path: &Path, motion: &Motion, changed: Option<&Changed>) -> Result<Vec<u8>> {
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    match &motion.source {
        Source::Glb(source) if motion.clip.is_on(&source.skeleton) => onto::onto(source, &name, &motion.clip, changed),
        _ => to_bytes(&[(&name, &motion.clip)]),
    }
}
