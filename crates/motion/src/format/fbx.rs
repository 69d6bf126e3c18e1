//! FBX, read by ufbx (crate `ufbx`, MIT or Unlicense): the bones of one figure and their animation.
//!
//! Bones of a file may be rotated at rest. In the clip, as in a BVH, all rotations are 0 at rest: the rotation of the bind
//! pose (or, without one, of the saved pose) is removed from each joint. Lengths are in metres and y is up; the file states
//! its unit and axes.

mod keys;

use super::figure::{Chosen, Nodes, choose_take};
use super::options::{ReadOptions, is_rate};
use super::posed::{Figure, MOST_PLACED, Placed, Posed, placed, unique};
use super::{Axes, Up};
use crate::error::{FaultKind, FileError};
use crate::{Motion, Result, Source, Vec3, Warning};
use kinelm_store::SourcePos;
use std::collections::BTreeSet;
use std::path::Path;
use ufbx::{AllocatorOpts, EvaluateOpts, LoadOpts, Matrix, Node, Scene};

/// Most frames: more than a day at 120 per second.
const MOST_FRAMES: f64 = 1e7;
/// Most bones.
const MOST_JOINTS: usize = 4096;
/// Deepest nesting of bones.
const DEEPEST: u32 = 512;

/// Reads the figure with the most bones, or what `root` of the options names, in the longest take that moves it.
///
/// # Errors
/// [`FaultKind::NotThisFormat`] for a file that ufbx refuses, without bones, or without the requested root;
/// [`FaultKind::TooLarge`].
pub fn read(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Motion> {
    read_within(memory_limit(bytes.len()), path, bytes, options)
}

/// Bytes that each of ufbx's two allocators may take for a file of this size: real files take up to 7 times their size,
/// hostile ones a thousand times.
fn memory_limit(bytes: usize) -> usize {
    bytes.saturating_mul(64).saturating_add(64 << 20).min(1 << 30)
}

/// [`read`] with a limit of bytes for each allocator.
fn read_within(limit: usize, path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Motion> {
    let fault =
        |kind: FaultKind, found: String, expected: &str| FileError::new(SourcePos::file(path), kind, found, expected);
    let refused = |e: ufbx::Error, at: &str, expected: &str| match e.type_ {
        ufbx::ErrorType::MemoryLimit => {
            let found = format!("{at}more than {:.1} MiB of memory", limit as f64 / (1 << 20) as f64);
            fault(FaultKind::TooLarge, found, "64 times the file and 64 MiB, within 1 GiB")
        }
        _ => fault(FaultKind::NotThisFormat, format!("{at}{}", e.description), expected),
    };
    let allocator = || AllocatorOpts { memory_limit: limit, ..AllocatorOpts::default() };
    let how = LoadOpts {
        target_axes: ufbx::CoordinateAxes::right_handed_y_up(),
        target_unit_meters: 1.0,
        ignore_geometry: true,
        ignore_embedded: true,
        node_depth_limit: DEEPEST,
        temp_allocator: allocator(),
        result_allocator: allocator(),
        ..LoadOpts::default()
    };
    let scene = ufbx::load_memory(bytes, how).map_err(|e| refused(e, "", "an FBX of version 6 or 7"))?;
    let mut warnings = Vec::new();
    let not_this = |(found, expected): (String, String)| fault(FaultKind::NotThisFormat, found, &expected);
    let Chosen { nodes, root } = figure(&scene, options.root.as_deref(), &mut warnings).map_err(not_this)?;
    if nodes.len() > MOST_JOINTS {
        return Err(fault(FaultKind::TooLarge, format!("{} bones", nodes.len()), "4,096 at most").into());
    }
    // a figure is moved by its bones and their ancestors
    let upwards = |&n: &usize| std::iter::successors(Some(n), |&n| parent(&scene.nodes[n]));
    let moving: BTreeSet<u32> = nodes.iter().flat_map(upwards).map(|n| scene.nodes[n].element.element_id).collect();
    let stack = take(&scene, &moving, options.take.as_deref(), &mut warnings).map_err(not_this)?;
    let anim = stack.map_or(&scene.anim, |stack| &stack.anim);
    let (begin, end) = stack.map_or((0.0, 0.0), |stack| keys::span(stack, &moving));
    let stated = scene.settings.frames_per_second;
    let own = stack.map_or(stated, |stack| keys::rate(stack, &moving, stated));
    if !is_rate(own) {
        return Err(fault(FaultKind::FrameTimeBad, format!("{own} frames a second"), "a rate of motion").into());
    }
    let count = ((end - begin) * own).round() + 1.0;
    if !(1.0..=MOST_FRAMES).contains(&count) {
        return Err(fault(FaultKind::TooLarge, format!("{count} frames"), "1 to 10,000,000").into());
    }
    if count * nodes.len() as f64 > MOST_PLACED {
        let found = format!("{count} frames of {} bones", nodes.len());
        return Err(fault(FaultKind::TooLarge, found, "134,217,728 rotations at most").into());
    }
    let joint = |node: usize| nodes.iter().position(|&n| n == node);
    let mut names: Vec<String> = Vec::with_capacity(nodes.len());
    for &n in &nodes {
        names.push(unique(&scene.nodes[n].element.name, &names));
    }
    let whole = Figure {
        names,
        parents: nodes.iter().map(|&n| parent(&scene.nodes[n]).and_then(joint)).collect(),
        rest: nodes.iter().map(|&n| split(&bind(&scene.nodes[n]))).collect(),
        roles: None,
        ends: Vec::new(),
    };
    let frames = (0..count as usize).map(|frame| {
        // the count is rounded, so the last frame may be past the end
        let time = (begin + frame as f64 / own).min(end);
        let how =
            EvaluateOpts { temp_allocator: allocator(), result_allocator: allocator(), ..EvaluateOpts::default() };
        let now = ufbx::evaluate_scene(&scene, anim, time, how)
            .map_err(|e| refused(e, &format!("frame {frame}: "), "one that can be posed"))?;
        Ok(nodes.iter().map(|&n| split(&now.nodes[n].node_to_world)).collect())
    });
    let stated_m = Some(scene.settings.original_unit_meters).filter(|m| *m > 0.0 && m.is_finite()).unwrap_or(1.0);
    let fps = options.fps_source.unwrap_or(own);
    let Posed { clip, found, warnings: more } = whole.clip(root.and_then(joint), fps, options, stated_m, frames)?;
    if nodes.iter().all(|&n| posed(&scene.nodes[n]).is_none()) {
        let what = "no bind pose: rotations are 0 as the figure stood when it was saved; was that no rest pose, export it \
                    with its mesh";
        warnings.push(Warning { kind: "no_bind_pose", what: what.into() });
    }
    warnings.extend(more);
    let (axes, doubt) = Axes::of_format(&clip, Up::Y, options, found.as_ref());
    warnings.extend(doubt);
    Ok(Motion::read(path, axes.to_y_up(clip)?, Source::plain(axes), warnings, found))
}

/// The node above a node, but for the root of the scene.
fn parent(node: &Node) -> Option<usize> {
    node.parent.as_ref().filter(|parent| !parent.is_root).map(|parent| parent.element.typed_id as usize)
}

/// The figure to read, by the places of its nodes in the scene.
fn figure(
    scene: &Scene,
    root: Option<&str>,
    warnings: &mut Vec<Warning>,
) -> std::result::Result<Chosen, (String, String)> {
    let nodes = Nodes {
        names: scene.nodes.iter().map(|node| node.element.name.to_string()).collect(),
        parents: scene.nodes.iter().map(|node| parent(node)).collect(),
        joints: scene.nodes.iter().map(|node| node.bone.is_some()).collect(),
    };
    if !nodes.joints.contains(&true) {
        return Err(("no bones".into(), "a figure; export the armature with its animation".into()));
    }
    nodes.choose(root, warnings)
}

/// The take to read, if there is one; `moving` has the elements that move the figure.
fn take<'a>(
    scene: &'a Scene,
    moving: &BTreeSet<u32>,
    name: Option<&str>,
    warnings: &mut Vec<Warning>,
) -> std::result::Result<Option<&'a ufbx::AnimStack>, (String, String)> {
    let stacks = &scene.anim_stacks;
    let names: Vec<String> = stacks.iter().map(|stack| stack.element.name.to_string()).collect();
    let of = |n: usize| {
        let (begin, end) = keys::span(&stacks[n], moving);
        (keys::curves(&stacks[n], moving).any(|curve| curve.max_value > curve.min_value), end - begin)
    };
    Ok(choose_take(&names, name, of, warnings)?.map(|n| &stacks[n]))
}

