//! GLB and VRM (binary glTF 2.0), read: the joints of the largest figure and the longest animation that moves it.
//!
//! Source: Khronos Group, glTF 2.0 Specification (2021), sections 3.5, 3.7.3, 3.11. Metres, y up. A file states no rate: it
//! is that of its keys, if they are evenly spaced.

mod document;
mod rate;
mod track;

use crate::format::figure::{Chosen, Nodes, choose_take};
use crate::format::posed::{Figure, MOST_PLACED, Placed, Posed, placed, unique};
use crate::format::{Axes, ReadOptions, Up};
use crate::{FaultKind, FileError, Motion, Quat, Result, Source, Vec3, Warning};
use document::Document;
use glam::DAffine3;
use kinelm_store::SourcePos;
use rate::Frames;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use track::{Between, Track, quat};

/// The unit of glTF.
const UNIT_M: f64 = 1.0;
/// The rate of animations whose keys have none.
const FPS: f64 = 30.0;
/// Most nodes, their deepest nesting, and most joints.
const MOST_NODES: usize = 65_536;
const DEEPEST: usize = 512;
const MOST_JOINTS: usize = 4096;

/// Reads the figure with the most joints, or what `root` of the options names.
///
/// # Errors
/// [`FaultKind::NotThisFormat`] for a file that is no GLB of version 2, is damaged, is compressed, or has no figure;
/// [`FaultKind::NotFinite`], [`FaultKind::TooLarge`].
pub fn read(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Motion> {
    let document = Document::parse(path, bytes)?;
    let tree = Tree::new(&document)?;
    let mut warnings = Vec::new();
    let Chosen { nodes: joints, root } = tree.figure(options.root.as_deref(), &mut warnings)?;
    let figure = tree.at_rest(&joints)?;
    let of_figure: BTreeSet<usize> = joints.iter().flat_map(|&joint| tree.upwards(joint)).collect();
    let take = take(&document, &of_figure, options.take.as_deref(), &mut warnings)?;
    let Frames { step_fps, fps, count } = match &take {
        None => {
            warnings.push(Warning { kind: "no_animation", what: "no animation: its pose is read as one frame".into() });
            Frames { step_fps: FPS, fps: options.fps_source.unwrap_or(FPS), count: 1.0 }
        }
        Some(take) => Frames::of(take, options, &mut warnings),
    };
    if !(1.0..=MOST_PLACED).contains(&(count * joints.len() as f64)) {
        let found = format!("{count} frames of {} joints", joints.len());
        return Err(FileError::new(SourcePos::file(path), FaultKind::TooLarge, found, "134,217,728 rotations").into());
    }
    let frames = (0..count as usize).map(|f| {
        let world = tree.world(take.as_ref().map(|take| (take, take.begin + f as f64 / step_fps)));
        Ok(joints.iter().map(|&node| split(&world[node])).collect())
    });
    let root = root.and_then(|node| joints.iter().position(|&j| j == node));
    let Posed { clip, found, warnings: more } = figure.clip(root, fps, options, UNIT_M, frames)?;
    warnings.extend(more);
    let (axes, doubt) = Axes::of_format(&clip, Up::Y, options, found.as_ref());
    warnings.extend(doubt);
    Ok(Motion::read(path, axes.to_y_up(clip)?, Source::plain(axes), warnings, found))
}

/// The take of that name, else the longest that moves one of these nodes, else the longest; `None` without any.
fn take(
    document: &Document,
    nodes: &BTreeSet<usize>,
    name: Option<&str>,
    warnings: &mut Vec<Warning>,
) -> Result<Option<Take>> {
    let animations = &document.json.animations;
    let read = |n: usize| Take::new(document, n, nodes);
    let mut takes: Vec<Take> = (0..animations.len()).map(read).collect::<Result<_>>()?;
    let names: Vec<String> =
        animations.iter().enumerate().map(|(n, a)| a.name.clone().unwrap_or_else(|| n.to_string())).collect();
    let chosen = choose_take(&names, name, |n| (takes[n].moves(), takes[n].length()), warnings);
    let chosen = chosen.map_err(|(found, expected)| document.fault(found, &expected))?;
    Ok(chosen.map(|n| takes.swap_remove(n)))
}

fn split(m: &DAffine3) -> Placed {
    placed([m.matrix3.x_axis, m.matrix3.y_axis, m.matrix3.z_axis], m.translation)
}

/// The nodes of a document as a forest.
struct Tree<'a> {
    document: &'a Document<'a>,
    parents: Vec<Option<usize>>,
    /// Nodes, parents before children.
    order: Vec<usize>,
}

