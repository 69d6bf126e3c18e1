//! A Butterworth low pass, run forth and back over a series so that nothing is delayed.

use crate::{Error, Result};
use kinelm_store::Subject;
use std::f64::consts::PI;

/// The highest order: beyond it a filter rings longer than it is sharper.
pub const MAX_ORDER: usize = 8;

/// The digital low pass of one order and cut-off, as second-order sections.
///
/// Made as scipy's `butter` makes it: the poles of the analogue prototype, its cut-off prewarped, then the bilinear
/// transform. Sections instead of two polynomials, which lose their digits where all poles are near
/// 1: order 6 at 0.4 Hz of 120 frames a second.
#[derive(Debug, Clone, PartialEq)]
pub struct Butterworth {
    order: usize,
    sections: Vec<Section>,
}

/// `y = b x` in the sense of `a[0] = 1`: two zeros, two poles; its gain at 0 Hz is 1.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Section {
    b: [f64; 3],
    a: [f64; 2],
}

impl Butterworth {
    /// The filter of `order` poles whose gain at `cutoff_hz` is 3 dB below 1 (6 dB, run both ways), for `fps` numbers a
    /// second.
    ///
    /// # Errors
    /// An order outside 1..=[`MAX_ORDER`]; a cut-off that isn't above 0 and below half the rate.
    pub(crate) fn new(order: usize, cutoff_hz: f64, fps: f64) -> Result<Butterworth> {
        if !(1..=MAX_ORDER).contains(&order) {
            return Err(Error::invalid(
                Subject::about("the Butterworth filter's `order`", "order"),
                order,
                format!("1 to {MAX_ORDER}"),
            ));
        }
        if !(cutoff_hz > 0.0 && cutoff_hz < 0.5 * fps) {
            return Err(super::beyond(cutoff_hz, fps));
        }
        // half of tan: the bilinear transform at a rate of 1/2
        let bent = (PI * cutoff_hz / fps).tan();
        let sections = (0..order.div_ceil(2)).map(|i| Section::of(order, i, bent)).collect();
        Ok(Butterworth { order, sections })
    }

    /// Numbers of padding on either side of a series, which must be longer. Scipy's `3 max(len(a), len(b))`.
    pub(crate) fn padding(&self) -> usize {
        3 * (self.order + 1)
    }

    /// A series without frequencies above the cut-off, undelayed: forth, then back, each as if its first number had
    /// always been there. Beyond its ends the series goes on turned by half a circle about its end points.
    ///
    /// Agrees with scipy's `filtfilt(*butter(order, cutoff, fs=fps), series)`.
    ///
    /// # Errors
    /// A series not longer than [`Butterworth::padding`].
    pub(crate) fn filtfilt(&self, series: &[f64]) -> Result<Vec<f64>> {
        let (n, pad) = (series.len(), self.padding());
        if n <= pad {
            let order = self.order;
            let what = format!("a Butterworth filter of order {order}");
            let why = format!(
                "{n} frames are too few; it needs more than {pad}, which pad both ends; take a lower order, or a band of the \
                 cosine transform"
            );
            return Err(Error::unsupported(what, why));
        }
        let (first, last) = (series[0], series[n - 1]);
        // odd about the end points: value and slope go on, where a mirrored series would turn back
        let before = (1..=pad).rev().map(|i| 2.0 * first - series[i]);
        let after = (1..=pad).map(|i| 2.0 * last - series[n - 1 - i]);
        let mut x: Vec<f64> = before.chain(series.iter().copied()).chain(after).collect();
        self.run(&mut x);
        x.reverse();
        self.run(&mut x);
        x.reverse();
        Ok(x[pad..pad + n].to_vec())
    }

    /// Once over the series in place, as if its first number had always been there.
    fn run(&self, x: &mut [f64]) {
        let start = x.first().copied().unwrap_or(0.0);
        for Section { b, a } in &self.sections {
            // where a constant leaves the two delays; every section lets it through as it is
            let (mut z1, mut z2) = ((1.0 - b[0]) * start, (b[2] - a[1]) * start);
            for x in x.iter_mut() {
                let y = b[0] * *x + z1;
                z1 = b[1] * *x - a[0] * y + z2;
                z2 = b[2] * *x - a[1] * y;
                *x = y;
            }
        }
    }
}