/// The rest transform of a bone: in its bind pose, or as the file was saved.
fn bind(node: &Node) -> Matrix {
    posed(node).unwrap_or(node.node_to_world)
}

/// The transform of a bone in its bind pose.
fn posed(node: &Node) -> Option<Matrix> {
    let of_node = |pose: &&ufbx::BonePose| pose.bone_node.element.element_id == node.element.element_id;
    Some(node.bind_pose.as_ref()?.bone_poses.iter().find(of_node)?.bone_to_world)
}

fn split(m: &Matrix) -> Placed {
    let column = |x: f64, y: f64, z: f64| Vec3::new(x, y, z);
    let columns = [column(m.m00, m.m10, m.m20), column(m.m01, m.m11, m.m21), column(m.m02, m.m12, m.m22)];
    placed(columns, column(m.m03, m.m13, m.m23))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::bvh;
    use std::fs;

    fn golden(name: &str) -> std::path::PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden").join(name)
    }

    #[test]
    fn what_blender_exports_moves_as_the_bvh_that_it_imported() {
        let path = golden("blender_dance.fbx");
        let found = crate::format::read(&path, &ReadOptions::default()).unwrap();
        let own = golden("blender_dance_y_up.bvh");
        let expected = bvh::read(&own, &fs::read(&own).unwrap(), &ReadOptions::default()).unwrap().clip;
        assert_eq!(found.clip.frames(), 16);
        assert!((found.clip.fps() - expected.fps()).abs() < 1e-9);
        assert_eq!(found.warnings, []);
        let (a, b) = (found.clip.positions(), expected.positions());
        let mut far: f64 = 0.0;
        for (j, name) in expected.skeleton().names().iter().enumerate() {
            let i = found.clip.skeleton().find(name).unwrap();
            for frame in 0..16 {
                far = far.max((a[frame * found.clip.joints() + i] - b[frame * expected.joints() + j]).length());
            }
        }
        assert!(far < 1e-4, "{far}");
    }

    #[test]
    fn memory_has_a_limit_in_loading_and_in_posing() {
        let path = golden("blender_dance.fbx");
        let bytes = fs::read(&path).unwrap();
        let within = |limit: usize| read_within(limit, &path, &bytes, &ReadOptions::default());
        let said = within(1 << 10).unwrap_err();
        let crate::Error::File(fault) = &said else { panic!("{said}") };
        assert_eq!(fault.kind, FaultKind::TooLarge);
        assert!(said.to_string().contains("found more than 0.0 MiB of memory, expected 64 times the file"), "{said}");
        // the least that loads it is no more than 7 times the file
        let enough = (1..=7).find(|n| within(n * bytes.len()).is_ok());
        assert!(enough.is_some(), "{:?}", within(7 * bytes.len()).err());
        assert_eq!(memory_limit(2_200_000), 2_200_000 * 64 + (64 << 20));
        assert_eq!((memory_limit(100 << 20), memory_limit(usize::MAX)), (1 << 30, 1 << 30));
    }

    #[test]
    fn what_is_no_figure_is_refused() {
        let read = |bytes: &[u8], root: Option<&str>| {
            let options = ReadOptions { root: root.map(str::to_owned), ..Default::default() };
            read(Path::new("a.fbx"), bytes, &options).map(|_| ()).unwrap_err().to_string()
        };
        assert!(read(b"", None).contains("a.fbx"));
        assert!(read(b"HIERARCHY", None).contains("an FBX of version 6 or 7"));
        let whole = fs::read(golden("blender_dance.fbx")).unwrap();
        assert!(read(&whole, Some("nobody")).contains("one of pelvis"));
        // truncated and corrupted files must not panic
        for cut in (0..whole.len()).step_by(997) {
            let _ = super::read(Path::new("a.fbx"), &whole[..cut], &ReadOptions::default());
            let mut spoilt = whole.clone();
            spoilt[cut] ^= 0x5a;
            let _ = super::read(Path::new("a.fbx"), &spoilt, &ReadOptions::default());
        }
    }
}
