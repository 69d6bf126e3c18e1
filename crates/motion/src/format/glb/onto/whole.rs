//! A new dance: keys in every frame.

use super::super::file::track::{Between, Track};
use super::keys::{of_place, of_quat};
use super::{Animation, Character};
use crate::Clip;
use crate::rotation::nearest_sign;
use std::collections::BTreeSet;

/// Quaternions this near to each other are one: half the angle that the single precision of a bind pose leaves.
const SAME_TURN: f64 = 1e-5;
/// Places this near to each other are one, in the file's lengths.
const SAME_PLACE: f64 = 1e-6;

impl Character<'_> {
    /// Adds the keys of a dance.
    pub fn dance(&self, clip: &Clip, animation: &mut Animation) {
        let times: Vec<f64> = (0..clip.frames()).map(|f| f as f64 / clip.fps()).collect();
        let above = &self.local.above;
        for (joint, &node) in self.source.nodes.iter().enumerate() {
            let (own, _) = self.local.own[joint];
            let mut before = own;
            let turn = |f: usize| {
                before = nearest_sign(self.local.turn(joint, clip.pose(f)[joint], above), before);
                of_quat(before)
            };
            let turns: Vec<Vec<f64>> = (0..clip.frames()).map(turn).collect();
            add(animation, (node, "rotation"), &times, &turns, (&of_quat(own), SAME_TURN));
        }
        let (_, own) = self.local.own[0];
        let places: Vec<Vec<f64>> = clip.root().iter().map(|&place| of_place(self.local.place(place, above))).collect();
        add(animation, (self.source.nodes[0], "translation"), &times, &places, (&of_place(own), SAME_PLACE));
        self.hold_others(animation, &times);
    }

    /// Adds keys of the saved pose for what only other animations of the file move of the figure or above it: in a program
    /// that plays one after the other it would stay where the last one left it (Blender's actions do).
    fn hold_others(&self, animation: &mut Animation, times: &[f64]) {
        let figure: BTreeSet<usize> = self.source.nodes.iter().flat_map(|&node| self.tree.upwards(node)).collect();
        let channels = self.document.json.animations.iter().flat_map(|other| &other.channels);
        let moved: BTreeSet<(usize, String)> =
            channels.filter_map(|channel| Some((channel.target.node?, channel.target.path.clone()))).collect();
        for (node, path) in moved.difference(&animation.moved.clone()).filter(|(node, _)| figure.contains(node)) {
            let (scale, turn, place) = self.tree.own(*node);
            let own = match path.as_str() {
                "translation" => of_place(place),
                "rotation" => of_quat(turn),
                "scale" => of_place(scale),
                _ => continue,
            };
            animation.add(*node, path, &held(&own, times));
        }
    }
}

/// Adds the keys (F) of a node's property, which is `own` where the file has none. Values nearer than `same` are one.
fn add(
    animation: &mut Animation,
    (node, path): (usize, &str),
    times: &[f64],
    values: &[Vec<f64>],
    (own, same): (&[f64], f64),
) {
    let far = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| (a - b).powi(2)).sum::<f64>().sqrt();
    let is_still = |value: &[f64]| values.iter().all(|other| far(other, value) < same);
    if is_still(own) {
        return;
    }
    let track = match is_still(&values[0]) {
        true => held(&values[0], times),
        false => Track { times: times.to_vec(), width: own.len(), values: values.concat(), between: Between::Linear },
    };
    animation.add(node, path, &track);
}

/// A pose that is held: its first and its last second need no others between them.
fn held(value: &[f64], times: &[f64]) -> Track {
    let mut ends = vec![times[0], times[times.len() - 1]];
    ends.dedup();
    Track { width: value.len(), values: value.repeat(ends.len()), times: ends, between: Between::Linear }
}
