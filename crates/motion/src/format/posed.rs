//! Clips of figures whose joints are placed in the world frame by frame, and are turned at rest: FBX and glTF.

use crate::{Clip, Quat, Result, Skeleton, Vec3};
use std::sync::Arc;

/// Rotation and place of a joint in the world, metres.
pub(super) type Placed = (Quat, Vec3);

/// A figure at rest: names, parents before children, rest placement.
pub(super) struct Figure {
    pub names: Vec<String>,
    pub parents: Vec<Option<usize>>,
    pub rest: Vec<Placed>,
}

impl Figure {
    /// The clip of the placements (F, J) that `frames` gives, and by how much the longest change of a bone's length is,
    /// metres. In the clip, as in a BVH, all rotations are 0 at rest: what a joint is turned by at rest is removed.
    ///
    /// # Errors
    /// Those of [`Skeleton::new`], [`Clip::new`] and of `frames`.
    pub fn clip(&self, fps: f64, frames: impl Iterator<Item = Result<Vec<Placed>>>) -> Result<(Clip, f64)> {
        let offset = |(j, parent): (usize, &Option<usize>)| match parent {
            Some(p) => self.rest[j].1 - self.rest[*p].1,
            None => Vec3::ZERO,
        };
        let offsets: Vec<Vec3> = self.parents.iter().enumerate().map(offset).collect();
        let skeleton = Skeleton::new(self.names.clone(), self.parents.clone(), offsets.clone(), Vec::new())?;
        let (mut root, mut rotations, mut stretch) = (Vec::new(), Vec::new(), 0.0f64);
        for here in frames {
            let here = here?;
            let turned: Vec<Quat> = here.iter().zip(&self.rest).map(|(now, rest)| now.0 * rest.0.inverse()).collect();
            root.push(here[0].1);
            for (j, parent) in self.parents.iter().enumerate() {
                rotations.push(parent.map_or(turned[j], |p| turned[p].inverse() * turned[j]).normalize());
                if let Some(p) = *parent {
                    stretch = stretch.max(((here[j].1 - here[p].1).length() - offsets[j].length()).abs());
                }
            }
        }
        Ok((Clip::new(Arc::new(skeleton), fps, root, rotations)?, stretch))
    }
}

/// A name that none of the others has: the name itself, else with a number.
pub(super) fn unique(name: &str, taken: &[String]) -> String {
    let numbered = (2..).map(|n| format!("{name}.{n}"));
    std::iter::once(name.to_owned()).chain(numbered).find(|name| !taken.contains(name)).unwrap_or_default()
}

/// Rotation and place of a matrix's columns, without its scale.
pub(super) fn placed(columns: [Vec3; 3], place: Vec3) -> Placed {
    let turn = crate::rotation::Mat3::from_cols(
        columns[0].normalize_or_zero(),
        columns[1].normalize_or_zero(),
        columns[2].normalize_or_zero(),
    );
    // a reflection is no rotation
    let turn = if turn.determinant() < 0.0 { -turn } else { turn };
    let q = Quat::from_mat3(&turn);
    (if q.is_finite() && q.length() > 1e-9 { q.normalize() } else { Quat::IDENTITY }, place)
}
