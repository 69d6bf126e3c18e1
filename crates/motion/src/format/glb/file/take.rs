//! An animation of a document: the tracks of its nodes.

use super::document::{self, ChannelOf, Document};
use super::track::{Between, Track};
use crate::Result;
use std::collections::{BTreeMap, BTreeSet};

/// The properties of a node that place it.
const PATHS: [&str; 3] = ["translation", "rotation", "scale"];

/// The type of an accessor with a property's values, and its components (section 3.11).
pub fn element(path: &str) -> (&'static str, usize) {
    match path {
        "translation" | "scale" => ("VEC3", 3),
        "rotation" => ("VEC4", 4),
        _ => ("SCALAR", 1),
    }
}

/// Tracks of a node, one for each of [`PATHS`].
pub type Tracks = [Option<Track>; 3];

/// An animation.
pub struct Take {
    pub tracks: BTreeMap<usize, Tracks>,
    /// The first and the last key, seconds.
    pub begin: f64,
    pub end: f64,
}

impl Take {
    /// The animation's tracks of these nodes.
    pub fn new(document: &Document, n: usize, nodes: &BTreeSet<usize>) -> Result<Take> {
        let animation = &document.json.animations[n];
        let mut take = Take { tracks: BTreeMap::new(), begin: f64::INFINITY, end: f64::NEG_INFINITY };
        for channel in &animation.channels {
            let Some(n) = PATHS.iter().position(|path| channel.target.path == *path) else { continue };
            let Some(node) = channel.target.node.filter(|node| nodes.contains(node)) else { continue };
            let track = Take::track(document, animation, channel)?;
            take.begin = take.begin.min(track.times[0]);
            take.end = take.end.max(track.times[track.times.len() - 1]);
            take.tracks.entry(node).or_default()[n] = Some(track);
        }
        if take.tracks.is_empty() {
            (take.begin, take.end) = (0.0, 0.0);
        }
        Ok(take)
    }

    /// The keys of a channel. Of weights of morph targets, scalars, a key has as many as there are for each time.
    ///
    /// # Errors
    /// No such sampler; keys that are none, or go back.
    pub fn track(document: &Document, animation: &document::Animation, channel: &ChannelOf) -> Result<Track> {
        let sampler = channel.sampler;
        let bad = |found: &str, expected: &str| document.fault(format!("sampler {sampler}: {found}"), expected);
        let sampler = Take::sampler(document, animation, channel)?;
        let between = match sampler.interpolation.as_deref() {
            None | Some("LINEAR") => Between::Linear,
            Some("STEP") => Between::Step,
            Some("CUBICSPLINE") => Between::Cubic,
            Some(other) => return Err(bad(other, "LINEAR, STEP or CUBICSPLINE")),
        };
        let times = document.numbers(sampler.input, 1)?;
        let (_, components) = element(&channel.target.path);
        let values = document.numbers(sampler.output, components)?;
        let keys = if between == Between::Cubic { 3 * times.len() } else { times.len() };
        let width = if components == 1 { values.len() / keys.max(1) } else { components };
        if times.is_empty() || width == 0 || values.len() != keys * width {
            let each = if between == Between::Cubic { 3 * components } else { components };
            return Err(bad(&format!("{} times, {} numbers", times.len(), values.len()), &format!("{each} a time")));
        }
        if !times.is_sorted() {
            return Err(bad("times that go back", "ascending ones"));
        }
        Ok(Track { times, values, width, between })
    }

    /// The sampler of a channel.
    ///
    /// # Errors
    /// No such sampler.
    pub fn sampler<'a>(
        document: &Document,
        animation: &'a document::Animation,
        channel: &ChannelOf,
    ) -> Result<&'a document::Sampler> {
        let missing = || document.fault(format!("sampler {}: not there", channel.sampler), "a sampler");
        animation.samplers.get(channel.sampler).ok_or_else(missing)
    }

    /// Whether a track changes anything.
    pub fn moves(&self) -> bool {
        self.tracks.values().flatten().flatten().any(|track| !track.is_still())
    }

    pub fn of(&self, node: usize) -> Option<&Tracks> {
        self.tracks.get(&node)
    }

    pub fn length(&self) -> f64 {
        self.end - self.begin
    }
}
