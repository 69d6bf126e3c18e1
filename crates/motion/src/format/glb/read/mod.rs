//! GLB, VRM and VRM animations (binary glTF 2.0), read: the joints of the largest figure and the longest animation that
//! moves it. VRM's files say which joint is which.
//!
//! Source: Khronos Group, glTF 2.0 Specification (2021), sections 3.5, 3.7.3, 3.11. Metres, y up. A file states no rate: it
//! is that of its keys, if they are evenly spaced.

mod rate;
mod vrm;

use super::file::document::Document;
use super::file::humanoid::{Humanoid, Kind};
use super::file::sole::soles;
use super::file::take::Take;
use super::file::tree::{Tree, split};
use crate::format::figure::{Chosen, choose_take};
use crate::format::posed::{MOST_PLACED, Posed};
use crate::format::source::glb::{GlbSource, Played};
use crate::format::source::vrm::VrmaSource;
use crate::format::{Axes, ReadOptions, Up};
use crate::rig;
use crate::{FaultKind, FileError, Motion, Result, Source, Warning};
use kinelm_store::SourcePos;
use rate::Frames;
use std::collections::BTreeSet;
use std::path::Path;

/// The unit of glTF.
const UNIT_M: f64 = 1.0;
/// The rate of animations whose keys have none.
const FPS: f64 = 30.0;

