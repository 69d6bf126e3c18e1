//! Can a classifier tell made dances from real ones? docs/referee.md, "Two sets side by side".
//!
//! A classifier two-sample test (Lopez-Paz and Oquab, "Revisiting classifier two-sample tests", 2017): windows of both are told
//! apart by classifiers that never saw the window's take; 50 % of them right is what nothing could better. Windows are the
//! search's: low cosine coefficients of the coded joints' rotations, at 60 frames a second.
//!
//! Limits: rotations alone, no path and no floor; a difference that these classifiers miss isn't shown, and few takes give wide
//! intervals.

use super::coded::Dance;
use super::compare::{Estimate, MeasuredDance, Side};
use super::reference::Reference;
use crate::{Error, Result, bootstrap};
use kinelm_classify::lda::Lda;
use kinelm_corpus::Split;
use kinelm_linalg::Pca;
use kinelm_spectral::{LowDct, Series, Transform, WindowSpec};
use rayon::prelude::*;
use serde::Serialize;
use std::collections::BTreeSet;

/// Lengths of windows, seconds; each begins half a window after the one before.
const SECONDS: [f64; 3] = [2.0, 5.0, 10.0];
/// Cosine coefficients of a channel.
const KEEP: usize = 16;
/// Principal components of all windows that the classifiers get.
const COMPONENTS: usize = 64;
/// The most windows of either class; of more a sample that is spread evenly.
const MOST: usize = 4_000;

/// The classifiers: linear discriminant analysis, and the nearest window.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum Teller {
    /// Linear discriminant analysis.
    Lda,
    /// The nearest window of another take.
    Nearest,
}

/// The share of windows that a classifier gets right, of two sets of dances, each beside the real clips.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ToldApart {
    /// The length of the windows.
    pub seconds: f64,
    /// The classifier.
    pub by: Teller,
    /// Of each set; `None` where it has no window of this length.
    pub sides: [Option<Estimate>; 2],
    /// The second's less the first's.
    pub difference: Option<Estimate>,
}

/// The rows as a table under those of [`super::compare::Comparison`], without a line end after the last.
pub fn table(rows: &[ToldApart]) -> String {
    let mut text = "told apart from all real clips, % of windows right; 50: not".to_string();
    for ToldApart { seconds, by, sides, difference } in rows {
        let name = format!("{seconds} s, {}", if *by == Teller::Lda { "discriminant" } else { "nearest window" });
        let percent = |found: &Option<Estimate>| {
            found.map_or("n/a".into(), |Estimate { mean, interval: [low, high] }| {
                format!("{:.1} ({:.1} to {:.1})", 100.0 * mean, 100.0 * low, 100.0 * high)
            })
        };
        let star = difference.is_some_and(|d| d.interval[0] > 0.0 || d.interval[1] < 0.0);
        let [a, b] = sides.each_ref().map(percent);
        let difference = percent(difference);
        text += &format!("\n{name:<32} {:>9} {a:>28} {b:>28} {difference:>28}{}", "", if star { "*" } else { " " });
    }
    text
}

/// A window of a real or a made dance.
struct Window {
    /// The index of its take.
    take: usize,
    made: bool,
    feature: Vec<f64>,
}

/// Of each take of either class: its name, windows that were right, and windows.
type Parts = Vec<(String, f64, f64)>;

