//! The default rig, for clips that come from no BVH.

use super::grammar::{MAX_DEPTH, MAX_JOINTS};
use super::print::hierarchy;
use crate::format::source::bvh::{BvhRig, BvhSource, Channel, Header, Node, NodeKind, Style};
use crate::format::{Axes, BvhPosition};
use crate::rig::MADE_UP_TIP;
use crate::rotation::Axis;
use crate::{Error, Result, Skeleton, Vec3};
use std::sync::Arc;

/// The unit of the default rig: centimetres, the most common one.
const METRES: f64 = 0.01;

impl BvhSource {
    /// A rig without frames for a skeleton: centimetres, the root with `Xposition Yposition Zposition Zrotation Xrotation
    /// Yrotation`, the others with `Zrotation Xrotation Yrotation`, an end site under every leaf.
    ///
    /// # Errors
    /// [`Limit`](kinelm_store::Error::Limit) when a BVH reader would refuse the number of joints or their nesting.
    pub fn for_skeleton(skeleton: &Arc<Skeleton>) -> Result<Self> {
        let (nodes, joints) = nodes(skeleton)?;
        let style = Style { line_end: "\n".into(), indent: "  ".into() };
        let mut before = hierarchy(&nodes, &style);
        before.extend_from_slice(b"MOTION\nFrames: ");
        let head = Header {
            width: nodes.iter().map(|n| n.channels.len()).sum(),
            nodes,
            declared: 0,
            frame_time: "1".into(),
            rows_at: 0,
            warnings: Vec::new(),
            pieces: [before, b"\nFrame Time: ".to_vec(), b"\n".to_vec()],
            style,
        };
        let rig = BvhRig {
            chain: vec![0],
            path: [0; 3],
            joints,
            skeleton: skeleton.clone(),
            unit_m: METRES,
            unit_judged: false,
            position: BvhPosition::Replace,
            stretch: Vec::new(),
            axes: Axes::OWN,
        };
        Ok(BvhSource { head, numbers: Vec::new(), frames: 0, read_fps: 1.0, rig, floor_m: None })
    }
}

/// The nodes of a skeleton in depth-first order, and the node of each joint.
fn nodes(skeleton: &Skeleton) -> Result<(Vec<Node>, Vec<usize>)> {
    if skeleton.joints() > MAX_JOINTS {
        let needs = format!("{} joints", skeleton.joints());
        return Err(Error::limit("a BVH of this skeleton", needs, MAX_JOINTS, ""));
    }
    let mut children = vec![Vec::new(); skeleton.joints()];
    // backwards, since `next` is popped from its end: siblings come out in the skeleton's order
    for (j, parent) in skeleton.parents().iter().enumerate().rev() {
        parent.iter().for_each(|&p| children[p].push(j));
    }
    let (mut nodes, mut joints, mut column) = (Vec::new(), vec![0; skeleton.joints()], 0);
    // a stack, not recursion: the depth is the caller's
    let mut next = vec![(0, None, 1)];
    while let Some((j, parent, depth)) = next.pop() {
        if depth >= MAX_DEPTH {
            let what = format!("joint {:?} of a BVH", skeleton.names()[j]);
            return Err(Error::limit(what, format!("{} levels", depth + 1), MAX_DEPTH, ""));
        }
        joints[j] = nodes.len();
        let node = joint(skeleton, j, parent, column);
        column += node.channels.len();
        nodes.push(node);
        for tip in tips(skeleton, j, children[j].is_empty()) {
            nodes.push(end_site(joints[j], tip, column));
        }
        next.extend(children[j].iter().map(|&c| (c, Some(joints[j]), depth + 1)));
    }
    Ok((nodes, joints))
}

fn joint(skeleton: &Skeleton, j: usize, parent: Option<usize>, column: usize) -> Node {
    let mut channels = [Axis::Z, Axis::X, Axis::Y].map(Channel::Rotation).to_vec();
    if j == 0 {
        channels.splice(0..0, [Axis::X, Axis::Y, Axis::Z].map(Channel::Position));
    }
    // the root's channels give its position; with an OFFSET of 0 that is right in both conventions
    let offset = if j == 0 { Vec3::ZERO } else { skeleton.offsets()[j] / METRES };
    let kind = if j == 0 { NodeKind::Root } else { NodeKind::Joint };
    let name = printable(&skeleton.names()[j], j);
    Node { kind, unique: name.clone(), name, parent, offset: offset.to_array(), channels, column, at: 0 }
}

fn end_site(parent: usize, tip: Vec3, column: usize) -> Node {
    Node {
        kind: NodeKind::End,
        name: String::new(),
        unique: String::new(),
        parent: Some(parent),
        offset: (tip / METRES).to_array(),
        channels: Vec::new(),
        column,
        at: 0,
    }
}

