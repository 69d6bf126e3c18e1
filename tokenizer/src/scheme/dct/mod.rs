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

mod config;
mod meaning;
mod table;
#[cfg(test)]
mod tests;
mod tile;

pub use config::{DctConfig, Quantizer, Steps};

use super::mix::Mix;
use super::series;
use super::walk::{check_height, check_positions, start};
use super::{Encoded, Scheme, UncodedPose, WordLength};
use crate::channel::{Channel, Channels};
use crate::meaning::{Legend, Meaning};
use crate::{Error, Result, Words};
use kinelm_motion::{Clip, smpl};
use serde::{Deserialize, Serialize};
use std::ops::Range;
use table::Table;
use tile::Tile;

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
        self.legend_of(channels)
    }

    fn meanings(&self, channels: &Channels, word: &[u16]) -> Vec<Meaning> {
        self.meanings_of(channels, word)
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
