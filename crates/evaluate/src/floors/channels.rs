//! Static floors: bits per frame of models without a network, fitted on train, measured on test.
//!
//! The models of the project's reference (order0.py), channel by channel; the space is certain and costs nothing:
//!
//! - a: order 0, add-one counts;
//! - b: order 0 of the difference to the frame before, modulo the bins, add-one counts;
//! - c: kernel mixture around the bin of the frame before;
//! - d: kernel mixture around the linear extrapolation of the last two, alone and together with c's;
//! - e: d and the order-0 histogram, with weights of their own for each size of the last step.
//!
//! A clip's first frame has no past and is coded by a in every model; its second is coded by a, b and c in theirs, by c
//! in d and e.

use super::codes::{CodeClips, CodeSplits};
use super::forecast::ForecastFloor;
use super::kernels::{Histogram, KERNELS, Kernels, LEAST_CASES, bits, distinct, fit};
use crate::{Error, Result};
use rayon::prelude::*;
use serde_json::{Map, Value, json};
use std::fmt;

/// The names of [`MODELS`] in tables.
const ROWS: [&str; 6] = [
    "order 0",
    "difference to the previous frame",
    "around the previous frame",
    "around the extrapolated frame",
    "both mixed",
    "both and order 0, by last step",
];

/// The static models, in the order of their names, as JSON has them.
pub const MODELS: [&str; 6] = ["a_order0", "b_delta", "c_prev", "d_extrap_only", "d_mix", "e_mix_by_activity"];

/// Lower bounds of the sizes of a last step that have weights of their own: 0 | 1 | 2 | 3-4 | 5-8 | 9-16 | 17 and more.
const ACTIVITY: [u32; 6] = [1, 2, 3, 5, 9, 17];

/// The floors of a corpus.
#[derive(Debug, Clone, PartialEq)]
pub struct ChannelFloors {
    /// Number of bins.
    pub bins: usize,
    /// C.
    pub channels: usize,
    /// Clips and frames that the tables and weights were fitted on.
    pub train: [usize; 2],
    /// Clips and frames that the bits were measured on.
    pub test: [usize; 2],
    /// Frames that both splits have, where these are a sample of them.
    pub of: [usize; 2],
    /// Bits per frame of each of `MODELS`, all test frames.
    pub bits_per_frame: [f64; 6],
    /// The same over the frames that have two before them; `None` where there are none.
    pub from_third_frame: Option<[f64; 6]>,
    /// The first figure by channel, for each model: (C).
    pub by_channel: [Vec<f64>; 6],
    /// Weight of the extrapolation in d: (C).
    pub weight_on_extrapolation: Vec<f64>,
    /// Bits of every test code, clip by clip (F, C), of the last static model and of the forecast's floor; empty where they
    /// weren't asked for, only a sample was measured, or characters were merged.
    pub(crate) by_code: [Vec<Vec<f32>>; 2],
    /// The forecast's floor, which isn't static: it learns from other channels. `None` where characters were merged.
    pub forecast: Option<ForecastFloor>,
}

impl ChannelFloors {
    /// Fits the static models on `codes.train` and measures them on `codes.test`.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Missing`] when a split has no frame, or the codes are no whole frames of bins below `codes.bins`, of which
    /// there are 2 to 65,536.
    pub fn measure(codes: &CodeSplits) -> Result<ChannelFloors> {
        ChannelFloors::measure_each(codes, false)
    }

