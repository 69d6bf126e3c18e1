//! Lapped tiles: a transform whose waves run into the neighbouring tiles, over channels mixed by what they move.
//!
//! A word is a hop of N frames. The **open** channels (rotation vectors, continuous in time; with `heading_delta` the
//! pelvis's tilt for its rotation; the root's height) are mixed over the joints so that an error of a component moves the
//! body's joints equally far whichever component it is in, then go through [`Lapped`](Transform) over time; every
//! coefficient is rounded to whole steps of one size. The **closed** ones are the root's velocity on the ground and the
//! rate of its turn: `root`. Numbers that are zero are counted in runs, in an order in which those that were seldom
//! non-zero in training come last, and fall away at the word's end.
//!
//! **Bound.** Every coefficient of the open channels is off by less than one step, and the transform keeps lengths: over
//! the frames of a clip (those that fill the last hop with them), the root mean square of `|W (x - x')|` is below
//! `step sqrt(K)`, K the number of open channels and W the matrix of [`Lapped::weigh`]; a tenth of it is usual. On the ground,
//! and as a turn, the sum of all hops' steps is off by at most half a step of their coefficient 0 in each direction, at
//! any time: errors never add up. Nothing clips: a number has as many characters as it needs, up to [`LARGEST`], which is
//! beyond a root that travels a kilometre within one hop.
//!
//! **Reach.** A changed character changes half a hop before its own and half a hop behind; beyond that nothing in the open
//! channels, and what follows in place and turn by a constant. The last two words of a clip would read otherwise if it
//! went on.

#[cfg(feature = "fit")]
mod fit;
mod root;
mod word;

use super::series::{self, open_count};
use super::walk::{Height, check_places, one_of};
use super::{Encoded, Scheme, UncodedPose, WordLength};
use crate::channel::{Channel, Channels};
use crate::transform::lapped::Lapped as Transform;
use crate::{Error, Result, Words};
use kinelm_motion::{Clip, Quat, Vec3, smpl};
use serde::{Deserialize, Serialize};

/// What is done over the joint dimension before the transform. The places on the ground and the turn stay out of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum LappedMix {
    /// Every channel by itself, in proportion to how far it moves the joints that hang on it: its lever arm. A component
    /// belongs to one joint.
    None {},
    /// Channels that move the same joints are weighed together, and turned onto the directions in which the training motion
    /// moves the body most (Karhunen and Loeve's transform in the metric of joint positions).
    Klt {},
}

/// Settings of the lapped scheme.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LappedConfig {
    /// N, frames that a word stands for, 1 to 240. Default 20.
    pub hop: u32,
    /// The step of a coefficient, millimetres that it moves the 24 joints (root mean square), 0.01 to 1000. The mean
    /// positional error is 0.6 to 0.9 of it. Default 12.
    pub step_mm: f64,
    /// How eagerly a number that is seldom non-zero becomes zero, in steps of error a bit, 0 to 0.2; 0 rounds plainly. Default
    /// 0.08, where a bit saved here costs as much as one saved by a larger step.
    pub thrift: f64,
    /// What is done over the joint dimension. Default klt.
    pub joint_transform: LappedMix,
    /// Every joint also carries a point so far off in each direction, metres, 0.001 to 1: what rotations of hands, feet and head
    /// count, on which no joint hangs. Default 0.1.
    pub tip_m: f64,
    /// L: numbers of -L to L have one character, larger ones more. 1 to 10000. Default 30.
    pub levels: u32,
    /// A run of up to so many zeros is one character, 1 to 1000. Default 40.
    pub runs: u32,
    /// How the height is told: above the clip's floor (default) or as it is in the world (`absolute`).
    pub height: Height,
}

impl Default for LappedConfig {
    fn default() -> Self {
        LappedConfig {
            hop: 20,
            step_mm: 12.0,
            thrift: 0.08,
            joint_transform: LappedMix::Klt {},
            tip_m: 0.1,
            levels: 30,
            runs: 40,
            height: Height::Floor,
        }
    }
}