impl Reference<'_> {
    /// How well two sets can be told from all clips of the corpus, whatever their split.
    ///
    /// # Errors
    /// Words that can't be decoded; features that are not finite.
    pub fn told_apart(&self, sides: &[Side; 2]) -> Result<Vec<ToldApart>> {
        let mut all = Vec::new();
        let real = self.real_windows()?;
        let of = |d: &MeasuredDance| Ok((d.take.clone(), self.window_spectra(&d.dance)?));
        let of_side = |side: &Side| side.dances.par_iter().map(of).collect::<Result<Vec<_>>>().map(by_length);
        let [a, b] = sides.each_ref().map(of_side);
        let made = [a?, b?];
        let tellers = [Teller::Lda, Teller::Nearest];
        for (length, seconds) in SECONDS.into_iter().enumerate() {
            let [a, b] = made.each_ref().map(|made| told(&real[length], &made[length]));
            let parts = [a?, b?];
            for (i, by) in tellers.into_iter().enumerate() {
                let of = parts.each_ref().map(|parts| parts.as_ref().map(|parts| &parts[i]));
                let estimate =
                    |parts: &Parts| Estimate { mean: right(parts), interval: bootstrap::interval(by_take(parts)) };
                let difference = |[a, b]: [&Parts; 2]| Estimate {
                    mean: right(b) - right(a),
                    interval: bootstrap::difference([by_take(a), by_take(b)]),
                };
                all.push(ToldApart {
                    seconds,
                    by,
                    sides: of.map(|parts| parts.map(estimate)),
                    difference: of[0].zip(of[1]).map(|(a, b)| difference([a, b])),
                });
            }
        }
        Ok(all.into_iter().filter(|row: &ToldApart| row.sides.iter().any(Option::is_some)).collect())
    }

    /// The windows of all real clips, of each length by their takes.
    fn real_windows(&self) -> Result<[Vec<TakeWindows>; 3]> {
        let mut all = Vec::new();
        for split in [Split::Train, Split::Valid, Split::Test] {
            let takes: Vec<String> = self.corpus.split(split).map(|clip| clip.take.clone()).collect();
            let found = self.each(split, |_, dance| self.window_spectra(dance))?;
            all.extend(takes.into_iter().zip(found));
        }
        Ok(by_length(all))
    }

    /// The features of a dance's windows of each length, each of norm 1.
    fn window_spectra(&self, dance: &Dance) -> Result<[Vec<Vec<f64>>; 3]> {
        if dance.clip.frames() < 2 {
            return Ok(Default::default());
        }
        let fps = WindowSpec::default().fps;
        let series = Series::of(&dance.clip, &self.joints, fps, false)?;
        Ok(SECONDS.map(|seconds| {
            let frames = (seconds * fps).round() as usize;
            let spec = WindowSpec { frames, hop: frames / 2, fps };
            let transform = Transform::Dct(LowDct::new(frames, KEEP));
            let feature = |start: usize| transform.unit_feature(&series.window(start, frames), series.channels.len());
            spec.starts(series.frames, 0).map(feature).collect()
        }))
    }
}

/// A clip's take and the features of its windows.
type TakeWindows = (String, Vec<Vec<f64>>);

/// The windows of each length, clip by clip.
fn by_length(clips: Vec<(String, [Vec<Vec<f64>>; 3])>) -> [Vec<TakeWindows>; 3] {
    let mut all: [Vec<TakeWindows>; 3] = Default::default();
    for (take, windows) in clips {
        all.iter_mut().zip(windows).for_each(|(all, windows)| all.push((take.clone(), windows)));
    }
    all
}

/// Per teller the windows that are right, take by take; `None` where either class has no window.
fn told(real: &[TakeWindows], made: &[TakeWindows]) -> Result<Option<[Parts; 2]>> {
    let names: Vec<&str> = real.iter().chain(made).map(|(take, _)| take.as_str()).collect();
    let takes: Vec<&str> = names.iter().copied().collect::<BTreeSet<_>>().into_iter().collect();
    let index = |take: &str| takes.binary_search(&take).unwrap_or(0);
    let of = |clips: &[TakeWindows]| -> Vec<(usize, Vec<f64>)> {
        clips.iter().flat_map(|(take, all)| all.iter().map(|feature| (index(take), feature.clone()))).collect()
    };
    let [real, made] = [of(real), of(made)];
    // as many of both: a guess is right in half of the cases
    let each = real.len().min(made.len()).min(MOST);
    if each == 0 {
        return Ok(None);
    }
    let spread = |all: Vec<(usize, Vec<f64>)>, made: bool| {
        let n = all.len();
        let taken = |i: &usize| (*i * each / n) != ((*i + 1) * each / n);
        let windows = all.into_iter().enumerate().filter(move |(i, _)| taken(i));
        windows.map(move |(_, (take, feature))| Window { take, made, feature }).collect::<Vec<_>>()
    };
    let mut windows = spread(real, false);
    windows.extend(spread(made, true));
    reduce(&mut windows)?;
    let lda = by_lda(&windows, takes.len())?;
    let nearest: Vec<bool> = windows.par_iter().map(|window| nearest(window, &windows)).collect();
    let parts = [lda, nearest].map(|right| {
        let mut parts: Vec<(String, f64, f64)> = Vec::new();
        for (take, made) in (0..takes.len()).flat_map(|take| [(take, false), (take, true)]) {
            let own = windows.iter().zip(&right).filter(|(w, _)| w.take == take && w.made == made);
            let (sum, count) =
                own.fold((0.0, 0.0), |(sum, n), (_, right)| (sum + f64::from(u8::from(*right)), n + 1.0));
            if count > 0.0 {
                parts.push((format!("{} {}", if made { "made" } else { "real" }, takes[take]), sum, count));
            }
        }
        parts
    });
    Ok(Some(parts))
}

