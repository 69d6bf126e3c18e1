//! The nodes of a document as a forest: which are a figure's, and where they stand.

use super::document::{Document, Skin};
use super::take::Take;
use super::track::quat;
use crate::format::figure::{Chosen, Nodes};
use crate::format::posed::{Figure, Placed, placed, unique};
use crate::{Error, Quat, Result, Vec3, Warning};
use glam::{DAffine3, DMat3};
use std::collections::BTreeSet;

/// Most nodes, their deepest nesting, and most joints.
const MOST_NODES: usize = 65_536;
const DEEPEST: usize = 512;
const MOST_JOINTS: usize = 4096;
/// Scales and slants below this fraction are rounding.
const UNEVEN: f64 = 0.005;

/// A fault of a skin's matrices, said to be one.
fn of_bind(e: Error) -> Error {
    match e {
        Error::File(mut e) => {
            e.found = format!("{}, the bind matrices of a skin", e.found);
            Error::File(e)
        }
        e => e,
    }
}

pub fn split(m: &DAffine3) -> Placed {
    placed([m.matrix3.x_axis, m.matrix3.y_axis, m.matrix3.z_axis], m.translation)
}

/// The nodes of a document as a forest.
pub struct Tree<'a> {
    document: &'a Document<'a>,
    /// The node above each.
    pub parents: Vec<Option<usize>>,
    /// Nodes, parents before children.
    order: Vec<usize>,
}

impl<'a> Tree<'a> {
    pub fn new(document: &'a Document<'a>) -> Result<Self> {
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

    pub fn upwards(&self, node: usize) -> impl Iterator<Item = usize> + '_ {
        std::iter::successors(Some(node), |&n| self.parents[n])
    }

    fn name(&self, node: usize) -> String {
        self.document.json.nodes[node].name.clone().filter(|n| !n.is_empty()).unwrap_or_else(|| format!("node{node}"))
    }

    /// The figure to read: of these bones, where there are any, else of the joints of all skins, else of what an animation
    /// moves.
    pub fn figure(&self, bones: &[usize], root: Option<&str>, warnings: &mut Vec<Warning>) -> Result<Chosen> {
        let nodes = Nodes {
            names: (0..self.parents.len()).map(|n| self.name(n)).collect(),
            parents: self.parents.clone(),
            joints: if bones.is_empty() { self.joints()? } else { self.only(bones) },
        };
        let chosen = nodes.choose(root, warnings);
        let chosen = chosen.map_err(|(found, expected)| self.document.fault(found, &expected))?;
        if chosen.nodes.len() > MOST_JOINTS {
            let found = format!("{} joints", chosen.nodes.len());
            return Err(self.document.fault(found, "4,096 at most"));
        }
        Ok(chosen)
    }

    /// Which nodes are these.
    fn only(&self, nodes: &[usize]) -> Vec<bool> {
        (0..self.parents.len()).map(|n| nodes.contains(&n)).collect()
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

    /// The inverse bind matrices of a skin; `None` where it states none.
    pub fn inverse_binds(&self, skin: &Skin) -> Result<Option<Vec<DAffine3>>> {
        let Some(matrices) = skin.inverse_bind_matrices else { return Ok(None) };
        let numbers = self.document.numbers(matrices, 16).map_err(of_bind)?;
        let affine = |m: &[f64]| {
            let column = |c: usize| Vec3::new(m[4 * c], m[4 * c + 1], m[4 * c + 2]);
            DAffine3::from_cols(column(0), column(1), column(2), column(3))
        };
        Ok(Some(numbers.chunks_exact(16).map(affine).collect()))
    }

    /// The figure in its bind pose, if every joint has one, else as its nodes stand.
    pub fn at_rest(&self, joints: &[usize]) -> Result<Figure> {
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
            for (&node, inverse) in skin.joints.iter().zip(self.inverse_binds(skin)?.into_iter().flatten()) {
                let Some(j) = place(node).filter(|&j| bound[j].is_none()) else { continue };
                // a singular matrix has no bind pose to give
                if inverse.matrix3.determinant().abs() > 1e-12 {
                    bound[j] = Some(split(&inverse.inverse()));
                }
            }
        }
        let rest = match bound.into_iter().collect::<Option<Vec<Placed>>>() {
            Some(bound) => as_long_as(&parents, bound, &stand),
            None => stand,
        };
        Ok(Figure { names, parents, rest, roles: None, ends: Vec::new() })
    }

