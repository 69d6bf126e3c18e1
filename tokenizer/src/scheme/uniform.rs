//! Uniform bins: angles over a full turn, the root's translation as steps in closed loop or as places.

use super::angle::Angles;
use super::line::Line;
use super::{Encoded, Rest, Scheme, WordLength};
use crate::channel::{Channel, Channels};
use crate::{Error, Result, Words, alphabet};
use kinelm_motion::{Clip, Quat, Vec3, smpl};
use serde::{Deserialize, Serialize};
use std::f64::consts::{PI, TAU};

/// Where the bins lie.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Form {
    /// A bin is centred on 0; the seam is at half a turn, where both vectors of a rotation are looked at.
    #[default]
    Centred,
    /// A bin has its edge at 0 (compat): `floor((v - lo) / w)`. An unused joint flickers between two codes, and a rotation
    /// within a bin of half a turn, decoded and coded again, may take another code.
    Edge,
}

/// What is coded of the root's translation.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Travel {
    /// The step from the decoded place before, turned into the decoded heading before, over a fitted range.
    #[default]
    Velocity,
    /// The place (of x and z from where the clip starts), the bins of the angles read as metres.
    Absolute,
}

/// Uniform bins for every channel.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct UniformConfig {
    /// Bins a channel, 2 to 21054 (as many as the alphabet has characters). Default 360: a step of 1 degree.
    pub bins: u32,
    /// Where the bins of the angles lie. Default centred on 0.
    pub form: Form,
    /// How x and z of the translation are coded. Default velocity.
    pub translation: Travel,
    /// How its y is coded. Default velocity.
    pub height: Travel,
}

impl Default for UniformConfig {
    fn default() -> Self {
        UniformConfig { bins: 360, form: Form::Centred, translation: Travel::Velocity, height: Travel::Velocity }
    }
}

impl UniformConfig {
    /// Checks every setting.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the setting, its value and its limits.
    pub fn validate(&self) -> Result<()> {
        let size = alphabet::SIZE;
        (2..=size).contains(&self.bins).then_some(()).ok_or_else(|| Error::Setting {
            field: "bins",
            found: self.bins.to_string(),
            expected: format!("2 to {size}"),
        })
    }

    /// The bins of a place in metres.
    fn place_line(&self) -> Line {
        let width = TAU / f64::from(self.bins);
        let zero = (self.bins / 2) as u16;
        let offset = match self.form {
            Form::Centred => 0.0,
            Form::Edge => (0.5 + f64::from(zero)) * width - PI,
        };
        Line { width, zero, offset, bins: self.bins }
    }
}

/// A root further from the origin than this is no body's, metres.
const FARTHEST: f64 = 1e6;

/// Uniform bins with their fitted ranges.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Uniform {
    #[serde(skip)]
    config: UniformConfig,
    /// Bins of the translation's x, y, z.
    translation: [Line; 3],
    /// Mean height of the training clips' first frames, metres: where frame 0 steps from.
    first_height: f64,
}

/// The decoded root on its way through a clip.
struct Walk {
    at: Vec3,
    /// Sine and cosine of the heading.
    facing: (f64, f64),
}

impl Walk {
    fn new(height: f64) -> Self {
        Walk { at: Vec3::new(0.0, height, 0.0), facing: (0.0, 1.0) }
    }

    /// A world vector seen by one who faces +z.
    fn turned_in(&self, v: Vec3) -> Vec3 {
        let (s, c) = self.facing;
        Vec3::new(v.x * c - v.z * s, v.y, v.x * s + v.z * c)
    }

    /// The inverse of [`Walk::turned_in`].
    fn turned_out(&self, v: Vec3) -> Vec3 {
        let (s, c) = self.facing;
        Vec3::new(v.x * c + v.z * s, v.y, v.z * c - v.x * s)
    }

    /// Takes the heading of a decoded pelvis, [`heading`](kinelm_motion::rotation::heading) without its angle; one that
    /// points straight up or down leaves it.
    fn face(&mut self, pelvis: Quat) {
        let z = pelvis * Vec3::Z;
        let along = (z.x * z.x + z.z * z.z).sqrt();
        if along > 1e-6 {
            self.facing = (z.x / along, z.z / along);
        }
    }
}

impl Uniform {
    /// The settings.
    pub fn config(&self) -> &UniformConfig {
        &self.config
    }

    /// The bins of the translation's x, y, z, metres.
    pub fn translation(&self) -> &[Line; 3] {
        &self.translation
    }