impl LappedConfig {
    /// Checks every setting.
    ///
    /// # Errors
    /// [`Error::Setting`] naming the setting, its value and its limits.
    pub fn validate(&self) -> Result<()> {
        let within = |field, value: f64, low: f64, high: f64| {
            (low..=high).contains(&value).then_some(()).ok_or_else(|| Error::Setting {
                field,
                found: value.to_string(),
                expected: format!("{low} to {high}"),
            })
        };
        within("hop", self.hop.into(), 1.0, 240.0)?;
        within("step_mm", self.step_mm, 0.01, 1000.0)?;
        within("thrift", self.thrift, 0.0, 0.2)?;
        within("tip_m", self.tip_m, 0.001, 1.0)?;
        within("levels", self.levels.into(), 1.0, 10_000.0)?;
        within("runs", self.runs.into(), 1.0, 1000.0)?;
        one_of(self.height, &[Height::Floor, Height::Absolute])
    }

    /// The step of a coefficient, metres.
    fn step(&self) -> f64 {
        self.step_mm / 1000.0
    }
}

/// The largest number; what lies beyond is counted as clipped.
pub const LARGEST: i32 = 1 << 20;

/// Lapped tiles with what was learnt.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Lapped {
    #[serde(skip)]
    config: LappedConfig,
    /// (K) mean of the open channels.
    mean: Vec<f64>,
    /// (K, K) from channels to components.
    forward: Vec<f64>,
    /// (K, K) back.
    inverse: Vec<f64>,
    /// What a radian of the turn moves the joints, metres.
    turn_arm: f64,
    /// From which size on a number that rounds to 1 isn't zero, in thousandths of a step; by frequency and series.
    thresholds: Vec<u16>,
    /// The numbers of a word in the order they are written.
    order: Vec<u32>,
}

/// Where the numbers of a word stand: by frequency, of each the open series, the turn's, x's and z's; then the facing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Layout {
    hop: usize,
    /// Open series, the height's among them as the last.
    open: usize,
    turn: bool,
}

impl Layout {
    fn new(config: &LappedConfig, channels: &Channels) -> Self {
        Layout { hop: config.hop as usize, open: open_count(channels) + 1, turn: channels.has_turn() }
    }

    /// Series, open and closed.
    fn series(&self) -> usize {
        self.open + 2 + usize::from(self.turn)
    }

    fn numbers(&self) -> usize {
        self.hop * self.series() + usize::from(self.turn)
    }

    fn at(&self, frequency: usize, series: usize) -> usize {
        frequency * self.series() + series
    }

    /// The series of the turn, if there is one, and those of x and z.
    fn closed(&self) -> (usize, [usize; 2]) {
        let ground = self.open + usize::from(self.turn);
        (self.open, [ground, ground + 1])
    }

    /// The number of the step of the turn at the hop's first frame: in the first word, where a clip faces.
    fn facing(&self) -> usize {
        self.hop * self.series()
    }
}

/// Where a number that isn't zero decodes beyond the whole, in steps: the middle of what is rounded to it, weighed by how
/// often it comes.
const LIFT: f64 = 0.05;

impl Lapped {
    /// The settings.
    pub fn config(&self) -> &LappedConfig {
        &self.config
    }

    pub(crate) fn with_config(self, config: LappedConfig) -> Self {
        Lapped { config, ..self }
    }

    /// The components of a difference of open channels, (K): rotation vectors by ascending joint (with a turn the pelvis's
    /// tilt x, z for its vector), then the root's height. Their length is how far the joints move, metres.
    ///
    /// # Panics
    /// When `difference` isn't K long.
    pub fn weigh(&self, difference: &[f64]) -> Vec<f64> {
        assert_eq!(difference.len(), self.mean.len(), "a difference of the open channels");
        let row = |r: &[f64]| r.iter().zip(difference).map(|(a, x)| a * x).sum();
        self.forward.chunks_exact(difference.len()).map(row).collect()
    }

    /// Checks what a file says, of which these channels are coded.
    pub(crate) fn validate(&self, channels: &Channels) -> Result<()> {
        self.config.validate()?;
        let layout = Layout::new(&self.config, channels);
        let (k, n) = (layout.open, layout.numbers());
        let lengths = [&self.mean, &self.forward, &self.inverse].map(Vec::len);
        let mut seen = vec![false; n];
        let order = self.order.iter().all(|&i| seen.get_mut(i as usize).is_some_and(|s| !std::mem::replace(s, true)));
        let all = self.mean.iter().chain(&self.forward).chain(&self.inverse);
        let good = lengths == [k, k * k, k * k]
            && all.copied().all(|x| x.abs() < 1e9)
            && (1e-6..1e6).contains(&self.turn_arm)
            && self.thresholds.len() == n
            && self.thresholds.iter().all(|t| (500..=HIGHEST).contains(t));
        (good && order && self.order.len() == n).then_some(()).ok_or_else(|| Error::Setting {
            field: "lapped",
            found: format!("tables of {lengths:?}, {} and {} numbers", self.thresholds.len(), self.order.len()),
            expected: format!("{k} finite means, two matrices of {k} x {k}, {n} thresholds, an order of {n} numbers"),
        })
    }

