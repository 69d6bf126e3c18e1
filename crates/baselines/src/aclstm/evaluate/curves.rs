//! Metrics over time: the error of each predicted frame, and the share of still frames in each second.

use super::saved::{no_report, saved};
use crate::{FPS, Result};
use kinelm_view::plot::{Chart, Look, Scale, Series, each_once};
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Means over dances.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
pub struct Curves {
    /// Mean joint distance, hips aligned, of each compared frame, cm.
    pub root_cm: Vec<f64>,
    /// The same of holding the last true frame.
    pub still_root_cm: Vec<f64>,
    /// Mean angle between local rotations of each compared frame, degrees.
    pub degrees: Vec<f64>,
    /// The same of holding the last true frame.
    pub still_degrees: Vec<f64>,
    /// Per second: the share of frames that are still with the hip fixed.
    pub still: Vec<f64>,
}

impl Curves {
    /// The mean at every index, over those that are long enough.
    pub fn mean<'a>(all: impl Iterator<Item = &'a Curves> + Clone) -> Curves {
        let of = |pick: fn(&Curves) -> &Vec<f64>| {
            let longest = all.clone().map(|one| pick(one).len()).max().unwrap_or(0);
            let at = |i: usize| {
                let (sum, count) =
                    all.clone().filter_map(|one| pick(one).get(i)).fold((0.0, 0), |(s, n), x| (s + x, n + 1));
                sum / f64::from(count)
            };
            (0..longest).map(at).collect()
        };
        Curves {
            root_cm: of(|c| &c.root_cm),
            still_root_cm: of(|c| &c.still_root_cm),
            degrees: of(|c| &c.degrees),
            still_degrees: of(|c| &c.still_degrees),
            still: of(|c| &c.still),
        }
    }

    /// The curves of the longest seeds in a JSON report of `kinelm aclstm evaluate`.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`]; [`kinelm_store::Error::File`] for what is no such report.
    pub fn load(path: &Path) -> Result<Curves> {
        #[derive(Deserialize)]
        struct Report {
            rows: Vec<Row>,
        }
        #[derive(Deserialize)]
        struct Row {
            seed_frames: usize,
            metrics: Metrics,
        }
        #[derive(Deserialize)]
        struct Metrics {
            curves: Curves,
        }
        let report: Report = saved(path)?;
        let longest = report.rows.into_iter().max_by_key(|row| row.seed_frames);
        longest.map(|row| row.metrics.curves).ok_or_else(|| no_report(path, "no rows"))
    }
}

/// Charts of networks by name. Runs of the same name are one line, their mean.
pub fn charts(all: &[(String, Curves)]) -> Vec<Chart> {
    let names = each_once(all.iter().map(|(name, _)| name.as_str()));
    let of = |name: &str| Curves::mean(all.iter().filter(|(other, _)| other == name).map(|(_, curves)| curves));
    let means: Vec<(&str, Curves)> = names.into_iter().map(|name| (name, of(name))).collect();
    let held = Curves::mean(all.iter().map(|(_, curves)| curves));
    let ms = 1000.0 / FPS;
    let chart = |title: &str, x: &str, y: &str, step: f64, scale, pick: fn(&Curves) -> &Vec<f64>, held: &[f64]| {
        // a value is of the end of its frame or second
        let points = |values: &[f64]| values.iter().enumerate().map(|(i, v)| ((i + 1) as f64 * step, *v)).collect();
        let line = |(name, curves): &(&str, Curves)| Series {
            name: (*name).into(),
            points: points(pick(curves)),
            look: Look::Line,
            colour: None,
        };
        let held = Series { name: "last frame held".into(), points: points(held), look: Look::Reference, colour: None };
        let series = means.iter().map(line).chain([held].into_iter().filter(|held| !held.points.is_empty())).collect();
        Chart {
            title: title.into(),
            x: x.into(),
            y: y.into(),
            scales: (scale, Scale::Linear),
            series,
            ..Chart::default()
        }
    };
    vec![
        chart("Joints, hips aligned", "ms predicted", "cm", ms, Scale::Linear, |c| &c.root_cm, &held.still_root_cm),
        chart("Local rotations", "ms predicted", "degrees", ms, Scale::Linear, |c| &c.degrees, &held.still_degrees),
        chart("Standing still, hip fixed", "seconds", "share of frames", 1.0, Scale::Log, |c| &c.still, &[]),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn curves(still: &[f64]) -> Curves {
        Curves { root_cm: vec![1.0, 2.0], still: still.into(), ..Curves::default() }
    }

    #[test]
    fn a_mean_goes_as_far_as_any() {
        let all = [curves(&[0.0, 1.0]), curves(&[1.0])];
        assert_eq!(Curves::mean(all.iter()).still, [0.5, 1.0]);
        assert_eq!(Curves::mean([].iter()), Curves::default());
    }

    #[test]
    fn runs_of_one_name_are_one_line() {
        let all = [("a", curves(&[0.0])), ("b", curves(&[1.0])), ("a", curves(&[0.5]))].map(|(n, c)| (n.into(), c));
        let charts = charts(&all);
        let lines: Vec<(&str, f64)> = charts[2].series.iter().map(|s| (s.name.as_str(), s.points[0].1)).collect();
        assert_eq!(lines, [("a", 0.25), ("b", 1.0)]);
        assert!((charts[0].series[0].points[1].0 - 2000.0 / 30.0).abs() < 1e-9);
        assert!(charts[1].is_empty());
    }

    #[test]
    fn a_report_without_curves_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("r.json");
        std::fs::write(&path, r#"{"rows":[{"seed_frames":9,"metrics":{}}]}"#).unwrap();
        let message = Curves::load(&path).unwrap_err().to_string();
        assert!(
            message.contains("missing field `curves`") && message.contains("measure the network again"),
            "{message}"
        );
    }
}
