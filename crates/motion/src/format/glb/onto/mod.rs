//! One more animation in the file of a character, of which all else stays as it is: the bytes of its buffer come first, and
//! its document is changed as text.
//!
//! A new dance has keys in every frame: rotations of the joints of its clip, and the place of the clip's root below whatever
//! is above it. Joints that stand as the file was saved get none. An edit of an animation of the file shares the keys of what
//! it leaves alone, and has its own where something is new.

mod edited;
mod keys;
mod local;
mod text;
mod whole;

use super::file::chunks::Chunks;
use super::file::document::{Animation as Animated, Document};
use super::file::take::element;
use super::file::track::Track;
use super::file::tree::Tree;
use super::write::buffer::{Buffer, Target};
use crate::format::source::Changed;
use crate::format::source::glb::GlbSource;
use crate::{Clip, Error, Result};
use glam::DMat4;
use kinelm_store::Subject;
use local::Local;
use serde::Deserialize;
use serde_json::value::RawValue;
use serde_json::{Value, json};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use text::{Edits, Members, items};

/// A matrix is its scale, rotation and place to this fraction of its largest number.
const SHEAR: f64 = 1e-4;

/// Checks whether an animation of this name can be added to a character's file.
///
/// # Errors
/// [`Unsupported`](kinelm_store::Error::Unsupported) for a name that is taken or not there, a buffer beside the file, and a
/// skeleton that is scaled unevenly.
pub(super) fn check(source: &GlbSource, name: &str) -> Result<()> {
    let chunks = Chunks::parse(&source.path, &source.bytes)?;
    let document = Document::of(&source.path, &chunks)?;
    checked(source, (&document, &Tree::new(&document)?), name).map(drop)
}

/// The name of an animation that is added, and the number of the one that it replaces.
fn checked<'a>(
    source: &'a GlbSource,
    (document, tree): (&Document, &Tree),
    name: &'a str,
) -> Result<(&'a str, Option<usize>)> {
    let path = &source.path;
    if document.json.buffers.first().is_some_and(|buffer| buffer.uri.is_some()) {
        let why = "its buffer isn't its binary chunk; export it as a GLB with one";
        return Err(Error::unsupported(path.display().to_string(), why));
    }
    if let Some((node, scale)) = tree.uneven(&source.nodes) {
        let why = format!(
            "its scale is uneven or sheared ({scale}), which rotations of the joints below it would distort; apply it in the \
             program that made the file"
        );
        return Err(Error::unsupported(format!("{node} of {}", path.display()), why));
    }
    placed(document, source.replace.as_deref(), (path, name))
}

