//! Where a mesh touches the floor: the soles of a character's feet, which no joint marks.

use super::document::{Document, Primitive};
use super::tree::{Tree, split};
use crate::format::posed::Figure;
use crate::{EndSite, Vec3};
use glam::DAffine3;

/// What is this near above a mesh's lowest point is a sole, as a fraction of the mesh's height: the arch of a foot too.
const SOLE: f64 = 0.03;
/// What is this near above the lowest point of one part of a sole is its edge, the same.
const EDGE: f64 = 0.006;

/// The end sites of a figure's soles: of each joint that moves lowest vertices of the mesh as it is at rest, the lowest and, of
/// those that are nearly as low, the one farthest from it. None where no mesh can be read: compressed, or in another file.
pub fn soles(document: &Document, tree: &Tree, (figure, joints): (&Figure, &[usize])) -> Vec<EndSite> {
    let Some((&first, rest)) = joints.first().zip(figure.rest.first()) else { return Vec::new() };
    let saved = tree.world(None);
    // by joint (J): the places (V) of what it moves in its frame at rest, as the world's axes are
    let mut moved: Vec<Vec<Vec3>> = vec![Vec::new(); joints.len()];
    for node in &document.json.nodes {
        let skinned = node.mesh.zip(node.skin);
        let Some((mesh, skin)) =
            skinned.and_then(|(mesh, skin)| Some((document.json.meshes.get(mesh)?, document.json.skins.get(skin)?)))
        else {
            continue;
        };
        let Ok(bound) = tree.inverse_binds(skin) else { continue };
        // a skin without matrices is bound as it is (section 5.28)
        let bound = bound.unwrap_or_else(|| vec![DAffine3::IDENTITY; skin.joints.len()]);
        let frame = |(&node, bind): (&usize, DAffine3)| {
            let joint = joints.iter().position(|&j| j == node)?;
            Some((joint, bind, saved[node].matrix3, split(&saved[node]).0.inverse()))
        };
        let frames: Vec<_> = skin.joints.iter().zip(bound).map(frame).collect();
        for (of_skin, place) in mesh.primitives.iter().filter_map(|p| held(document, p)).flatten() {
            let Some(Some((joint, bind, stretch, back))) = frames.get(of_skin) else { continue };
            let from_joint = *stretch * bind.transform_point3(place);
            moved[*joint].push(figure.rest[*joint].0 * (*back * from_joint));
        }
    }
    // the bind pose may have other axes than the world
    let up = axis(rest.0 * split(&saved[first]).0.inverse() * Vec3::Y);
    let height = |joint: usize, from: &Vec3| up.dot(figure.rest[joint].1 + *from);
    let heights = moved.iter().enumerate().flat_map(|(joint, own)| own.iter().map(move |from| (joint, from)));
    let heights = heights.map(|(joint, from)| height(joint, from));
    let (low, high) = heights.fold((f64::MAX, f64::MIN), |(a, b), y| (a.min(y), b.max(y)));
    let near = |share: f64, y: f64| y + share * (high - low);
    let mut ends = Vec::new();
    for (parent, own) in moved.iter().enumerate() {
        let Some(lowest) = own.iter().copied().min_by(|a, b| up.dot(*a).total_cmp(&up.dot(*b))) else { continue };
        if height(parent, &lowest) > near(SOLE, low) {
            continue;
        }
        let reach = |p: &Vec3| p.reject_from_normalized(up).length();
        let edge = own.iter().copied().filter(|p| up.dot(*p) <= near(EDGE, up.dot(lowest)));
        let farthest = edge.max_by(|a, b| reach(a).total_cmp(&reach(b))).filter(|p| *p != lowest);
        ends.extend(std::iter::once(lowest).chain(farthest).map(|offset| EndSite { parent, offset }));
    }
    ends
}

/// The axis that is nearest to a direction.
fn axis(direction: Vec3) -> Vec3 {
    let largest = (0..3).max_by(|&a, &b| direction[a].abs().total_cmp(&direction[b].abs())).unwrap_or(1);
    Vec3::AXES[largest] * direction[largest].signum()
}

/// The vertices of a part of a mesh: each with the joint of its skin that moves it most, and its place.
fn held(document: &Document, primitive: &Primitive) -> Option<Vec<(usize, Vec3)>> {
    if primitive.is_compressed() {
        return None;
    }
    let of = |name: &str, width: usize| document.stored(*primitive.attributes.get(name)?, width).ok();
    let (places, moved_by) = (of("POSITION", 3)?, of("JOINTS_0", 4)?);
    let weights = document.numbers(*primitive.attributes.get("WEIGHTS_0")?, 4).ok()?;
    let vertices = places.chunks_exact(3).zip(moved_by.chunks_exact(4)).zip(weights.chunks_exact(4));
    let vertex = |((place, joints), weights): ((&[f64], &[f64]), &[f64])| {
        // the first of equals
        let most = (0..4).rev().max_by(|&a, &b| weights[a].total_cmp(&weights[b])).unwrap_or(0);
        (joints[most] as usize, Vec3::from_slice(place))
    };
    Some(vertices.map(vertex).collect())
}
