//! The linear forecast: what a straight line knows of the next frame.
//!
//! Let `d[t,c]` be the *step* of slot c into frame t: the difference of its bins in frames t and t - 1, the short way round
//! where the slot is circular, at most a ninth of its bins (40 of 360). A forecast of `d[t,c]` is a sum of known steps times
//! coefficients, plus a constant. There are two:
//!
//! - *all*: the steps of all slots in the [`LAGS`] frames before, and of the slots before c in frame t;
//! - *own*: the steps of slot c alone in the frames before.
//!
//! Where fewer frames are known, at a clip's start, there are coefficients for each number of them; frame 0 has no forecast.
//! *all* is better on dances like those it was fitted on, *own* on a stranger's, whose joints don't move together in the
//! same way. So the forecast is their mean, each weighted by the inverse fourth power of its error in that slot over the
//! last [`ERRORS`] frames. It depends on the [`HISTORY`] frames before and on nothing else.
//!
//! Coefficients are whole numbers, parts of 2^16 of a bin, and so are all sums: a forecast is the same on every processor
//! and in every form of a model. [`Fit`] finds them, a [`Track`] follows a dance. Letters: F frames, C slots.

mod corpora;
mod fit;
mod track;

pub use fit::Fit;
pub use track::Track;

use crate::{Error, Result};
use kinelm_engine::bins::Bins;

/// Frames of steps that a forecast reads.
pub const LAGS: usize = 4;
/// Frames over which the errors of both forecasts are compared.
pub const ERRORS: usize = 16;
/// Frames before a frame on which its forecast depends: each error is of a forecast of its own.
pub const HISTORY: usize = ERRORS + LAGS + 1;
/// A bin, in the parts that forecasts and coefficients are counted in.
pub const BIN: i32 = 1 << 16;

/// The tensors of a forecast: (LAGS + 1, LAGS C + 1 + C, C) and (LAGS + 1, LAGS + 1, C). The first side is the number of known
/// frames of steps. The second are the steps of the frame before, of the one before that and so on, those of all slots or of
/// the slot's own; the constant; and the steps of this frame.
pub const NAMES: [&str; 2] = ["forecast.all", "forecast.own"];

/// Whether a tensor of this name is a forecast's. No optimizer moves it.
pub fn is_tensor(name: &str) -> bool {
    NAMES.contains(&name)
}

/// The largest whole number of a coefficient: f32, in which tensors are stored, has all up to it.
const LARGEST: f32 = (1 << 24) as f32;

/// The coefficients of both forecasts, for words of C slots.
#[derive(Debug, Clone, PartialEq)]
pub struct Forecast {
    places: Vec<Bins>,
    all: Vec<i32>,
    own: Vec<i32>,
}

impl Forecast {
    /// The shapes of its tensors, in the order of [`NAMES`].
    pub fn shapes(slots: usize) -> [[usize; 3]; 2] {
        [[LAGS + 1, LAGS * slots + 1 + slots, slots], [LAGS + 1, LAGS + 1, slots]]
    }

    /// A forecast that every slot stays where it is.
    pub fn still(places: Vec<Bins>) -> Forecast {
        let [all, own] = Forecast::shapes(places.len()).map(|shape| vec![0; shape.iter().product()]);
        Forecast { places, all, own }
    }

    /// A forecast of these tensors, in the order of [`NAMES`].
    ///
    /// # Errors
    /// Numbers that aren't whole or above 2^24, with the tensor's name.
    ///
    /// # Panics
    /// If tensors have other numbers than their shapes.
    pub fn of_tensors(places: Vec<Bins>, tensors: [&[f32]; 2]) -> Result<Forecast> {
        let shapes = Forecast::shapes(places.len());
        let read = |i: usize| -> Result<Vec<i32>> {
            assert_eq!(tensors[i].len(), shapes[i].iter().product::<usize>(), "the numbers of {}", NAMES[i]);
            let whole = |&x: &f32| match x.fract() == 0.0 && x.abs() <= LARGEST {
                true => Ok(x as i32),
                false => Err(Error::Weights(format!("{} holds {x}; expected whole numbers up to {LARGEST}", NAMES[i]))),
            };
            tensors[i].iter().map(whole).collect()
        };
        Ok(Forecast { all: read(0)?, own: read(1)?, places })
    }

