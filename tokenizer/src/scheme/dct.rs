//! Tiles of a discrete cosine transform: the motion-language thesis's scheme, modelled on JPEG.
//!
//! A clip is split into tiles of L frames. Rotation vectors, continuous in time, are transformed to K components
//! ([`JointTransform`]) and each component by the DCT-II over the tile; the largest coefficients by magnitude are kept and
//! quantised, and zeros are run-length coded. A word is a tile: the root's x, y, z, with `heading_delta` its turn, then the
//! components, each from low to high frequency.
//!
//! The root's path is coded relative to the decoded position and heading at the end of the previous tile; so is its turn. They
//! have no joint transform, their own shares of kept coefficients and their own bins. The clip's last frame pads the last tile.
//!
//! **Bound.** The transform is orthonormal, so over a tile the squared error of the components is that of the coefficients: at
//! most half a bin's width for each kept one, its own magnitude for each other. With `keep` = 1, a given `step` and nothing
//! clipped, every component (and coordinate of the path) is within `step / 2` in root mean square over the tile and within
//! `step sqrt(L / 2)` in any frame; without a joint transform so is every component of a rotation vector (with lever arms, times
//! the arm), and the geodesic error is at most the length of the three errors. The loss of a joint transform, of quantile bins
//! and of a smaller share has no bound; `kinelm tokenizer study` measures it.

use super::bins::Bins;
use super::line::{Line, Scale};
use super::mix::{JointTransform, Mix};
use super::runs::{Part, Runs};
use super::series::{self, Anchor};
use super::walk::{Height, check_height, check_positions, one_of, start};
use super::{Encoded, Scheme, UncodedPose, WordLength};
use crate::channel::{Channel, Channels};
use crate::meaning::{Legend, Meaning, Number, Series, Unit};
use crate::transform::dct::Dct;
use crate::{Error, Result, Words, alphabet};
use kinelm_motion::{Clip, Quat, Vec3, smpl};
use serde::{Deserialize, Serialize};
use std::ops::Range;
use std::sync::OnceLock;

/// How kept coefficients become codes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Quantizer {
    /// Bins of one width.
    Uniform,
    /// Bins with equal numbers of training coefficients.
    #[default]
    Quantile,
}

/// Weights of the joints' rotation vectors.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Steps {
    /// 1 for every joint.
    #[default]
    Equal,
    /// The joint's lever arm in metres: bins are narrower for joints that move more of the body, and a joint
    /// transform works on displacements instead of angles.
    LeverArm,
}

/// Settings of the tiles of a discrete cosine transform.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct DctConfig {
    /// L, frames of a tile, 15 to 120. Default 60.
    pub tile: u32,
    /// The transform over the joints. Default PCA to 24 components.
    pub joint_transform: JointTransform,
    /// The share of coefficients that is kept, above 0, at most 1. Default 0.1. It applies separately to the components, the path
    /// and the turn, with at least one coefficient each.
    pub keep: f64,
    /// Bins, from 2; with `longest_run` at most 21054, the size of the alphabet. Default 360.
    pub bins: u32,
    /// How kept coefficients become codes. Default quantile. Bins are fitted to the kept coefficients of training tiles: one set
    /// for all components, one for the path, one for the turn.
    pub quantizer: Quantizer,
    /// Weights of the joints' rotation vectors. Default equal.
    pub steps: Steps,
    /// Width of the uniform bins, 1e-6 to 10: radians, with lever arms metres; for the path metres. Coefficients beyond the bins
    /// are clipped. Default none: the bins span the training coefficients.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub step: Option<f64>,
    /// The longest run of zeros of one character, from 1. Default 256.
    pub longest_run: u32,
    /// How the height is coded: above the clip's floor (default) or relative to the end of the previous tile.
    pub height: Height,
}

impl Default for DctConfig {
    fn default() -> Self {
        DctConfig {
            tile: 60,
            joint_transform: JointTransform::Pca { components: 24 },
            keep: 0.1,
            bins: 360,
            quantizer: Quantizer::Quantile,
            steps: Steps::Equal,
            step: None,
            longest_run: 256,
            height: Height::Floor,
        }
    }
}

/// The longest tile.
const LONGEST: usize = 120;

