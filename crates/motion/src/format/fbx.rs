//! FBX, read by ufbx (crate `ufbx`, MIT or Unlicense): the bones of one figure and their animation.
//!
//! Bones of a file may be rotated at rest. In the clip, as in a BVH, all rotations are 0 at rest: the rotation of the bind
//! pose (or, without one, of the saved pose) is removed from each joint. Lengths are in metres and y is up; the file states
//! its unit and axes.

mod keys;

use super::options::{ReadOptions, is_rate};
use super::posed::{Figure, Placed, placed, unique};
use super::{Axes, Up};
use crate::error::{FaultKind, FileError};
use crate::{Motion, Result, Source, Vec3, Warning};
use kinelm_store::SourcePos;
use std::path::Path;
use ufbx::{EvaluateOpts, LoadOpts, Matrix, Node, Scene};

/// Most frames: more than a day at 120 per second.
const MOST_FRAMES: f64 = 1e7;
/// Most frames times bones: 8 GiB.
const MOST_ROTATIONS: f64 = (1u64 << 28) as f64;
/// Most bones.
const MOST_JOINTS: usize = 4096;
/// Deepest nesting of bones.
const DEEPEST: u32 = 512;
/// A change of a bone's length above this is reported, metres.
const STILL_M: f64 = 0.01;

/// Reads the figure with the most bones, or the one whose root bone is `root`.
///
/// # Errors
/// [`FaultKind::NotThisFormat`] for a file that ufbx refuses, without bones, or without the requested root;
/// [`FaultKind::TooLarge`].
pub fn read(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Motion> {
    let fault =
        |kind: FaultKind, found: String, expected: &str| FileError::new(SourcePos::file(path), kind, found, expected);
    let how = LoadOpts {
        target_axes: ufbx::CoordinateAxes::right_handed_y_up(),
        target_unit_meters: 1.0,
        ignore_geometry: true,
        ignore_embedded: true,
        node_depth_limit: DEEPEST,
        ..LoadOpts::default()
    };
    let scene = ufbx::load_memory(bytes, how)
        .map_err(|e| fault(FaultKind::NotThisFormat, e.description.to_string(), "an FBX of version 6 or 7"))?;
    let mut warnings = Vec::new();
    let figure = figure(&scene, options.root.as_deref(), &mut warnings)
        .map_err(|(found, expected)| fault(FaultKind::NotThisFormat, found, &expected))?;
    if figure.len() > MOST_JOINTS {
        return Err(fault(FaultKind::TooLarge, format!("{} bones", figure.len()), "4,096 at most").into());
    }
    // the longest of several takes
    let length = |stack: &ufbx::AnimStack| {
        let (begin, end) = keys::span(stack, &figure);
        end - begin
    };
    let stack = scene.anim_stacks.iter().max_by(|a, b| length(a).total_cmp(&length(b)));
    if scene.anim_stacks.len() > 1
        && let Some(stack) = stack
    {
        let what = format!("{} takes; {} is read, the longest", scene.anim_stacks.len(), stack.element.name);
        warnings.push(Warning { kind: "several_takes", what });
    }
    let anim = stack.map_or(&scene.anim, |stack| &stack.anim);
    let (begin, end) = stack.map_or((0.0, 0.0), |stack| keys::span(stack, &figure));
    let stated = scene.settings.frames_per_second;
    let own = stack.map_or(stated, |stack| keys::rate(stack, &figure, stated));
    if !is_rate(own) {
        return Err(fault(FaultKind::FrameTimeBad, format!("{own} frames a second"), "a rate of motion").into());
    }
    let count = ((end - begin) * own).round() + 1.0;
    if !(1.0..=MOST_FRAMES).contains(&count) {
        return Err(fault(FaultKind::TooLarge, format!("{count} frames"), "1 to 10,000,000").into());
    }
    if count * figure.len() as f64 > MOST_ROTATIONS {
        let found = format!("{count} frames of {} bones", figure.len());
        return Err(fault(FaultKind::TooLarge, found, "268,435,456 rotations at most").into());
    }
    let whole = Figure {
        names: figure.iter().map(|joint| joint.name.clone()).collect(),
        parents: figure.iter().map(|joint| joint.parent).collect(),
        rest: figure.iter().map(|joint| split(&bind(joint.node))).collect(),
    };
    let frames = (0..count as usize).map(|frame| {
        let time = (begin + frame as f64 / own).min(end);
        let now = ufbx::evaluate_scene(&scene, anim, time, EvaluateOpts::default()).map_err(|e| {
            fault(FaultKind::NotThisFormat, format!("frame {frame}: {}", e.description), "one that can be posed")
        })?;
        let at = |joint: &Joint| split(&now.nodes[joint.node.element.typed_id as usize].node_to_world);
        Ok(figure.iter().map(at).collect())
    });
    let (clip, stretch) = whole.clip(options.fps_source.unwrap_or(own), frames)?;
    if figure.iter().all(|joint| posed(joint.node).is_none()) {
        let what = "no bind pose: rotations are 0 as the figure stood when it was saved; was that no rest pose, export it \
                    with its mesh";
        warnings.push(Warning { kind: "no_bind_pose", what: what.into() });
    }
    if stretch > STILL_M {
        let what = format!("bones get longer or shorter by {:.1} cm at most: left as at rest", 100.0 * stretch);
        warnings.push(Warning { kind: "stretch_dropped", what });
    }
    let (axes, doubt) = Axes::of_format(&clip, Up::Y, options)?;
    warnings.extend(doubt);
    Ok(Motion { path: path.to_owned(), clip: axes.to_y_up(clip)?, source: Source::plain(axes), warnings })
}

/// A bone of a figure, and the index of its parent.
struct Joint<'a> {
    node: &'a Node,
    parent: Option<usize>,
    name: String,
}

