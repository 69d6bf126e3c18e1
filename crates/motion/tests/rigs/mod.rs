//! Rigs for tests: hierarchies of tools' rigs as trees of names, put on a body of given proportions, and danced.
//!
//! A file of this folder is a tree by indentation; `= left_hip` after a name says which SMPL joint it is. Places are made
//! up: joints of SMPL's stand where that body has them, others between them, twists along their bone, fingers along the
//! hand. `#` begins a comment: where the names are from.

use kinelm_motion::retarget::Retarget;
use kinelm_motion::rig::{Humanoid, SkeletonMap};
use kinelm_motion::{Clip, GlobalPose, Quat, Skeleton, Vec3, smpl};
use std::path::Path;

/// A joint of a tree.
#[derive(Debug, Clone)]
pub struct Node {
    pub name: String,
    pub parent: Option<usize>,
    /// SMPL's joint.
    pub id: Option<usize>,
}

/// A rig's tree; parents come before their children.
#[derive(Debug, Clone)]
pub struct Tree {
    pub rig: String,
    pub nodes: Vec<Node>,
}

/// The trees that the rules of recognition were made with, by name.
pub fn all() -> Vec<Tree> {
    trees("tests/rigs")
}

/// The trees that were first looked at when the rules were done.
pub fn held_out() -> Vec<Tree> {
    trees("tests/rigs/held_out")
}

fn trees(folder: &str) -> Vec<Tree> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
    let mut files: Vec<_> = std::fs::read_dir(folder).unwrap().map(|e| e.unwrap().path()).collect();
    files.retain(|f| f.extension().is_some_and(|e| e == "txt"));
    files.sort();
    files
        .iter()
        .map(|f| Tree::parse(f.file_stem().unwrap().to_str().unwrap(), &std::fs::read_to_string(f).unwrap()))
        .collect()
}

impl Tree {
    pub fn parse(rig: &str, text: &str) -> Tree {
        let mut nodes: Vec<Node> = Vec::new();
        let mut open: Vec<(usize, usize)> = Vec::new();
        for line in text.lines().filter(|l| !l.trim().is_empty() && !l.starts_with('#')) {
            let depth = line.len() - line.trim_start().len();
            let (name, id) = match line.trim().split_once(" = ") {
                Some((name, joint)) => {
                    let id = smpl::NAMES.iter().position(|n| *n == joint.trim());
                    (name.trim(), Some(id.unwrap_or_else(|| panic!("{rig}: {joint} is no SMPL joint"))))
                }
                None => (line.trim(), None),
            };
            open.retain(|(d, _)| *d < depth);
            let parent = open.last().map(|o| o.1);
            open.push((depth, nodes.len()));
            nodes.push(Node { name: name.to_owned(), parent, id });
        }
        Tree { rig: rig.to_owned(), nodes }
    }

    /// The rig with twists, helpers and joints between, both sides alike, as many as `random` draws.
    pub fn with_helpers(&self, random: &mut dyn FnMut() -> f64) -> Tree {
        let mut nodes: Vec<Node> = Vec::new();
        let mut at = Vec::new();
        let helper = |nodes: &mut Vec<Node>, parent| {
            nodes.push(Node { name: format!("helper{}", nodes.len()), parent, id: None });
            Some(nodes.len() - 1)
        };
        let draws: Vec<[f64; 2]> = (0..24).map(|_| [random(), random()]).collect();
        let drawn = |id: Option<usize>| id.map(|id| draws[left(id)]);
        for node in &self.nodes {
            let mut parent = node.parent.map(|p: usize| at[p]);
            if node.id != Some(0) && drawn(node.id).is_some_and(|d| d[0] < 0.15) {
                parent = helper(&mut nodes, parent);
            }
            at.push(nodes.len());
            nodes.push(Node { parent, ..node.clone() });
            if drawn(node.id).is_some_and(|d| d[1] < 0.3) {
                helper(&mut nodes, at.last().copied());
            }
        }
        Tree { rig: self.rig.clone(), nodes }
    }

