//! The forecast floor: bits per frame of what a straight line knows, without a network.
//!
//! The linear forecast of [`kinelm_model::forecast`] is fitted on the train clips as they are. A code is coded by a mixture of
//! the static floors' kernels around it, and the order-0 histogram. The kernels of the two bins around the forecast count by
//! their nearness to it, in eighths of a bin; those of a circular slot go round. The mixture's weights are a channel's own for
//! each *activity*: how much the slot moved in the frame before (not at all, up to 2, up to 6 bins, more) and how much the
//! body did (eighths of the train frames by the mean of all slots' steps). Activities with few train cases take the weights of
//! the whole channel. A clip's first frame is coded by order 0.

use super::codes::{CodeClips, CodeSplits};
use super::kernels::{Histogram, KERNELS, Kernels, LEAST_CASES, bits, distinct, fit};
use kinelm_engine::bins::Bins;
use kinelm_model::forecast::{BIN, Fit, Forecast, step};
use rayon::prelude::*;

/// Upper bounds of a slot's last step, in bins; above is one more class.
const STEPS: [u32; 3] = [0, 2, 6];
/// Classes of the body's activity.
const ACTIVITIES: usize = 8;
/// Parts of a bin that a forecast is rounded to.
const PARTS: i64 = 8;

/// Bits per frame of the forecast floor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ForecastFloor {
    /// Of all test frames.
    pub bits_per_frame: f64,
    /// Over the frames that have two before them; `None` where there are none.
    pub from_third_frame: Option<f64>,
}

/// A code, as the kernels see it; small, as there are as many as frames.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
struct Case {
    /// Its class of activity.
    class: u8,
    /// How far the forecast is above the bin below it, in parts of a bin.
    part: u8,
    /// The bin below the forecast and the code; of a circular slot moved so that the bin below is the middle one.
    below: u16,
    code: u16,
}

impl ForecastFloor {
    /// Fits on `codes.train` and measures on `codes.test`, codes that were checked; with the static floors' kernels and
    /// histograms of order 0. Also returns the bits of every code, slot by slot, if `keeps`.
    pub(super) fn measure(
        codes: &CodeSplits,
        (kernels, order0): (&Kernels, &[Histogram]),
        keeps: bool,
    ) -> (ForecastFloor, Vec<Vec<f32>>) {
        let (places, c) = (&codes.places, codes.channels);
        let bins = |clip: &[u16]| clip.iter().map(|&code| Some(usize::from(code))).collect::<Vec<_>>();
        let mut sums = Fit::new(places.clone());
        codes.train.iter().for_each(|clip| sums.add(&bins(clip), 1.0));
        let forecast = sums.forecast();
        let [train, test] = [&codes.train, &codes.test].map(|clips| Moves::of(clips, places, &forecast));
        let bounds = train.bounds();
        let cost = |slot: usize| {
            let order0 = &order0[slot];
            let cases = |moves: &Moves, clips| moves.cases(clips, places[slot], (c, slot), &bounds);
            let fitted = Mixtures::fit(kernels, order0, cases(&train, &codes.train));
            let (mut all, mut third, mut kept) = (0.0, 0.0, Vec::new());
            let mut later = cases(&test, &codes.test).into_iter();
            for clip in &codes.test {
                let first = clip.get(slot).map(|&code| order0.bits(code.into()));
                let rest = later.by_ref().take((clip.len() / c).saturating_sub(1));
                let rest = rest.map(|case| fitted.bits(kernels, order0, case));
                for (frame, bits) in first.into_iter().chain(rest).enumerate() {
                    all += bits;
                    third += if frame > 1 { bits } else { 0.0 };
                    kept.extend(keeps.then_some(bits as f32));
                }
            }
            ([all, third], kept)
        };
        let (costs, kept): (Vec<[f64; 2]>, Vec<Vec<f32>>) = (0..c).into_par_iter().map(cost).unzip();
        let frames = |least: usize| codes.test.iter().map(|clip| (clip.len() / c).saturating_sub(least)).sum::<usize>();
        let sum = |i: usize| costs.iter().map(|cost| cost[i]).sum::<f64>();
        let floor = ForecastFloor {
            bits_per_frame: sum(0) / frames(0) as f64,
            from_third_frame: (frames(2) > 0).then(|| sum(1) / frames(2) as f64),
        };
        (floor, kept)
    }
}

/// The size of a step.
fn moved(place: Bins, from: u16, to: u16) -> u32 {
    step(place, from.into(), to.into()).unsigned_abs()
}

/// How clips move, clip by clip.
struct Moves {
    /// (F, C) forecasts in eighths of a bin, two bytes each: those of slots of more than 24,000 bins are cut.
    forecasts: Vec<Vec<i16>>,
    /// (F) sums of the sizes of a frame's steps.
    activity: Vec<Vec<u32>>,
}

impl Moves {
    fn of(clips: &CodeClips, places: &[Bins], forecast: &Forecast) -> Moves {
        let c = places.len();
        let eighths = |x: i32| {
            let eighths = (i64::from(x) * PARTS).div_euclid(BIN.into());
            eighths.clamp(i16::MIN.into(), i16::MAX.into()) as i16
        };
        let activity = |clip: &Vec<u16>| -> Vec<u32> {
            let frames = clip.chunks(c).zip(clip.chunks(c).skip(1));
            let size = |(place, (from, to)): (&Bins, (&u16, &u16))| moved(*place, *from, *to);
            let of_frame = |(from, to): (&[u16], &[u16])| places.iter().zip(from.iter().zip(to)).map(size).sum::<u32>();
            std::iter::once(0).chain(frames.map(of_frame)).collect()
        };
        Moves {
            forecasts: clips
                .par_iter()
                .map(|clip| forecast.of_codes(clip).into_iter().map(eighths).collect())
                .collect(),
            activity: clips.par_iter().map(activity).collect(),
        }
    }

