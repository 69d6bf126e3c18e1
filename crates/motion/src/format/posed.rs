//! Clips of figures whose joints are placed in the world frame by frame, and are turned at rest: FBX and glTF.

use super::options::ReadOptions;
use super::{motion_root, size};
use crate::rig::{FoundMap, map_if_any};
use crate::{Clip, EndSite, Quat, Result, Skeleton, Vec3, Warning};
use std::sync::Arc;

/// A change of a bone's length above this is reported, metres.
const STRETCH_M: f64 = 0.01;
/// Positions in the frame of the joint above that stay within this of where they are at rest don't move, metres.
const STILL_M: f64 = 0.0005;
/// Most frames times joints: 8 GiB.
pub(super) const MOST_PLACED: f64 = (1u64 << 27) as f64;

/// Rotation and place of a joint in the world, metres.
pub(super) type Placed = (Quat, Vec3);

/// A figure at rest: names, parents before children, rest placement.
pub(super) struct Figure {
    pub names: Vec<String>,
    pub parents: Vec<Option<usize>>,
    pub rest: Vec<Placed>,
    /// The joints by SMPL id, where the file states them.
    pub roles: Option<[Option<usize>; 24]>,
    /// Points that a joint moves, at rest as the world's axes are.
    pub ends: Vec<EndSite>,
}

/// A clip of a figure, as far as it is read.
pub(super) struct Posed {
    pub clip: Clip,
    /// The map of its rig, if one was found.
    pub found: Option<FoundMap>,
    pub warnings: Vec<Warning>,
}

impl Figure {
    /// The clip of the placements (F, J) that `frames` gives in metres, by the unit of `stated_m` that the file states, with its
    /// warnings; another unit in the options is what its numbers really are. In the clip, as in a BVH, all
    /// rotations are 0 at rest: the rest rotation of each joint is removed. It begins at `root`, else at the motion root:
    /// everything above is composed into it.
    ///
    /// # Errors
    /// Those of [`Skeleton::new`], [`Clip::new`], of a skeleton map and of `frames`.
    pub fn clip(
        &self,
        root: Option<usize>,
        fps: f64,
        options: &ReadOptions,
        stated_m: f64,
        frames: impl Iterator<Item = Result<Vec<Placed>>>,
    ) -> Result<Posed> {
        let offset = |(j, parent): (usize, &Option<usize>)| match parent {
            Some(p) => self.rest[j].1 - self.rest[*p].1,
            None => Vec3::ZERO,
        };
        let offsets: Vec<Vec3> = self.parents.iter().enumerate().map(offset).collect();
        let skeleton = Skeleton::new(self.names.clone(), self.parents.clone(), offsets.clone(), self.ends.clone())?;
        let (mut places, mut rotations) = (Vec::new(), Vec::new());
        // by joint: how far it moves from its place at the joint above, and by how much its bone changes its length
        let (mut moved, mut stretched) = (vec![0.0f64; offsets.len()], vec![0.0f64; offsets.len()]);
        for here in frames {
            let here = here?;
            // `now * rest^-1` is the world rotation from rest, whatever axes the joint had
            let turned: Vec<Quat> = here.iter().zip(&self.rest).map(|(now, rest)| now.0 * rest.0.inverse()).collect();
            places.extend(here.iter().map(|placed| placed.1));
            for (j, parent) in self.parents.iter().enumerate() {
                // local rotations between joints that are unrotated at rest, so rest offsets are world offsets
                rotations.push(parent.map_or(turned[j], |p| turned[p].inverse() * turned[j]).normalize());
                if let Some(p) = *parent {
                    let bone = here[j].1 - here[p].1;
                    moved[j] = moved[j].max((turned[p].inverse() * bone).distance(offsets[j]));
                    stretched[j] = stretched[j].max((bone.length() - offsets[j].length()).abs());
                }
            }
        }
        let metres = options.unit.metres().map_or(1.0, |metres| metres / stated_m);
        let joints = self.names.len();
        let path = |joint: usize| -> Vec<Vec3> { places.iter().skip(joint).step_by(joints).copied().collect() };
        moved[0] = spread(&path(0));
        let whole = Clip::new(Arc::new(skeleton), fps, path(0), rotations)?;
        let given = options.map.as_deref();
        let roles = self.roles.as_ref().filter(|_| given.is_none());
        let stated = roles.and_then(|roles| FoundMap::stated(&whole, roles));
        let mut found = stated.map_or_else(|| map_if_any(&whole, given), |stated| Ok(Some(stated)))?;
        let root = motion_root::choose(&whole, root, &mut found, given, |j| moved[j] * metres > STILL_M)?;
        let beside = motion_root::beside(whole.skeleton(), root, |j| moved[j] * metres);
        let (clip, found) = if root == 0 {
            (whole, found)
        } else {
            let clip = motion_root::from_joint(&whole, root, path(root))?;
            let found = motion_root::map_below(&clip, found, given)?;
            (clip, found)
        };
        let of = |name: &String| self.names.iter().position(|n| n == name);
        let below = clip.skeleton().names()[1..].iter().filter_map(of);
        let large: Vec<usize> = below.filter(|&j| stretched[j] * metres > STRETCH_M).collect();
        let warning = large.iter().copied().max_by(|a, b| stretched[*a].total_cmp(&stretched[*b])).map(|most| {
            let (count, by, name) = (large.len(), stretched[most] * metres, &self.names[most]);
            let what = format!(
                "bones of {count} joints change their length; they are left as at rest, which leaves out up to {by:.3} m, at {name}"
            );
            Warning { kind: "stretch_dropped", what }
        });
        let clip = if metres == 1.0 { clip } else { clip.scaled(metres)? };
        let map = found.as_ref().map(|found| &found.map);
        let size = size::doubt(&clip, map, options.unit.metres().unwrap_or(stated_m));
        Ok(Posed { clip, found, warnings: warning.into_iter().chain(beside).chain(size).collect() })
    }
}

/// The longest way between the first place and any other.
fn spread(path: &[Vec3]) -> f64 {
    path.iter().map(|p| p.distance(path[0])).fold(0.0, f64::max)
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
