//! Errors by length of the seed: means and standard deviations over runs.

use super::saved::saved;
use crate::Result;
use crate::form::Form;
use kinelm_view::plot::{Chart, Look, Scale, Series, each_once};
use serde::Deserialize;
use std::collections::BTreeMap;
use std::path::Path;

/// Errors of a report, by frames of the seed.
#[derive(Debug, Clone, PartialEq)]
pub struct SeedLengths {
    form: Form,
    rows: BTreeMap<usize, Errors>,
}

/// Errors over the compared frames.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Errors {
    loss: f64,
    root_cm: f64,
    degrees: f64,
}

impl SeedLengths {
    /// The rows of a JSON report of `kinelm aclstm evaluate`.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`]; [`kinelm_store::Error::File`] for what is no such report.
    pub fn load(path: &Path) -> Result<SeedLengths> {
        #[derive(Deserialize)]
        struct Report {
            form: Form,
            rows: Vec<Row>,
        }
        #[derive(Deserialize)]
        struct Row {
            seed_frames: usize,
            metrics: Metrics,
        }
        #[derive(Deserialize)]
        struct Metrics {
            loss: Mean,
            root_cm: Mean,
            degrees: Mean,
        }
        #[derive(Deserialize)]
        struct Mean {
            mean: f64,
        }
        let report: Report = saved(path)?;
        let errors = |m: Metrics| Errors { loss: m.loss.mean, root_cm: m.root_cm.mean, degrees: m.degrees.mean };
        let rows = report.rows.into_iter().map(|row| (row.seed_frames, errors(row.metrics))).collect();
        Ok(SeedLengths { form: report.form, rows })
    }
}

/// Charts of networks by name: the loss of each form, which others can't be compared with, then errors of joints and of
/// rotations. Runs of the same name are one line, their mean, with a bar of a standard deviation to both sides.
pub fn seed_charts(all: &[(String, SeedLengths)]) -> Vec<Chart> {
    let forms = each_once(all.iter().map(|(_, one)| one.form));
    // a name has its colour in all charts
    let names = each_once(all.iter().map(|(name, _)| name.as_str()));
    let chart = |title: String, y: &str, form: Option<Form>, pick: fn(&Errors) -> f64| {
        let series = names.iter().enumerate().flat_map(|(colour, name)| {
            let runs = all.iter().filter(|(other, one)| other == name && form.is_none_or(|form| form == one.form));
            of_runs(name, colour, &runs.map(|(_, one)| one).collect::<Vec<_>>(), pick)
        });
        let (series, x) = (series.collect(), "frames of the seed".into());
        Chart { title, x, y: y.into(), scales: (Scale::Linear, Scale::Linear), series, ..Chart::default() }
    };
    let losses = forms.iter().map(|form| {
        let name = format!("{form:?}").to_lowercase();
        chart(format!("{name}: the next {} frames", super::COMPARED), "loss", Some(*form), |e| e.loss)
    });
    let others = [
        chart("Joints, hips aligned".into(), "cm", None, |e| e.root_cm),
        chart("Local rotations".into(), "degrees", None, |e| e.degrees),
    ];
    losses.chain(others).collect()
}

/// The mean of some runs at each length, and a bar where there are several.
fn of_runs(name: &str, colour: usize, runs: &[&SeedLengths], pick: fn(&Errors) -> f64) -> Vec<Series> {
    let mut by_length: BTreeMap<usize, Vec<f64>> = BTreeMap::new();
    for (length, errors) in runs.iter().flat_map(|run| &run.rows) {
        by_length.entry(*length).or_default().push(pick(errors));
    }
    let stats = by_length.into_iter().map(|(length, values)| {
        let [mean, deviation] = mean_and_deviation(&values);
        (length as f64, mean, deviation)
    });
    let stats: Vec<(f64, f64, f64)> = stats.collect();
    let colour = Some(colour);
    let points = stats.iter().map(|(x, mean, _)| (*x, *mean)).collect();
    let bars = stats.iter().filter(|(.., deviation)| *deviation > 0.0).map(|(x, mean, deviation)| Series {
        name: String::new(),
        points: vec![(*x, mean - deviation), (*x, mean + deviation)],
        look: Look::Line,
        colour,
    });
    [Series { name: name.into(), points, look: Look::Joined, colour }].into_iter().chain(bars).collect()
}

/// The mean and the standard deviation, of n as all of ours.
fn mean_and_deviation(values: &[f64]) -> [f64; 2] {
    let n = values.len() as f64;
    let mean = values.iter().sum::<f64>() / n;
    let squares: f64 = values.iter().map(|x| (x - mean).powi(2)).sum();
    [mean, (squares / n).sqrt()]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn report(dir: &Path, name: &str, form: &str, losses: &[(usize, f64)]) -> (String, SeedLengths) {
        let row = |(frames, loss): &(usize, f64)| {
            let of = |x: f64| serde_json::json!({ "mean": x, "over_takes": [x, x] });
            let metrics =
                serde_json::json!({ "loss": of(*loss), "root_cm": of(10.0 * loss), "degrees": of(100.0 * loss) });
            serde_json::json!({ "seed_frames": frames, "metrics": metrics })
        };
        let text = serde_json::json!({ "schema": 2, "form": form, "rows": losses.iter().map(row).collect::<Vec<_>>() });
        let path = dir.join("report.json");
        std::fs::write(&path, text.to_string()).unwrap();
        (name.into(), SeedLengths::load(&path).unwrap())
    }

    #[test]
    fn runs_of_a_name_are_a_mean_with_its_spread() {
        let dir = tempfile::tempdir().unwrap();
        let all = [
            report(dir.path(), "euler-5", "euler", &[(200, 4.0), (100, 1.0)]),
            report(dir.path(), "euler-5", "euler", &[(100, 2.0), (200, 4.0)]),
            report(dir.path(), "euler-5", "euler", &[(100, 3.0)]),
            report(dir.path(), "quat", "quaternion", &[(100, 7.0)]),
        ];
        let charts = seed_charts(&all);
        let titles: Vec<&str> = charts.iter().map(|chart| &*chart.title).collect();
        assert_eq!(titles[..2], ["euler: the next 20 frames", "quaternion: the next 20 frames"]);
        assert_eq!(titles[2..], ["Joints, hips aligned", "Local rotations"]);
        // 1, 2, 3: mean 2; twice 4: no bar
        let deviation = (2.0f64 / 3.0).sqrt();
        let shown: Vec<_> = charts[0].series.iter().map(|s| (&*s.name, s.points.clone(), s.colour)).collect();
        let (mean, bar) = (vec![(100.0, 2.0), (200.0, 4.0)], vec![(100.0, 2.0 - deviation), (100.0, 2.0 + deviation)]);
        assert_eq!(shown[..2], [("euler-5", mean, Some(0)), ("", bar, Some(0))]);
        assert_eq!(charts[1].series.iter().flat_map(|s| s.points.clone()).collect::<Vec<_>>(), [(100.0, 7.0)]);
        assert_eq!(charts[3].series.last().unwrap().points, [(100.0, 700.0)]);
        assert_eq!(charts[3].series.last().unwrap().colour, Some(1));
        std::fs::write(dir.path().join("report.json"), "{}").unwrap();
        let message = SeedLengths::load(&dir.path().join("report.json")).unwrap_err().to_string();
        assert!(message.contains("expected a JSON report of kinelm aclstm evaluate"), "{message}");
    }
}