    /// A coefficient in steps as a number; a clipped one is counted.
    fn round(&self, at: usize, x: f64, clipped: &mut u64) -> i32 {
        let size = x.abs();
        // a bit and a half more for every whole number further, about
        let n = (size + 0.5 - (1.6 * self.config.thrift).min(0.3)).floor();
        let n = if n <= 1.0 { f64::from(size >= f64::from(self.thresholds[at]) / 1000.0) } else { n };
        limited(n.copysign(x), clipped)
    }

    /// The numbers of a clip's words, one word's after the other's.
    fn quantise(&self, channels: &Channels, clip: &Clip, clipped: &mut u64) -> Vec<i32> {
        let layout = Layout::new(&self.config, channels);
        let tiles = clip.frames().div_ceil(layout.hop);
        let mut numbers = vec![0; tiles * layout.numbers()];
        if tiles == 0 {
            return numbers;
        }
        let n = tiles * layout.hop;
        let transform = Transform::new(layout.hop);
        let mut scratch = vec![0.0; transform.scratch_len()];
        let mut components = self.components(channels, clip, n);
        for (s, series) in components.chunks_exact_mut(n).enumerate() {
            transform.forward(series, &mut scratch);
            for (t, x) in series.iter().enumerate() {
                let at = layout.at(t % layout.hop, s);
                numbers[t / layout.hop * layout.numbers() + at] = self.round(at, x / self.config.step(), clipped);
            }
        }
        root::Root::new(self, channels).encode(clip, &mut numbers, clipped);
        numbers
    }

    /// The components (K, n) of a clip, whose last frame goes on up to n.
    fn components(&self, channels: &Channels, clip: &Clip, n: usize) -> Vec<f64> {
        let mut rows = open_rows(channels, clip, n);
        for (row, mean) in rows.chunks_exact_mut(n).zip(&self.mean) {
            row.iter_mut().for_each(|x| *x -= mean);
        }
        multiply(&self.forward, n, &rows)
    }

    /// The open channels (K, n) that numbers decode to.
    fn channels_of(&self, layout: Layout, numbers: &[i32]) -> Vec<f64> {
        let n = numbers.len() / layout.numbers() * layout.hop;
        let transform = Transform::new(layout.hop);
        let mut scratch = vec![0.0; transform.scratch_len()];
        let mut components = vec![0.0; layout.open * n];
        for (s, series) in components.chunks_exact_mut(n.max(1)).enumerate() {
            for (t, x) in series.iter_mut().enumerate() {
                let number = numbers[t / layout.hop * layout.numbers() + layout.at(t % layout.hop, s)];
                *x = lifted(number) * self.config.step();
            }
            transform.inverse(series, &mut scratch);
        }
        let mut rows = multiply(&self.inverse, n, &components);
        for (row, mean) in rows.chunks_exact_mut(n.max(1)).zip(&self.mean) {
            row.iter_mut().for_each(|x| *x += mean);
        }
        rows
    }

    fn writing(&self) -> word::Writing<'_> {
        word::Writing::new(self.config.levels, self.config.runs, &self.order)
    }
}

/// The largest threshold: what decodes to 1 must be coded as 1 again.
const HIGHEST: u16 = 990;

/// A number of whole steps within [`LARGEST`].
fn limited(n: f64, clipped: &mut u64) -> i32 {
    let largest = f64::from(LARGEST);
    *clipped += u64::from(n.abs() > largest);
    n.clamp(-largest, largest) as i32
}

/// What a number decodes to, in steps.
fn lifted(number: i32) -> f64 {
    f64::from(number) + LIFT * f64::from(number.signum())
}