    /// The same; also keeps the bits of every code, if `each` and where the codes are those of the whole split.
    ///
    /// # Errors
    /// As [`ChannelFloors::measure`].
    pub(crate) fn measure_each(codes: &CodeSplits, each: bool) -> Result<ChannelFloors> {
        check(codes)?;
        let &CodeSplits { bins, channels, .. } = codes;
        let kernels = Kernels::new(bins);
        let order0: Vec<Histogram> =
            (0..channels).map(|c| Histogram::fit(bins, column(&codes.train, channels, c))).collect();
        let is_whole = codes.of[1] * channels == codes.test.iter().map(Vec::len).sum::<usize>();
        let keeps = each && is_whole && !codes.places.is_empty();
        let costs: Vec<ChannelCost> = (0..channels)
            .into_par_iter()
            .map(|c| {
                let models = ChannelModels::fit(&kernels, &order0[c], &Series::of(&codes.train, channels, c));
                models.cost(&codes.test, (channels, c), keeps)
            })
            .collect();
        let size = |clips: &CodeClips| [clips.len(), clips.iter().map(Vec::len).sum::<usize>() / channels];
        let test = size(&codes.test);
        let later: usize = codes.test.iter().map(|c| (c.len() / channels).saturating_sub(2)).sum();
        let by_channel: [Vec<f64>; 6] =
            std::array::from_fn(|m| costs.iter().map(|c| (c.early[m] + c.later[m]) / test[1] as f64).collect());
        // 0 / 0 where no clip has a third frame; `then_some` drops it below
        let from_third = std::array::from_fn(|m| costs.iter().map(|c| c.later[m]).sum::<f64>() / later as f64);
        let (forecast, by_forecast) = match codes.places.is_empty() {
            true => (None, Vec::new()),
            false => {
                let (floor, by_slot) = ForecastFloor::measure(codes, (&kernels, &order0), keeps);
                (Some(floor), clips_of(&codes.test, by_slot))
            }
        };
        Ok(ChannelFloors {
            bins,
            channels,
            train: size(&codes.train),
            test,
            of: codes.of,
            bits_per_frame: std::array::from_fn(|m| by_channel[m].iter().sum()),
            from_third_frame: (later > 0).then_some(from_third),
            by_channel,
            weight_on_extrapolation: costs.iter().map(|c| c.weight_on_extrapolation).collect(),
            by_code: [clips_of(&codes.test, costs.into_iter().map(|cost| cost.codes).collect()), by_forecast],
            forecast,
        })
    }

    /// C times log2 of the bins: a code without any model.
    pub fn uniform(&self) -> f64 {
        self.channels as f64 * (self.bins as f64).log2()
    }

    /// The lowest of the static models.
    pub fn best(&self) -> f64 {
        self.bits_per_frame.into_iter().fold(f64::INFINITY, f64::min)
    }

    /// The figures under the keys of the reference's `order0.json`.
    pub(crate) fn to_json(&self) -> Value {
        let named = |values: &[f64; 6]| -> Map<String, Value> {
            MODELS.iter().zip(values).map(|(m, v)| ((*m).to_owned(), json!(v))).collect()
        };
        let mut all = named(&self.bits_per_frame);
        all.insert("uniform".into(), json!(self.uniform()));
        let by_channel: Map<String, Value> =
            MODELS.iter().zip(&self.by_channel).map(|(m, v)| ((*m).to_owned(), json!(v))).collect();
        let mut line = json!({
            "schema": 1,
            "bins": self.bins,
            "channels": self.channels,
            "clips": { "train": self.train[0], "test": self.test[0] },
            "frames": { "train": self.train[1], "test": self.test[1] },
            "bits_per_frame": all,
            "bits_per_frame_from_third_frame": self.from_third_frame.as_ref().map(named),
            "bits_per_character": by_channel,
            "d_mix_weight_on_extrapolation": self.weight_on_extrapolation,
            "forecast": self.forecast.map(|f| json!({ "bits_per_frame": f.bits_per_frame, "from_third_frame": f.from_third_frame })),
        });
        if let Some(of) = sampled([self.train[1], self.test[1]], self.of) {
            line["frames_of"] = json!({ "train": of[0], "test": of[1] });
        }
        line
    }
}

impl fmt::Display for ChannelFloors {
    /// A table, a row a model, without a line end after the last.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ([tc, tf], [mc, mf]) = (self.train, self.test);
        writeln!(f, "fitted on {tc} clips, {tf} frames; measured on {mc} clips, {mf} frames")?;
        fmt_sample(f, [tf, mf], self.of)?;
        write!(f, "{}", row("bits/frame", "all frames", "from the third"))?;
        write!(f, "\n{}", figure_row("uniform", self.uniform(), None))?;
        for (i, name) in ROWS.iter().enumerate() {
            write!(f, "\n{}", figure_row(name, self.bits_per_frame[i], self.from_third_frame.map(|t| t[i])))?;
        }
        if let Some(floor) = self.forecast {
            write!(f, "\n{}", figure_row("around a linear forecast", floor.bits_per_frame, floor.from_third_frame))?;
        }
        Ok(())
    }
}

/// The frames there are, where more than the `taken` ones.
pub(super) fn sampled(taken: [usize; 2], of: [usize; 2]) -> Option<[usize; 2]> {
    (taken != of).then_some(of)
}

/// A line that says that a sample was taken, if it was.
pub(super) fn fmt_sample(f: &mut fmt::Formatter<'_>, taken: [usize; 2], of: [usize; 2]) -> fmt::Result {
    match sampled(taken, of) {
        Some([train, test]) => {
            writeln!(f, "measured on a sample in stretches, of {train} and of {test} frames")
        }
        None => Ok(()),
    }
}

