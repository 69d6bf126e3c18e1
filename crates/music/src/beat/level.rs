//! Selects the metrical level and the phase of the beat within a pulse.
//!
//! The strongest pulse is often at half or double tempo, or on the swung eighth before the beat. So all levels and phases of
//! the pulse are scored over each stretch of 32 pulses, by the flux at their beats and between them (`weights.rs`).

use super::flux::{RISES, SERIES, Series};
use super::weights::{ALTERNATION, MIDDLE, PLACES, PROFILE, RETURN, RETURNS, TEMPO};
use super::{FPS, Tempo, TempoRange};

/// Subdivisions of a pulse.
const PARTS: usize = 12; // halves, thirds and quarters of a pulse are whole
/// Levels, in subdivisions per beat: from three beats per pulse to three pulses per beat.
const LEVELS: [usize; 9] = [4, 6, 8, 9, 12, 16, 18, 24, 36];
/// Pulses of a stretch, and from one to the next.
const STRETCH: usize = 32;
const STEP: usize = 8;
/// Pulses on each side of a stretch that count for repeating patterns.
const AROUND: usize = 16;
/// Cost of changing the level or phase.
const CHANGE: f32 = 10.0;
/// Least distance of beats, frames.
const NEAREST: f64 = 0.2 * FPS;

/// A level and a phase: a beat every `parts` subdivisions, the first at `phase`.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Count {
    parts: usize,
    phase: usize,
}

impl Count {
    fn all() -> Vec<Count> {
        LEVELS.into_iter().flat_map(|parts| (0..parts).map(move |phase| Count { parts, phase })).collect()
    }

    /// Its beats in a range of subdivisions.
    fn beats(self, from: f64, to: f64) -> impl Iterator<Item = f64> {
        let (parts, phase) = (self.parts as f64, self.phase as f64);
        let first = ((from - phase) / parts).ceil();
        (0..).map(move |i| phase + parts * (first + f64::from(i))).take_while(move |part| *part < to)
    }
}

/// The flux and the pulse of a piece.
struct Piece<'a> {
    series: &'a Series,
    pulse: &'a [f64],
}

impl Piece<'_> {
    /// The frame of a subdivision.
    fn frame(&self, part: f64) -> f64 {
        let (p, last) = (self.pulse, self.pulse.len() - 1);
        let at = part / PARTS as f64;
        // beyond both ends the pulse goes on at the pace of its last step
        let i = (at.max(0.0) as usize).min(last - 1);
        p[i] + (at - i as f64) * (p[i + 1] - p[i])
    }

    fn flux(&self, series: usize, part: f64) -> f32 {
        let x = &self.series[series];
        let frame = self.frame(part).clamp(0.0, (x.len() - 1) as f64);
        let i = (frame as usize).min(x.len().saturating_sub(2));
        let t = (frame - i as f64) as f32;
        (1.0 - t) * x[i] + t * x[(i + 1).min(x.len() - 1)]
    }

    /// The mean of each series over a stretch of pulses.
    fn means(&self, from: usize, to: usize) -> [f32; SERIES] {
        let n = ((to - from) * PARTS) as f32;
        let mean = |s| (from * PARTS..to * PARTS).map(|part| self.flux(s, part as f64)).sum::<f32>() / n;
        // divided by below: a silent series must not blow up
        std::array::from_fn(|s| mean(s) + 0.05)
    }

    /// The autocorrelation of the rises by lag in subdivisions, -1 to 1.
    fn returns(&self, from: usize, to: usize) -> Vec<f32> {
        let (from, to) = (from.saturating_sub(AROUND), (to + AROUND).min(self.pulse.len()));
        let n = (to - from) * PARTS;
        let columns: Vec<Vec<f32>> = (0..RISES)
            .map(|s| {
                let x: Vec<f32> = (from * PARTS..to * PARTS).map(|part| self.flux(s, part as f64)).collect();
                let mean = x.iter().sum::<f32>() / n as f32;
                let square = x.iter().map(|x| (x - mean).powi(2)).sum::<f32>() / n as f32;
                x.iter().map(|x| (x - mean) / (square.sqrt() + 0.05)).collect()
            })
            .collect();
        let after = |lag: usize| {
            // less than a pulse of overlap says nothing
            if lag + PARTS >= n {
                return 0.0;
            }
            let of = |x: &Vec<f32>| x.iter().zip(&x[lag..]).map(|(a, b)| a * b).sum::<f32>();
            columns.iter().map(of).sum::<f32>() / ((n - lag) * RISES) as f32
        };
        (0..=RETURNS[RETURNS.len() - 1] * LEVELS[LEVELS.len() - 1])
            .map(|lag| if is_return(lag) { after(lag) } else { 0.0 })
            .collect()
    }

    /// The median frames per pulse of a stretch.
    fn pace(&self, from: usize, to: usize) -> f64 {
        let mut paces: Vec<f64> =
            self.pulse[from..(to + 1).min(self.pulse.len())].windows(2).map(|w| w[1] - w[0]).collect();
        super::median(&mut paces).unwrap_or(self.pulse[1] - self.pulse[0])
    }

    /// The score of each count over a stretch of pulses.
    fn scores(&self, counts: &[Count], from: usize, to: usize) -> Vec<f32> {
        let (means, returns, pace) = (self.means(from, to), self.returns(from, to), self.pace(from, to));
        let score = |count: &Count| {
            let beats: Vec<f64> = count.beats((from * PARTS) as f64, (to * PARTS) as f64).collect();
            if beats.is_empty() {
                // a count without a beat in the stretch has no profile
                return f32::NEG_INFINITY;
            }
            // TEMPO was fitted around this tempo
            let octaves = (bpm(pace, count.parts) / 110.0).log2() as f32;
            let repeats = RETURNS.iter().zip(RETURN).map(|(n, w)| w * returns[n * count.parts]).sum::<f32>();
            let flux: f32 = (0..SERIES).map(|s| self.weigh(s, *count, &beats, means[s])).sum();
            flux + repeats + TEMPO[0] * octaves + TEMPO[1] * octaves * octaves
        };
        counts.iter().map(score).collect()
    }

    /// The score of one series for a count.
    fn weigh(&self, s: usize, count: Count, beats: &[f64], mean: f32) -> f32 {
        let n = beats.len() as f32;
        let mut on: Vec<f32> = beats.iter().map(|part| self.flux(s, *part) / mean).collect();
        let mut out = 0.0;
        for (place, weight) in PLACES.iter().zip(PROFILE[s]) {
            let off = place * count.parts as f64;
            let level = beats.iter().map(|part| self.flux(s, part + off)).sum::<f32>() / (mean * n);
            out += weight * (level + 0.1).ln();
        }
        if on.len() > 3 {
            let every_second = |from: usize| {
                let n = (on.len() - from).div_ceil(2) as f32;
                on[from..].iter().step_by(2).sum::<f32>() / n
            };
            out += ALTERNATION[s] * (every_second(0) - every_second(1)).abs() / (on.iter().sum::<f32>() / n + 0.1);
        }
        on.sort_by(f32::total_cmp);
        let middle = 0.5 * (on[(on.len() - 1) / 2] + on[on.len() / 2]);
        out + MIDDLE[s] * (middle + 0.1).ln()
    }
}

