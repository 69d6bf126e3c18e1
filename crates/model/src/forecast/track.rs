//! A dance followed slot by slot, with the forecast of the slot that comes next.

use super::{BIN, ERRORS, Forecast, LAGS, limit, step};

/// Leading bits of an error that decide its forecast's weight.
const BITS: u32 = 8;

/// The slots of a dance as far as they are known, and what was forecast of each.
#[derive(Debug, Clone)]
pub struct Track {
    /// C.
    slots: usize,
    /// (F, C) bins, of the last frame as far as it is known; `None` where a slot has none.
    bins: Vec<Option<u32>>,
    /// The same of the steps into them, 0 where one isn't known,
    steps: Vec<i32>,
    /// of the errors of *all* and *own*, in parts of a bin,
    errors: Vec<[i64; 2]>,
    /// and of the forecasts.
    forecasts: Vec<i32>,
    /// (C): what is known of a frame before its first slot, and which frame it is.
    before: Vec<Before>,
    frame: Option<usize>,
    /// *all* and *own* for the next slot, and their weights, where they were asked for.
    upcoming: Option<([i64; 2], [i64; 2])>,
}

/// What is known of a slot before its frame begins.
#[derive(Debug, Clone, Copy, Default)]
struct Before {
    /// Both forecasts, but for the steps of the slot's own frame.
    all: i64,
    own: i64,
    /// Their weights.
    weights: [i64; 2],
}

impl Track {
    /// Before a dance; up to `frames` it allocates nothing more.
    pub fn new(slots: usize, frames: usize) -> Track {
        let all = frames * slots;
        Track {
            slots,
            bins: Vec::with_capacity(all),
            steps: Vec::with_capacity(all),
            errors: Vec::with_capacity(all),
            forecasts: Vec::with_capacity(all),
            before: vec![Before::default(); slots],
            frame: None,
            upcoming: None,
        }
    }

    /// Slots that are known, of all frames.
    pub fn known_slots(&self) -> usize {
        self.bins.len()
    }

    /// The forecasts of the slots that are known.
    pub fn forecasts(&self) -> &[i32] {
        &self.forecasts
    }

    /// The same, when nothing more is asked.
    pub fn into_forecasts(self) -> Vec<i32> {
        self.forecasts
    }

    /// Forgets all but the first `slots` slots.
    pub fn truncate(&mut self, slots: usize) {
        if slots < self.known_slots() {
            self.upcoming = None;
        }
        self.bins.truncate(slots);
        self.steps.truncate(slots);
        self.errors.truncate(slots);
        self.forecasts.truncate(slots);
        // what is known before a frame depends on the frames before it alone
        self.frame = self.frame.filter(|frame| frame * self.slots <= slots);
    }

    /// The forecast of the next slot.
    pub fn next(&mut self, forecast: &Forecast) -> i32 {
        let (both, weights) = self.both(forecast);
        self.upcoming = Some((both, weights));
        mean(both, weights)
    }

    /// Adds the words `ids`, of a slot each and a space; the last may be incomplete, and is completed by slots without bins.
    pub fn follow(&mut self, forecast: &Forecast, ids: &[u32]) {
        for ids in ids.chunks(self.slots + 1) {
            for (slot, place) in forecast.places.iter().enumerate() {
                self.push(forecast, ids.get(slot).and_then(|&id| place.bin(id)));
            }
        }
    }

    /// Adds the next slot's bin.
    pub fn push(&mut self, forecast: &Forecast, bin: Option<usize>) {
        let (both, weights) = self.both(forecast);
        self.upcoming = None;
        let slot = self.bins.len() % self.slots;
        let place = forecast.places[slot];
        let from = self.bins.len().checked_sub(self.slots).and_then(|before| self.bins[before]);
        let known = from.zip(bin).map(|(from, to)| step(place, from as usize, to));
        let most = i64::from(limit(place)) << 16;
        // a step that isn't known speaks against neither
        let error = |forecast: i64| known.map_or(0, |step| ((i64::from(step) << 16) - forecast).abs().min(most));
        self.forecasts.push(mean(both, weights));
        self.errors.push(both.map(error));
        self.steps.push(known.unwrap_or(0));
        self.bins.push(bin.map(|bin| bin as u32));
    }

    /// *all* and *own* for the next slot, and their weights.
    fn both(&mut self, forecast: &Forecast) -> ([i64; 2], [i64; 2]) {
        if let Some(upcoming) = self.upcoming {
            return upcoming;
        }
        let (c, frame, slot) = (self.slots, self.bins.len() / self.slots, self.bins.len() % self.slots);
        let Some(known) = frame.checked_sub(1).map(|before| before.min(LAGS)) else { return ([0; 2], [1; 2]) };
        if self.frame != Some(frame) {
            self.begin(forecast, frame, known);
        }
        let first = (known * (LAGS * c + 1 + c) + LAGS * c + 1) * c;
        let steps = &self.steps[frame * c..];
        let rows = forecast.all[first..].chunks_exact(c);
        let now: i64 = steps.iter().zip(rows).map(|(&d, row)| i64::from(d) * i64::from(row[slot])).sum();
        let most = 3 * (i64::from(limit(forecast.places[slot])) << 16) / 2;
        let Before { all, own, weights } = self.before[slot];
        ([all + now, own].map(|x| x.clamp(-most, most)), weights)
    }

    /// Finds what is known before `frame` begins, of which `known` frames of steps count.
    fn begin(&mut self, forecast: &Forecast, frame: usize, known: usize) {
        let c = self.slots;
        let all = &forecast.all[known * (LAGS * c + 1 + c) * c..];
        let own = &forecast.own[known * (LAGS + 1) * c..];
        for (i, before) in self.before.iter_mut().enumerate() {
            before.all = all[LAGS * c * c + i].into();
            before.own = own[LAGS * c + i].into();
        }
        for lag in 0..known {
            let steps = &self.steps[(frame - 1 - lag) * c..][..c];
            // most steps are 0, and a row of coefficients is read for each that isn't
            for (from, &d) in steps.iter().enumerate().filter(|(_, d)| **d != 0) {
                let row = &all[(lag * c + from) * c..][..c];
                self.before.iter_mut().zip(row).for_each(|(before, &w)| before.all += i64::from(d) * i64::from(w));
                self.before[from].own += i64::from(d) * i64::from(own[lag * c + from]);
            }
        }
        for (slot, before) in self.before.iter_mut().enumerate() {
            // a bin each before anything is known: equal weights
            let mut sums = [i64::from(BIN); 2];
            for frame in frame.saturating_sub(ERRORS)..frame {
                sums.iter_mut().zip(self.errors[frame * c + slot]).for_each(|(sum, error)| *sum += error);
            }
            before.weights = weights(sums);
        }
        self.frame = Some(frame);
    }
}

/// The weights of two forecasts with these errors: inverse fourth powers, times a number that both have.
fn weights(errors: [i64; 2]) -> [i64; 2] {
    let largest = errors[0].max(errors[1]);
    // their leading bits alone, so that no product of the mean overflows
    let shift = (64 - largest.leading_zeros()).saturating_sub(BITS);
    let [all, own] = errors.map(|error| (error >> shift).max(1).pow(4));
    [own, all]
}

/// The mean of both forecasts by their weights.
fn mean([all, own]: [i64; 2], weights: [i64; 2]) -> i32 {
    (all * weights[0] + own * weights[1]).div_euclid(weights[0] + weights[1]) as i32
}
