//! A new dance: keys in every frame.

use super::{Animation, Character};
use crate::rotation::{angle_between, nearest_sign};
use crate::{Clip, Quat, Vec3};
use std::collections::BTreeSet;

/// Rotations this near to each other are equal, radians: the single precision of a bind pose.
const SAME_TURN: f64 = 2e-5;
/// Places this near to each other are equal, in the file's lengths.
const SAME_PLACE: f64 = 1e-6;

impl Character<'_> {
    /// Adds the keys of a dance.
    pub fn dance(&self, clip: &Clip, animation: &mut Animation) {
        let times: Vec<f64> = (0..clip.frames()).map(|f| f as f64 / clip.fps()).collect();
        let above = &self.local.above;
        for joint in 0..clip.joints() {
            let (own, _) = self.local.own[joint];
            let mut before = own;
            let turn = |f: usize| {
                before = nearest_sign(self.local.turn(joint, clip.pose(f)[joint], above), before);
                before
            };
            let turns: Vec<Quat> = (0..clip.frames()).map(turn).collect();
            let is_same = |a: Quat, b: Quat| angle_between(a, b) < SAME_TURN;
            self.add(animation, (joint, "rotation"), &times, &turns, own, is_same, |q| q.to_array().to_vec());
        }
        let (_, own) = self.local.own[0];
        let places: Vec<Vec3> = clip.root().iter().map(|&place| self.local.place(place, above)).collect();
        let is_same = |a: Vec3, b: Vec3| a.distance(b) < SAME_PLACE;
        self.add(animation, (0, "translation"), &times, &places, own, is_same, |p| p.to_array().to_vec());
        self.hold_others(animation, &times);
    }

    /// Adds keys of the saved pose for what only other animations of the file move of the figure or above it: in a program
    /// that plays one after the other it would stay where the last one left it (Blender's actions do).
    fn hold_others(&self, animation: &mut Animation, times: &[f64]) {
        let figure: BTreeSet<usize> = self.source.nodes.iter().flat_map(|&node| self.tree.upwards(node)).collect();
        let channels = self.document.json.animations.iter().flat_map(|other| &other.channels);
        let moved: BTreeSet<(usize, &str)> =
            channels.filter_map(|channel| Some((channel.target.node?, &*channel.target.path))).collect();
        for (node, path) in moved {
            let target = Animation::target(node, path);
            if !figure.contains(&node) || animation.has(&target) {
                continue;
            }
            let (scale, turn, place) = self.tree.own(node);
            let own = match path {
                "translation" => place.to_array().to_vec(),
                "rotation" => turn.to_array().to_vec(),
                "scale" => scale.to_array().to_vec(),
                _ => continue,
            };
            let ends = ends(times);
            animation.moved.insert(node);
            animation.add(&target, &ends, &own.repeat(ends.len()), (own.len(), "LINEAR"));
        }
    }

    /// Adds the keys (F) of a joint's property, which is `own` where the file has none.
    #[allow(clippy::too_many_arguments)]
    fn add<T: Copy>(
        &self,
        animation: &mut Animation,
        (joint, path): (usize, &str),
        times: &[f64],
        values: &[T],
        own: T,
        is_same: impl Fn(T, T) -> bool,
        numbers: impl Fn(&T) -> Vec<f64>,
    ) {
        let is_still = |value: T| values.iter().all(|&other| is_same(other, value));
        if is_still(own) {
            return;
        }
        let (times, values): (Vec<f64>, Vec<f64>) = match is_still(values[0]) {
            true => (ends(times), numbers(&values[0]).repeat(ends(times).len())),
            false => (times.to_vec(), values.iter().flat_map(numbers).collect()),
        };
        let (node, width) = (self.source.nodes[joint], values.len() / times.len());
        animation.moved.insert(node);
        animation.add(&Animation::target(node, path), &times, &values, (width, "LINEAR"));
    }
}

/// The first and the last second: what holds a pose needs no others.
fn ends(times: &[f64]) -> Vec<f64> {
    let mut ends = vec![times[0], times[times.len() - 1]];
    ends.dedup();
    ends
}