    /// A node's scale, rotation and place in the frame of the node above, as the file was saved.
    pub fn own(&self, node: usize) -> (Vec3, Quat, Vec3) {
        let node = &self.document.json.nodes[node];
        match node.matrix {
            Some(m) => DAffine3::from_mat4(glam::DMat4::from_cols_array(&m)).to_scale_rotation_translation(),
            None => (
                Vec3::from_array(node.scale.unwrap_or([1.0; 3])),
                node.rotation.map_or(Quat::IDENTITY, |q| quat(&q)),
                Vec3::from_array(node.translation.unwrap_or_default()),
            ),
        }
    }

    /// Of what these joints hang from, a node whose frame in the world is scaled unevenly or sheared, as the file was saved; and
    /// its scale.
    pub fn uneven(&self, joints: &[usize]) -> Option<(String, Vec3)> {
        let world = self.world(None);
        let above: BTreeSet<usize> = joints.iter().flat_map(|&joint| self.upwards(joint).skip(1)).collect();
        let is_even = |m: &DMat3| {
            let [x, y, z] = [m.x_axis, m.y_axis, m.z_axis];
            let (least, most) =
                (x.length().min(y.length()).min(z.length()), x.length().max(y.length()).max(z.length()));
            let slant = x.dot(y).abs().max(y.dot(z).abs()).max(z.dot(x).abs());
            most - least <= UNEVEN * most && slant <= UNEVEN * most * most
        };
        let uneven = above.into_iter().find(|&node| !is_even(&world[node].matrix3))?;
        Some((self.name(uneven), self.own(uneven).0))
    }

    /// Where all nodes stand, as the file was saved or at a time of a take.
    pub fn world(&self, take: Option<(&Take, f64)>) -> Vec<DAffine3> {
        let mut world = vec![DAffine3::IDENTITY; self.parents.len()];
        for &n in &self.order {
            let node = &self.document.json.nodes[n];
            let local = match (node.matrix, take.map(|(take, time)| (take.of(n), time))) {
                // an animated node must not have a matrix: where a file has both, its tracks win
                (Some(m), None | Some((None, _))) => DAffine3::from_mat4(glam::DMat4::from_cols_array(&m)),
                (_, moved) => {
                    let at = |path: usize| moved.and_then(|(tracks, time)| Some((tracks?[path].as_ref()?, time)));
                    let (scale, turn, place) = self.own(n);
                    let place = at(0).map_or(place, |(track, s)| track.vector(s));
                    let turn = at(1).map_or(turn, |(track, s)| track.rotation(s));
                    let scale = at(2).map_or(scale, |(track, s)| track.vector(s));
                    DAffine3::from_scale_rotation_translation(scale, turn, place)
                }
            };
            world[n] = self.parents[n].map_or(local, |p| world[p] * local);
        }
        world
    }
}

/// A bind pose with its bones as long as where the figure stands, where they have a length: that is how far apart an
/// animation's rotations leave the joints, while some programs bind in centimetres below a scaled node.
fn as_long_as(parents: &[Option<usize>], bound: Vec<Placed>, stand: &[Placed]) -> Vec<Placed> {
    let mut rest = bound.clone();
    for (j, parent) in parents.iter().enumerate() {
        let Some(p) = *parent else { continue };
        let (own, bone) = (bound[j].1 - bound[p].1, stand[j].1 - stand[p].1);
        // the bone as the joint above carries it
        let turned = bound[p].0 * (stand[p].0.inverse() * bone);
        rest[j].1 = rest[p].1 + if bone.length() > 0.0 { turned } else { own };
    }
    rest
}
