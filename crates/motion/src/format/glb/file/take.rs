//! An animation of a document: the tracks of its nodes.

use super::document::{self, Document};
use super::track::{Between, Track};
use crate::Result;
use std::collections::{BTreeMap, BTreeSet};

/// Tracks of a node: translation, rotation, scale.
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
            let (path, width) = match channel.target.path.as_str() {
                "translation" => (0, 3),
                "rotation" => (1, 4),
                "scale" => (2, 3),
                _ => continue,
            };
            let Some(node) = channel.target.node.filter(|node| nodes.contains(node)) else { continue };
            let track = Take::track(document, animation, channel.sampler, width)?;
            take.begin = take.begin.min(track.times[0]);
            take.end = take.end.max(track.times[track.times.len() - 1]);
            take.tracks.entry(node).or_default()[path] = Some(track);
        }
        if take.tracks.is_empty() {
            (take.begin, take.end) = (0.0, 0.0);
        }
        Ok(take)
    }

    /// The keys of an animation's sampler, of `width` numbers each.
    ///
    /// # Errors
    /// No such sampler; keys that are none, or go back.
    pub fn track(document: &Document, animation: &document::Animation, sampler: usize, width: usize) -> Result<Track> {
        Take::of_width(document, animation, sampler, (width, width))
    }

    /// The keys of a sampler of `width` numbers each, in elements of `of` components.
    fn of_width(
        document: &Document,
        animation: &document::Animation,
        sampler: usize,
        (of, width): (usize, usize),
    ) -> Result<Track> {
        let bad = |found: &str, expected: &str| document.fault(format!("sampler {sampler}: {found}"), expected);
        let sampler = animation.samplers.get(sampler).ok_or_else(|| bad("not there", "a sampler"))?;
        let between = match sampler.interpolation.as_deref() {
            None | Some("LINEAR") => Between::Linear,
            Some("STEP") => Between::Step,
            Some("CUBICSPLINE") => Between::Cubic,
            Some(other) => return Err(bad(other, "LINEAR, STEP or CUBICSPLINE")),
        };
        let times = document.numbers(sampler.input, 1)?;
        let values = document.numbers(sampler.output, of)?;
        let each = if between == Between::Cubic { 3 * width } else { width };
        if times.is_empty() || values.len() != times.len() * each {
            return Err(bad(&format!("{} times, {} numbers", times.len(), values.len()), &format!("{each} a time")));
        }
        if !times.is_sorted() {
            return Err(bad("times that go back", "ascending ones"));
        }
        Ok(Track { times, values, width, between })
    }

    /// The keys of a sampler of scalars, as many a key as there are: weights of morph targets.
    ///
    /// # Errors
    /// Those of [`Take::track`].
    pub fn scalars(document: &Document, animation: &document::Animation, sampler: usize) -> Result<Track> {
        let bad = |found: &str| document.fault(format!("sampler {sampler}: {found}"), "scalars at times");
        let own = animation.samplers.get(sampler).ok_or_else(|| bad("not there"))?;
        let keys = document.numbers(own.input, 1)?.len();
        let numbers = document.numbers(own.output, 1)?.len();
        let each = if own.interpolation.as_deref() == Some("CUBICSPLINE") { 3 * keys } else { keys };
        if each == 0 || !numbers.is_multiple_of(each) {
            return Err(bad(&format!("{keys} times, {numbers} numbers")));
        }
        Take::of_width(document, animation, sampler, (1, numbers / each))
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
