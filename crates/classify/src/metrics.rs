//! Metrics of classification: accuracy, balanced accuracy, macro F1, confusion, calibration, intervals.

use super::class_scores::likeliest;
use kinelm_store::random;
use serde::Serialize;

/// A classified window or clip.
#[derive(Debug, Clone, PartialEq)]
pub struct Outcome {
    /// Its clip: the independent unit.
    pub clip: usize,
    /// Its true class.
    pub class: usize,
    /// ln p of every class.
    pub log_p: Vec<f64>,
}

/// Metrics of some outcomes.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Metrics {
    /// Outcomes.
    pub count: usize,
    /// Their clips.
    pub clips: usize,
    /// Share of right ones.
    pub accuracy: f64,
    /// Its 95 % interval: Wilson's where each outcome is one clip, else by bootstrap over clips.
    pub accuracy_95: [f64; 2],
    /// Mean over the classes of their accuracy.
    pub balanced_accuracy: f64,
    /// Mean over the classes of F1 = 2 TP / (2 TP + FP + FN).
    pub macro_f1: f64,
    /// Expected calibration error: mean |accuracy - confidence| over ten bins of confidence, by their counts.
    pub calibration_error: f64,
    /// Mean -ln p of the right class.
    pub nats: f64,
    /// (classes, classes) counts, `[true][predicted]`.
    pub confusion: Vec<Vec<usize>>,
}

/// Resamples of the bootstrap.
const RESAMPLES: u64 = 1000;

impl Metrics {
    /// Of outcomes over `classes` classes; `None` without outcomes. Balanced accuracy and F1 are over the classes that occur.
    pub(crate) fn of(outcomes: &[Outcome], classes: usize, seed: u64) -> Option<Metrics> {
        if outcomes.is_empty() {
            return None;
        }
        let mut confusion = vec![vec![0usize; classes]; classes];
        for o in outcomes {
            confusion[o.class][likeliest(&o.log_p)] += 1;
        }
        let right = |o: &&Outcome| likeliest(&o.log_p) == o.class;
        let hits = outcomes.iter().filter(right).count();
        let mut clips: Vec<usize> = outcomes.iter().map(|o| o.clip).collect();
        clips.sort_unstable();
        clips.dedup();
        let of_class = |class: usize| confusion[class].iter().sum::<usize>();
        let predicted = |class: usize| confusion.iter().map(|row| row[class]).sum::<usize>();
        let occurring: Vec<usize> = (0..classes).filter(|&c| of_class(c) > 0).collect();
        let mean = |of: &dyn Fn(usize) -> f64| occurring.iter().map(|&c| of(c)).sum::<f64>() / occurring.len() as f64;
        Some(Metrics {
            count: outcomes.len(),
            clips: clips.len(),
            accuracy: hits as f64 / outcomes.len() as f64,
            // windows of a clip are not independent, and Wilson's interval takes them to be
            accuracy_95: match clips.len() == outcomes.len() {
                true => wilson(hits, outcomes.len()),
                false => bootstrap(outcomes, &clips, seed),
            },
            balanced_accuracy: mean(&|c| confusion[c][c] as f64 / of_class(c) as f64),
            macro_f1: mean(&|c| 2.0 * confusion[c][c] as f64 / (of_class(c) + predicted(c)) as f64),
            calibration_error: calibration(outcomes),
            nats: -outcomes.iter().map(|o| o.log_p[o.class]).sum::<f64>() / outcomes.len() as f64,
            confusion,
        })
    }
}

/// Wilson's 95 % interval of a share of `n` independent outcomes, at least one; within 0 to 1.
///
/// Source: Wilson, "Probable Inference, the Law of Succession, and Statistical Inference" (1927), without a correction for
/// continuity.
///
/// ```
/// let [low, high] = kinelm_classify::metrics::wilson(8, 10);
/// assert!((low - 0.490).abs() < 1e-3 && (high - 0.943).abs() < 1e-3);
/// ```
pub fn wilson(hits: usize, n: usize) -> [f64; 2] {
    // the 97.5 % quantile of the standard normal distribution
    const Z: f64 = 1.959_963_984_540_054;
    let (n, p) = (n as f64, hits as f64 / n as f64);
    let (middle, scale) = (p + Z * Z / (2.0 * n), 1.0 + Z * Z / n);
    let half = Z * (p * (1.0 - p) / n + Z * Z / (4.0 * n * n)).sqrt();
    [(middle - half) / scale, (middle + half) / scale].map(|x| x.clamp(0.0, 1.0))
}

