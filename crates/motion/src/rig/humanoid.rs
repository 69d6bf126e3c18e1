//! A rig as a humanoid: its map and reference pose, which all work on its clips needs, found once.

use super::{Feet, Floor, FoundBy, FoundMap, ReferencePose, SkeletonMap, find_map};
use crate::{Clip, Result, Skeleton, smpl};
use std::borrow::Cow;
use std::sync::{Arc, LazyLock};

/// A rig with its skeleton map and the reference pose in which it is compared with other bodies.
#[derive(Debug, Clone)]
pub struct Humanoid {
    rig: Arc<Skeleton>,
    found: FoundMap,
    /// `None` for a rig on which no body stands in the reference pose of the map.
    pose: Option<ReferencePose>,
}

impl Humanoid {
    /// The humanoid of a clip's rig: by the map of this name or path, else by the one that is found.
    ///
    /// # Errors
    /// Those of [`find_map`].
    pub fn of(clip: &Clip, map: Option<&str>) -> Result<Humanoid> {
        let neutral = Humanoid::neutral();
        if map.is_none() && *clip.skeleton() == neutral.rig {
            return Ok(neutral.clone());
        }
        Ok(Humanoid::new(find_map(clip, map)?, clip.skeleton()))
    }

    /// The neutral SMPL body.
    pub fn neutral() -> &'static Humanoid {
        static NEUTRAL: LazyLock<Humanoid> = LazyLock::new(|| {
            let body = smpl::neutral();
            let map = SkeletonMap::builtin("smpl").expect("a built-in map");
            Humanoid::new(FoundMap::standing(map, FoundBy::Names, &body, None), &body)
        });
        &NEUTRAL
    }

    /// The humanoid of a rig with this map, bound to it as far as it fits.
    pub fn with_map(rig: &Skeleton, map: &SkeletonMap) -> Humanoid {
        let found = FoundMap::standing(map.bind_any(rig.names()), FoundBy::Given, rig, None);
        Humanoid::new(found, &Arc::new(rig.clone()))
    }

    /// The humanoid of a rig with the map that was found for it.
    pub(crate) fn new(found: FoundMap, rig: &Arc<Skeleton>) -> Humanoid {
        Humanoid { pose: ReferencePose::new(rig, &found.map).ok(), rig: rig.clone(), found }
    }

    /// The rig.
    pub fn rig(&self) -> &Arc<Skeleton> {
        &self.rig
    }

    /// The map, bound to the rig's joint names.
    pub fn map(&self) -> &SkeletonMap {
        &self.found.map
    }

    /// The map, and how it was found.
    pub fn found(&self) -> &FoundMap {
        &self.found
    }

    /// The rig in the map's reference pose.
    ///
    /// # Errors
    /// Those of [`ReferencePose::new`].
    pub fn pose(&self) -> Result<Cow<'_, ReferencePose>> {
        match &self.pose {
            Some(pose) => Ok(Cow::Borrowed(pose)),
            // errors aren't `Clone`: failing a second time gives each caller its own
            None => ReferencePose::new(&self.rig, &self.found.map).map(Cow::Owned),
        }
    }

    /// The feet.
    ///
    /// # Errors
    /// Those of [`Humanoid::pose`].
    pub fn feet(&self) -> Result<Feet> {
        let pose = self.pose()?;
        Ok(Feet::from_pose(&self.rig, &pose))
    }

    /// The floor of a clip on this rig; see [`Feet::floor`].
    ///
    /// # Errors
    /// Those of [`Humanoid::pose`].
    pub fn floor(&self, clip: &Clip) -> Result<Floor> {
        Ok(self.feet()?.floor(clip))
    }
}