    /// Where a clip's first step in height is measured from, metres.
    pub fn first_height(&self) -> f64 {
        self.first_height
    }

    /// The bins of the rotation vectors.
    pub fn angles(&self) -> Angles {
        Angles::new(self.config.form, self.config.bins)
    }

    pub(crate) fn with_config(self, config: UniformConfig) -> Self {
        Uniform { config, ..self }
    }

    pub(crate) fn validate(&self) -> Result<()> {
        self.config.validate()?;
        for line in &self.translation {
            line.validate(self.config.bins)?;
        }
        (self.first_height.abs() <= FARTHEST).then_some(()).ok_or_else(|| Error::Setting {
            field: "first_height",
            found: self.first_height.to_string(),
            expected: "a height in metres".into(),
        })
    }

    /// One step: the codes of a place, and which of them clipped. Moves the walk to what they decode to.
    fn step(&self, walk: &mut Walk, place: Vec3) -> [(u16, bool); 3] {
        let ahead = walk.turned_in(place - walk.at);
        let (wanted_xz, wanted_y) = (self.pick(ahead, place), if self.absolute_y() { place.y } else { ahead.y });
        let wanted = [wanted_xz.x, wanted_y, wanted_xz.z];
        let coded: [(u16, bool); 3] = std::array::from_fn(|i| self.translation[i].code(wanted[i]));
        self.follow(walk, coded.map(|(k, _)| k));
        coded
    }

    /// Moves the walk by decoded codes.
    fn follow(&self, walk: &mut Walk, codes: [u16; 3]) {
        let value = Vec3::from_array(std::array::from_fn(|i| self.translation[i].value(codes[i])));
        let out = walk.turned_out(value);
        let xz = self.pick(walk.at + out, value);
        let y = if self.absolute_y() { value.y } else { walk.at.y + value.y };
        walk.at = Vec3::new(xz.x, y, xz.z);
    }

    fn pick(&self, velocity: Vec3, absolute: Vec3) -> Vec3 {
        match self.config.translation {
            Travel::Velocity => velocity,
            Travel::Absolute => absolute,
        }
    }

    fn absolute_y(&self) -> bool {
        self.config.height == Travel::Absolute
    }
}

impl Scheme for Uniform {
    fn symbols(&self) -> u32 {
        self.config.bins
    }

    fn frames_per_word(&self) -> usize {
        1
    }

    fn word_length(&self, channels: &Channels) -> WordLength {
        WordLength::Fixed(channels.len())
    }

    fn encode(&self, channels: &Channels, clip: &Clip) -> Result<Encoded> {
        check_places(clip)?;
        let (c, angles) = (channels.len(), self.angles());
        let mut codes = vec![0; clip.frames() * c];
        let mut out = Encoded::default();
        let start = clip.root().first().map_or(Vec3::ZERO, |p| Vec3::new(p.x, 0.0, p.z));
        let mut walk = Walk::new(self.first_height);
        for (f, word) in codes.chunks_exact_mut(c).enumerate() {
            let (head, turns) = word.split_at_mut(3);
            for (i, (code, clipped)) in self.step(&mut walk, clip.root()[f] - start).into_iter().enumerate() {
                head[i] = code;
                out.clipped += u64::from(clipped);
            }
            let pose = clip.pose(f);
            for (&joint, place) in channels.joints().iter().zip(turns.chunks_exact_mut(3)) {
                let (code, second) = angles.code(pose[joint]);
                place.copy_from_slice(&code);
                out.second_codes += u64::from(second);
                if joint == 0 {
                    walk.face(angles.rotation(code));
                }
            }
        }
        out.words = Words::fixed(codes, c);
        Ok(out)
    }

    fn decode(&self, channels: &Channels, words: &Words, fps: f64, rest: Rest<'_>) -> Result<Clip> {
        let frames = words.len();
        let angles = self.angles();
        let mut root = Vec::with_capacity(frames);
        let mut rotations = Vec::with_capacity(frames * 24);
        let mut walk = Walk::new(self.first_height);
        for (f, word) in words.iter().enumerate() {
            self.follow(&mut walk, [word[0], word[1], word[2]]);
            root.push(walk.at);
            rest.fill(f, &mut rotations);
            let pose = &mut rotations[f * 24..];
            for (&joint, k) in channels.joints().iter().zip(word[3..].chunks_exact(3)) {
                pose[joint] = angles.rotation([k[0], k[1], k[2]]);
                if joint == 0 {
                    walk.face(pose[0]);
                }
            }
        }
        Ok(Clip::new(smpl::neutral(), fps, root, rotations)?)
    }