/// A row of a table of bits per frame; a model's own figure may stand below the floors in the same columns.
pub(crate) fn figure_row(name: &str, all: f64, from_third: Option<f64>) -> String {
    row(name, &format!("{all:.2}"), &from_third.map_or(String::new(), |t| format!("{t:.2}")))
}

fn row(name: &str, all: &str, from_third: &str) -> String {
    format!("{name:<32} {all:>12} {from_third:>16}").trim_end().to_owned()
}

fn check(codes: &CodeSplits) -> Result<()> {
    let &CodeSplits { bins, channels, .. } = codes;
    if !(2..=1 << 16).contains(&bins) || channels == 0 {
        return Err(Error::invalid(
            "the codes' shape",
            format!("{channels} channels of {bins} bins"),
            "at least 1 channel and 2 to 65536 bins",
        ));
    }
    for (split, clips) in [("train", &codes.train), ("test", &codes.test)] {
        if clips.iter().all(Vec::is_empty) {
            let help = "static floors are fitted on train and measured on another split";
            return Err(Error::missing(format!("frame in the {split} split"), help));
        }
        for (i, clip) in clips.iter().enumerate() {
            if !clip.len().is_multiple_of(channels) {
                let found = format!("{} codes", clip.len());
                return Err(Error::invalid(format!("{split} clip {i}"), found, format!("frames of {channels}")));
            }
            if let Some(at) = clip.iter().position(|&c| usize::from(c) >= bins) {
                let (frame, code) = (at / channels, clip[at]);
                let name = format!("{split} clip {i}, frame {frame}, the code");
                return Err(Error::invalid(name, code, format!("below {bins}")));
            }
        }
    }
    Ok(())
}

/// One channel of all clips, by how much past a frame has.
struct Series {
    first: Vec<u32>,       // of every clip
    second: Vec<[u32; 2]>, // of every clip: the code, the one before
    later: Vec<[u32; 3]>,  // all others: the code, the one before, the one before that
}

impl Series {
    fn of(clips: &CodeClips, channels: usize, channel: usize) -> Self {
        let mut s = Series { first: Vec::new(), second: Vec::new(), later: Vec::new() };
        for clip in clips {
            let codes: Vec<u32> = clip.iter().skip(channel).step_by(channels).map(|&c| c.into()).collect();
            s.first.extend(codes.first());
            s.second.extend(codes.get(..2).map(|w| [w[1], w[0]]));
            s.later.extend(codes.windows(3).map(|w| [w[2], w[1], w[0]]));
        }
        s
    }

    /// (code, the one before) of every frame that has one.
    fn pairs(&self) -> impl Iterator<Item = (u32, u32)> + '_ {
        self.second.iter().map(|s| (s[0], s[1])).chain(self.later.iter().map(|l| (l[0], l[1])))
    }
}

struct ChannelCost {
    early: [f64; 6], // bits of all first and second frames
    later: [f64; 6], // bits of all others
    weight_on_extrapolation: f64,
    codes: Vec<f32>, // bits of every code under the last model, where they are kept
}

/// The static models of a channel.
struct ChannelModels<'a> {
    kernels: &'a Kernels,
    order0: &'a Histogram,
    delta: Histogram,
    previous: [f64; KERNELS],
    extrapolated: [f64; KERNELS],
    mixed: [f64; 2 * KERNELS],
    by_size: [[f64; 2 * KERNELS + 1]; ACTIVITY.len() + 1],
}

impl<'a> ChannelModels<'a> {
    fn fit(kernels: &'a Kernels, order0: &'a Histogram, train: &Series) -> ChannelModels<'a> {
        let bins = kernels.bins() as usize;
        let line = |b1, b2| line(bins, b1, b2);
        let delta = Histogram::fit(bins, train.pairs().map(|(x, b)| step(bins, x, b)));

        // equal cases are counted once: expectation maximisation reads every case in each round
        let (pairs, counts) = distinct(train.pairs().collect());
        let previous = fit(&counts, |i| kernels.row(pairs[i].1, pairs[i].0));

        let (pairs, counts) = distinct(train.later.iter().map(|&[x, b1, b2]| (x, line(b1, b2))).collect());
        let extrapolated = fit(&counts, |i| kernels.row(pairs[i].1, pairs[i].0));

        let (triples, counts) = distinct(train.later.iter().map(|&[x, b1, b2]| (x, b1, line(b1, b2))).collect());
        let mixed = fit(&counts, |i| both(kernels, triples[i].0, triples[i].1, triples[i].2));