impl DctConfig {
    /// Checks every setting.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the setting, its value and its limits.
    pub fn validate(&self) -> Result<()> {
        let refuse = |field, found: String, expected: String| Err(Error::setting(field, found, expected));
        if !(15..=LONGEST as u32).contains(&self.tile) {
            return refuse("tile", self.tile.to_string(), format!("15 to {LONGEST} frames"));
        }
        if !(self.keep > 0.0 && self.keep <= 1.0) {
            return refuse("keep", self.keep.to_string(), "a share above 0, at most 1".into());
        }
        let size = alphabet::SIZE;
        if self.bins < 2 || self.longest_run < 1 || self.bins.saturating_add(self.longest_run) > size {
            let found = format!("{} bins and runs of {}", self.bins, self.longest_run);
            return refuse("bins", found, format!("from 2 bins and runs of 1, together at most {size}"));
        }
        match (self.step, self.quantizer) {
            (Some(step), Quantizer::Uniform) if !(1e-6..=10.0).contains(&step) => {
                return refuse("step", step.to_string(), "1e-6 to 10".into());
            }
            (Some(step), Quantizer::Quantile) => {
                return refuse(
                    "step",
                    step.to_string(),
                    "none with quantizer = \"quantile\", which fits its bins".into(),
                );
            }
            _ => {}
        }
        one_of(self.height, &[Height::Floor, Height::Velocity])?;
        self.joint_transform.validate()
    }

    fn anchor(&self, height: f64) -> Anchor {
        match self.height {
            Height::Velocity => Anchor::new(height),
            _ => Anchor::above_floor(height),
        }
    }

    fn runs(&self) -> Runs {
        Runs::new(self.bins, self.longest_run)
    }

    /// The weight of each open series.
    fn weights(&self, channels: &Channels) -> Option<Vec<f64>> {
        let arms = series::lever_arms();
        let of = |joints: Vec<usize>| joints.into_iter().map(|j| arms[j]).collect();
        (self.steps == Steps::LeverArm).then(|| of(series::open_joints(channels)))
    }

    /// The weight of the turn.
    fn turn_weight(&self) -> f64 {
        if self.steps == Steps::LeverArm { series::lever_arms()[0] } else { 1.0 }
    }
}

/// The bins of a group of coefficients.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case")]
enum Table {
    Uniform(Line),
    Quantile(Bins),
}

/// Smaller coefficients are rounding errors, and zero.
const ZERO: f64 = 1e-9;

impl Table {
    /// Fits bins to kept coefficients of training tiles.
    fn fitted(config: &DctConfig, mut kept: Vec<f64>) -> Table {
        match (config.quantizer, config.step) {
            (Quantizer::Uniform, Some(width)) => {
                Table::Uniform(Line { width, zero: (config.bins / 2) as u16, offset: 0.0, bins: config.bins })
            }
            (Quantizer::Uniform, None) => {
                let low = kept.iter().copied().fold(0.0, f64::min);
                let high = kept.iter().copied().fold(0.0, f64::max);
                Table::Uniform(Line::fitted(low, high, config.bins))
            }
            (Quantizer::Quantile, _) => {
                // zeros are run-length coded, so bins would be wasted on them
                kept.retain(|x| x.abs() >= ZERO);
                kept.sort_by(f64::total_cmp);
                Table::Quantile(if kept.is_empty() { Bins::at_zero() } else { Bins::fitted(&kept, config.bins) })
            }
        }
    }

    /// The code of a coefficient, `None` for zero, and whether it is clipped.
    fn code(&self, value: f64) -> (Option<u16>, bool) {
        let (code, clipped) = match self {
            Table::Uniform(line) => line.code(value),
            Table::Quantile(bins) => bins.code(value),
        };
        ((value.abs() >= ZERO && self.value(code).abs() >= ZERO).then_some(code), clipped)
    }

    fn value(&self, code: u16) -> f64 {
        match self {
            Table::Uniform(line) => line.value(code),
            Table::Quantile(bins) => bins.value(code),
        }
    }

    /// The quantised number for order-0 tables: 0 for zero.
    fn number(&self, code: Option<u16>) -> i32 {
        match (self, code) {
            (_, None) => 0,
            (Table::Uniform(line), Some(code)) => i32::from(code) - i32::from(line.zero),
            (Table::Quantile(_), Some(code)) => i32::from(code) + 1,
        }
    }

