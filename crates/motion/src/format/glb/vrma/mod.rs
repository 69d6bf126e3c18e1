//! VRM animations: a GLB of humanoid bones that any avatar plays. Its rest is the T-pose of the rig, a node a bone without
//! rotation; keys in every frame turn bones from there, and move the hips. No scale, no eyes, no mesh.
//!
//! Rotations are transferred in the world: with `G` the rotation of a joint from the rig's rest pose, now and in the T-pose,
//! its bone turns by `N = G_now G_tpose^-1`, below the bone above it by `N_parent^-1 N`. So a bone of another avatar that
//! lies in its own T-pose as this one did ends up as this one does.
//!
//! Source: VRM Consortium, VRMC_vrm_animation-1.0.

mod pose;

use super::file::chunks::Chunks;
use super::write::{GENERATOR, buffer};
use crate::format::source::vrm::{TPose, bones};
use crate::format::{self, Motion, Source};
use crate::rotation::{angle_between, nearest_sign};
use crate::{Clip, Error, GlobalPose, Quat, Result, Vec3};
use buffer::{Buffer, Target, beyond};
use serde_json::{Map, Value, json};
use std::borrow::Cow;
use std::path::Path;

/// A bone without an SMPL joint that turns by less than this in a whole clip has no keys, radians: fingers of a body that
/// nothing moves are left to the player.
const STILL: f64 = 1e-5;

/// The bytes of a motion that goes to `path`, whose stem names the animation. Its rig is that of the avatar or animation
/// that it was read from, or put on, else any with VRM's required bones. The floor of the motion becomes y = 0.
///
/// # Errors
/// [`Unsupported`](kinelm_store::Error::Unsupported) for a rig without a required bone, a clip without frames, and numbers
/// beyond single precision; those of [`Motion::humanoid`].
pub fn motion_to_bytes(path: &Path, motion: &Motion) -> Result<Vec<u8>> {
    let name = path.file_stem().unwrap_or_default().to_string_lossy();
    let (pose, floor) = match &motion.source {
        Source::Vrma(source) if motion.clip.is_on(&source.skeleton) => {
            // an animation that was read stands on the floor of its format
            (Cow::Borrowed(&source.pose), source.floor_m.map_or(0.0, |floor| floor - source.pose.sole_m))
        }
        _ => {
            let of_rig = || Ok::<_, Error>(Cow::Owned(pose::of_rig(motion.humanoid()?)?));
            let of_avatar = motion.avatar().and_then(|avatar| avatar.vrm.as_ref()).map(Cow::Borrowed);
            let pose = of_avatar.map_or_else(of_rig, Ok)?;
            // the clip's rig ends at its feet, and not at their soles
            let floor = format::floor_height(motion)? - pose.sole_m;
            (pose, floor)
        }
    };
    to_bytes(&name, &motion.clip, &pose, floor)
}

