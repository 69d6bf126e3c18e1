//! New files: each clip becomes a skeleton of nodes, a skinned body of capsules, and an animation with keys in every frame:
//! rotations, and positions of the root. Metres, y up. All clips of a file play together in one animation. Joints that never
//! rotate have no keys.

pub(super) mod buffer;
mod mesh;

use super::file::chunks::Chunks;
use crate::rotation::nearest_sign;
use crate::{Clip, Error, GlobalPose, Quat, Result, Vec3};
use buffer::{Buffer, Target, beyond};
use mesh::Mesh;
use serde_json::{Value, json};

/// What wrote a file.
pub(super) const GENERATOR: &str = concat!("kinelm ", env!("CARGO_PKG_VERSION"));

/// A name and a clip.
pub type Named<'a> = (&'a str, &'a Clip);

/// Colours of the bodies in turn: red, green, blue from 0 to 1.
const COLOURS: [[f64; 3]; 4] = [[0.13, 0.24, 0.47], [0.06, 0.37, 0.29], [0.56, 0.20, 0.08], [0.33, 0.16, 0.43]];

/// A GLB under construction.
#[derive(Default)]
struct Scene {
    buffer: Buffer,
    nodes: Vec<Value>,
    /// Nodes without a parent.
    roots: Vec<usize>,
    meshes: Vec<Value>,
    skins: Vec<Value>,
    materials: Vec<Value>,
    samplers: Vec<Value>,
    channels: Vec<Value>,
}

/// The bytes of a GLB with these clips.
///
/// # Errors
/// [`Unsupported`](kinelm_store::Error::Unsupported) without clips, for a clip without frames, more than 65,535 joints, and
/// numbers beyond single precision.
pub fn to_bytes(clips: &[Named]) -> Result<Vec<u8>> {
    if clips.is_empty() {
        return Err(Error::unsupported("a GLB", "no clips; it needs at least one"));
    }
    let mut scene = Scene::default();
    for (i, (name, clip)) in clips.iter().enumerate() {
        if clip.frames() == 0 || clip.joints() > usize::from(u16::MAX) {
            let (frames, joints) = (clip.frames(), clip.joints());
            let why = format!("{frames} frames of {joints} joints; a GLB needs a frame and takes 65,535 joints");
            return Err(Error::unsupported(name.to_string(), why));
        }
        scene.add(name, clip, COLOURS[i % COLOURS.len()])?;
    }
    let Scene { buffer, nodes, roots, meshes, skins, materials, samplers, channels } = scene;
    let mut document = json!({
        "asset": {"version": "2.0", "generator": GENERATOR},
        "scene": 0, "scenes": [{"nodes": roots}], "nodes": nodes,
    });
    // glTF forbids empty lists
    for (key, list) in [("meshes", meshes), ("skins", skins), ("materials", materials)] {
        if !list.is_empty() {
            document[key] = list.into();
        }
    }
    if !channels.is_empty() {
        document["animations"] = json!([{"name": "dance", "samplers": samplers, "channels": channels}]);
    }
    let (views, accessors, binary) = buffer.parts("the body")?;
    document["buffers"] = json!([{"byteLength": binary.len()}]);
    document["bufferViews"] = views.into();
    document["accessors"] = accessors.into();
    Chunks { json: document.to_string().as_bytes(), binary: Some(&binary), others: Vec::new() }.bytes("the body")
}

impl Scene {
    fn add(&mut self, name: &str, clip: &Clip, colour: [f64; 3]) -> Result<()> {
        let too_far = |p: &Vec3| !p.as_vec3().is_finite();
        if let Some(frame) = clip.root().iter().position(too_far) {
            return Err(beyond(format!("{name}: the root in frame {frame}")));
        }
        if let Some(joint) = clip.skeleton().offsets().iter().position(too_far) {
            return Err(beyond(format!("{name}: {}", clip.skeleton().names()[joint])));
        }
        // a parent node of the joints, from which programs make one armature per clip
        let around = self.nodes.len();
        let first = around + 1;
        self.nodes.push(json!({"name": name, "children": [first]}));
        let times: Vec<f32> = (0..clip.frames()).map(|f| (f as f64 / clip.fps()) as f32).collect();
        let input = self.buffer.floats(&times, ("SCALAR", 1), Target::None, true);
        let skeleton = clip.skeleton();
        for joint in 0..clip.joints() {
            let turns = turns(clip, joint);
            let at = if joint == 0 { clip.root()[0] } else { skeleton.offsets()[joint] };
            let mut node =
                json!({"name": skeleton.names()[joint], "translation": place(at), "rotation": quat(turns[0])});
            let children: Vec<usize> = skeleton.children(joint).map(|child| first + child).collect();
            if !children.is_empty() {
                node["children"] = children.into();
            }
            self.nodes.push(node);
            if turns.iter().any(|turn| *turn != turns[0]) {
                let numbers: Vec<f32> = turns.iter().flat_map(|q| quat(*q)).collect();
                self.animate(input, &numbers, ("VEC4", 4), first + joint, "rotation");
            }
        }
        if clip.root().iter().any(|p| *p != clip.root()[0]) {
            let numbers: Vec<f32> = clip.root().iter().flat_map(|p| place(*p)).collect();
            self.animate(input, &numbers, ("VEC3", 3), first, "translation");
        }
        self.roots.push(around);
        self.add_body(name, clip, first, colour)
    }

