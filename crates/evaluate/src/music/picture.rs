//! A piece of music as charts.

use crate::{Error, Result};
use kinelm_music::feature::{CHANNELS, CHROMA, Features, STRENGTH};
use kinelm_view::plot::{Chart, Heat, Look, Rule, Scale, Series};
use std::ops::Range;

const LINEAR: (Scale, Scale) = (Scale::Linear, Scale::Linear);

/// Three charts: onset strength with the beats, and the pitch classes, both of a stretch (seconds); the tempo of the whole.
///
/// # Errors
/// [`kinelm_store::Error::Invalid`] for a stretch that has no frame of the piece.
pub fn charts(features: &Features, stretch: Range<f64>) -> Result<[Chart; 3]> {
    let fps = features.fps;
    let frames = |s: f64| ((s * fps).max(0.0).ceil() as usize).min(features.frames());
    let (from, to) = (frames(stretch.start), frames(stretch.end));
    if from >= to {
        let (Range { start, end }, whole) = (stretch, features.frames() as f64 / fps);
        let name = "the stretch to draw";
        return Err(Error::invalid(
            name,
            format!("{start} to {end} s"),
            format!("times within the piece's {whole:.2} s"),
        ));
    }
    let row = |f: usize| &features.numbers[f * CHANNELS..][..CHANNELS];
    let strength = (from..to).map(|f| (f as f64 / fps, f64::from(row(f)[STRENGTH]))).collect();
    let rule = |time: &f64| Rule { x: *time, name: String::new() };
    let within = features.beats.times_s.iter().filter(|t| stretch.contains(*t));
    let classes = |f: usize| row(f)[CHROMA].iter().map(|x| f64::from(*x));
    let tempi = features.beats.times_s.iter().copied().zip(features.beats.tempi_bpm()).collect();
    let line = |points| vec![Series { points, look: Look::Line, ..Series::default() }];
    let time = || "time, s".to_owned();
    Ok([
        Chart {
            title: "Onset strength, and the beats".into(),
            x: time(),
            y: "mean rise of a band, dB".into(),
            scales: LINEAR,
            series: line(strength),
            rules: within.map(rule).collect(),
            ..Chart::default()
        },
        Chart {
            title: "Pitch classes".into(),
            x: time(),
            y: "semitones above C".into(),
            scales: LINEAR,
            heat: Some(Heat {
                // cells are centred on their frames and pitch classes, hence the halves
                x: [(from as f64 - 0.5) / fps, (to as f64 - 0.5) / fps],
                y: [-0.5, 11.5],
                columns: to - from,
                values: (from..to).flat_map(classes).collect(),
                limits: [0.0, 1.0],
                label: "share".into(),
            }),
            ..Chart::default()
        },
        Chart {
            title: "Tempo".into(),
            x: time(),
            y: "beats a minute".into(),
            scales: LINEAR,
            series: line(tempi),
            ..Chart::default()
        },
    ])
}