    /// The rig's joint by SMPL id.
    pub fn joints(&self) -> [Option<usize>; 24] {
        std::array::from_fn(|id| self.nodes.iter().position(|n| n.id == Some(id)))
    }

    /// The map of the rig.
    pub fn map(&self) -> SkeletonMap {
        let mut text = String::from("name = \"true\"\n[joints]\n");
        for (id, joint) in self.joints().iter().enumerate() {
            if let Some(j) = joint {
                text += &format!("{} = {:?}\n", smpl::NAMES[id], self.nodes[*j].name);
            }
        }
        SkeletonMap::parse(&text, Path::new(&self.rig)).unwrap()
    }

    /// The rig with these bones of SMPL's body, in its T-pose.
    pub fn skeleton(&self, body: &Skeleton) -> Skeleton {
        let places = self.places(body);
        let offset = |j: usize| places[j] - self.nodes[j].parent.map_or(Vec3::ZERO, |p| places[p]);
        Skeleton::new(
            self.nodes.iter().map(|n| n.name.clone()).collect(),
            self.nodes.iter().map(|n| n.parent).collect(),
            (0..self.nodes.len()).map(offset).collect(),
            Vec::new(),
        )
        .unwrap()
    }

    /// A clip of `body` on the rig.
    pub fn dance(&self, rig: &Skeleton, clip: &Clip) -> Clip {
        Retarget::new(&Humanoid::with_map(rig, &self.map()), clip.skeleton().clone()).unwrap().to_rig(clip).unwrap()
    }

    fn places(&self, body: &Skeleton) -> Vec<Vec3> {
        let rest = GlobalPose::new(body, Vec3::Y * smpl::STANDING_PELVIS_M, &[Quat::IDENTITY; 24]).positions;
        let n = self.nodes.len();
        let upwards = |j: usize| std::iter::successors(Some(j), |&j| self.nodes[j].parent);
        // the nearest joint below that is SMPL's, and how many steps down
        let mut below: Vec<Option<(usize, usize)>> = vec![None; n];
        for j in (0..n).rev() {
            let own = self.nodes[j].id.map(|_| (j, 0)).or(below[j]);
            if let (Some((d, steps)), Some(p)) = (own, self.nodes[j].parent) {
                let steps = steps + 1;
                if below[p].is_none_or(|(_, s)| steps <= s) {
                    below[p] = Some((d, steps));
                }
            }
        }
        let mut places = vec![Vec3::ZERO; n];
        for j in 0..n {
            if let Some(id) = self.nodes[j].id {
                places[j] = rest[id];
                continue;
            }
            let above = upwards(j).skip(1).enumerate().find(|(_, a)| self.nodes[*a].id.is_some());
            places[j] = match (above, below[j]) {
                (Some((up, a)), Some((d, down))) => {
                    let share = (up + 1) as f64 / (up + 1 + down) as f64;
                    places[a].lerp(rest[self.nodes[d].id.unwrap()], share)
                }
                (Some((up, a)), None) => places[a] + self.aside(j, a, up, &rest),
                (None, Some(_)) | (None, None) => Vec3::ZERO,
            };
        }
        places
    }

    /// Where a joint `up + 1` steps below SMPL's joint `a` stands that none of SMPL's descends from.
    fn aside(&self, j: usize, a: usize, up: usize, rest: &[Vec3]) -> Vec3 {
        let siblings: Vec<usize> = (0..self.nodes.len())
            .filter(|&s| self.nodes[s].parent == self.nodes[j].parent && self.nodes[s].id.is_none())
            .collect();
        let place = siblings.iter().position(|&s| s == j).unwrap_or(0) as f64;
        let steps = (up + 1) as f64;
        let id = self.nodes[a].id.unwrap();
        let side = if rest[id].x < 0.0 { -1.0 } else { 1.0 };
        let first = if up == 0 { place } else { 0.0 };
        match id {
            20..=23 => Vec3::new(side * (0.07 * f64::from(u8::from(up == 0)) + 0.03 * steps), 0.0, 0.03 - 0.02 * first),
            15 => Vec3::new(0.03 * (first - 1.0), 0.08, 0.09) * (0.5 + 0.5 * steps),
            10 | 11 => Vec3::new(0.01 * first, 0.0, 0.05 * steps),
            7 | 8 => Vec3::new(0.0, -0.05, -0.04 - 0.01 * first),
            _ => {
                let next = (0..24)
                    .find(|&c| usize::try_from(smpl::PARENTS[c]) == Ok(id))
                    .map_or(Vec3::Y * 0.1, |c| rest[c] - rest[id]);
                next * ((first + steps) / (siblings.len() as f64 + 1.0)).min(1.0)
            }
        }
    }
}