/// The windows in principal components of all of them; no label is used.
fn reduce(windows: &mut [Window]) -> Result<()> {
    let width = windows[0].feature.len();
    let data: Vec<f64> = windows.iter().flat_map(|window| window.feature.iter().copied()).collect();
    let pca =
        Pca::fit(&data, width).ok_or_else(|| Error::NotFinite("the features of a window are not finite".into()))?;
    let components = COMPONENTS.min(width).min(windows.len());
    windows.par_iter_mut().for_each(|window| {
        let centred: Vec<f64> = window.feature.iter().zip(&pca.mean).map(|(x, mean)| x - mean).collect();
        let rows = pca.components.chunks_exact(width).take(components);
        window.feature = rows.map(|row| row.iter().zip(&centred).map(|(a, b)| a * b).sum()).collect();
    });
    Ok(())
}

/// Whether each window's class is the one that discriminants of all other takes say.
fn by_lda(windows: &[Window], takes: usize) -> Result<Vec<bool>> {
    let told = |take: usize| -> Result<Vec<(usize, bool)>> {
        let (own, others): (Vec<usize>, Vec<usize>) = (0..windows.len()).partition(|&i| windows[i].take == take);
        let rows: Vec<Vec<f64>> = others.iter().map(|&i| windows[i].feature.clone()).collect();
        let labels: Vec<usize> = others.iter().map(|&i| usize::from(windows[i].made)).collect();
        if own.is_empty() {
            return Ok(Vec::new());
        }
        // of one class alone there is nothing to learn: a guess
        if labels.iter().all(|label| *label == labels.first().copied().unwrap_or(0)) {
            return Ok(own.into_iter().map(|i| (i, i % 2 == 0)).collect());
        }
        let lda = Lda::fit(&rows, &labels, 2, COMPONENTS)?;
        let right = |i: usize| {
            let log_p = lda.log_p(&windows[i].feature);
            (log_p[1] > log_p[0]) == windows[i].made
        };
        Ok(own.into_iter().map(|i| (i, right(i))).collect())
    };
    let found: Vec<Vec<(usize, bool)>> = (0..takes).into_par_iter().map(told).collect::<Result<_>>()?;
    let mut right = vec![false; windows.len()];
    found.into_iter().flatten().for_each(|(i, is)| right[i] = is);
    Ok(right)
}

/// Whether the nearest window of another take is of a window's class; the first of equally near ones.
fn nearest(window: &Window, windows: &[Window]) -> bool {
    let distance =
        |other: &Window| window.feature.iter().zip(&other.feature).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
    let others = windows.iter().filter(|other| other.take != window.take).map(|other| (distance(other), other.made));
    others.min_by(|a, b| a.0.total_cmp(&b.0)).is_some_and(|(_, made)| made == window.made)
}

/// The parts as the bootstrap has them.
fn by_take(parts: &Parts) -> impl Iterator<Item = (&str, f64, f64)> {
    parts.iter().map(|(take, sum, count)| (take.as_str(), *sum, *count))
}

/// The share of windows that are right.
fn right(parts: &Parts) -> f64 {
    parts.iter().map(|part| part.1).sum::<f64>() / parts.iter().map(|part| part.2).sum::<f64>()
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_store::random;

    /// Takes of windows around a centre, `apart` from 0 in the first number.
    fn cloud(name: &str, takes: usize, apart: f64) -> Vec<(String, Vec<Vec<f64>>)> {
        let take = |number: usize| {
            let mut rng = random::stream(5, name, number as u64, 0);
            let mut window = |_| {
                let mut numbers: Vec<f64> = (0..12).map(|_| random::normal(&mut rng)).collect();
                numbers[0] += apart;
                numbers
            };
            (format!("{name} {number}"), (0..20).map(&mut window).collect())
        };
        (0..takes).map(take).collect()
    }

    #[test]
    fn alike_sets_are_not_told_apart_and_others_are() {
        let real = cloud("real", 15, 0.0);
        let share = |made: &[(String, Vec<Vec<f64>>)]| told(&real, made).unwrap().unwrap().each_ref().map(right);
        let [lda, nearest] = share(&cloud("made", 8, 0.0));
        // 320 windows: four standard deviations of a binomial are 0.11
        assert!((lda - 0.5).abs() < 0.11 && (nearest - 0.5).abs() < 0.11, "{lda} {nearest}");
        let [lda, nearest] = share(&cloud("made", 8, 4.0));
        // two Gaussians four deviations apart overlap by 2.3 %
        assert!(lda > 0.94 && nearest > 0.9, "{lda} {nearest}");
    }

    #[test]
    fn a_copy_of_its_own_take_is_not_looked_at() {
        // made dances are the real windows of takes of the same names: what would be nearest is left out
        let real = cloud("real", 10, 0.0);
        let [lda, nearest] = told(&real, &real).unwrap().unwrap().each_ref().map(right);
        assert!((nearest - 0.5).abs() < 0.1 && (lda - 0.5).abs() < 0.1, "{lda} {nearest}");
        assert_eq!(told(&real, &[]).unwrap(), None);
    }
}