fn is_return(lag: usize) -> bool {
    LEVELS.iter().any(|parts| RETURNS.iter().any(|n| n * parts == lag))
}

/// Beats a minute of a level, at `pace` frames per pulse.
fn bpm(pace: f64, parts: usize) -> f64 {
    60.0 * FPS * PARTS as f64 / (pace * parts as f64)
}

/// The beats of a pulse, in frames, by the best-scoring path of counts, restricted to levels within `range` or nearest to it; and
/// the tempo of each level, the most likely first.
pub fn beats(series: &Series, pulse: &[f64], range: Option<TempoRange>) -> (Vec<f64>, Vec<Tempo>) {
    if pulse.len() < 3 {
        return (pulse.to_vec(), Vec::new());
    }
    let (piece, counts) = (Piece { series, pulse }, Count::all());
    // a shorter pulse is one stretch
    let last = pulse.len().saturating_sub(STRETCH);
    let stretches: Vec<(usize, usize)> =
        (0..=last).step_by(STEP).map(|from| (from, (from + STRETCH).min(pulse.len()))).collect();
    let mut scores: Vec<Vec<f32>> = stretches.iter().map(|(from, to)| piece.scores(&counts, *from, *to)).collect();
    // before the range is applied: the tempi are what the piece suggests, not what the caller allows
    let tempi = tempi(&counts, &scores, piece.pace(0, pulse.len()));
    if let Some(range) = range {
        for ((from, to), row) in stretches.iter().zip(&mut scores) {
            let off = LEVELS.map(|parts| range.octaves_off(bpm(piece.pace(*from, *to), parts)));
            // if no level is inside, the nearest: a range never leaves a piece without beats
            let least = off.iter().copied().fold(f64::INFINITY, f64::min);
            let is_out =
                |count: &Count| LEVELS.iter().zip(off).any(|(parts, off)| *parts == count.parts && off > least);
            counts.iter().zip(row).filter(|(count, _)| is_out(count)).for_each(|(_, x)| *x = f32::NEG_INFINITY);
        }
    }
    let path = steadiest(&scores);
    let mut out: Vec<f64> = Vec::new();
    // stretches overlap by 24 pulses: each has the pulses nearer to its own middle
    let middle = |i: usize| 0.5 * (stretches[i].0 + stretches[i].1 - STEP) as f64;
    for (i, count) in path.iter().enumerate() {
        let from = if i == 0 { 0.0 } else { middle(i) };
        let to = if i + 1 == path.len() { pulse.len() as f64 } else { middle(i + 1) };
        for part in counts[*count].beats(from * PARTS as f64, to * PARTS as f64) {
            let frame = piece.frame(part);
            // where the count changes, both may have a beat at the seam
            if frame >= 0.0 && out.last().is_none_or(|last| frame - last > NEAREST) {
                out.push(frame);
            }
        }
    }
    (out, tempi)
}