/// The bytes of a character's file with a clip of its rig as an animation. The animation has this name, or that of the one which
/// the source replaces. `changed`: of the animation that was read, what is new.
///
/// # Errors
/// Those of [`check`], and for numbers beyond single precision; those of reading for a file that can't be read.
pub(super) fn onto(source: &GlbSource, name: &str, clip: &Clip, changed: Option<&Changed>) -> Result<Vec<u8>> {
    let path = &source.path;
    let chunks = Chunks::parse(path, &source.bytes)?;
    let document = Document::of(path, &chunks)?;
    let damaged = |e: &dyn std::fmt::Display| document.fault(e.to_string(), "a glTF document");
    let text = std::str::from_utf8(chunks.json).map_err(|e| damaged(&e))?;
    let members: Members = serde_json::from_str(text).map_err(|e| damaged(&e))?;
    let tree = Tree::new(&document)?;
    let (name, replaced) = checked(source, (&document, &tree), name)?;
    if clip.frames() == 0 {
        return Err(Error::unsupported(name.to_owned(), "0 frames; a GLB needs one"));
    }
    let (frames, joints) = (clip.frames(), clip.joints());
    if changed.is_some_and(|new| new.root.len() != frames || new.joints.len() != frames * joints) {
        let expected = format!("a flag for each of {frames} frames, and of {joints} joints in them");
        return Err(Error::invalid("what is new of the clip", "other flags", expected));
    }
    let clip = source.axes.restored(clip)?;
    let character = Character { source, document: &document, local: Local::of(source, &tree), tree: &tree };
    let binary = chunks.binary.unwrap_or_default();
    let begin = binary.len().next_multiple_of(4);
    let views = [document.json.buffer_views.len(), document.json.accessors.len()];
    let mut animation = Animation::after(begin, views);
    let own = items(members.animations).map_err(|e| damaged(&e))?;
    match (changed, source.played) {
        (Some(changed), Some(played)) => {
            let targets = targets(own[played.animation]).map_err(|e| damaged(&e))?;
            character.edit(&clip, (changed, played), &targets, &mut animation)?;
        }
        _ => character.dance(&clip, &mut animation),
    }
    let Animation { buffer, samplers, channels, moved, .. } = animation;
    let (views, accessors, added) = buffer.parts(name)?;

    let mut edits = Edits::of(text);
    let printed = |values: Vec<Value>| values.iter().map(Value::to_string).collect::<Vec<_>>();
    edits.append("bufferViews", members.buffer_views, &printed(views));
    edits.append("accessors", members.accessors, &printed(accessors));
    // an animation has channels (section 5.5); a pose in which the file stands needs none
    if !channels.is_empty() {
        let (channels, samplers) = (channels.join(","), Value::from(samplers));
        let printed = format!("{{\"name\":{},\"samplers\":{samplers},\"channels\":[{channels}]}}", json!(name));
        match replaced {
            Some(n) => edits.replace(own[n], printed),
            None => edits.append("animations", members.animations, &[printed]),
        }
    }
    let length = begin + added.len();
    match items(members.buffers).map_err(|e| damaged(&e))?.first() {
        Some(first) => {
            let BufferText { byte_length } = serde_json::from_str(first.get()).map_err(|e| damaged(&e))?;
            edits.replace(byte_length, length.to_string());
        }
        None => edits.append("buffers", members.buffers, &[json!({"byteLength": length}).to_string()]),
    }
    let nodes = items(members.nodes).map_err(|e| damaged(&e))?;
    let moved: BTreeSet<usize> = moved.into_iter().map(|(node, _)| node).collect();
    for node in moved {
        let text = nodes.get(node).ok_or_else(|| damaged(&format!("a channel of node {node}, which isn't there")))?;
        let NodeText { matrix } = serde_json::from_str(text.get()).map_err(|e| damaged(&e))?;
        let Some((text, matrix)) = matrix.zip(document.json.nodes[node].matrix.as_ref()) else { continue };
        // an animated node has no matrix (section 3.6.1.1)
        let (scale, turn, place) = tree.own(node);
        let (own, same) = (DMat4::from_cols_array(matrix), DMat4::from_scale_rotation_translation(scale, turn, place));
        if !own.abs_diff_eq(same, SHEAR * own.to_cols_array().iter().fold(1.0, |most: f64, x| most.max(x.abs()))) {
            let why =
                "its matrix is sheared, and an animated node has none; apply it in the program that made the file";
            return Err(Error::unsupported(format!("node {node} of {}", path.display()), why));
        }
        let [place, turn, scale] = [&place.to_array()[..], &turn.to_array(), &scale.to_array()].map(|x| json!(x));
        let by = format!("\"translation\":{place},\"rotation\":{turn},\"scale\":{scale}");
        if !edits.replace_member("matrix", text, by) {
            return Err(damaged(&format!("node {node}: a matrix whose name has escapes")));
        }
    }
    let mut whole = binary.to_vec();
    whole.resize(begin, 0);
    whole.extend(added);
    Chunks { json: edits.text().as_bytes(), binary: Some(&whole), others: chunks.others }.bytes(name)
}

