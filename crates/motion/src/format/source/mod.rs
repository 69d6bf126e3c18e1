//! A motion as it came from a file: its clip, and what the file contains beyond it.
//!
//! Readers make these types and writers use them, without knowing each other.

pub mod bvh;
mod changed;
pub mod glb;
pub mod vrm;

use super::{Axes, Up};
use crate::rig::{Floor, FoundBy, FoundMap, Humanoid, SkeletonMap, unknown};
use crate::{Clip, Result, Vec3, Warning};
use bvh::BvhSource;
pub use changed::Changed;
use glb::GlbSource;
use std::ops::Range;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};
use vrm::VrmaSource;

/// A clip with its source, and what is known of its rig and floor.
///
/// Reading a file finds the skeleton map of its rig; [`Motion::humanoid`] and [`Motion::floor`] give what follows from it to
/// all who work on the motion, without another search.
#[derive(Debug, Clone)]
pub struct Motion {
    /// The file, as the user named it.
    pub path: PathBuf,
    /// The motion itself. [`Motion::with_clip`] replaces it by another.
    pub clip: Clip,
    /// What the file contains beyond the clip.
    pub source: Source,
    /// What was odd in the file.
    pub warnings: Vec<Warning>,
    /// `None` inside: no map is known for the rig.
    humanoid: OnceLock<Option<Arc<Humanoid>>>,
    floor: OnceLock<Floor>,
}

impl Motion {
    /// A clip that a program made, to be written to `path`.
    pub fn new(path: impl Into<PathBuf>, clip: Clip) -> Motion {
        let (humanoid, floor) = Default::default();
        Motion { path: path.into(), clip, source: Source::Plain, warnings: Vec::new(), humanoid, floor }
    }

    /// The motion with what its file contains beyond the clip.
    pub fn with_source(self, source: Source) -> Motion {
        Motion { source, ..self }
    }

    /// The same with another clip: other frames of its rig, or the frames of another rig.
    pub fn with_clip(self, clip: Clip) -> Motion {
        let is_same = clip.skeleton() == self.clip.skeleton();
        // another clip has its own floor, but on the same rig the same humanoid
        let humanoid = if is_same { self.humanoid } else { OnceLock::new() };
        Motion { clip, humanoid, floor: OnceLock::new(), ..self }
    }

    /// The motion with this skeleton map of its rig, by name or path, or its TOML.
    ///
    /// # Errors
    /// Those of [`SkeletonMap::by_name_or_file`].
    pub fn with_map(self, map: &str) -> Result<Motion> {
        let humanoid = Arc::new(Humanoid::of(&self.clip, Some(map))?);
        Ok(Motion { humanoid: OnceLock::from(Some(humanoid)), floor: OnceLock::new(), ..self })
    }

    /// The same for writing into the file of its character in place of the animation of this name.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) for a motion of a file without a mesh, into which nothing is written.
    pub fn replacing(mut self, animation: &str) -> Result<Motion> {
        let Source::Glb(glb) = &mut self.source else {
            let found = format!("{animation} of {}", self.path.display());
            return Err(crate::Error::invalid_parameter("replace_animation", found, "a .glb or .vrm with a mesh"));
        };
        glb.replace = Some(animation.to_owned());
        Ok(self)
    }

    /// The same for writing into the file of its avatar, a VRM.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) for a motion of another file.
    pub fn embedded(mut self) -> Result<Motion> {
        match &mut self.source {
            Source::Glb(glb) if glb.vrm.is_some() => glb.embed = true,
            _ => {
                let found = format!("a dance on another rig, {}", self.path.display());
                return Err(crate::Error::invalid_parameter("embed", found, "one on that of a .vrm with a mesh"));
            }
        }
        Ok(self)
    }

    /// The VRM on whose rig it is, if it is on one's.
    pub(crate) fn avatar(&self) -> Option<&GlbSource> {
        match &self.source {
            Source::Glb(glb) if glb.vrm.is_some() && self.clip.is_on(&glb.skeleton) => Some(glb),
            _ => None,
        }
    }

    /// Whether its file has a mesh that can be given a dance.
    pub fn has_character(&self) -> bool {
        matches!(self.source, Source::Glb(_))
    }

    /// The motion of a file, of whose rig this map was found, or none, in the file's own axes.
    pub(crate) fn read(
        path: &Path,
        clip: Clip,
        source: Source,
        warnings: Vec<Warning>,
        found: Option<FoundMap>,
    ) -> Motion {
        let motion = Motion { source, warnings, ..Motion::new(path, clip) };
        motion.with_found(found)
    }

    /// The motion with the map that was found for another view of its rig, or with none.
    pub(crate) fn with_found(self, found: Option<FoundMap>) -> Motion {
        // a map that doesn't come from the clip is the same in all views
        let of_clip = |found: FoundMap| if found.is_of_clip() { found.on(&self.clip) } else { found };
        let humanoid = found.map(of_clip).map(|found| Arc::new(Humanoid::new(found, self.clip.skeleton())));
        Motion { humanoid: OnceLock::from(humanoid), ..self }
    }