/// The middle 95 % of the accuracy of clips resampled with replacement.
fn bootstrap(outcomes: &[Outcome], clips: &[usize], seed: u64) -> [f64; 2] {
    let mut tally = vec![[0usize; 2]; clips.len()];
    for o in outcomes {
        let at = clips.partition_point(|&c| c < o.clip);
        tally[at][0] += usize::from(likeliest(&o.log_p) == o.class);
        tally[at][1] += 1;
    }
    let one = |resample: u64| {
        let mut rng = random::stream(seed, "bootstrap", resample, 0);
        let (mut hits, mut all) = (0, 0);
        for _ in 0..clips.len() {
            let [h, n] = tally[(random::unit(&mut rng) * clips.len() as f64) as usize];
            (hits, all) = (hits + h, all + n);
        }
        hits as f64 / all as f64
    };
    let mut found: Vec<f64> = (0..RESAMPLES).map(one).collect();
    found.sort_by(f64::total_cmp);
    [found[(0.025 * RESAMPLES as f64) as usize], found[(0.975 * RESAMPLES as f64) as usize]]
}

/// Mean |accuracy - confidence| over ten bins of confidence, weighted by their counts.
fn calibration(outcomes: &[Outcome]) -> f64 {
    let mut bins = [[0.0; 2]; 10];
    for o in outcomes {
        let predicted = likeliest(&o.log_p);
        // rounding may leave the largest ln p just above 0
        let sure = o.log_p[predicted].exp().min(1.0);
        // a confidence of 1 belongs to the last bin
        let bin = &mut bins[((sure * 10.0) as usize).min(9)];
        bin[0] += sure;
        bin[1] += f64::from(u8::from(predicted == o.class));
    }
    // sums in place of means: times a bin's share its count cancels
    bins.iter().map(|[sure, right]| (sure - right).abs()).sum::<f64>() / outcomes.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn outcome(clip: usize, class: usize, p: [f64; 2]) -> Outcome {
        Outcome { clip, class, log_p: p.map(f64::ln).to_vec() }
    }

    #[test]
    fn metrics_by_hand() {
        // 3 of class 0, of which 2 are right; 1 of class 1, right
        let all = [
            outcome(0, 0, [0.75, 0.25]),
            outcome(1, 0, [0.75, 0.25]),
            outcome(2, 0, [0.25, 0.75]),
            outcome(3, 1, [0.25, 0.75]),
        ];
        let f = Metrics::of(&all, 2, 1).unwrap();
        assert_eq!(f.confusion, [[2, 1], [0, 1]]);
        assert_eq!((f.count, f.clips, f.accuracy), (4, 4, 0.75));
        assert!((f.balanced_accuracy - (2.0 / 3.0 + 1.0) / 2.0).abs() < 1e-12);
        // F1: 4/5 and 2/3
        assert!((f.macro_f1 - (0.8 + 2.0 / 3.0) / 2.0).abs() < 1e-12);
        // all in the bin of 0.7 to 0.8: right 3 of 4, sure 0.75
        assert!(f.calibration_error < 1e-12);
        assert!((f.nats + (3.0 * 0.75f64.ln() + 0.25f64.ln()) / 4.0).abs() < 1e-12);
        assert_eq!(Metrics::of(&[], 2, 1), None);
    }

    #[test]
    fn intervals() {
        // scipy 1.17.1, binomtest(9, 10).proportion_ci(method="wilson")
        let [low, high] = wilson(9, 10);
        assert!(
            (low - 0.595_849_973_204_761_6).abs() < 1e-12 && (high - 0.982_123_786_904_927_2).abs() < 1e-12,
            "{low} {high}"
        );
        // windows of one clip are right or wrong together: wider than of 40 independent ones
        let windows: Vec<Outcome> =
            (0..40).map(|i| outcome(i / 10, 0, if i / 10 == 0 { [0.1, 0.9] } else { [0.9, 0.1] })).collect();
        let [low, high] = Metrics::of(&windows, 2, 1).unwrap().accuracy_95;
        assert!(low <= 0.25 + 1e-9 && high == 1.0, "{low} {high}");
    }
}