        let three = |x, b1, l| three(kernels, order0, x, b1, l);
        let any_size = fit(&counts, |i| three(triples[i].0, triples[i].1, triples[i].2));
        let by_size = weights_by_size(train, any_size, line, three);
        ChannelModels { kernels, order0, delta, previous, extrapolated, mixed, by_size }
    }

    fn bins(&self) -> usize {
        self.kernels.bins() as usize
    }

    /// Bits of code `x` after those `before` it, the last one first.
    fn bits(&self, x: u32, before: [Option<u32>; 2]) -> [f64; 6] {
        let a = self.order0.bits(x);
        let [Some(b1), b2] = before else { return [a; 6] };
        let b = self.delta.bits(step(self.bins(), x, b1));
        let c = bits(&self.previous, &self.kernels.row(b1, x));
        let Some(b2) = b2 else { return [a, b, c, c, c, c] };
        let l = line(self.bins(), b1, b2);
        let d_line = bits(&self.extrapolated, &self.kernels.row(l, x));
        let d = bits(&self.mixed, &both(self.kernels, x, b1, l));
        let e = bits(&self.by_size[size_of_step(b1, b2)], &three(self.kernels, self.order0, x, b1, l));
        [a, b, c, d_line, d, e]
    }

    /// The bits of a channel of clips of `channels`.
    fn cost(&self, clips: &CodeClips, (channels, channel): (usize, usize), keeps: bool) -> ChannelCost {
        // `both` has the extrapolation's kernels second
        let weight_on_extrapolation = self.mixed[KERNELS..].iter().sum();
        let mut cost = ChannelCost { early: [0.0; 6], later: [0.0; 6], weight_on_extrapolation, codes: Vec::new() };
        for clip in clips {
            let mut before = [None; 2];
            for &code in clip.iter().skip(channel).step_by(channels) {
                let code = code.into();
                let bits = self.bits(code, before);
                add(if before[1].is_some() { &mut cost.later } else { &mut cost.early }, bits);
                cost.codes.extend(keeps.then_some(bits[5] as f32));
                before = [Some(code), before[0]];
            }
        }
        cost
    }
}

/// The codes of a channel of clips of `channels`.
pub(super) fn column(clips: &CodeClips, channels: usize, channel: usize) -> impl Iterator<Item = u32> + '_ {
    clips.iter().flat_map(move |clip| clip.iter().skip(channel).step_by(channels).map(|&code| code.into()))
}

/// The linear extrapolation of the last two codes. It may leave the bins, and kernels are centred on bins alone.
fn line(bins: usize, b1: u32, b2: u32) -> u32 {
    (2 * i64::from(b1) - i64::from(b2)).clamp(0, bins as i64 - 1) as u32
}

fn step(bins: usize, x: u32, b: u32) -> u32 {
    (x + bins as u32 - b) % bins as u32
}

fn both(kernels: &Kernels, x: u32, b1: u32, l: u32) -> [f64; 2 * KERNELS] {
    join(&kernels.row(b1, x), &kernels.row(l, x))
}

fn three(kernels: &Kernels, order0: &Histogram, x: u32, b1: u32, l: u32) -> [f64; 2 * KERNELS + 1] {
    join(&both(kernels, x, b1, l), &[order0.p(x)])
}

/// Bits by slot, each over all clips, as (F, C) of each clip; empty where none are kept.
fn clips_of(clips: &CodeClips, by_slot: Vec<Vec<f32>>) -> Vec<Vec<f32>> {
    let channels = by_slot.len();
    if by_slot.iter().all(Vec::is_empty) {
        return Vec::new();
    }
    let mut first = 0;
    let mut of_clip = |clip: &Vec<u16>| {
        let frames = first..first + clip.len() / channels;
        first = frames.end;
        frames.flat_map(|frame| by_slot.iter().map(move |bits| bits[frame])).collect()
    };
    clips.iter().map(&mut of_clip).collect()
}

/// The weights of e for each size of the last step.
fn weights_by_size<const N: usize>(
    train: &Series,
    any_size: [f64; N],
    line: impl Fn(u32, u32) -> u32,
    row: impl Fn(u32, u32, u32) -> [f64; N],
) -> [[f64; N]; ACTIVITY.len() + 1] {
    let mut by_size: [Vec<(u32, u32, u32)>; ACTIVITY.len() + 1] = Default::default();
    for &[x, b1, b2] in &train.later {
        by_size[size_of_step(b1, b2)].push((x, b1, line(b1, b2)));
    }
    by_size.map(|cases| {
        // a few cases would fit the 27 weights to their noise
        if cases.len() < LEAST_CASES {
            return any_size;
        }
        let (cases, counts) = distinct(cases);
        fit(&counts, |i| row(cases[i].0, cases[i].1, cases[i].2))
    })
}

fn size_of_step(b1: u32, b2: u32) -> usize {
    ACTIVITY.partition_point(|&least| least <= b1.abs_diff(b2))
}