    /// The map that reading found for the rig.
    pub(crate) fn found(&self) -> Option<&FoundMap> {
        Some(self.humanoid.get()?.as_deref()?.found())
    }

    /// What is known of the rig.
    ///
    /// # Errors
    /// [`Unsupported`](kinelm_store::Error::Unsupported) for a rig that no map is known for, with what is missing or doubtful
    /// and a TOML to start from.
    pub fn humanoid(&self) -> Result<&Humanoid> {
        self.known().ok_or_else(|| unknown(&self.clip))
    }

    /// The skeleton map of the rig; `None` where [`Motion::humanoid`] says why none is known.
    pub fn map(&self) -> Option<&SkeletonMap> {
        self.known().map(Humanoid::map)
    }

    pub(crate) fn known(&self) -> Option<&Humanoid> {
        let found = || Humanoid::of(&self.clip, None).ok().map(Arc::new);
        self.humanoid.get_or_init(found).as_deref()
    }

    /// Whether the caller gave the map.
    pub(crate) fn has_own_map(&self) -> bool {
        self.found().is_some_and(|found| found.by == FoundBy::Given)
    }

    /// The floor, detected from the feet ([`mod@crate::rig::floor`]).
    ///
    /// # Errors
    /// Those of [`Motion::humanoid`] and [`Humanoid::pose`].
    pub fn floor(&self) -> Result<&Floor> {
        match self.floor.get() {
            Some(floor) => Ok(floor),
            None => {
                let floor = self.humanoid()?.floor(&self.clip)?;
                Ok(self.floor.get_or_init(|| floor))
            }
        }
    }

    /// The frames of a range alone, of clip and source, without a copy of them.
    ///
    /// # Panics
    /// If the range leaves the clip.
    pub fn slice(mut self, frames: Range<usize>) -> Motion {
        if let Source::Bvh(source) = &mut self.source {
            // rows correspond to frames only until the clip was resampled or cut
            if source.frames == self.clip.frames() {
                source.keep(frames.clone());
            }
        }
        self.clip.keep(frames);
        Motion { floor: OnceLock::new(), ..self }
    }
}

/// What a file contains beyond its clip.
#[derive(Debug, Clone, PartialEq)]
pub enum Source {
    /// A BVH: its header and numbers.
    Bvh(Box<BvhSource>),
    /// An AMASS file.
    Amass {
        /// `SMPL`, `SMPL+H` or `SMPL-X`.
        model: String,
        /// The gender in the file; empty if it has none.
        gender: String,
        /// The number of shape coefficients in the file.
        betas: usize,
        /// The rest pelvis, metres, in the file's axes: what was added to `trans`.
        rest_pelvis: Vec3,
        /// Whether rest pelvis and offsets come from a body model; otherwise they are the neutral skeleton's.
        body_model: bool,
        /// How the file's axes are rotated to the clip's.
        axes: Axes,
    },
    /// An AIST++ file.
    Aist {
        /// `smpl_scaling`: the divisor of `smpl_trans`.
        scaling: f64,
        /// The rest pelvis, metres: what was added to the scaled `smpl_trans`.
        rest_pelvis: Vec3,
        /// Whether rest pelvis and offsets come from a body model; otherwise they are the neutral skeleton's.
        body_model: bool,
        /// How the file's axes are rotated to the clip's.
        axes: Axes,
    },
    /// A GLB with a mesh.
    Glb(Box<GlbSource>),
    /// A VRM animation.
    Vrma(Box<VrmaSource>),
    /// A JSON clip whose up axis is not y, or that is mirrored.
    Json(Axes),
    /// A clip of another format without a source of its own, whose up axis is not y.
    Turned(Axes),
    /// A motion that was put on another body.
    Retargeted {
        /// The floor found before that, metres; retargeting doesn't move it.
        floor_m: f64,
    },
    /// Nothing beyond the clip: a JSON clip, or one made by a program.
    Plain,
}

impl Source {
    /// The axes of the file.
    pub fn axes(&self) -> Axes {
        match self {
            Source::Bvh(bvh) => bvh.rig.axes,
            Source::Glb(glb) => glb.axes,
            Source::Json(axes) | Source::Turned(axes) => *axes,
            Source::Amass { axes, .. } | Source::Aist { axes, .. } => *axes,
            Source::Vrma(_) | Source::Retargeted { .. } | Source::Plain => Axes::OWN,
        }
    }

    /// The source of a format that has none of its own, with these axes.
    pub(crate) fn plain(axes: Axes) -> Source {
        if axes.up == Up::Y { Source::Plain } else { Source::Turned(axes) }
    }
}