/// The name of a new animation, and the number of the one that it replaces.
fn placed<'a>(
    document: &Document,
    replaced: Option<&'a str>,
    (path, name): (&Path, &'a str),
) -> Result<(&'a str, Option<usize>)> {
    let called = |name: &str| {
        let is_called = |own: &Animated| own.name.as_deref() == Some(name);
        let all = document.json.animations.iter().enumerate().filter(|(_, own)| is_called(own));
        all.map(|(n, _)| n).collect::<Vec<_>>()
    };
    let subject = |name: &str| Subject::of_parameter("replace_animation").with(format!("{name} of {}", path.display()));
    match (replaced, called(replaced.unwrap_or(name)).as_slice()) {
        (Some(name), [n]) => Ok((name, Some(*n))),
        (None, []) => Ok((name, None)),
        (Some(name), [_, ..]) => Err(Error::unsupported(subject(name), "several animations have that name")),
        (None, [_, ..]) => {
            let why =
                "an animation of that name is there: name the file that is written otherwise, or replace it by name";
            Err(Error::unsupported(format!("the animation {name} in {}", path.display()), why))
        }
        (Some(name), []) => {
            let names: Vec<&str> = document.json.animations.iter().filter_map(|own| own.name.as_deref()).collect();
            let has = if names.is_empty() { "no animation has a name".to_owned() } else { names.join(", ") };
            Err(Error::unsupported(subject(name), format!("not there; the file has: {has}")))
        }
    }
}

#[derive(Deserialize)]
#[serde(rename_all = "camelCase")]
struct BufferText<'a> {
    #[serde(borrow)]
    byte_length: &'a RawValue,
}

#[derive(Deserialize)]
struct NodeText<'a> {
    #[serde(borrow, default)]
    matrix: Option<&'a RawValue>,
}

#[derive(Deserialize)]
struct AnimationText<'a> {
    #[serde(borrow, default)]
    channels: Vec<ChannelText<'a>>,
}

#[derive(Deserialize)]
struct ChannelText<'a> {
    #[serde(borrow)]
    target: &'a RawValue,
}

/// What the channels of an animation move, as text.
fn targets(animation: &RawValue) -> serde_json::Result<Vec<&str>> {
    let animation: AnimationText = serde_json::from_str(animation.get())?;
    Ok(animation.channels.iter().map(|channel| channel.target.get()).collect())
}

/// A file that is given an animation.
struct Character<'a> {
    source: &'a GlbSource,
    document: &'a Document<'a>,
    tree: &'a Tree<'a>,
    local: Local,
}

/// An animation under construction.
struct Animation {
    buffer: Buffer,
    samplers: Vec<Value>,
    /// Each as text.
    channels: Vec<String>,
    /// What it moves: nodes and their properties.
    moved: BTreeSet<(usize, String)>,
    /// The accessors of times that there are, by the bits of the times.
    inputs: BTreeMap<Vec<u32>, usize>,
}

impl Animation {
    /// In a file of so many bytes, views and accessors.
    fn after(bytes: usize, [views, accessors]: [usize; 2]) -> Animation {
        let buffer = Buffer::after(bytes, views, accessors);
        let (samplers, channels, moved, inputs) = Default::default();
        Animation { buffer, samplers, channels, moved, inputs }
    }

    /// Adds keys of a node's property.
    fn add(&mut self, node: usize, path: &str, track: &Track) {
        self.moved.insert((node, path.to_owned()));
        self.add_keys((&json!({"node": node, "path": path}).to_string(), path), track);
    }

    /// Adds keys of a property, whose target is given as text.
    fn add_keys(&mut self, (target, path): (&str, &str), track: &Track) {
        let Track { times, values, between, .. } = track;
        let times: Vec<f32> = times.iter().map(|&time| time as f32).collect();
        let bits: Vec<u32> = times.iter().map(|time| time.to_bits()).collect();
        let buffer = &mut self.buffer;
        let input =
            *self.inputs.entry(bits).or_insert_with(|| buffer.floats(&times, ("SCALAR", 1), Target::None, true));
        let numbers: Vec<f32> = values.iter().map(|&x| x as f32).collect();
        let output = self.buffer.floats(&numbers, element(path), Target::None, false);
        self.share(target, input, output, between.name());
    }

    /// Adds keys that the file has.
    fn share(&mut self, target: &str, input: usize, output: usize, between: &str) {
        let sampler = json!({"input": input, "output": output, "interpolation": between});
        let n = self.samplers.iter().position(|own| *own == sampler).unwrap_or_else(|| {
            self.samplers.push(sampler);
            self.samplers.len() - 1
        });
        self.channels.push(format!("{{\"sampler\":{n},\"target\":{target}}}"));
    }
}

#[cfg(test)]
mod tests;