    fn animate(&mut self, input: usize, numbers: &[f32], kind: (&str, usize), node: usize, path: &str) {
        let output = self.buffer.floats(numbers, kind, Target::None, false);
        self.channels.push(json!({"sampler": self.samplers.len(), "target": {"node": node, "path": path}}));
        self.samplers.push(json!({"input": input, "output": output, "interpolation": "LINEAR"}));
    }

    /// Adds the skin and its mesh.
    fn add_body(&mut self, name: &str, clip: &Clip, first: usize, colour: [f64; 3]) -> Result<()> {
        let (skeleton, joints) = (clip.skeleton(), clip.joints());
        let rest = GlobalPose::new(skeleton, Vec3::ZERO, &vec![Quat::IDENTITY; joints]);
        let matrices: Vec<f32> = rest.positions.iter().flat_map(|p| moved_by(-*p)).collect();
        let matrices = self.buffer.floats(&matrices, ("MAT4", 16), Target::None, false);
        let nodes: Vec<usize> = (first..first + joints).collect();
        let mesh = Mesh::of(skeleton)?;
        if mesh.positions.is_empty() {
            return Ok(()); // a single point
        }
        self.skins.push(json!({"name": name, "inverseBindMatrices": matrices, "joints": nodes, "skeleton": first - 1}));
        let vectors = |of: &[Vec3]| -> Vec<f32> { of.iter().flat_map(|p| place(*p)).collect() };
        let positions = self.buffer.floats(&vectors(&mesh.positions), ("VEC3", 3), Target::Vertices, true);
        let normals = self.buffer.floats(&vectors(&mesh.normals), ("VEC3", 3), Target::Vertices, false);
        let turned_by: Vec<[u16; 4]> = mesh.joints.iter().map(|&joint| [joint as u16, 0, 0, 0]).collect();
        let turned_by = self.buffer.joints(&turned_by);
        let weights: Vec<f32> = mesh.joints.iter().flat_map(|_| [1.0, 0.0, 0.0, 0.0]).collect();
        let weights = self.buffer.floats(&weights, ("VEC4", 4), Target::Vertices, false);
        let corners = self.buffer.corners(&mesh.corners);
        let [r, g, b] = colour;
        self.materials.push(json!({"name": name, "pbrMetallicRoughness":
            {"baseColorFactor": [r, g, b, 1.0], "metallicFactor": 0.0, "roughnessFactor": 0.7}}));
        let attributes = json!({"POSITION": positions, "NORMAL": normals, "JOINTS_0": turned_by, "WEIGHTS_0": weights});
        let material = self.materials.len() - 1;
        let primitive = json!({"attributes": attributes, "indices": corners, "material": material});
        self.meshes.push(json!({"name": name, "primitives": [primitive]}));
        self.roots.push(self.nodes.len());
        self.nodes
            .push(json!({"name": format!("{name} body"), "mesh": self.meshes.len() - 1, "skin": self.skins.len() - 1}));
        Ok(())
    }
}

/// The rotations of a joint (F), with signs such that interpolation takes the shorter arc.
fn turns(clip: &Clip, joint: usize) -> Vec<Quat> {
    // a linear sampler takes the keys as they are; q after -q would go the long way round
    let mut before = Quat::IDENTITY;
    let next = |f: usize| {
        before = nearest_sign(clip.pose(f)[joint], before);
        before
    };
    (0..clip.frames()).map(next).collect()
}

/// x, y, z, w.
fn quat(q: Quat) -> [f32; 4] {
    [q.x, q.y, q.z, q.w].map(|x| x as f32)
}

fn place(p: Vec3) -> [f32; 3] {
    p.to_array().map(|x| x as f32)
}

/// A translation matrix, column by column.
fn moved_by(p: Vec3) -> [f32; 16] {
    let [x, y, z] = place(p);
    [1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 0.0, 1.0, 0.0, x, y, z, 1.0]
}

#[cfg(test)]
mod tests;