    /// Numbers that decoding needs.
    fn numbers(&self) -> u64 {
        match self {
            Table::Uniform(line) => u64::from(line.bins),
            Table::Quantile(bins) => bins.values().len() as u64,
        }
    }

    fn validate(&self, config: &DctConfig) -> Result<()> {
        match (self, config.quantizer) {
            (Table::Uniform(line), Quantizer::Uniform) => line.validate(config.bins),
            (Table::Quantile(bins), Quantizer::Quantile) => bins.validate("coefficients", config.bins),
            _ => Err(Error::setting("quantizer", "bins of the other kind", format!("{:?} bins", config.quantizer))),
        }
    }
}

/// Fitted tiles: the bins of coefficients and the joint transform.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct DctTiles {
    #[serde(skip)]
    config: DctConfig,
    mix: Mix,
    path: Table,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    turn: Option<Table>,
    components: Table,
    /// Mean height of the training clips' first frames, metres: the origin of the first tile.
    first_height: f64,
}

/// Working state of a tile: S closed series and components of L numbers each.
struct Tile<'a> {
    channels: &'a Channels,
    mix: &'a Mix,
    turn_weight: f64,
    dct: &'static Dct,
    /// The last values of the basis functions, which give the last number of a series from its coefficients.
    last: Vec<f64>,
    /// Open series (C, L).
    open: Vec<f64>,
    /// (S, L): the path, the turn, the components; numbers over time or coefficients.
    series: Vec<f64>,
    scratch: Vec<f64>,
    anchor: Anchor,
}

/// The transform of a tile's length.
fn plan(length: usize) -> &'static Dct {
    static PLANS: [OnceLock<Dct>; LONGEST + 1] = [const { OnceLock::new() }; LONGEST + 1];
    PLANS[length].get_or_init(|| Dct::new(length))
}

impl<'a> Tile<'a> {
    fn new(config: &DctConfig, channels: &'a Channels, mix: &'a Mix, height: f64) -> Self {
        let n = config.tile as usize;
        let dct = plan(n);
        let mut scratch = vec![0.0; dct.scratch_len().max(n)];
        // the transform is orthonormal, so the transform of the last unit vector has the basis functions' last values
        let mut last = vec![0.0; n];
        last[n - 1] = 1.0;
        dct.forward(&mut last, &mut scratch);
        Tile {
            channels,
            mix,
            turn_weight: config.turn_weight(),
            dct,
            last,
            open: vec![0.0; series::open_count(channels) * n],
            series: vec![0.0; (series::closed_count(channels) + mix.components()) * n],
            scratch,
            anchor: config.anchor(height),
        }
    }

    fn length(&self) -> usize {
        self.dct.len()
    }

    /// Numbers of the closed series.
    fn closed(&self) -> usize {
        series::closed_count(self.channels) * self.length()
    }

    /// The coefficients of frames of a clip, relative to the anchor.
    fn analyse(&mut self, clip: &Clip, start: Vec3, frames: Range<usize>) {
        let (n, closed) = (self.length(), self.closed());
        series::open(self.channels, clip, frames.clone(), n, &mut self.open);
        let (head, components) = self.series.split_at_mut(closed);
        self.mix.forward(n, &mut self.open, components);
        self.anchor.closed(self.channels, clip, start, frames, n, head);
        head[3 * n..].iter_mut().for_each(|x| *x *= self.turn_weight);
        self.series.chunks_exact_mut(n).for_each(|x| self.dct.forward(x, &mut self.scratch));
    }

    /// Inverts the transform of the coefficients, and the joint transform; moves the anchor to the tile's end.
    ///
    /// Returns the previous anchor, to which the closed series are relative.
    fn synthesise(&mut self) -> Anchor {
        let before = self.anchor;
        self.advance();
        let (n, closed) = (self.length(), self.closed());
        // most series of a tile are all zeros
        for x in self.series.chunks_exact_mut(n).filter(|x| x.iter().any(|x| *x != 0.0)) {
            self.dct.inverse(x, &mut self.scratch);
        }
        let (head, components) = self.series.split_at_mut(closed);
        head[3 * n..].iter_mut().for_each(|x| *x /= self.turn_weight);
        self.mix.inverse(n, components, &mut self.open);
        before
    }