impl<'a> Tree<'a> {
    fn new(document: &'a Document<'a>) -> Result<Self> {
        let nodes = &document.json.nodes;
        let n = nodes.len();
        if n > MOST_NODES {
            return Err(document.fault(format!("{n} nodes"), "65,536 at most"));
        }
        let mut parents = vec![None; n];
        for (parent, node) in nodes.iter().enumerate() {
            for &child in &node.children {
                match parents.get_mut(child) {
                    Some(free @ None) if child != parent => *free = Some(parent),
                    _ => return Err(document.fault(format!("node {child} below node {parent}"), "one parent a node")),
                }
            }
        }
        let mut order: Vec<usize> = Vec::with_capacity(n);
        let mut next: Vec<(usize, usize)> = (0..n).rev().filter(|&i| parents[i].is_none()).map(|i| (i, 0)).collect();
        while let Some((node, depth)) = next.pop() {
            if depth > DEEPEST {
                return Err(document.fault(format!("node {node}, more than {DEEPEST} deep"), "512 levels at most"));
            }
            order.push(node);
            next.extend(nodes[node].children.iter().rev().map(|&c| (c, depth + 1)));
        }
        // what a circle of nodes holds is reached from no root
        if order.len() < n {
            return Err(document.fault("nodes in a circle".into(), "trees of nodes"));
        }
        Ok(Tree { document, parents, order })
    }