/// A clip whose frames are counted from its pose at `frame`: what was there is its rest pose.
pub fn from_pose(clip: &Clip, frame: usize) -> Clip {
    let rig = clip.skeleton();
    let still = clip.global_pose(frame);
    let offset = |j: usize| rig.parents()[j].map_or(rig.offsets()[j], |p| still.rotations[p] * rig.offsets()[j]);
    let offsets = (0..rig.joints()).map(offset).collect();
    let based = Skeleton::new(rig.names().to_vec(), rig.parents().to_vec(), offsets, Vec::new()).unwrap();
    reframed(clip, based, &still.rotations.iter().map(|q| q.inverse()).collect::<Vec<_>>())
}

/// A clip whose joints' frames are turned by `turns` (J) of their own.
pub fn tilted(clip: &Clip, turns: &[Quat]) -> Clip {
    let rig = clip.skeleton();
    let offset = |j: usize| rig.parents()[j].map_or(rig.offsets()[j], |p| turns[p].inverse() * rig.offsets()[j]);
    let offsets = (0..rig.joints()).map(offset).collect();
    let based = Skeleton::new(rig.names().to_vec(), rig.parents().to_vec(), offsets, Vec::new()).unwrap();
    reframed(clip, based, turns)
}

/// The clip with `G_j A_j` for the rotations `G_j` of its joints in the world.
fn reframed(clip: &Clip, rig: Skeleton, turns: &[Quat]) -> Clip {
    let mut rotations = Vec::new();
    for f in 0..clip.frames() {
        let pose = clip.global_pose(f);
        let turned = pose.rotations.iter().zip(turns).map(|(g, a)| *g * *a).collect();
        rotations.extend(GlobalPose { rotations: turned, positions: pose.positions }.to_local(&rig));
    }
    Clip::new(rig.into(), clip.fps(), clip.root().to_vec(), rotations).unwrap()
}

/// A rotation for each of `joints` joints, up to 3 radians about any axis.
pub fn turns(joints: usize, random: &mut dyn FnMut() -> f64) -> Vec<Quat> {
    let axis = |random: &mut dyn FnMut() -> f64| Vec3::new(random() - 0.5, random() - 0.5, random() - 0.5).normalize();
    (0..joints).map(|_| Quat::from_axis_angle(axis(random), 3.0 * random())).collect()
}

/// SMPL's neutral body with each bone up to `share` longer or shorter, both sides alike; `random` draws from 0 to 1.
pub fn varied(share: f64, random: &mut dyn FnMut() -> f64) -> Skeleton {
    let neutral = smpl::neutral();
    let factors: Vec<f64> = (0..24).map(|_| 1.0 + share * (2.0 * random() - 1.0)).collect();
    let of = |id: usize| factors[left(id)];
    let offsets = neutral.offsets().iter().enumerate().map(|(id, o)| *o * of(id)).collect();
    Skeleton::new(neutral.names().to_vec(), neutral.parents().to_vec(), offsets, Vec::new()).unwrap()
}

/// The left joint of a pair, else the joint itself.
fn left(id: usize) -> usize {
    if matches!(id, 2 | 5 | 8 | 11 | 14 | 17 | 19 | 21 | 23) { id - 1 } else { id }
}

/// Draws from 0 to 1 (xorshift64*).
pub fn random(seed: u64) -> impl FnMut() -> f64 {
    let mut state = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    move || {
        state ^= state >> 12;
        state ^= state << 25;
        state ^= state >> 27;
        (state.wrapping_mul(0x2545_F491_4F6C_DD1D) >> 11) as f64 / (1u64 << 53) as f64
    }
}