    /// Moves the anchor to the end of the tile of the quantised coefficients, by the same sums in encoder and decoder.
    fn advance(&mut self) {
        let ends =
            |x: &[f64]| -> f64 { x.iter().zip(&self.last).filter(|(x, _)| **x != 0.0).map(|(x, w)| x * w).sum() };
        let mut at: Vec<f64> = self.series.chunks_exact(self.length()).map(ends).collect();
        let (head, components) = at.split_at_mut(series::closed_count(self.channels));
        head[3..].iter_mut().for_each(|x| *x /= self.turn_weight);
        let (place, turn) = self.anchor.apply(self.channels, head, 1, 0);
        let mut pose = [Quat::IDENTITY; 24];
        if self.channels.joints().first() == Some(&0) {
            let mut open = vec![0.0; series::open_count(self.channels)];
            self.mix.inverse(1, components, &mut open);
            series::set_pose(self.channels, turn, &open, 1, 0, &mut pose);
            self.anchor.move_to(place, turn, pose[0]);
        } else {
            self.anchor.move_to(place, turn, Quat::IDENTITY);
        }
    }
}

/// Calls `keep` with the `share` largest coefficients by magnitude, in order; of equal ones the first.
fn largest(coefficients: &[f64], share: f64, sizes: &mut Vec<u64>, mut keep: impl FnMut(usize, f64)) {
    let count = coefficients.len();
    // rounding of the product must not add one: 0.07 of 100 is 7.000000000000001
    let most = ((share * count as f64 - 1e-9).ceil() as usize).clamp(1, count);
    if most == count {
        coefficients.iter().enumerate().for_each(|(i, &x)| keep(i, x));
        return;
    }
    // positive floats have the order of their bits, and integers sort faster
    sizes.clear();
    sizes.extend(coefficients.iter().map(|x| x.abs().to_bits()));
    let (_, &mut least, above) = sizes.select_nth_unstable(count - most);
    // `above` may have more of `least`'s size, so only larger ones are subtracted
    let mut ties = most - above.iter().filter(|&&size| size > least).count();
    for (i, &x) in coefficients.iter().enumerate() {
        let size = x.abs().to_bits();
        if size > least {
            keep(i, x);
        } else if size == least && ties > 0 {
            ties -= 1;
            keep(i, x);
        }
    }
}

impl DctTiles {
    /// Fits to training clips.
    ///
    /// # Errors
    /// [`Error::Nothing`] when no clip has a frame, [`Error::Frame`] for an implausible position.
    #[cfg(feature = "fit")]
    pub(crate) fn fit(config: &DctConfig, channels: &Channels, clips: &[Clip]) -> Result<DctTiles> {
        let clips: Vec<&Clip> = clips.iter().filter(|c| c.frames() > 0).collect();
        clips.iter().try_for_each(|clip| check_positions(clip))?;
        if clips.is_empty() {
            return Err(Error::Nothing("no training clip has a frame".into()));
        }
        let first_height = clips.iter().map(|c| c.root()[0].y).sum::<f64>() / clips.len() as f64;
        let rows = rows(config, channels, &clips);
        let weights = config.weights(channels);
        let mix = Mix::fit(&config.joint_transform, &rows, series::open_count(channels), weights.as_deref())?;
        // the largest array; the pass over the coefficients needs memory of its own
        drop(rows);
        let [path, turn, components] =
            kept(config, channels, &mix, first_height, &clips).map(|x| Table::fitted(config, x));
        let turn = channels.has_turn().then_some(turn);
        Ok(DctTiles { config: config.clone(), mix, path, turn, components, first_height })
    }

    pub(crate) fn with_config(self, config: DctConfig) -> Self {
        DctTiles { config, ..self }
    }

    pub(crate) fn validate(&self, channels: &Channels) -> Result<()> {
        self.config.validate()?;
        self.mix.validate(&self.config.joint_transform, series::open_count(channels))?;
        check_height(self.first_height)?;
        if self.turn.is_some() != channels.has_turn() {
            return Err(Error::setting(
                "turn",
                format!("bins for it: {}", self.turn.is_some()),
                "bins for the turn where, and only where, root_rotation is heading_delta",
            ));
        }
        [Some(&self.path), self.turn.as_ref(), Some(&self.components)]
            .into_iter()
            .flatten()
            .try_for_each(|table| table.validate(&self.config))
    }