/// The tempo of each level and its probability, the mean over stretches of the conditional logit's probability of the level's
/// counts. The most likely first.
fn tempi(counts: &[Count], scores: &[Vec<f32>], pace: f64) -> Vec<Tempo> {
    let mut odds = [0.0; LEVELS.len()];
    for row in scores {
        let most = row.iter().copied().fold(f32::NEG_INFINITY, f32::max);
        // less the largest, as in any softmax: the ratios are the same and no power overflows
        let shares: Vec<f64> = row.iter().map(|x| f64::from(x - most).exp()).collect();
        let sum: f64 = shares.iter().sum();
        for (parts, odds) in LEVELS.iter().zip(&mut odds) {
            let own = counts.iter().zip(&shares).filter(|(count, _)| count.parts == *parts).map(|(_, share)| share);
            *odds += own.sum::<f64>() / (sum * scores.len() as f64);
        }
    }
    let mut tempi: Vec<Tempo> =
        LEVELS.iter().zip(odds).map(|(parts, odds)| Tempo { bpm: bpm(pace, *parts), odds }).collect();
    tempi.sort_by(|a, b| b.odds.total_cmp(&a.odds));
    tempi
}

/// The best path through scores where each change costs the same.
fn steadiest(scores: &[Vec<f32>]) -> Vec<usize> {
    let greatest = |x: &[f32]| (0..x.len()).fold(0, |a, b| if x[b] > x[a] { b } else { a });
    let (mut total, mut back) = (scores[0].clone(), Vec::new());
    for row in &scores[1..] {
        // changes all cost the same, so a change can only come from the best: n steps a row, not n^2
        let best = greatest(&total);
        let from: Vec<usize> =
            (0..total.len()).map(|i| if total[i] >= total[best] - CHANGE { i } else { best }).collect();
        total = from
            .iter()
            .zip(row)
            .enumerate()
            .map(|(i, (from, x))| x + if *from == i { total[i] } else { total[best] - CHANGE })
            .collect();
        back.push(from);
    }
    let mut at = greatest(&total);
    let mut path = vec![at];
    for from in back.iter().rev() {
        at = from[at];
        path.push(at);
    }
    path.reverse();
    path
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_have_their_beats() {
        let count = Count { parts: 8, phase: 3 };
        assert_eq!(count.beats(0.0, 30.0).collect::<Vec<_>>(), [3.0, 11.0, 19.0, 27.0]);
        assert_eq!(count.beats(3.5, 19.0).collect::<Vec<_>>(), [11.0]);
        assert_eq!(Count::all().len(), LEVELS.iter().sum::<usize>());
    }

    #[test]
    fn a_path_changes_only_where_it_pays() {
        let row = |a, b| vec![a, b];
        let short = [row(5.0, 0.0), row(0.0, 5.0), row(5.0, 0.0)];
        assert_eq!(steadiest(&short), [0, 0, 0]);
        let long = [row(15.0, 0.0), row(15.0, 0.0), row(0.0, 15.0), row(0.0, 15.0)];
        assert_eq!(steadiest(&long), [0, 0, 1, 1]);
    }

    #[test]
    fn a_swung_pulse_is_counted_from_its_beats() {
        // strong low beats every 48 frames, weak high strokes two thirds on; the pulse has been caught by the strokes
        let mut series: Series = Default::default();
        series.iter_mut().for_each(|s| s.resize(4800, 0.0));
        for beat in (10..4700).step_by(48) {
            for (s, x) in [(0, 3.0), (4, 2.0), (5, 2.0), (2, 1.0)] {
                series[s][beat] = x;
            }
            series[3][beat + 32] = 2.0;
            series[3][beat] = 1.5;
        }
        let pulse: Vec<f64> = (0..97).map(|i| 42.0 + 48.0 * f64::from(i)).collect();
        let (found, tempi) = beats(&series, &pulse, None);
        assert!((tempi.iter().map(|t| t.odds).sum::<f64>() - 1.0).abs() < 1e-6, "{tempi:?}");
        let phases: Vec<f64> = found.iter().map(|f| (f - 10.0).rem_euclid(48.0)).collect();
        let right = phases.iter().filter(|p| **p < 3.0 || **p > 45.0).count();
        // without bars every second beat will do
        assert!(right == phases.len() && found.len() > 45, "{phases:?}");
    }
}