/// The bytes of a clip whose rig has this T-pose, and whose floor is at this height.
fn to_bytes(name: &str, clip: &Clip, pose: &TPose, floor: f64) -> Result<Vec<u8>> {
    let missing = pose.missing();
    if !missing.is_empty() {
        let why = format!(
            "its rig has no joint for {}, which VRM requires; give a skeleton map with them as `map` (docs/skeletons.md)",
            missing.join(", ")
        );
        return Err(Error::unsupported(format!("{name} as a VRM animation"), why));
    }
    if clip.frames() == 0 {
        return Err(Error::unsupported(name.to_owned(), "0 frames; a VRM animation needs one"));
    }
    let parents = pose.parents();
    let mut nodes = Vec::with_capacity(pose.bones.len());
    let mut human_bones = Map::new();
    for (n, (bone, parent)) in pose.bones.iter().zip(&parents).enumerate() {
        let place = parent.map_or(bone.place, |p| bone.place - pose.bones[p].place).as_vec3();
        if !place.is_finite() {
            return Err(beyond(format!("{name}: {}", bones()[bone.bone].name)));
        }
        let mut node = json!({"name": clip.skeleton().names()[bone.joint], "translation": place.to_array()});
        let children: Vec<usize> = (0..parents.len()).filter(|&c| parents[c] == Some(n)).collect();
        if !children.is_empty() {
            node["children"] = children.into();
        }
        nodes.push(node);
        human_bones.insert(bones()[bone.bone].name.clone(), json!({"node": n}));
    }

    let Moved { turns, hips } = Moved::of(clip, pose, &parents, floor);
    let (mut buffer, mut samplers, mut channels) = (Buffer::default(), Vec::new(), Vec::new());
    let times: Vec<f32> = (0..clip.frames()).map(|f| (f as f64 / clip.fps()) as f32).collect();
    let input = buffer.floats(&times, ("SCALAR", 1), Target::None, true);
    let mut animate = |numbers: &[f32], kind, node: usize, path: &str| {
        let output = buffer.floats(numbers, kind, Target::None, false);
        channels.push(json!({"sampler": samplers.len(), "target": {"node": node, "path": path}}));
        samplers.push(json!({"input": input, "output": output, "interpolation": "LINEAR"}));
    };
    let places: Vec<f32> = hips.iter().flat_map(|p| p.as_vec3().to_array()).collect();
    animate(&places, ("VEC3", 3), 0, "translation");
    for (n, (bone, turns)) in pose.bones.iter().zip(&turns).enumerate() {
        let is_still = || turns.iter().all(|turn| angle_between(*turn, Quat::IDENTITY) < STILL);
        if bones()[bone.bone].smpl_id.is_some() || !is_still() {
            let numbers: Vec<f32> = turns.iter().flat_map(|q| q.as_quat().to_array()).collect();
            animate(&numbers, ("VEC4", 4), n, "rotation");
        }
    }
    let (views, accessors, binary) = buffer.parts(name)?;
    let document = json!({
        "asset": {"version": "2.0", "generator": GENERATOR},
        "extensionsUsed": [EXTENSION],
        "extensions": {EXTENSION: {"specVersion": "1.0", "humanoid": {"humanBones": human_bones}}},
        "scene": 0, "scenes": [{"nodes": [0]}], "nodes": nodes,
        "animations": [{"name": name, "samplers": samplers, "channels": channels}],
        "buffers": [{"byteLength": binary.len()}], "bufferViews": Value::from(views), "accessors": Value::from(accessors),
    });
    Chunks { json: document.to_string().as_bytes(), binary: Some(&binary), others: Vec::new() }.bytes(name)
}

const EXTENSION: &str = "VRMC_vrm_animation";

/// How bones move.
struct Moved {
    /// By bone, its rotations (F) below the bone above it, with signs such that interpolation takes the shorter arc.
    turns: Vec<Vec<Quat>>,
    /// Places (F) of the hips.
    hips: Vec<Vec3>,
}

impl Moved {
    fn of(clip: &Clip, pose: &TPose, parents: &[Option<usize>], floor: f64) -> Moved {
        let mut turns = vec![Vec::with_capacity(clip.frames()); pose.bones.len()];
        let mut hips = Vec::with_capacity(clip.frames());
        let mut global = GlobalPose::default();
        for f in 0..clip.frames() {
            global.set(clip.skeleton(), clip.root()[f], clip.pose(f));
            // hips are required, and the first of all bones
            hips.push(global.positions[pose.bones[0].joint] - floor * Vec3::Y);
            let world: Vec<Quat> =
                pose.bones.iter().map(|bone| global.rotations[bone.joint] * bone.turn.conjugate()).collect();
            for (n, parent) in parents.iter().enumerate() {
                let turn = parent.map_or(world[n], |p| world[p].conjugate() * world[n]).normalize();
                let before = turns[n].last().copied().unwrap_or(Quat::IDENTITY);
                turns[n].push(nearest_sign(turn, before));
            }
        }
        Moved { turns, hips }
    }
}

#[cfg(test)]
mod tests;