    /// Its tensors, in the order of [`NAMES`].
    pub fn tensors(&self) -> [Vec<f32>; 2] {
        [&self.all, &self.own].map(|numbers| numbers.iter().map(|&x| x as f32).collect())
    }

    /// C.
    pub fn slots(&self) -> usize {
        self.places.len()
    }

    /// The forecasts (F, C) of codes (F, C), bins of their slots.
    pub fn of_codes(&self, codes: &[u16]) -> Vec<i32> {
        let mut track = Track::new(self.slots(), codes.len().div_ceil(self.slots()));
        codes.iter().for_each(|&code| track.push(self, Some(code.into())));
        track.into_forecasts()
    }
}

/// The whole bins of a forecast, the nearest.
pub fn whole(forecast: i32) -> i64 {
    // halves go up, as they do in every form
    i64::from((forecast + BIN / 2) >> 16)
}

/// The bin that a forecast step leads to from bin `from`: round the circle, or up to a slot's last bin.
pub fn reached(bins: Bins, from: usize, forecast: i32) -> usize {
    let to = from as i64 + whole(forecast);
    let count = i64::from(bins.count);
    (if bins.circular { to.rem_euclid(count) } else { to.clamp(0, count - 1) }) as usize
}

/// The step from bin `from` to bin `to`, the short way round a circle, at most a ninth of the bins.
pub fn step(bins: Bins, from: usize, to: usize) -> i32 {
    let (by, count) = (to as i32 - from as i32, bins.count as i32);
    let by = if bins.circular { (by + count / 2).rem_euclid(count) - count / 2 } else { by };
    let most = limit(bins);
    by.clamp(-most, most)
}

/// The largest step that counts, in bins.
fn limit(bins: Bins) -> i32 {
    (bins.count as i32 / 9).max(1)
}

/// Knots of a number of bins, in parts of [`BIN`].
const KNOTS: [i32; 19] = {
    let mut knots = [0; 19];
    let mut i = 0;
    while i < 9 {
        // 1/4, 1/2, 1 .. 64 bins, of either sign
        knots[10 + i] = (BIN / 4) << i;
        knots[8 - i] = -((BIN / 4) << i);
        i += 1;
    }
    knots
};
/// Knots of the difference of a forecast and its [`whole`] bins.
const PARTS: [i32; 5] = [-BIN / 2, -BIN / 4, 0, BIN / 4, BIN / 2];

/// Numbers of a slot: see [`numbers`].
pub const NUMBERS: usize = 3 * KNOTS.len() + PARTS.len();

/// Writes what a frame decoder reads of a slot's `forecast`, `out` ([`NUMBERS`]): where between the knots are the forecast, its
/// difference from the slot's `last` step (in bins), that step, and the fraction of a bin in the forecast. At a knot its number
/// is 1; between two, both have a part that falls to 0 at the other; beyond the last, it stays 1.
pub fn numbers(forecast: i32, last: i32, out: &mut [f32]) {
    out.fill(0.0);
    let last = last.saturating_mul(BIN);
    let fraction = forecast - (whole(forecast) * i64::from(BIN)) as i32;
    let all: [(i32, &[i32]); 4] =
        [(forecast, &KNOTS), (forecast.saturating_sub(last), &KNOTS), (last, &KNOTS), (fraction, &PARTS)];
    let mut first = 0;
    for (x, knots) in all {
        let out = &mut out[first..first + knots.len()];
        first += knots.len();
        match knots.partition_point(|knot| *knot <= x) {
            0 => out[0] = 1.0,
            n if n == knots.len() => out[n - 1] = 1.0,
            above => {
                // knots are a power of two apart, so the parts are exact
                let share = (x - knots[above - 1]) as f32 / (knots[above] - knots[above - 1]) as f32;
                (out[above - 1], out[above]) = (1.0 - share, share);
            }
        }
    }
}

#[cfg(test)]
mod tests;