/// Reads the figure with the most joints, or what `root` of the options names.
///
/// # Errors
/// [`FaultKind::NotThisFormat`] for a file that is no GLB of version 2, is damaged, is compressed, or has no figure;
/// [`FaultKind::NotFinite`], [`FaultKind::TooLarge`].
pub fn read(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Motion> {
    let document = Document::parse(path, bytes)?;
    let humanoid = Humanoid::of(&document)?;
    motion((path, bytes), &document, humanoid, options)
}

/// The motion of a file with this document.
fn motion(
    (path, bytes): (&Path, &[u8]),
    document: &Document,
    humanoid: Option<Humanoid>,
    options: &ReadOptions,
) -> Result<Motion> {
    let tree = Tree::new(document)?;
    let mut warnings = Vec::new();
    // an avatar has joints beside its bones, and an animation has nodes that are no joints
    let bones: Vec<usize> = match &humanoid {
        Some(Humanoid { kind: Kind::Animation { has_face }, bones }) => {
            warnings.extend(has_face.then(vrm::face_dropped));
            bones.iter().map(|(_, node)| *node).collect()
        }
        _ => Vec::new(),
    };
    let Chosen { nodes: joints, root } = tree.figure(&bones, options.root.as_deref(), &mut warnings)?;
    let mut figure = tree.at_rest(&joints)?;
    figure.roles = humanoid.as_ref().map(|of| vrm::roles_of(of, &joints));
    if bones.is_empty() && document.has_character() {
        figure.ends = soles(document, &tree, (&figure, &joints));
    }
    if let Some((node, scale)) = tree.uneven(&joints) {
        let what = format!(
            "{node} is scaled unevenly or sheared, {scale}: a clip has no scale, so the joints below it come out elsewhere when \
             they turn; apply the scale in the program that made the file"
        );
        warnings.push(Warning { kind: "uneven_scale", what });
    }
    let of_figure: BTreeSet<usize> = joints.iter().flat_map(|&joint| tree.upwards(joint)).collect();
    let take = take(document, &of_figure, options.take.as_deref(), &mut warnings)?;
    let Frames { step_fps, fps, count } = match &take {
        None => {
            warnings.push(Warning { kind: "no_animation", what: "no animation: its pose is read as one frame".into() });
            Frames { step_fps: FPS, fps: options.fps_source.unwrap_or(FPS), count: 1.0 }
        }
        Some((_, take)) => Frames::of(take, options, &mut warnings),
    };
    if !(1.0..=MOST_PLACED).contains(&(count * joints.len() as f64)) {
        let found = format!("{count} frames of {} joints", joints.len());
        return Err(FileError::new(SourcePos::file(path), FaultKind::TooLarge, found, "134,217,728 rotations").into());
    }
    let frames = (0..count as usize).map(|f| {
        let world = tree.world(take.as_ref().map(|(_, take)| (take, take.begin + f as f64 / step_fps)));
        Ok(joints.iter().map(|&node| split(&world[node])).collect())
    });
    let root = root.and_then(|node| joints.iter().position(|&j| j == node));
    let Posed { clip, found, warnings: more } = figure.clip(root, fps, options, UNIT_M, frames)?;
    warnings.extend(more);
    let (axes, doubt) = Axes::of_format(&clip, Up::Y, options, found.as_ref());
    warnings.extend(doubt);
    let axes = axes.mirrored(options.mirror_axis);
    let clip = axes.to_y_up(clip)?;
    let of_name = |name: &String| figure.names.iter().position(|own| own == name);
    let of_clip: Vec<usize> = clip.skeleton().names().iter().filter_map(of_name).collect();
    let metres = options.unit.metres().map_or(1.0, |metres| metres / UNIT_M);
    // VRM's files have y up: in other axes, or mirrored, it is a rig as any
    let pose = humanoid.as_ref().filter(|of| !of.bones.is_empty() && axes.up == Up::Y && axes.mirror.is_none());
    let pose = pose.map(|of| {
        let rig = found.clone().map(|found| rig::Humanoid::new(found, clip.skeleton()));
        let feet = rig.and_then(|rig| rig.feet().ok());
        vrm::pose(of, &tree, (&figure, &joints, &of_clip), (metres, feet))
    });
    if !bones.is_empty() || !document.has_character() {
        let (skeleton, floor_m) = (clip.skeleton().clone(), None);
        let vrma = pose.filter(|_| !bones.is_empty()).map(|pose| VrmaSource { skeleton, pose, floor_m });
        let source = vrma.map_or(Source::plain(axes), |vrma| Source::Vrma(Box::new(vrma)));
        return Ok(Motion::read(path, clip, source, warnings, found));
    }
    let played = |(animation, take): (usize, Take)| Played {
        animation,
        begin_s: take.begin,
        fps: step_fps,
        frames: count as usize,
    };
    let source = GlbSource {
        path: path.to_owned(),
        bytes: bytes.into(),
        skeleton: clip.skeleton().clone(),
        nodes: of_clip.iter().map(|&j| joints[j]).collect(),
        rest: of_clip.iter().map(|&j| figure.rest[j].0).collect(),
        metres,
        axes,
        played: take.map(played),
        floor_m: None,
        vrm: pose,
        embed: false,
        replace: None,
    };
    Ok(Motion::read(path, clip, Source::Glb(Box::new(source)), warnings, found))
}

/// Reads a VRM animation, as [`read`] does.
///
/// # Errors
/// Those of [`read`]; [`FaultKind::NotThisFormat`] for a GLB that is none.
pub fn read_vrma(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Motion> {
    let document = Document::parse(path, bytes)?;
    let humanoid = Humanoid::of(&document)?;
    match humanoid.as_ref().map(|of| (of.kind, of.bones.len())) {
        Some((Kind::Animation { .. }, 1..)) => motion((path, bytes), &document, humanoid, options),
        Some((Kind::Animation { .. }, 0)) => {
            Err(document.fault("a VRM animation without humanoid bones".into(), "one that moves a body"))
        }
        Some(_) => Err(document.fault("a VRM, an avatar".into(), "a VRM animation; name it .vrm")),
        None => Err(document.fault("a GLB without VRMC_vrm_animation".into(), "a VRM animation; name it .glb")),
    }
}

/// The take of that name and its number, else the longest that moves one of these nodes, else the longest; `None` without any.
fn take(
    document: &Document,
    nodes: &BTreeSet<usize>,
    name: Option<&str>,
    warnings: &mut Vec<Warning>,
) -> Result<Option<(usize, Take)>> {
    let animations = &document.json.animations;
    let read = |n: usize| Take::new(document, n, nodes);
    let mut takes: Vec<Take> = (0..animations.len()).map(read).collect::<Result<_>>()?;
    let names: Vec<String> =
        animations.iter().enumerate().map(|(n, a)| a.name.clone().unwrap_or_else(|| n.to_string())).collect();
    let chosen = choose_take(&names, name, |n| (takes[n].moves(), takes[n].length()), warnings);
    let chosen = chosen.map_err(|(found, expected)| document.fault(found, &expected))?;
    Ok(chosen.map(|n| (n, takes.swap_remove(n))))
}

#[cfg(test)]
mod tests;
