//! Lapped tiles: a lapped transform over time, after a transform over the joints in the metric of joint positions.
//!
//! A word is a hop of N frames. The **open** channels (rotation vectors, continuous in time; with `heading_delta` the pelvis's
//! tilt instead of its rotation; the root's height) are transformed so that equal errors of components move the joints equally
//! far, then by [`Lapped`](Transform) over time; coefficients are rounded to multiples of one step. The **closed** channels
//! are the root's ground velocity and rate of turn: `root`. Zeros are run-length coded; numbers that are seldom non-zero in
//! training come last in a word and are dropped when they are zero.
//!
//! **Bound.** Every coefficient of the open channels is off by less than one step, and the transform is orthonormal: over the
//! frames of a clip, including the padding of the last hop, the root mean square of `|W (x - x')|` is below `step sqrt(K)`, K
//! the number of open channels and W the matrix of [`Lapped::weigh`]; a tenth of it is usual. Ground position and turn are off
//! by at most half a step of coefficient 0 in each direction at any time. Nothing clips: numbers take as many characters as
//! they need, up to [`LARGEST`], a root that travels more than a kilometre within one hop.
//!
//! **Reach.** A changed character affects half a hop before and after its own; beyond that it shifts later positions and turns
//! by a constant. The last two words of a clip depend on how it continues.

#[cfg(feature = "fit")]
mod fit;
mod meaning;
mod root;
mod word;

use super::series::{self, open_count};
use super::walk::{Height, check_positions, one_of};
use super::{Encoded, Scheme, UncodedPose, WordLength};
use crate::channel::{Channel, Channels};
use crate::meaning::{Legend, Meaning};
use crate::transform::lapped::Lapped as Transform;
use crate::{Error, Result, Words};
use kinelm_motion::{Clip, Quat, Vec3, smpl};
use serde::{Deserialize, Serialize};

/// The transform over the joints, before that over time. It excludes ground positions and the turn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "type", rename_all = "snake_case", deny_unknown_fields)]
pub enum LappedMix {
    /// None: every channel separately, scaled by its joint's lever arm. A component belongs to one joint.
    None {},
    /// The Karhunen-Loève transform in the metric of joint positions: the directions in which the training motion moves the body
    /// most.
    Klt {},
}

/// Settings of the lapped scheme.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct LappedConfig {
    /// N, frames of a word, 1 to 240. Default 20.
    pub hop: u32,
    /// Quantisation step of a coefficient: its root mean square displacement of the 24 joints in millimetres, 0.01 to 1000. The
    /// mean positional error is 0.6 to 0.9 of it. Default 12.
    pub step_mm: f64,
    /// Rate-distortion weight: the error in steps that saving one bit is worth when a number is rounded to zero, 0 to 0.2; 0 is
    /// plain rounding. Default 0.08, at which a bit saved here costs as much as one saved by a larger step.
    pub thrift: f64,
    /// The transform over the joints. Default klt.
    pub joint_transform: LappedMix,
    /// Distance in metres of extra points around every joint, 0.001 to 1, through which rotations of hands, feet and head count.
    /// Default 0.1.
    pub tip_m: f64,
    /// L: numbers from -L to L take one character, larger ones more. 1 to 10000. Default 30.
    pub levels: u32,
    /// The longest run of zeros of one character, 1 to 1000. Default 40.
    pub runs: u32,
    /// How the height is coded: above the clip's floor (default) or in the world (`absolute`).
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
            (low..=high)
                .contains(&value)
                .then_some(())
                .ok_or_else(|| Error::setting(field, value, format!("{low} to {high}")))
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

/// The largest number; larger ones are clipped and counted.
pub const LARGEST: i32 = 1 << 20;

/// A fitted lapped scheme.
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
    /// Displacement of the joints per radian of turn, metres.
    turn_arm: f64,
    /// Least magnitude of a number that rounds to 1, in thousandths of a step, by frequency and series; smaller ones are zero.
    thresholds: Vec<u16>,
    /// The order of a word's numbers.
    order: Vec<u32>,
}

/// The layout of a word's numbers: for each frequency the open series, the turn, x and z; then the facing.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Layout {
    hop: usize,
    /// Open series; the height is the last.
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

    /// Index of the turn's jump at the hop's first frame; in the first word, the clip's facing.
    fn facing(&self) -> usize {
        self.hop * self.series()
    }
}

/// Offset of the decoded value of non-zero numbers, in steps: the mean of the values rounded to them.
const LIFT: f64 = 0.05;

impl Lapped {
    pub(crate) fn with_config(self, config: LappedConfig) -> Self {
        Lapped { config, ..self }
    }

