//! The distance of spectra from the second dance's, by frequency, and its picture.

use super::Spectrum;
use crate::{LowDct, Stft, Transform};
use kinelm_view::plot::{Chart, Look, Rule, Scale, Series as Curve};
use std::ops::Range;

/// The part of the largest distance that is the smallest one in a picture: closed forms leave 1e-16.
const SMALLEST: f64 = 1e-5;

/// The distance from the second dance's coefficients at one frequency: root mean squares over the channels (of
/// magnitudes also over their places), in the units of the coefficients.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct SpectralDistance {
    /// The frequency.
    pub hz: f64,
    /// The first dance's.
    pub before: f64,
    /// The blend's.
    pub after: f64,
}

/// The distances of windows (C, N) of the first dance, the second and the one between. Of STFT at its frequencies, else
/// at those of all N coefficients of a cosine transform, also of components, which have none.
pub(super) fn distances(spectrum: Spectrum, frames: usize, fps: f64, windows: [&[f64]; 3]) -> Vec<SpectralDistance> {
    let (transform, bins, step) = match spectrum {
        Spectrum::Stft => {
            let stft = Stft::new(frames, false);
            let bins = stft.bins();
            (Transform::Stft(stft), bins, fps / Stft::WINDOW as f64)
        }
        Spectrum::Dct | Spectrum::Pca => (Transform::Dct(LowDct::new(frames, frames)), frames, hz(1, frames, fps)),
    };
    let [a, b, c] = windows.map(|window| transform.feature(window, window.len() / frames));
    let distance = |x: &[f64], bin: usize| {
        let squares = x.iter().zip(&b).skip(bin).step_by(bins).map(|(x, to)| (x - to).powi(2));
        (squares.sum::<f64>() / (b.len() / bins) as f64).sqrt()
    };
    let at = |bin| SpectralDistance { hz: bin as f64 * step, before: distance(&a, bin), after: distance(&c, bin) };
    (0..bins).map(at).collect()
}

/// The frequency of a coefficient of a cosine transform over `frames`.
fn hz(coefficient: usize, frames: usize, fps: f64) -> f64 {
    coefficient as f64 * fps / (2 * frames) as f64
}

/// The distances before and after as curves, with the ends of the band that was moved.
pub(super) fn chart(distances: &[SpectralDistance], band: Option<(Range<usize>, usize, f64)>) -> Chart {
    let largest = distances.iter().map(|d| d.before.max(d.after)).fold(0.0, f64::max);
    let curve = |name: &str, of: fn(&SpectralDistance) -> f64| Curve {
        name: name.into(),
        points: distances.iter().map(|d| (d.hz, of(d).max(SMALLEST * largest))).collect(),
        look: Look::Line,
        colour: None,
    };
    let rules = band.map_or(Vec::new(), |(band, frames, fps)| {
        let rule =
            |what: &str, k: usize| Rule { x: hz(k, frames, fps), name: format!("{what} {:.1} Hz", hz(k, frames, fps)) };
        let from = (band.start > 0).then(|| rule("from", band.start));
        from.into_iter().chain([rule("to", band.end - 1)]).collect()
    });
    Chart {
        title: "Distance of the coefficients to B's".into(),
        x: "frequency, Hz".into(),
        y: "root mean square over channels, radians".into(),
        scales: (Scale::Linear, Scale::Log),
        series: vec![curve("A", |d| d.before), curve("the blend", |d| d.after)],
        rules,
        ..Chart::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn distances_are_those_of_the_coefficients() {
        // two channels of a wave that is coefficient 6 alone: c_6 = sqrt(2/32), so its coefficient is a sqrt(16)
        let wave = |a: f64| (0..32).map(move |n| a * (std::f64::consts::PI * 6.0 * (n as f64 + 0.5) / 32.0).cos());
        let window = |a: f64, b: f64| wave(a).chain(wave(b)).collect::<Vec<f64>>();
        let [a, b, c] = [window(0.1, 0.0), window(0.5, 0.3), window(0.4, 0.3)];
        let found = distances(Spectrum::Dct, 32, 60.0, [&a, &b, &c]);
        assert_eq!((found.len(), found[6].hz), (32, 5.625));
        // of 4 x 0.4 and 4 x 0.3, and of 4 x 0.1 and 0
        assert!((found[6].before - (1.6f64 * 1.6 + 1.2 * 1.2).sqrt() / 2f64.sqrt()).abs() < 1e-12, "{:?}", found[6]);
        assert!((found[6].after - 0.4 / 2f64.sqrt()).abs() < 1e-12);
        assert!(found.iter().filter(|d| d.hz != 5.625).all(|d| d.before < 1e-12 && d.after < 1e-12));
        let found = distances(Spectrum::Stft, 32, 60.0, [&a, &b, &c]);
        assert_eq!((found.len(), found[1].hz, found[8].hz), (9, 3.75, 30.0));
        assert!(found[1].before > found[1].after);
        let chart = chart(&found, Some((4..16, 128, 60.0)));
        let names: Vec<&str> = chart.rules.iter().map(|rule| rule.name.as_str()).collect();
        assert_eq!(names, ["from 0.9 Hz", "to 3.5 Hz"]);
        assert_eq!(chart.series[1].points.len(), 9);
    }
}