    /// The bins of each group of a tile's coefficients.
    fn tables(&self) -> impl Iterator<Item = (Range<usize>, &Table)> {
        let n = self.config.tile as usize;
        groups(n, usize::from(self.turn.is_some()), self.mix.components())
            .into_iter()
            .zip([Some(&self.path), self.turn.as_ref(), Some(&self.components)])
            .filter_map(|(range, table)| Some((range, table?)))
    }

    fn numbers_in_tile(&self, channels: &Channels) -> usize {
        (series::closed_count(channels) + self.mix.components()) * self.config.tile as usize
    }

    /// Quantises a tile's coefficients in place and sets their codes; returns how many are clipped.
    fn quantise(&self, series: &mut [f64], sizes: &mut Vec<u64>, codes: &mut [Option<u16>]) -> u64 {
        let mut clipped = 0;
        codes.fill(None);
        for (range, table) in self.tables() {
            let (own, codes) = (&mut series[range.clone()], &mut codes[range]);
            largest(own, self.config.keep, sizes, |i, x| {
                let (code, outside) = table.code(x);
                codes[i] = code;
                clipped += u64::from(outside);
            });
            own.iter_mut().zip(&*codes).for_each(|(x, code)| *x = code.map_or(0.0, |code| table.value(code)));
        }
        clipped
    }
}

/// The ranges of the path, the turn and the components in a tile's coefficients.
fn groups(n: usize, turns: usize, components: usize) -> [Range<usize>; 3] {
    let closed = 3 + turns;
    [0..3 * n, 3 * n..closed * n, closed * n..(closed + components) * n]
}

/// The ranges of a clip's tiles.
fn tiles(frames: usize, length: usize) -> impl Iterator<Item = Range<usize>> {
    (0..frames).step_by(length).map(move |start| start..frames.min(start + length))
}

/// The open series of all frames, frame by frame (N, C), for fitting a joint transform.
fn rows(config: &DctConfig, channels: &Channels, clips: &[&Clip]) -> Vec<f64> {
    let (n, c) = (config.tile as usize, series::open_count(channels));
    let mut open = vec![0.0; c * n];
    let mut rows = Vec::with_capacity(clips.iter().map(|c| c.frames()).sum::<usize>() * c);
    for clip in clips {
        for frames in tiles(clip.frames(), n) {
            series::open(channels, clip, frames.clone(), n, &mut open);
            rows.extend((0..frames.len()).flat_map(|t| open[t..].iter().step_by(n)));
        }
    }
    rows
}

/// The kept coefficients of training tiles: of the path, the turn, the components. Closed series are relative to the true
/// previous position, which is near the decoded one.
fn kept(config: &DctConfig, channels: &Channels, mix: &Mix, height: f64, clips: &[&Clip]) -> [Vec<f64>; 3] {
    let n = config.tile as usize;
    let (mut out, mut sizes) = ([vec![], vec![], vec![]], vec![]);
    for clip in clips {
        let mut tile = Tile::new(config, channels, mix, height);
        for frames in tiles(clip.frames(), n) {
            tile.analyse(clip, start(clip), frames);
            let groups = groups(n, usize::from(channels.has_turn()), mix.components());
            for (range, out) in groups.into_iter().zip(&mut out).filter(|(range, _)| !range.is_empty()) {
                largest(&tile.series[range], config.keep, &mut sizes, |_, x| out.push(x));
            }
            // by the unquantised end, since no bins exist yet
            tile.advance();
        }
    }
    out
}

impl Scheme for DctTiles {
    fn symbols(&self) -> u32 {
        self.config.runs().symbols()
    }

    fn frames_per_word(&self) -> usize {
        self.config.tile as usize
    }

    fn word_length(&self, channels: &Channels) -> WordLength {
        WordLength::Varying { most: self.numbers_in_tile(channels) }
    }

    fn encode(&self, channels: &Channels, clip: &Clip) -> Result<Encoded> {
        check_positions(clip)?;
        let (n, runs) = (self.config.tile as usize, self.config.runs());
        let mut tile = Tile::new(&self.config, channels, &self.mix, self.first_height);
        let mut codes = vec![None; self.numbers_in_tile(channels)];
        let (mut sizes, mut word, mut out) = (vec![], vec![], Encoded::default());
        for frames in tiles(clip.frames(), n) {
            out.padded += (n - frames.len()) as u64;
            tile.analyse(clip, start(clip), frames);
            out.clipped += self.quantise(&mut tile.series, &mut sizes, &mut codes);
            tile.advance();
            word.clear();
            runs.encode(&codes, &mut word);
            out.words.push(&word);
        }
        Ok(out)
    }