/// The open channels (K, n) of a clip: those of [`series::open`], and the height.
fn open_rows(channels: &Channels, clip: &Clip, n: usize) -> Vec<f64> {
    let open = open_count(channels);
    let mut rows = vec![0.0; (open + 1) * n];
    series::open(channels, clip, 0..clip.frames(), n, &mut rows[..open * n]);
    let last = clip.frames() - 1;
    for (t, y) in rows[open * n..].iter_mut().enumerate() {
        *y = clip.root()[t.min(last)].y;
    }
    rows
}

/// `matrix` (K, K) times `series` (K, n), always in the same order of additions.
fn multiply(matrix: &[f64], n: usize, series: &[f64]) -> Vec<f64> {
    let k = series.len() / n.max(1);
    let mut out = vec![0.0; k * n];
    for (row, out) in matrix.chunks_exact(k.max(1)).zip(out.chunks_exact_mut(n.max(1))) {
        // a matrix of one joint's channels alone is mostly zeros
        for (&weight, x) in row.iter().zip(series.chunks_exact(n.max(1))).filter(|(w, _)| **w != 0.0) {
            out.iter_mut().zip(x).for_each(|(o, x)| *o += weight * x);
        }
    }
    out
}

impl Scheme for Lapped {
    fn symbols(&self) -> u32 {
        self.writing().symbols()
    }

    fn frames_per_word(&self) -> usize {
        self.config.hop as usize
    }

    fn word_length(&self, channels: &Channels) -> WordLength {
        WordLength::Varying { most: Layout::new(&self.config, channels).numbers() * self.writing().most_characters() }
    }

    fn encode(&self, channels: &Channels, clip: &Clip) -> Result<Encoded> {
        check_places(clip)?;
        let mut clipped = 0;
        let numbers = self.quantise(channels, clip, &mut clipped);
        let (mut words, mut word) = (Words::new(), Vec::new());
        for tile in numbers.chunks_exact(Layout::new(&self.config, channels).numbers()) {
            word.clear();
            self.writing().write(tile, &mut word);
            words.push(&word);
        }
        let padded = (words.len() * self.frames_per_word() - clip.frames()) as u64;
        Ok(Encoded { words, clipped, padded, ..Encoded::default() })
    }

    fn decode(&self, channels: &Channels, words: &Words, fps: f64, rest: UncodedPose<'_>) -> Result<Clip> {
        let layout = Layout::new(&self.config, channels);
        let mut numbers = vec![0; words.len() * layout.numbers()];
        for (word, tile) in words.iter().zip(numbers.chunks_exact_mut(layout.numbers())) {
            self.writing().read(word, tile);
        }
        let n = words.len() * layout.hop;
        let rows = self.channels_of(layout, &numbers);
        let (open, height) = rows.split_at((layout.open - 1) * n);
        let (turn, ground) = root::Root::new(self, channels).decode(&numbers);
        let mut root = Vec::with_capacity(n);
        let mut rotations: Vec<Quat> = Vec::with_capacity(n * smpl::NAMES.len());
        for t in 0..n {
            root.push(Vec3::new(ground[t].0, height[t], ground[t].1));
            let start = rotations.len();
            rest.fill(t, &mut rotations);
            series::set_pose(channels, turn.get(t).copied().unwrap_or(0.0), open, n, t, &mut rotations[start..]);
        }
        Ok(Clip::new(smpl::neutral(), fps, root, rotations)?)
    }

    fn neutral(&self, _: &Channels) -> Vec<u16> {
        Vec::new()
    }

    fn slot_channels(&self, _: &Channels) -> std::result::Result<Vec<Channel>, String> {
        Err("a character of a lapped tile stands for a wave of several joints, or for a run of zeros".into())
    }

    fn numbers(&self, channels: &Channels, word: &[u16], out: &mut Vec<i32>) {
        let start = out.len();
        out.resize(start + Layout::new(&self.config, channels).numbers(), 0);
        self.writing().read(word, &mut out[start..]);
    }

    fn fitted_numbers(&self) -> u64 {
        // thresholds and the matrix forward are the encoder's alone
        (self.mean.len() + self.inverse.len() + 1 + self.order.len()) as u64
    }

    fn reach(&self) -> usize {
        self.config.hop as usize / 2
    }

    fn unsettled_words(&self) -> usize {
        if self.config.hop == 1 { 0 } else { 2 }
    }
}

#[cfg(test)]
mod tests;