    fn neutral(&self, channels: &Channels) -> Vec<u16> {
        let mut codes = vec![(self.config.bins / 2) as u16; channels.len()];
        for (i, line) in self.translation.iter().enumerate() {
            codes[i] = line.code(if i == 1 && self.absolute_y() { self.first_height } else { 0.0 }).0;
        }
        codes
    }

    fn places(&self, channels: &Channels) -> std::result::Result<Vec<Channel>, String> {
        Ok(channels.iter().collect())
    }

    fn numbers(&self, _: &Channels, word: &[u16], out: &mut Vec<i32>) {
        out.extend(word.iter().map(|&k| i32::from(k)));
    }

    fn fitted_numbers(&self) -> u64 {
        u64::from(self.config.bins) + 7 // a value each; a width and a zero a coordinate, and the first height
    }
}

/// What is learnt from training clips, one after another or in parts that are merged; the order changes nothing.
#[derive(Debug, Clone, PartialEq)]
pub struct UniformFit {
    config: UniformConfig,
    /// Extremes of the steps x, y, z in the decoded heading before, metres. Of y without the first frames.
    low: Vec3,
    high: Vec3,
    first_low: f64,
    first_high: f64,
    /// Sum of the first heights in units of 2^-40 m: whole numbers add up to the same in every order.
    first_sum: i128,
    clips: u64,
}

const UNITS_PER_M: f64 = (1u64 << 40) as f64;

impl UniformFit {
    pub(crate) fn new(config: UniformConfig) -> Self {
        let (low, high) = (Vec3::ZERO, Vec3::ZERO); // who stands still must fit, and frame 0 makes no step in x and z
        UniformFit {
            config,
            low,
            high,
            first_low: f64::INFINITY,
            first_high: f64::NEG_INFINITY,
            first_sum: 0,
            clips: 0,
        }
    }

    /// Learns from one clip, whose pelvis is coded or, if not, decodes to the identity.
    pub(crate) fn add(&mut self, channels: &Channels, clip: &Clip) -> Result<()> {
        check_places(clip)?;
        let Some(first) = clip.root().first() else { return Ok(()) };
        let angles = Angles::new(self.config.form, self.config.bins);
        let turns = channels.joints().first() == Some(&0);
        let mut walk = Walk::new(0.0);
        for (f, pair) in clip.root().windows(2).enumerate() {
            if turns {
                walk.face(angles.rotation(angles.code(clip.pose(f)[0]).0));
            }
            let step = walk.turned_in(pair[1] - pair[0]);
            (self.low, self.high) = (self.low.min(step), self.high.max(step));
        }
        self.first_low = self.first_low.min(first.y);
        self.first_high = self.first_high.max(first.y);
        self.first_sum += (first.y * UNITS_PER_M).round() as i128;
        self.clips += 1;
        Ok(())
    }

    pub(crate) fn merge(&mut self, other: &UniformFit) {
        (self.low, self.high) = (self.low.min(other.low), self.high.max(other.high));
        self.first_low = self.first_low.min(other.first_low);
        self.first_high = self.first_high.max(other.first_high);
        self.first_sum += other.first_sum;
        self.clips += other.clips;
    }

    pub(crate) fn finish(self) -> Result<Uniform> {
        if self.clips == 0 {
            return Err(Error::Nothing("no training clip has a frame".into()));
        }
        let first_height = self.first_sum as f64 / self.clips as f64 / UNITS_PER_M;
        let (mut low, mut high) = (self.low, self.high);
        low.y = low.y.min(self.first_low - first_height);
        high.y = high.y.max(self.first_high - first_height);
        let line = |i: usize| match if i == 1 { self.config.height } else { self.config.translation } {
            Travel::Velocity => Line::fitted(low[i], high[i], self.config.bins),
            Travel::Absolute => self.config.place_line(),
        };
        let translation = [line(0), line(1), line(2)];
        Ok(Uniform { config: self.config, translation, first_height })
    }
}

fn check_places(clip: &Clip) -> Result<()> {
    match clip.root().iter().position(|p| p.abs().max_element() > FARTHEST) {
        None => Ok(()),
        Some(frame) => Err(Error::Frame {
            frame,
            joint: "translation".into(),
            what: format!(
                "{} m is no place of a body; expected less than {FARTHEST} m; is the unit right?",
                clip.root()[frame]
            ),
        }),
    }
}

#[cfg(test)]
#[path = "uniform_tests.rs"]
mod tests;