    fn decode(&self, channels: &Channels, words: &Words, fps: f64, rest: UncodedPose<'_>) -> Result<Clip> {
        let (n, runs) = (self.config.tile as usize, self.config.runs());
        let mut tile = Tile::new(&self.config, channels, &self.mix, self.first_height);
        let mut codes = vec![None; self.numbers_in_tile(channels)];
        let mut root = Vec::with_capacity(words.len() * n);
        let mut rotations = Vec::with_capacity(words.len() * n * 24);
        for word in words.iter() {
            runs.decode(word, &mut codes);
            for (range, table) in self.tables() {
                let own = tile.series[range.clone()].iter_mut().zip(&codes[range]);
                own.for_each(|(x, code)| *x = code.map_or(0.0, |code| table.value(code)));
            }
            let before = tile.synthesise();
            for t in 0..n {
                let (place, turn) = before.apply(channels, &tile.series, n, t);
                rest.fill(root.len(), &mut rotations);
                let pose = rotations.len() - 24;
                series::set_pose(channels, turn, &tile.open, n, t, &mut rotations[pose..]);
                root.push(place);
            }
        }
        Ok(Clip::new(smpl::neutral(), fps, root, rotations)?)
    }

    fn neutral(&self, _: &Channels) -> Vec<u16> {
        Vec::new()
    }

    fn slot_channels(&self, _: &Channels) -> std::result::Result<Vec<Channel>, String> {
        Err("a character of a tile affects all its frames, and its slot in the word varies".into())
    }

    fn legend(&self, channels: &Channels) -> Legend {
        let unit = if self.config.steps == Steps::LeverArm { Unit::Metres } else { Unit::Radians };
        let closed = series::closed_count(channels);
        let of_root = |(i, channel)| Series::of(channel, "", if i < 3 { Unit::Metres } else { Unit::Radians });
        let mut all: Vec<Series> = channels.iter().take(closed).enumerate().map(of_root).collect();
        match self.mix.mixes() {
            true => all.extend(self.mix.series(&series::open_joints(channels), unit)),
            false => all.extend(channels.iter().skip(closed).map(|channel| Series::of(channel, "", Unit::Radians))),
        }
        let n = self.config.tile as usize;
        let numbers = (0..all.len() * n).map(|i| Number { series: i / n, coefficient: Some(i % n) }).collect();
        Legend { word: "tile", series: all, numbers }
    }

    fn meanings(&self, channels: &Channels, word: &[u16]) -> Vec<Meaning> {
        let (n, runs, most) = (self.config.tile as usize, self.config.runs(), self.numbers_in_tile(channels));
        let closed = series::closed_count(channels);
        let per_unit = |series: usize| match series {
            0..3 => 1.0,
            _ if series < closed => self.config.turn_weight(),
            _ if self.mix.mixes() => 1.0,
            _ => self.mix.weight(series - closed),
        };
        let value = |number: usize, code| {
            let table = self.tables().find(|(range, _)| range.contains(&number)).map(|(_, table)| table)?;
            // the transform is orthonormal: over the tile, a coefficient's mean square is its own square by L
            let value = table.value(code) / (n as f64).sqrt() / per_unit(number / n);
            Some(Meaning::Value { number, value })
        };
        let mut at = 0;
        let meaning = |&code: &u16| {
            let place = at;
            match runs.part(code) {
                Part::Value(code) => {
                    at += 1;
                    value(place, code).unwrap_or(Meaning::Nothing)
                }
                Part::Zeros(count) => {
                    at += count;
                    Meaning::zeros(place, count, most)
                }
            }
        };
        word.iter().map(meaning).collect()
    }

    fn numbers(&self, channels: &Channels, word: &[u16], out: &mut Vec<i32>) {
        let mut codes = vec![None; self.numbers_in_tile(channels)];
        self.config.runs().decode(word, &mut codes);
        for (range, table) in self.tables() {
            out.extend(codes[range].iter().map(|&code| table.number(code)));
        }
    }

    fn fitted_numbers(&self) -> u64 {
        self.mix.numbers() + self.tables().map(|(_, table)| table.numbers()).sum::<u64>() + 1
    }
}

#[cfg(test)]
#[path = "dct_tests.rs"]
mod tests;