/// The bones below a root, parents before children; `Err((found, expected))` without any.
fn figure<'a>(
    scene: &'a Scene,
    root: Option<&str>,
    warnings: &mut Vec<Warning>,
) -> std::result::Result<Vec<Joint<'a>>, (String, String)> {
    let is_bone = |node: &Node| node.bone.is_some();
    let is_root = |node: &&Node| is_bone(node) && !node.parent.as_ref().is_some_and(|parent| is_bone(parent));
    let mut figures = Vec::new();
    for top in scene.nodes.iter().map(|node| &**node).filter(is_root) {
        let mut joints: Vec<Joint> = Vec::new();
        let mut next = vec![(top, None)];
        while let Some((node, parent)) = next.pop() {
            let taken: Vec<String> = joints.iter().map(|joint| joint.name.clone()).collect();
            joints.push(Joint { node, parent, name: unique(&node.element.name, &taken) });
            let here = joints.len() - 1;
            next.extend(node.children.iter().rev().filter(|c| is_bone(c)).map(|child| (&**child, Some(here))));
        }
        figures.push(joints);
    }
    let roots: Vec<String> = figures.iter().map(|joints| joints[0].name.clone()).collect();
    let chosen = match root {
        Some(root) => figures.into_iter().find(|joints| joints[0].name == root),
        None => figures.into_iter().rev().max_by_key(Vec::len),
    };
    let found = chosen.ok_or_else(|| match root.filter(|_| !roots.is_empty()) {
        Some(root) => (format!("no figure {root}"), format!("one of {}", roots.join(", "))),
        None => ("no bones".to_owned(), "a figure; export the armature with its animation".to_owned()),
    })?;
    if root.is_none() && roots.len() > 1 {
        let what =
            format!("{} figures, {}; {} is read, `root` takes another", roots.len(), roots.join(", "), found[0].name);
        warnings.push(Warning { kind: "several_roots", what });
    }
    Ok(found)
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
