//! Curves of several runs in one chart: lines for training, marks for measurements on the validation clips.

use super::log::{Log, Valid};
use crate::metrics::StepMetrics;
use kinelm_view::plot::{Chart, Look, Scale, Series};

/// The vertical axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum), value(rename_all = "snake_case"))]
pub enum Metric {
    /// Nats per token.
    Loss,
    /// Bits per frame.
    BitsPerFrame,
    /// The learning rate.
    Rate,
    /// The gradient's norm before clipping.
    GradientNorm,
    /// Tokens per second.
    TokensPerSecond,
}

impl Metric {
    fn label(self) -> &'static str {
        match self {
            Metric::Loss => "loss, nats a token",
            Metric::BitsPerFrame => "bits a frame",
            Metric::Rate => "learning rate",
            Metric::GradientNorm => "gradient norm",
            Metric::TokensPerSecond => "tokens a second",
        }
    }

    fn of_step(self, s: &StepMetrics) -> f64 {
        match self {
            Metric::Loss => s.loss,
            Metric::BitsPerFrame => s.bits_per_frame,
            Metric::Rate => s.rate,
            Metric::GradientNorm => s.gradient_norm,
            Metric::TokensPerSecond => s.tokens_per_second,
        }
    }

    fn of_valid(self, v: &Valid) -> Option<f64> {
        match self {
            Metric::Loss => Some(v.nats_per_token),
            Metric::BitsPerFrame => Some(v.bits_per_frame),
            _ => None,
        }
    }

    /// Losses and norms are on a logarithmic axis.
    fn scale(self) -> Scale {
        match self {
            Metric::Loss | Metric::BitsPerFrame | Metric::GradientNorm => Scale::Log,
            Metric::Rate | Metric::TokensPerSecond => Scale::Linear,
        }
    }
}

/// The horizontal axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum XAxis {
    /// Updates.
    Step,
    /// Tokens trained on.
    Tokens,
    /// Hours of training steps.
    Time,
}

/// Largest number of points of a line; more are averaged.
const POINTS: usize = 400;

/// Largest number of marks of a run; of more, every n-th is drawn, and the last.
const MARKS: usize = 40;

/// The curves of runs, by name.
pub fn chart(runs: &[(String, Log)], metric: Metric, over: XAxis) -> Chart {
    let mut series = Vec::new();
    for (colour, (name, log)) in runs.iter().enumerate() {
        let along = along(log, over);
        let train = along.iter().zip(&log.steps).map(|(x, s)| (*x, metric.of_step(s))).collect::<Vec<_>>();
        // a measurement has the abscissa of the last step before it
        let at = |v: &Valid| log.steps.partition_point(|s| s.step <= v.step).checked_sub(1).map(|i| along[i]);
        let valid = log.valid.iter().filter_map(|v| Some((at(v)?, metric.of_valid(v)?))).collect::<Vec<_>>();
        let colour = Some(colour);
        let label = if valid.is_empty() {
            String::new()
        } else {
            format!("{name} {}", if log.valid.iter().any(|v| v.pseudo) { "valid, pseudo" } else { "valid" })
        };
        series.push(Series { name: name.clone(), points: thinned(&train), look: Look::Line, colour });
        series.push(Series { name: label, points: spread(&valid), look: Look::Marks, colour });
    }
    let x = match over {
        XAxis::Step => "steps",
        XAxis::Tokens => "tokens",
        XAxis::Time => "hours of training steps",
    };
    let scales = (Scale::Linear, metric.scale());
    Chart { title: metric.label().into(), x: x.into(), y: metric.label().into(), scales, series, ..Chart::default() }
}

/// The abscissa of each step.
fn along(log: &Log, over: XAxis) -> Vec<f64> {
    match over {
        XAxis::Step => log.steps.iter().map(|s| s.step as f64).collect(),
        XAxis::Tokens => log.steps.iter().map(|s| s.tokens as f64).collect(),
        XAxis::Time => log.seconds().into_iter().map(|s| s / 3600.0).collect(),
    }
}

/// Means over stretches of equal length, for more than [`POINTS`] points.
fn thinned(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let stretch = points.len().div_ceil(POINTS).max(1);
    let mean = |part: &[(f64, f64)]| {
        let (x, y) = part.iter().fold((0.0, 0.0), |(a, b), (x, y)| (a + x, b + y));
        (x / part.len() as f64, y / part.len() as f64)
    };
    // means, as a pick of single steps would show the noise of those
    points.chunks(stretch).map(mean).collect()
}

/// Every n-th point counted from the last, for more than [`MARKS`] points.
fn spread(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let step = points.len().div_ceil(MARKS).max(1);
    let mut some: Vec<_> = points.iter().rev().step_by(step).copied().collect();
    some.reverse();
    some
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::runs::log::tests::write;

    #[test]
    fn measurements_are_at_their_steps() {
        let dir = tempfile::tempdir().unwrap();
        write(dir.path(), 12);
        let log = Log::read(dir.path()).unwrap();
        let runs = [("a".to_string(), log.clone()), ("b".to_string(), Log::default())];
        let of = |metric, over| chart(&runs, metric, over).series;
        let series = of(Metric::BitsPerFrame, XAxis::Step);
        assert_eq!(series[0].points[3], (4.0, 45.0));
        assert_eq!(series[1].points, [(5.0, 42.0), (10.0, 21.0)]);
        assert_eq!((series[1].name.as_str(), series[1].colour, series[3].name.as_str()), ("a valid", Some(0), ""));
        assert_eq!(of(Metric::Loss, XAxis::Tokens)[1].points, [(250.0, 0.6), (500.0, 0.3)]);
        assert_eq!(of(Metric::Loss, XAxis::Time)[0].points[11], (24.0 / 3600.0, 0.25));
        assert!(of(Metric::Rate, XAxis::Step)[1].points.is_empty());
        assert!(chart(&runs[1..], Metric::Loss, XAxis::Step).is_empty());
    }

    #[test]
    fn long_runs_are_averaged() {
        let points: Vec<(f64, f64)> = (0..1001).map(|i| (i as f64, 2.0 * i as f64)).collect();
        let thin = thinned(&points);
        assert_eq!((thin.len(), thin[0], thin[333]), (334, (1.0, 2.0), (999.5, 1999.0)));
        assert_eq!(thinned(&points[..400]), points[..400]);
        assert_eq!((spread(&points).len(), spread(&points)[38]), (39, points[1000]));
        assert_eq!(spread(&points[..40]), points[..40]);
    }
}