    fn upwards(&self, node: usize) -> impl Iterator<Item = usize> + '_ {
        std::iter::successors(Some(node), |&n| self.parents[n])
    }

    fn name(&self, node: usize) -> String {
        self.document.json.nodes[node].name.clone().filter(|n| !n.is_empty()).unwrap_or_else(|| format!("node{node}"))
    }

    /// The figure to read: of the joints of all skins, else of what an animation moves.
    fn figure(&self, root: Option<&str>, warnings: &mut Vec<Warning>) -> Result<Chosen> {
        let nodes = Nodes {
            names: (0..self.parents.len()).map(|n| self.name(n)).collect(),
            parents: self.parents.clone(),
            joints: self.joints()?,
        };
        let chosen = nodes.choose(root, warnings);
        let chosen = chosen.map_err(|(found, expected)| self.document.fault(found, &expected))?;
        if chosen.nodes.len() > MOST_JOINTS {
            let found = format!("{} joints", chosen.nodes.len());
            return Err(self.document.fault(found, "4,096 at most"));
        }
        Ok(chosen)
    }

    /// Which nodes are joints: those of the skins; without skins the nodes that an animation moves, and all nodes below
    /// their common ancestor that are no mesh or camera, since a joint may never rotate.
    fn joints(&self) -> Result<Vec<bool>> {
        let json = &self.document.json;
        let mut joints = vec![false; json.nodes.len()];
        let mut mark = |node: usize| match joints.get_mut(node) {
            Some(joint) => {
                *joint = true;
                Ok(())
            }
            None => Err(self.document.fault(format!("a joint at node {node}"), "a node of the file")),
        };
        if json.skins.iter().any(|skin| !skin.joints.is_empty()) {
            json.skins.iter().flat_map(|skin| &skin.joints).try_for_each(|&node| mark(node))?;
            return Ok(joints);
        }
        let channels = json.animations.iter().flat_map(|a| &a.channels);
        let moving = channels.filter(|c| matches!(c.target.path.as_str(), "rotation" | "translation"));
        moving.filter_map(|c| c.target.node).try_for_each(&mut mark)?;
        // how many moving nodes are in and below each node, and in its whole tree
        let mut below: Vec<usize> = joints.iter().map(|&moves| usize::from(moves)).collect();
        for &n in self.order.iter().rev() {
            if let Some(p) = self.parents[n] {
                below[p] += below[n];
            }
        }
        let mut whole = below.clone();
        for &n in &self.order {
            if let Some(p) = self.parents[n] {
                whole[n] = whole[p];
            }
        }
        // a node is under the common ancestor of its tree's moving nodes, or under one that moves
        let mut under = vec![false; joints.len()];
        for &n in &self.order {
            let Some(p) = self.parents[n] else { continue };
            let shared = below[p] > 0 && below[p] == whole[p] && below[n] < whole[p];
            under[n] = under[p] || joints[p] || shared;
            let node = &json.nodes[n];
            joints[n] |= under[n] && node.mesh.is_none() && node.camera.is_none();
        }
        Ok(joints)
    }

    /// The figure in its bind pose, if every joint has one, else as its nodes stand.
    fn at_rest(&self, joints: &[usize]) -> Result<Figure> {
        let mut names: Vec<String> = Vec::with_capacity(joints.len());
        for &node in joints {
            names.push(unique(&self.name(node), &names));
        }
        let place = |node: usize| joints.iter().position(|&j| j == node);
        let parents: Vec<Option<usize>> = joints.iter().map(|&node| self.parents[node].and_then(place)).collect();
        let world = self.world(None);
        let stand: Vec<Placed> = joints.iter().map(|&node| split(&world[node])).collect();
        let mut bound: Vec<Option<Placed>> = vec![None; joints.len()];
        for skin in &self.document.json.skins {
            let Some(matrices) = skin.inverse_bind_matrices else { continue };
            let numbers = self.document.numbers(matrices, 16)?;
            for (&node, m) in skin.joints.iter().zip(numbers.chunks_exact(16)) {
                let Some(j) = place(node).filter(|&j| bound[j].is_none()) else { continue };
                let column = |c: usize| Vec3::new(m[4 * c], m[4 * c + 1], m[4 * c + 2]);
                let inverse = DAffine3::from_cols(column(0), column(1), column(2), column(3));
                // a singular matrix has no bind pose to give
                if inverse.matrix3.determinant().abs() > 1e-12 {
                    bound[j] = Some(split(&inverse.inverse()));
                }
            }
        }
        let rest = match bound.into_iter().collect::<Option<Vec<Placed>>>() {
            Some(bound) => scaled_as(&parents, bound, &stand),
            None => stand,
        };
        Ok(Figure { names, parents, rest })
    }

    /// Where all nodes stand, as the file was saved or at a time of a take.
    fn world(&self, take: Option<(&Take, f64)>) -> Vec<DAffine3> {
        let mut world = vec![DAffine3::IDENTITY; self.parents.len()];
        for &n in &self.order {
            let node = &self.document.json.nodes[n];
            let local = match (node.matrix, take.map(|(take, time)| (take.of(n), time))) {
                // an animated node must not have a matrix: where a file has both, its tracks win
                (Some(m), None | Some((None, _))) => DAffine3::from_mat4(glam::DMat4::from_cols_array(&m)),
                (_, moved) => {
                    let at = |path: usize| moved.and_then(|(tracks, time)| Some((tracks?[path].as_ref()?, time)));
                    let place =
                        at(0).map_or(Vec3::from_array(node.translation.unwrap_or_default()), |(t, s)| t.vector(s));
                    let own = || node.rotation.map_or(Quat::IDENTITY, |q| quat(&q));
                    let turn = at(1).map_or_else(own, |(t, s)| t.rotation(s));
                    let scale = at(2).map_or(Vec3::from_array(node.scale.unwrap_or([1.0; 3])), |(t, s)| t.vector(s));
                    DAffine3::from_scale_rotation_translation(scale, turn, place)
                }
            };
            world[n] = self.parents[n].map_or(local, |p| world[p] * local);
        }
        world
    }
}