    /// The activities that divide the frames after a clip's first into classes of the same size.
    fn bounds(&self) -> Vec<u32> {
        let mut all: Vec<u32> =
            self.activity.iter().flat_map(|clip| &clip[..clip.len().saturating_sub(1)]).copied().collect();
        all.sort_unstable();
        (1..ACTIVITIES).filter_map(|i| all.get(i * all.len() / ACTIVITIES).copied()).collect()
    }

    /// The cases of a slot after each clip's first frame.
    fn cases(&self, clips: &CodeClips, bins: Bins, (c, slot): (usize, usize), bounds: &[u32]) -> Vec<Case> {
        // room for all at once: a list that grows holds them twice
        let mut all = Vec::with_capacity(clips.iter().map(|clip| (clip.len() / c).saturating_sub(1)).sum());
        for (i, clip) in clips.iter().enumerate() {
            for frame in 1..clip.len() / c {
                let at = |frame: usize| frame * c + slot;
                let [from, code] = [frame - 1, frame].map(|frame| i64::from(clip[at(frame)]));
                let eighths = i64::from(self.forecasts[i][at(frame)]);
                let (below, part) = (from + eighths.div_euclid(PARTS), eighths.rem_euclid(PARTS));
                let count = i64::from(bins.count);
                let last = if frame > 1 { moved(bins, clip[at(frame - 2)], clip[at(frame - 1)]) } else { 0 };
                let (below, code) = match bins.circular {
                    // the circle is cut opposite the forecast
                    true => (count / 2, (code - below + count / 2).rem_euclid(count)),
                    false => (below.clamp(0, count - 1), code),
                };
                let body = bounds.partition_point(|bound| *bound <= self.activity[i][frame - 1]);
                let class = body * (STEPS.len() + 1) + STEPS.partition_point(|most| *most < last);
                let (class, part) = (class as u8, part as u8);
                all.push(Case { class, part, below: below as u16, code: code as u16 });
            }
        }
        all
    }
}

/// The weights of a channel's mixtures.
struct Mixtures {
    any: [f64; KERNELS + 1],
    by_class: Vec<Option<[f64; KERNELS + 1]>>,
}

impl Mixtures {
    fn fit(kernels: &Kernels, order0: &Histogram, mut cases: Vec<Case>) -> Mixtures {
        let of = |cases: Vec<Case>| {
            let (cases, counts) = distinct(cases);
            fit(&counts, |i| row(kernels, order0, cases[i]))
        };
        // by class first
        cases.sort_unstable();
        let mut by_class = vec![None; ACTIVITIES * (STEPS.len() + 1)];
        for cases in cases.chunk_by(|a, b| a.class == b.class).filter(|cases| cases.len() >= LEAST_CASES) {
            by_class[usize::from(cases[0].class)] = Some(of(cases.to_vec()));
        }
        cases.iter_mut().for_each(|case| case.class = 0);
        Mixtures { any: of(cases), by_class }
    }

    fn bits(&self, kernels: &Kernels, order0: &Histogram, case: Case) -> f64 {
        bits(self.by_class[usize::from(case.class)].as_ref().unwrap_or(&self.any), &row(kernels, order0, case))
    }
}

/// The densities of a case: the kernels, and order 0.
fn row(kernels: &Kernels, order0: &Histogram, case: Case) -> [f64; KERNELS + 1] {
    let (below, code, part) = (u32::from(case.below), u32::from(case.code), case.part);
    let above = (below + 1).min(kernels.bins() - 1);
    let (low, high) = (kernels.row(below, code), kernels.row(above, code));
    let share = f64::from(part) / PARTS as f64;
    std::array::from_fn(|k| match k {
        KERNELS => order0.p(code),
        k => (1.0 - share) * low[k] + share * high[k],
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::floors::ChannelFloors;
    use rand_chacha::rand_core::RngCore;

    /// Clips whose second channel steps as the first did a frame before; the first, an angle, wanders.
    fn following(clips: usize, frames: usize) -> CodeClips {
        let clip = |number: usize| {
            let mut rng = kinelm_store::random::stream(3, "following", number as u64, 0);
            let mut steps = vec![0i64];
            let mut at = [40i64, 20];
            let frame = |_| {
                let last = steps[steps.len() - 1];
                steps.push(i64::from(rng.next_u32() % 7) - 3);
                at = [(at[0] + steps[steps.len() - 1]).rem_euclid(60), (at[1] + last).clamp(0, 59)];
                at.map(|code| code as u16)
            };
            (0..frames).flat_map(frame).collect()
        };
        (0..clips).map(clip).collect()
    }

    #[test]
    fn what_another_channel_tells_costs_nothing_but_here() {
        let place = |circular| Bins { first: 0, count: 60, circular };
        let (train, test) = (following(20, 200), following(23, 100)[20..].to_vec());
        let places = vec![place(true), place(false)];
        let codes = CodeSplits { bins: 60, channels: 2, places, train, test, of: [4000, 300] };
        let floors = ChannelFloors::measure(&codes).unwrap();
        let found = floors.forecast.unwrap().from_third_frame.unwrap();
        // one of seven steps, and next to nothing
        let least = 7f64.log2();
        assert!(found > least - 0.2 && found < least + 0.9, "{found} of {least}");
        assert!(floors.from_third_frame.unwrap()[5] > 2.0 * least - 0.5, "{floors:?}");
        assert!(floors.to_string().ends_with(&format!("{found:.2}")), "{floors}");
    }
}