impl Section {
    /// The `i`-th pair of poles, or the one real pole of an odd order.
    fn of(order: usize, i: usize, bent: f64) -> Section {
        if 2 * i + 1 == order {
            // the bilinear transform of the pole -bent; its zero is at half the rate
            let pole = (1.0 - bent) / (1.0 + bent);
            let gain = 0.5 * (1.0 - pole);
            return Section { b: [gain, gain, 0.0], a: [-pole, 0.0] };
        }
        // analogue pole bent * (-sin, cos); z = (1 + p) / (1 - p)
        let (sin, cos) = (PI * (2 * i + 1) as f64 / (2 * order) as f64).sin_cos();
        let (re, im) = (-bent * sin, bent * cos);
        let below = (1.0 - re).powi(2) + im * im;
        // real part and square of the modulus of the digital pole
        let (along, square) = ((1.0 - re * re - im * im) / below, ((1.0 + re).powi(2) + im * im) / below);
        // 1 - 2 along + square, without the difference of near numbers
        let gain = (re * re + im * im) / below;
        Section { b: [gain, 2.0 * gain, gain], a: [-2.0 * along, square] }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[derive(serde::Deserialize)]
    struct Golden {
        series: Vec<Vec<f64>>,
        cases: Vec<Case>,
    }

    #[derive(serde::Deserialize)]
    struct Case {
        order: usize,
        cutoff_hz: f64,
        fps: f64,
        series: usize,
        of: String,
        at: Vec<usize>,
        output: Vec<f64>,
    }

    #[test]
    fn as_scipy_has_it() {
        let golden: Golden = serde_json::from_str(include_str!("../../tests/golden/filter.json")).unwrap();
        assert!(golden.cases.iter().filter(|c| c.of == "filtfilt").count() > 40);
        for case in &golden.cases {
            let filter = Butterworth::new(case.order, case.cutoff_hz, case.fps).unwrap();
            let got = filter.filtfilt(&golden.series[case.series]).unwrap();
            let scale = golden.series[case.series].iter().fold(0.0f64, |m, x| m.max(x.abs()));
            for (&i, want) in case.at.iter().zip(&case.output) {
                let miss = (got[i] - want).abs() / scale;
                let [order, hz] = [case.order as f64, case.cutoff_hz];
                assert!(miss < 1e-9, "order {order}, {hz} Hz of {}, number {i}: {miss:e}", case.fps);
            }
        }
    }

    #[test]
    fn what_it_lets_through() {
        let (fps, n) = (60.0, 600);
        let wave = |hz: f64| (0..n).map(|i| (2.0 * PI * hz * i as f64 / fps).sin()).collect::<Vec<_>>();
        let strength = |x: &[f64]| x[200..400].iter().map(|x| x * x).sum::<f64>().sqrt();
        for order in 1..=MAX_ORDER {
            let filter = Butterworth::new(order, 6.0, fps).unwrap();
            let gain = |hz: f64| strength(&filter.filtfilt(&wave(hz)).unwrap()) / strength(&wave(hz));
            assert!((gain(6.0) - 0.5).abs() < 1e-3, "6 dB at the cut-off: {}", gain(6.0));
            assert!(gain(0.6) > 0.97 && gain(20.0) < 0.07 && gain(20.0) < 0.5f64.powi(order as i32));
            // a line is not bent, up to its ends: it goes on beyond them
            let line: Vec<f64> = (0..n).map(|i| 3.0 - 0.01 * i as f64).collect();
            let out = filter.filtfilt(&line).unwrap();
            let worst = out.iter().zip(&line).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(worst < 0.1, "order {order}: {worst}");
        }
    }

    #[test]
    fn what_is_too_short_or_too_high_is_refused() {
        let said = |order, cutoff| Butterworth::new(order, cutoff, 60.0).unwrap_err().to_string();
        assert!(said(0, 5.0).contains("`order` is 0; expected 1 to 8") && said(9, 5.0).contains("`order` is 9"));
        for cutoff in [0.0, -1.0, f64::NAN, 30.0, 31.0] {
            assert!(said(2, cutoff).contains("half the rate"), "{cutoff}");
        }
        let filter = Butterworth::new(2, 5.0, 60.0).unwrap();
        let message = filter.filtfilt(&[0.0; 9]).unwrap_err().to_string();
        assert!(message.contains("9 frames are too few") && message.contains("more than 9"), "{message}");
        assert_eq!(filter.filtfilt(&[0.0; 10]).unwrap(), [0.0; 10]);
    }
}