    /// The components (K) of a difference of open channels: rotation vectors by ascending joint (with a turn, x and z of the
    /// pelvis's tilt), then the root's height. Their length is the displacement of the joints, metres.
    ///
    /// # Panics
    /// When `difference` isn't K long.
    pub fn weigh(&self, difference: &[f64]) -> Vec<f64> {
        assert_eq!(difference.len(), self.mean.len(), "a difference of the open channels");
        let row = |r: &[f64]| r.iter().zip(difference).map(|(a, x)| a * x).sum();
        self.forward.chunks_exact(difference.len()).map(row).collect()
    }

    /// Checks a file's tables against the channels.
    pub(crate) fn validate(&self, channels: &Channels) -> Result<()> {
        self.config.validate()?;
        let layout = Layout::new(&self.config, channels);
        let (k, n) = (layout.open, layout.numbers());
        let lengths = [&self.mean, &self.forward, &self.inverse].map(Vec::len);
        let mut seen = vec![false; n];
        // a permutation: otherwise a number would be written twice or never
        let order = self.order.iter().all(|&i| seen.get_mut(i as usize).is_some_and(|s| !std::mem::replace(s, true)));
        let all = self.mean.iter().chain(&self.forward).chain(&self.inverse);
        let good = lengths == [k, k * k, k * k]
            && all.copied().all(|x| x.abs() < 1e9)
            && (1e-6..1e6).contains(&self.turn_arm)
            && self.thresholds.len() == n
            && self.thresholds.iter().all(|t| (500..=HIGHEST).contains(t));
        (good && order && self.order.len() == n).then_some(()).ok_or_else(|| {
            Error::setting(
                "lapped",
                format!("tables of {lengths:?}, {} and {} numbers", self.thresholds.len(), self.order.len()),
                format!("{k} finite means, two matrices of {k} x {k}, {n} thresholds, an order of {n} numbers"),
            )
        })
    }

    /// Rounds a coefficient in steps; counts it if it is clipped.
    fn round(&self, at: usize, x: f64, clipped: &mut u64) -> i32 {
        let size = x.abs();
        // each larger number costs about 1.5 bits more
        let n = (size + 0.5 - (1.6 * self.config.thrift).min(0.3)).floor();
        // 0 or 1 is decided by the fitted threshold of this number alone
        let n = if n <= 1.0 { f64::from(size >= f64::from(self.thresholds[at]) / 1000.0) } else { n };
        limited(n.copysign(x), clipped)
    }

    /// The numbers of a clip's words, word by word.
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

    /// The components (K, n) of a clip, with its last frame repeated up to n.
    fn components(&self, channels: &Channels, clip: &Clip, n: usize) -> Vec<f64> {
        let mut rows = open_rows(channels, clip, n);
        for (row, mean) in rows.chunks_exact_mut(n).zip(&self.mean) {
            row.iter_mut().for_each(|x| *x -= mean);
        }
        multiply(&self.forward, n, &rows)
    }

    /// The decoded open channels (K, n).
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

/// The largest threshold: a decoded 1 must encode to 1.
const HIGHEST: u16 = 990;

/// Clips a number of steps to [`LARGEST`].
fn limited(n: f64, clipped: &mut u64) -> i32 {
    let largest = f64::from(LARGEST);
    *clipped += u64::from(n.abs() > largest);
    n.clamp(-largest, largest) as i32
}

/// The decoded value of a number, in steps.
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

/// `matrix` (K, K) times `series` (K, n), always summed in the same order.
fn multiply(matrix: &[f64], n: usize, series: &[f64]) -> Vec<f64> {
    let k = series.len() / n.max(1);
    let mut out = vec![0.0; k * n];
    for (row, out) in matrix.chunks_exact(k.max(1)).zip(out.chunks_exact_mut(n.max(1))) {
        // without a transform the matrix is mostly zeros
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
        check_positions(clip)?;
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
        // zeros at a word's end are not written
        Vec::new()
    }

    fn slot_channels(&self, _: &Channels) -> std::result::Result<Vec<Channel>, String> {
        Err("a character of a lapped tile stands for a wave of several joints, or for a run of zeros".into())
    }

    fn legend(&self, channels: &Channels) -> Legend {
        self.legend_of(channels)
    }

    fn meanings(&self, channels: &Channels, word: &[u16]) -> Vec<Meaning> {
        self.meanings_of(channels, word)
    }

    fn numbers(&self, channels: &Channels, word: &[u16], out: &mut Vec<i32>) {
        let start = out.len();
        out.resize(start + Layout::new(&self.config, channels).numbers(), 0);
        self.writing().read(word, &mut out[start..]);
    }

    fn fitted_numbers(&self) -> u64 {
        // thresholds and the forward matrix are used only by the encoder
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