/// The end sites of a leaf; without any, a short tip that extends its bone. Below a joint with children, readers expect none.
fn tips(skeleton: &Skeleton, joint: usize, leaf: bool) -> Vec<Vec3> {
    let own: Vec<Vec3> = skeleton.ends().iter().filter(|e| e.parent == joint).map(|e| e.offset).collect();
    if !leaf {
        return Vec::new();
    }
    if !own.is_empty() {
        return own;
    }
    let bone = if joint == 0 { Vec3::ZERO } else { skeleton.offsets()[joint] };
    // a bone without length has no direction to extend
    vec![if bone.length() > 1e-6 { bone * MADE_UP_TIP } else { Vec3::new(0.0, 0.02, 0.0) }]
}

/// A name that a reader accepts: no opening brace, no line ends, no blanks around it.
fn printable(name: &str, joint: usize) -> String {
    let plain: String = name.chars().map(|c| if matches!(c, '{' | '\r' | '\n') { '_' } else { c }).collect();
    let plain = plain.trim_matches([' ', '\t']);
    if plain.is_empty() { format!("joint{joint}") } else { plain.to_owned() }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::{ReadOptions, Unit, Up, bvh};
    use crate::rotation::{angle_between, exp_map};
    use crate::{Clip, EndSite, Motion, Quat, smpl};
    use std::path::Path;

    fn plain(clip: Clip) -> Motion {
        Motion::new("x", clip)
    }

    #[test]
    fn a_clip_of_another_source_comes_back_joint_by_joint() {
        let f = 40;
        let root = (0..f).map(|i| Vec3::new(0.01 * i as f64, 0.97, -0.02 * i as f64)).collect();
        let turn = |i: usize, j: usize| {
            let t = 0.2 * i as f64 + j as f64;
            exp_map::from_vector(Vec3::new(t.sin(), (1.3 * t).cos(), 0.5 * t.sin()) * 1.5)
        };
        let rotations = (0..f).flat_map(|i| (0..24).map(move |j| turn(i, j))).collect();
        let clip = Clip::new(smpl::neutral(), 20.0, root, rotations).unwrap();
        let bytes = bvh::to_bytes(&plain(clip.clone())).unwrap();
        // the body tumbles, so the up axis can't be inferred
        let options = ReadOptions { up: Up::Y, ..Default::default() };
        let back = bvh::read(Path::new("x.bvh"), &bytes, &options).unwrap();
        assert!(back.warnings.is_empty(), "{:?}", back.warnings);
        assert_eq!((back.clip.fps(), back.clip.frames()), (20.0, f));
        let map: Vec<usize> = clip.skeleton().names().iter().map(|n| back.clip.skeleton().find(n).unwrap()).collect();
        for i in 0..f {
            let (a, b) = (clip.global_pose(i), back.clip.global_pose(i));
            for (j, &k) in map.iter().enumerate() {
                assert!(a.positions[j].distance(b.positions[k]) < 1e-6);
                assert!(angle_between(clip.pose(i)[j], back.clip.pose(i)[k]) < 1e-7);
            }
        }
        assert_eq!(bvh::to_bytes(&back).unwrap(), bytes);
        // every leaf of the neutral skeleton gets a tip that extends its bone
        assert_eq!(back.clip.skeleton().ends().len(), 5);
    }

    #[test]
    fn odd_names_and_bodies_are_written_so_that_they_are_read() {
        let names = ["a{b", " ", "c\nd", "e f"].map(String::from).to_vec();
        let parents = vec![None, Some(0), Some(0), Some(1)];
        let offsets = vec![Vec3::ONE, Vec3::Y, Vec3::ZERO, Vec3::X];
        let ends = vec![EndSite { parent: 0, offset: Vec3::Z }];
        let s = Arc::new(Skeleton::new(names, parents, offsets, ends).unwrap());
        let clip = Clip::new(s, 29.97, vec![Vec3::ONE], vec![Quat::IDENTITY; 4]).unwrap();
        let bytes = bvh::to_bytes(&plain(clip.clone())).unwrap();
        let options = ReadOptions { unit: Unit::CENTIMETRE, ..Default::default() };
        let back = bvh::read(Path::new("x.bvh"), &bytes, &options).unwrap();
        assert_eq!(back.clip.skeleton().names(), ["a_b", "joint1", "e f", "c_d"]);
        assert!((back.clip.fps() - 29.97).abs() < 1e-12);
        assert!(back.clip.root()[0].distance(Vec3::ONE) < 1e-8);
        assert_eq!(back.clip.skeleton().ends().len(), 2);
    }

    #[test]
    fn what_no_reader_takes_is_refused() {
        let chain = |n: usize| {
            let parents = (0..n).map(|j| j.checked_sub(1)).collect();
            let names = (0..n).map(|j| format!("j{j}")).collect();
            Arc::new(Skeleton::new(names, parents, vec![Vec3::Y; n], vec![]).unwrap())
        };
        assert!(BvhSource::for_skeleton(&chain(511)).is_ok());
        assert!(BvhSource::for_skeleton(&chain(512)).is_err());
        let names = (0..4097).map(|j| format!("j{j}")).collect();
        let parents = (0..4097).map(|j| (j > 0).then_some(0)).collect();
        let wide = Arc::new(Skeleton::new(names, parents, vec![Vec3::Y; 4097], vec![]).unwrap());
        assert!(BvhSource::for_skeleton(&wide).is_err());
    }
}
