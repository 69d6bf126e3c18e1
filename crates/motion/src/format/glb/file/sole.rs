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
    let saved = tree.world(None);
    // (V) joint, and place in its frame at rest, as the world's axes are
    let mut vertices: Vec<(usize, Vec3)> = Vec::new();
    for node in &document.json.nodes {
        let skinned = node.mesh.zip(node.skin);
        let Some((mesh, skin)) =
            skinned.and_then(|(mesh, skin)| Some((document.json.meshes.get(mesh)?, document.json.skins.get(skin)?)))
        else {
            continue;
        };
        let Some(bound) = bind_matrices(document, skin.inverse_bind_matrices, skin.joints.len()) else { continue };
        for (of_skin, place) in mesh.primitives.iter().filter_map(|p| held(document, p)).flatten() {
            let Some((&node, bind)) = skin.joints.get(of_skin).zip(bound.get(of_skin)) else { continue };
            let Some(joint) = joints.iter().position(|&j| j == node) else { continue };
            let (turn, _) = split(&saved[node]);
            let from_joint = saved[node].matrix3 * bind.transform_point3(place);
            vertices.push((joint, figure.rest[joint].0 * (turn.inverse() * from_joint)));
        }
    }
    let Some((&first, rest)) = joints.first().zip(figure.rest.first()) else { return Vec::new() };
    // the bind pose may have other axes than the world
    let up = axis(rest.0 * split(&saved[first]).0.inverse() * Vec3::Y);
    let height = |&(joint, from): &(usize, Vec3)| up.dot(figure.rest[joint].1 + from);
    let (low, high) = vertices.iter().map(height).fold((f64::MAX, f64::MIN), |(a, b), y| (a.min(y), b.max(y)));
    let near = |share: f64, y: f64| y + share * (high - low);
    let mut ends = Vec::new();
    for parent in 0..joints.len() {
        let own: Vec<Vec3> = vertices.iter().filter(|v| v.0 == parent).map(|v| v.1).collect();
        let Some(lowest) = own.iter().copied().min_by(|a, b| up.dot(*a).total_cmp(&up.dot(*b))) else { continue };
        if height(&(parent, lowest)) > near(SOLE, low) {
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

/// The inverse bind matrices of a skin's joints; the identity where it states none (section 5.28).
fn bind_matrices(document: &Document, accessor: Option<usize>, joints: usize) -> Option<Vec<DAffine3>> {
    let Some(accessor) = accessor else { return Some(vec![DAffine3::IDENTITY; joints]) };
    let numbers = document.numbers(accessor, 16).ok()?;
    let affine = |m: &[f64]| {
        let column = |c: usize| Vec3::new(m[4 * c], m[4 * c + 1], m[4 * c + 2]);
        DAffine3::from_cols(column(0), column(1), column(2), column(3))
    };
    Some(numbers.chunks_exact(16).map(affine).collect())
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
