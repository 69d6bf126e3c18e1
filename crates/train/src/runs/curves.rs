//! Curves of several runs: lines for training, marks for measurements on the validation clips.

use super::log::{Log, LstmLoss, Valid};
use crate::metrics::StepMetrics;
use kinelm_view::plot::{Chart, Look, Scale, Series, each_once};

/// The vertical axis.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum), value(rename_all = "snake_case"))]
pub enum Metric {
    /// Nats per token; of an LSTM the loss in its own measure.
    Loss,
    /// Bits per frame.
    BitsPerFrame,
    /// The learning rate.
    Rate,
    /// The gradient's norm before clipping.
    GradientNorm,
    /// Tokens per second.
    TokensPerSecond,
    /// The root's part of an LSTM's loss.
    Root,
    /// The rotations' part of an LSTM's loss.
    Rotations,
}

impl Metric {
    fn label(self, is_lstm: bool) -> &'static str {
        match self {
            Metric::Loss if is_lstm => "loss",
            Metric::Loss => "loss, nats a token",
            Metric::BitsPerFrame => "bits a frame",
            Metric::Rate => "learning rate",
            Metric::GradientNorm => "gradient norm",
            Metric::TokensPerSecond => "tokens a second",
            Metric::Root => "loss of the root",
            Metric::Rotations => "loss of the rotations",
        }
    }

    fn of_step(self, s: &StepMetrics) -> Option<f64> {
        Some(match self {
            Metric::Loss => s.loss,
            Metric::BitsPerFrame => s.bits_per_frame,
            Metric::Rate => s.rate,
            Metric::GradientNorm => s.gradient_norm,
            Metric::TokensPerSecond => s.tokens_per_second,
            Metric::Root | Metric::Rotations => return None,
        })
    }

    fn of_lstm(self, found: &LstmLoss) -> Option<f64> {
        match self {
            Metric::Loss => Some(found.loss),
            Metric::Root => found.root,
            Metric::Rotations => found.rotations,
            _ => None,
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
            Metric::Rate | Metric::TokensPerSecond => Scale::Linear,
            _ => Scale::Log,
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

/// The curves of runs, by name: a chart of GPTs and one of each form of LSTMs, whose losses can't be compared.
pub fn charts(runs: &[(String, Log)], metric: Metric, over: XAxis) -> Vec<Chart> {
    let forms = each_once(runs.iter().map(|(_, log)| &log.form));
    let of = |form| chart(form, runs.iter().filter(|(_, log)| log.form == *form), metric, over);
    forms.into_iter().map(of).collect()
}

fn chart<'a>(
    form: &Option<String>,
    runs: impl Iterator<Item = &'a (String, Log)>,
    metric: Metric,
    over: XAxis,
) -> Chart {
    let mut series = Vec::new();
    for (colour, (name, log)) in runs.enumerate() {
        let [train, valid] = if form.is_some() { of_lstm(log, metric, over) } else { of_gpt(log, metric, over) };
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
    let y = metric.label(form.is_some());
    let title = form.as_ref().map_or(y.into(), |form| format!("{form}: {y}"));
    let scales = (Scale::Linear, metric.scale());
    Chart { title, x: x.into(), y: y.into(), scales, series, ..Chart::default() }
}

/// Points of a GPT's steps and of its measurements.
fn of_gpt(log: &Log, metric: Metric, over: XAxis) -> [Vec<(f64, f64)>; 2] {
    let along = along(log, over);
    let train = along.iter().zip(&log.steps).filter_map(|(x, s)| Some((*x, metric.of_step(s)?)));
    // a measurement has the abscissa of the last step before it
    let at = |v: &Valid| log.steps.partition_point(|s| s.step <= v.step).checked_sub(1).map(|i| along[i]);
    let valid = log.valid.iter().filter_map(|v| Some((at(v)?, metric.of_valid(v)?)));
    [train.collect(), valid.collect()]
}

/// Points of an LSTM's updates and of its measurements.
fn of_lstm(log: &Log, metric: Metric, over: XAxis) -> [Vec<(f64, f64)>; 2] {
    let hours = log.lstm.iter().scan(0.0, |total, step| {
        *total += step.seconds / 3600.0;
        Some(*total)
    });
    let along: Vec<f64> = match over {
        XAxis::Step => log.lstm.iter().map(|step| step.step as f64).collect(),
        XAxis::Time => hours.collect(),
        XAxis::Tokens => return [Vec::new(), Vec::new()],
    };
    let train = along.iter().zip(&log.lstm).filter_map(|(x, step)| Some((*x, metric.of_lstm(step)?)));
    let at = |v: &LstmLoss| log.lstm.partition_point(|s| s.step <= v.step).checked_sub(1).map(|i| along[i]);
    let valid = log.lstm_valid.iter().filter_map(|v| Some((at(v)?, metric.of_lstm(v)?)));
    [train.collect(), valid.collect()]
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
        let of = |metric, over| charts(&runs, metric, over).remove(0).series;
        let series = of(Metric::BitsPerFrame, XAxis::Step);
        assert_eq!(series[0].points[3], (4.0, 45.0));
        assert_eq!(series[1].points, [(5.0, 42.0), (10.0, 21.0)]);
        assert_eq!((series[1].name.as_str(), series[1].colour, series[3].name.as_str()), ("a valid", Some(0), ""));
        assert_eq!(of(Metric::Loss, XAxis::Tokens)[1].points, [(250.0, 0.6), (500.0, 0.3)]);
        assert_eq!(of(Metric::Loss, XAxis::Time)[0].points[11], (24.0 / 3600.0, 0.25));
        assert!(of(Metric::Rate, XAxis::Step)[1].points.is_empty());
        assert!(charts(&runs[1..], Metric::Loss, XAxis::Step)[0].is_empty());
    }

    #[test]
    fn lstms_have_a_chart_of_their_own_for_each_form() {
        let dir = tempfile::tempdir().unwrap();
        let run = |name: &str, config: &str, kind: &str| {
            let run = dir.path().join(name);
            std::fs::create_dir(&run).unwrap();
            std::fs::write(run.join("config.toml"), config).unwrap();
            let line = |step: u64, loss: f64| {
                format!(
                    "{{\"schema\":1,\"kind\":\"{kind}\",\"step\":{step},\"loss\":{loss},\"root\":0.25,\"rotations\":0.5,\"seconds\":1800}}\n"
                )
            };
            let valid = "{\"schema\":1,\"kind\":\"valid\",\"step\":2,\"valid\":{\"loss\":0.75,\"root\":0.125,\"rotations\":0.625}}\n";
            std::fs::write(run.join("metrics.jsonl"), line(1, 2.0) + &line(2, 1.0) + valid + "{\"cut").unwrap();
            (name.to_string(), Log::read(&run).unwrap())
        };
        let aclstm = |form: &str| format!("kind = \"aclstm\"\n[config]\nform = \"{form}\"\n");
        let music = "kind = \"music-lstm\"\n[config]\npose = \"aligned\"\neffort = \"none\"\n";
        let runs = [
            run("a", &aclstm("euler"), "aclstm"),
            run("b", &aclstm("positional"), "aclstm"),
            run("c", &aclstm("euler"), "aclstm"),
            run("m", music, "music-lstm"),
        ];
        assert_eq!(runs[0].1.incomplete, 1);
        let found = charts(&runs, Metric::Rotations, XAxis::Time);
        let titles: Vec<&str> = found.iter().map(|chart| &*chart.title).collect();
        assert_eq!(
            titles,
            ["aclstm euler", "aclstm positional", "music-lstm aligned"]
                .map(|form| format!("{form}: loss of the rotations"))
        );
        let euler: Vec<_> = found[0].series.iter().map(|s| (&*s.name, s.points.clone(), s.colour)).collect();
        let (train, valid) = (vec![(0.5, 0.5), (1.0, 0.5)], vec![(1.0, 0.625)]);
        assert_eq!(euler[..2], [("a", train, Some(0)), ("a valid", valid, Some(0))]);
        assert_eq!((euler[2].0, euler[2].2), ("c", Some(1)));
        assert_eq!(charts(&runs, Metric::Loss, XAxis::Step)[2].series[0].points, [(1.0, 2.0), (2.0, 1.0)]);
        // what an LSTM hasn't
        assert!(charts(&runs, Metric::BitsPerFrame, XAxis::Step).iter().all(Chart::is_empty));
        assert!(charts(&runs, Metric::Loss, XAxis::Tokens).iter().all(Chart::is_empty));
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