/// A bind pose with its bones as long as where the figure stands: some programs bind in centimetres below a scaled node.
fn scaled_as(parents: &[Option<usize>], bound: Vec<Placed>, stand: &[Placed]) -> Vec<Placed> {
    let length = |pose: &[Placed]| -> f64 {
        let bones = parents.iter().enumerate().filter_map(|(j, p)| Some((pose[j].1 - pose[(*p)?].1).length()));
        bones.sum()
    };
    let factor = length(stand) / length(&bound);
    // a bind pose may differ a little from the standing one in its bones; a unit differs by far more
    let factor = if factor.is_finite() && !(0.8..1.25).contains(&factor) { factor } else { 1.0 };
    bound.into_iter().map(|(q, place)| (q, place * factor)).collect()
}

/// Tracks of a node: translation, rotation, scale.
type Tracks = [Option<Track>; 3];

/// An animation.
struct Take {
    tracks: BTreeMap<usize, Tracks>,
    begin: f64,
    end: f64,
}

impl Take {
    /// The animation's tracks of these nodes.
    fn new(document: &Document, n: usize, nodes: &BTreeSet<usize>) -> Result<Take> {
        let animation = &document.json.animations[n];
        let mut take = Take { tracks: BTreeMap::new(), begin: f64::INFINITY, end: f64::NEG_INFINITY };
        for channel in &animation.channels {
            let (path, width) = match channel.target.path.as_str() {
                "translation" => (0, 3),
                "rotation" => (1, 4),
                "scale" => (2, 3),
                _ => continue,
            };
            let Some(node) = channel.target.node.filter(|node| nodes.contains(node)) else { continue };
            let track = Take::track(document, animation, channel.sampler, width)?;
            take.begin = take.begin.min(track.times[0]);
            take.end = take.end.max(track.times[track.times.len() - 1]);
            take.tracks.entry(node).or_default()[path] = Some(track);
        }
        if take.tracks.is_empty() {
            (take.begin, take.end) = (0.0, 0.0);
        }
        Ok(take)
    }

    fn track(document: &Document, animation: &document::Animation, sampler: usize, width: usize) -> Result<Track> {
        let bad = |found: &str, expected: &str| document.fault(format!("sampler {sampler}: {found}"), expected);
        let sampler = animation.samplers.get(sampler).ok_or_else(|| bad("not there", "a sampler"))?;
        let between = match sampler.interpolation.as_deref() {
            None | Some("LINEAR") => Between::Linear,
            Some("STEP") => Between::Step,
            Some("CUBICSPLINE") => Between::Cubic,
            Some(other) => return Err(bad(other, "LINEAR, STEP or CUBICSPLINE")),
        };
        let times = document.numbers(sampler.input, 1)?;
        let values = document.numbers(sampler.output, width)?;
        let each = if between == Between::Cubic { 3 * width } else { width };
        if times.is_empty() || values.len() != times.len() * each {
            return Err(bad(&format!("{} times, {} numbers", times.len(), values.len()), &format!("{each} a time")));
        }
        if !times.is_sorted() {
            return Err(bad("times that go back", "ascending ones"));
        }
        Ok(Track { times, values, width, between })
    }

    /// Whether a track changes anything.
    fn moves(&self) -> bool {
        self.tracks.values().flatten().flatten().any(|track| !track.is_still())
    }

    fn of(&self, node: usize) -> Option<&Tracks> {
        self.tracks.get(&node)
    }

    fn length(&self) -> f64 {
        self.end - self.begin
    }
}

#[cfg(test)]
mod tests;
