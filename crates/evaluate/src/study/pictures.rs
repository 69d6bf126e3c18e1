//! A study's pictures.

use super::Report;
use super::metrics::RowMetrics;
use kinelm_tokenizer::SchemeConfig;
use kinelm_view::plot::{Chart, Look, Series, each_once};

/// The pictures, by their names without extension.
pub fn all(report: &Report) -> [(&'static str, Vec<Chart>); 2] {
    [("bins", vec![bins(&report.rows)]), ("rate", rate(&report.rows).into())]
}

/// Angle error against the number of uniform bins, with what even errors would give.
fn bins(rows: &[RowMetrics]) -> Chart {
    let of = |f: &RowMetrics| match &f.row.config.scheme {
        SchemeConfig::Uniform(u) if f.row.group == "uniform" => Some(f64::from(u.bins)),
        _ => None,
    };
    let mut points: Vec<(f64, &RowMetrics)> = rows.iter().filter_map(|f| Some((of(f)?, f))).collect();
    points.sort_by(|a, b| a.0.total_cmp(&b.0));
    let along = |name: &str, look: Look, y: &dyn Fn(f64, &RowMetrics) -> f64| Series {
        name: name.into(),
        points: points.iter().map(|(n, f)| (*n, y(*n, f))).collect(),
        look,
        colour: None,
    };
    // half the diagonal of a bin, and its mean over a cube
    let (most, even) = (3f64.sqrt() / 2.0 * 360.0, 0.480_296 * 360.0);
    Chart {
        title: "Angle error against bins".into(),
        x: "bins a component".into(),
        y: "angle error, degrees".into(),
        series: vec![
            along("bound: 0.87 of a bin", Look::Reference, &|n, _| most / n),
            along("even errors: 0.48 of a bin", Look::Reference, &|n, _| even / n),
            along("largest", Look::Joined, &|_, f| f.angle.max.to_degrees()),
            along("mean", Look::Joined, &|_, f| f.angle.mean.to_degrees()),
        ],
        ..Chart::default()
    }
}

/// Order-0 bits and tokens a second against the error of places, a curve a group.
fn rate(rows: &[RowMetrics]) -> [Chart; 2] {
    let groups = each_once(rows.iter().map(|f| f.row.group.as_str()));
    let chart = |title: &str, x: &str, rate: fn(&RowMetrics) -> f64| {
        let series = groups.iter().map(|group| {
            let mut points: Vec<(f64, f64)> =
                rows.iter().filter(|f| f.row.group == *group).map(|f| (rate(f), f.mpjpe.global)).collect();
            points.sort_by(|a, b| a.0.total_cmp(&b.0));
            // a curve only where more bits buy less error all along
            let joined = points.len() > 2 && points.windows(2).all(|w| w[1].1 < w[0].1 && w[1].0 > 1.02 * w[0].0);
            let look = if joined { Look::Joined } else { Look::Marks };
            Series { name: group.to_string(), points, look, colour: None }
        });
        Chart { title: title.into(), x: x.into(), y: "MPJPE, mm".into(), series: series.collect(), ..Chart::default() }
    };
    [
        chart("Order-0 rate against distortion", "bits a second, static tables", |f| f.order0.bits_per_second),
        chart("Tokens against distortion", "tokens a second", |f| f.text.tokens_per_second),
    ]
}