fn join<const A: usize, const B: usize, const N: usize>(a: &[f64; A], b: &[f64; B]) -> [f64; N] {
    let mut joined = [0.0; N];
    joined[..A].copy_from_slice(a);
    joined[A..].copy_from_slice(b);
    joined
}

fn add(sum: &mut [f64; 6], bits: [f64; 6]) {
    sum.iter_mut().zip(bits).for_each(|(s, b)| *s += b);
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde::Deserialize;

    #[derive(Deserialize)]
    struct Golden {
        bins: usize,
        channels: usize,
        train: Vec<Vec<u16>>,
        test: Vec<Vec<u16>>,
        bits_per_frame: [f64; 6],
        from_third_frame: [f64; 6],
        by_channel: [Vec<f64>; 6],
        weight_on_extrapolation: Vec<f64>,
    }

    /// The order of sums is all that differs.
    const TOLERANCE: f64 = 1e-9;

    fn near(found: &[f64], expected: &[f64]) {
        assert_eq!(found.len(), expected.len());
        for (f, e) in found.iter().zip(expected) {
            assert!((f - e).abs() < TOLERANCE, "found {found:?}, expected {expected:?}");
        }
    }

    #[test]
    fn the_figures_are_those_of_numpy() {
        let golden: Golden = serde_json::from_str(include_str!("../../tests/golden/baselines.json")).unwrap();
        let codes = CodeSplits {
            bins: golden.bins,
            channels: golden.channels,
            places: Vec::new(),
            of: [776, 183],
            train: golden.train,
            test: golden.test,
        };
        let b = ChannelFloors::measure(&codes).unwrap();
        near(&b.bits_per_frame, &golden.bits_per_frame);
        near(&b.from_third_frame.unwrap(), &golden.from_third_frame);
        b.by_channel.iter().zip(&golden.by_channel).for_each(|(f, e)| near(f, e));
        near(&b.weight_on_extrapolation, &golden.weight_on_extrapolation);
        assert_eq!((b.train, b.test), ([7, 776], [4, 183]));
    }

    fn splits(train: Vec<u16>, test: Vec<u16>) -> CodeSplits {
        let one = |codes| vec![codes];
        let of = [train.len(), test.len()];
        CodeSplits { bins: 8, channels: 1, places: Vec::new(), train: one(train), test: one(test), of }
    }

    #[test]
    fn a_constant_channel_costs_its_add_one_share() {
        // 8 counts of one and 100 more of code 3: p = 101/108
        let b = ChannelFloors::measure(&splits(vec![3; 100], vec![3; 50])).unwrap();
        assert!((b.bits_per_frame[0] - (108.0_f64 / 101.0).log2()).abs() < 1e-12);
        assert!(b.best() <= b.bits_per_frame[0] && b.uniform() == 3.0);
    }

    #[test]
    fn short_clips_are_measured() {
        let b = ChannelFloors::measure(&splits(vec![1, 2, 3], vec![4])).unwrap();
        assert_eq!(b.from_third_frame, None);
        assert!(b.bits_per_frame.iter().all(|x| (x - b.bits_per_frame[0]).abs() < 1e-12));
        assert!(
            ChannelFloors::measure(&splits(vec![1], vec![4, 4])).unwrap().bits_per_frame.iter().all(|x| x.is_finite())
        );
    }

    #[test]
    fn nonsense_is_refused() {
        let says = |codes| ChannelFloors::measure(&codes).unwrap_err().to_string();
        assert!(says(splits(vec![], vec![1])).contains("no frame in the train split"));
        assert!(says(splits(vec![1], vec![1, 8])).contains("test clip 0, frame 1, the code is 8; expected below 8"));
        assert!(says(CodeSplits { channels: 2, ..splits(vec![1], vec![1, 2]) }).contains("frames of 2"));
        assert!(says(CodeSplits { bins: 1, ..splits(vec![0], vec![0]) }).contains("2 to 65536"));
    }

    #[test]
    fn the_table_has_a_row_a_model() {
        let b = ChannelFloors::measure(&splits(vec![3; 100], vec![3; 50])).unwrap();
        let text = b.to_string();
        assert!(text.starts_with("fitted on 1 clips, 100 frames; measured on 1 clips, 50 frames\n"), "{text}");
        assert_eq!(text.lines().count(), 2 + 1 + MODELS.len());
        let json = b.to_json();
        assert_eq!(json["bits_per_frame"]["uniform"], 3.0);
        assert!(json["bits_per_frame_from_third_frame"]["e_mix_by_activity"].is_f64());
    }
}
