//! Poses as components of a joint transform, one character per component; a component belongs to all joints.

use super::Encoded;
use super::frame::{Numbers, Poses};
use super::line::Scale;
use super::mix::{JointTransform, Mix};
use crate::{Channels, Result};
use kinelm_motion::Quat;

/// Codes poses as the turn's step, if there is one, and components.
pub(super) struct Mixed<'a, S> {
    numbers: Numbers<'a>,
    mix: &'a Mix,
    /// One per component, or one for all.
    scales: &'a [S],
    row: Vec<f64>,
    components: Vec<f64>,
}

/// The most times that a pose is decoded and encoded until its codes are stable.
const TRIES: u32 = 12;

/// Radians by which a vector near half a turn, whose twin decodes beyond it too, is shortened at the first attempt; at the n-th
/// n² times that, since coarse bins need more.
const SHORTER: f64 = 0.02;

/// The reason why characters don't belong to joints.
pub(super) const REASON: &str = "a joint transform spreads each joint over all characters of a pose";

impl<'a, S: Scale> Mixed<'a, S> {
    /// At a clip's start; `bins` of the turn, if the channels have one.
    pub(super) fn new(channels: &'a Channels, bins: u32, mix: &'a Mix, scales: &'a [S]) -> Self {
        let components = vec![0.0; mix.components()];
        Mixed { numbers: Numbers::new(channels, bins), mix, scales, row: vec![0.0; Numbers::len(channels)], components }
    }

    /// The characters of a word: translation, turn, components.
    pub(super) fn length(channels: &Channels, mix: &Mix) -> usize {
        3 + usize::from(channels.has_turn()) + mix.components()
    }

    fn scale(&self, component: usize) -> &'a S {
        &self.scales[component.min(self.scales.len() - 1)]
    }

    /// Encodes and consumes the numbers of a pose; returns how many components are clipped.
    fn code(&mut self, codes: &mut [u16]) -> u64 {
        self.mix.forward(1, &mut self.row, &mut self.components);
        let mut count = 0;
        for (i, place) in codes.iter_mut().enumerate() {
            let (code, clipped) = self.scale(i).code(self.components[i]);
            *place = code;
            count += u64::from(clipped);
        }
        count
    }

    /// Decodes codes into the numbers of a pose. While a vector is longer than half a turn, where it would not encode to itself,
    /// replaces the codes by those of the decoded pose. Returns whether codes were replaced.
    fn settle(&mut self, codes: &mut [u16]) -> bool {
        self.unmix(codes);
        if !self.numbers.canonical(&mut self.row, 0.0) {
            return false;
        }
        let first = codes.to_vec();
        // re-encoding may lengthen another vector, since each component moves all joints
        for attempt in 1..=TRIES {
            self.code(codes);
            self.unmix(codes);
            if !self.numbers.canonical(&mut self.row, SHORTER * f64::from(attempt * attempt)) {
                return true;
            }
        }
        // not stable after all attempts: the nearest codes are the better ones
        codes.copy_from_slice(&first);
        self.unmix(codes);
        false
    }

    /// Decodes the components into the numbers of a pose.
    fn unmix(&mut self, codes: &[u16]) {
        for (i, &code) in codes.iter().enumerate() {
            self.components[i] = self.scale(i).value(code);
        }
        self.mix.inverse(1, &self.components, &mut self.row);
    }
}

impl<S: Scale> Poses for Mixed<'_, S> {
    fn encode(&mut self, pose: &[Quat], word: &mut [u16], out: &mut Encoded) -> Option<Quat> {
        let before = self.numbers.turns;
        self.row.clear();
        let mut step = self.numbers.of(pose, &mut self.row);
        let (turn, places) = word.split_at_mut(usize::from(step.is_some()));
        let mut clipped = self.code(places);
        let mut second = self.settle(places);
        // known only after decoding: quantised components may tilt the pelvis to where its turn is undefined
        if self.numbers.turns != before && self.numbers.upside_down(&self.row) {
            self.numbers.turns = before;
            self.row.clear();
            step = self.numbers.of_kept_turn(pose, &mut self.row);
            (clipped, second) = (self.code(places), self.settle(places));
        }
        turn.iter_mut().zip(step).for_each(|(place, step)| *place = step);
        out.clipped += clipped;
        out.second_codes += u64::from(second);
        self.numbers.has_pelvis().then(|| self.numbers.pelvis(&self.row))
    }

    fn decode(&mut self, word: &[u16], pose: &mut [Quat]) -> Option<Quat> {
        let (turn, places) = word.split_at(usize::from(self.numbers.turns.is_some()));
        self.unmix(places);
        self.numbers.set(&self.row, turn.first().copied(), pose)
    }
}

/// Fits a joint transform to the numbers of training poses, (N, `columns`); returns it and their components, (N, K). `None`
/// without a transform.
#[cfg(feature = "fit")]
pub(super) fn fit(transform: &JointTransform, rows: &mut [f64], columns: usize) -> Result<Option<(Mix, Vec<f64>)>> {
    if *transform == (JointTransform::None {}) {
        return Ok(None);
    }
    let mix = Mix::fit(transform, rows, columns, None)?;
    let mut components = vec![0.0; rows.len() / columns * mix.components()];
    for (row, out) in rows.chunks_exact_mut(columns).zip(components.chunks_exact_mut(mix.components())) {
        mix.forward(1, row, out);
    }
    Ok(Some((mix, components)))
}
