//! Interpolation of two dances: the rotations of the first move until their spectrum is the second's, or between.
//!
//! [`Alignment`] makes two clips comparable, [`descent::descend`] moves the first's rotation vectors, [`interpolate()`] does
//! both and measures the result. The root's path stays the first's. Source: the motion-language thesis;
//! docs/interpolation.md.

pub mod align;
pub mod descent;

pub use align::{Aligned, Alignment};
pub use descent::{Descent, Method};

use super::pca::PcaFit;
use super::{LowDct, PcaBasis, Series, Stft, Transform, WindowSpec};
use crate::{Error, Result};
use kinelm_motion::metric::jitter;
use kinelm_motion::{Clip, Motion};
use serde::Serialize;
use std::fmt;

/// Frames of the longest window that a basis is fitted to: its covariance has their square.
const MAX_PCA_FRAMES: usize = 1024;
/// Of the larger jitter of the two dances what lies between may have.
pub const JITTER_BOUND: f64 = 1.1;

/// Whose spectrum.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
pub enum Spectrum {
    /// Low coefficients of a cosine transform: what is above stays the first dance's.
    #[default]
    Dct,
    /// Coordinates in a basis of principal components, fitted to both clips.
    Pca,
    /// Magnitudes of a short-time Fourier transform; their phase is free, and what comes of them shakes.
    Stft,
}

/// How two dances are blended.
#[derive(Debug, Clone, PartialEq)]
pub struct InterpolateOptions {
    /// What of them.
    pub alignment: Alignment,
    /// By which spectrum.
    pub spectrum: Spectrum,
    /// Coefficients or components that are moved; `None`: those up to 3.5 Hz, 16 for a basis.
    pub keep: Option<usize>,
    /// How far, and how it gets there.
    pub method: Method,
}

/// Two dances and what lies between.
#[derive(Debug, Clone)]
pub struct Interpolated {
    /// The first's window, the second's on the first's rig, and the one between, on the first's rig and path.
    pub clips: [Clip; 3],
    /// What was changed to make the two comparable.
    pub notes: Vec<String>,
    /// What was measured.
    pub report: Report,
}

/// How alike three windows are, by the cosine of their features.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Likeness {
    /// The first and the second.
    pub a_b: f64,
    /// The first and the one between.
    pub a_c: f64,
    /// The one between and the second.
    pub c_b: f64,
}

/// What was measured of a blend.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Report {
    /// Frames of the window.
    pub frames: usize,
    /// Frames per second.
    pub fps: f64,
    /// C.
    pub channels: usize,
    /// The transform, in words.
    pub transform: String,
    /// Numbers of a feature.
    pub numbers: usize,
    /// The method with its settings, in words.
    pub method: String,
    /// By STFT features, whatever the transform.
    pub stft: Likeness,
    /// By the features of the transform.
    pub own: Likeness,
    /// The loss at the beginning and at the end of the way.
    pub loss: [f64; 2],
    /// Jitter of the first, the second and the one between, m/s^3.
    pub jitter: [f64; 3],
    /// Jitter of the one between over the larger of the others'; `None` where these stand still.
    pub jitter_ratio: Option<f64>,
    /// Whether it lies between the two by STFT features, nearer to either than they are to each other.
    pub is_between: bool,
    /// Whether it shakes at most a tenth more than the more shaken of the two.
    pub is_smooth: bool,
}

/// Interpolates from the first dance towards the second.
///
/// # Errors
/// What [`Alignment::of`] and [`descent::descend`] refuse; more coefficients than frames; a basis of more components than
/// the clips have series, or over a window of more than 1,024 frames.
pub fn interpolate(a: &Motion, b: &Motion, options: &InterpolateOptions) -> Result<Interpolated> {
    let Aligned { a: first, b: second, series: [sa, sb], notes } = options.alignment.of(a, b)?;
    let (frames, channels) = (sa.frames, sa.channels.len());
    let transform = options.transform(frames, [a, b])?;
    let method = options.method.resolve(channels * transform.kept());
    let moved = descent::descend(&transform, channels, &sa.numbers, &sb.numbers, method)?;
    let between = Series { numbers: moved.window, ..sa.clone() };
    let third = between.apply_to(&first)?;
    let windows = [&sa.numbers, &sb.numbers, &between.numbers];
    let stft = Likeness::of(&Transform::Stft(Stft::new(frames, false)), channels, windows);
    let shakes = [&first, &second, &third].map(|clip| jitter(clip).unwrap_or(0.0));
    let larger = shakes[0].max(shakes[1]);
    let report = Report {
        frames,
        fps: sa.fps,
        channels,
        transform: options.spectrum.in_words(&transform),
        numbers: channels * transform.kept(),
        method: in_words(method),
        stft,
        own: Likeness::of(&transform, channels, windows),
        loss: moved.loss,
        jitter: shakes,
        jitter_ratio: (larger > 0.0).then(|| shakes[2] / larger),
        is_between: stft.a_c > stft.a_b && stft.c_b > stft.a_b,
        is_smooth: shakes[2] <= JITTER_BOUND * larger,
    };
    Ok(Interpolated { clips: [first, second, third], notes, report })
}

impl InterpolateOptions {
    fn transform(&self, frames: usize, clips: [&Motion; 2]) -> Result<Transform> {
        let keep = self.keep.unwrap_or_else(|| match self.spectrum {
            Spectrum::Pca => PcaBasis::KEEP.min(frames),
            _ => self.alignment.low(frames),
        });
        if keep == 0 || keep > frames {
            return Err(Error::invalid("`keep`", keep, format!("1 to {frames}, the window's frames")));
        }
        match self.spectrum {
            Spectrum::Dct => Ok(Transform::Dct(LowDct::new(frames, keep))),
            Spectrum::Stft => Ok(Transform::Stft(Stft::new(frames, false))),
            Spectrum::Pca => Ok(Transform::Pca(self.basis(frames, keep, clips)?)),
        }
    }

    /// A basis fitted to all windows of both clips, half a window apart.
    fn basis(&self, frames: usize, keep: usize, clips: [&Motion; 2]) -> Result<PcaBasis> {
        if frames > MAX_PCA_FRAMES {
            let (needs, most) = (format!("windows of {frames} frames"), format!("{MAX_PCA_FRAMES} frames"));
            return Err(Error::limit("a fitted basis", needs, most, "take DCT"));
        }
        let spec = WindowSpec { frames, hop: (frames / 2).max(1), fps: self.alignment.fps };
        let mut fit = PcaFit::new(frames);
        let mut count = 0;
        for motion in clips {
            let series = Series::of(&motion.clip, &[], spec.fps, false)?;
            for start in spec.starts(series.frames, 0) {
                fit.add(&series.window(start, frames));
                count += series.channels.len();
            }
        }
        if count < keep {
            return Err(Error::invalid("`keep`", keep, format!("at most {count}, the series that the clips have")));
        }
        fit.finish(keep)
    }
}

impl Spectrum {
    /// `dct`, `pca` or `stft`, with its size.
    fn in_words(self, transform: &Transform) -> String {
        match transform {
            Transform::Dct(t) => format!("dct {} of {}", t.kept(), t.length()),
            Transform::Pca(t) => format!("pca {}", t.kept()),
            Transform::Stft(t) => format!("stft {} x {}", t.frames(), t.bins()),
        }
    }
}

fn in_words(method: Method) -> String {
    let descent = |name: &str, d: Descent| {
        let rate = d.rate.unwrap_or_default();
        format!("{name}, strength {}, rate {rate}, {} steps", d.strength, d.steps)
    };
    match method {
        Method::Closed { amount } => format!("closed form, amount {amount}"),
        Method::Adam(d) => descent("Adam", d),
        Method::Plain(d) => descent("plain descent", d),
    }
}

impl Likeness {
    /// Of windows a, b, c.
    fn of(transform: &Transform, channels: usize, [a, b, c]: [&Vec<f64>; 3]) -> Likeness {
        let [a, b, c] = [a, b, c].map(|x| transform.feature(x, channels));
        Likeness { a_b: cosine(&a, &b), a_c: cosine(&a, &c), c_b: cosine(&c, &b) }
    }
}

/// The cosine of the angle between two features; 0 where one of them is 0.
fn cosine(a: &[f64], b: &[f64]) -> f64 {
    let dot = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
    let size = (dot(a, a) * dot(b, b)).sqrt();
    if size > 0.0 { dot(a, b) / size } else { 0.0 }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}; {} frames at {} fps, {} channels", self.method, self.frames, self.fps, self.channels)?;
        writeln!(f, "loss {:.3e} to {:.3e}", self.loss[0], self.loss[1])?;
        writeln!(f, "{:<14}{:>8}{:>8}{:>8}", "cosine of", "A-B", "A-C", "C-B")?;
        for (name, l) in [("stft 16/8", self.stft), (&self.transform, self.own)] {
            writeln!(f, "{name:<14}{:>8.3}{:>8.3}{:>8.3}", l.a_b, l.a_c, l.c_b)?;
        }
        let [a, b, c] = self.jitter;
        write!(f, "jitter, m/s^3: A {a:.0}, B {b:.0}, C {c:.0}")?;
        if let Some(ratio) = self.jitter_ratio {
            write!(f, ", {ratio:.2} of the larger")?;
        }
        let yes = |is: bool| if is { "yes" } else { "no" };
        write!(f, "\nnearer to both than they are to each other: {}; ", yes(self.is_between))?;
        write!(f, "at most {JITTER_BOUND} of their jitter: {}", yes(self.is_smooth))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::rotation::angle_between;
    use kinelm_motion::{Source, synth};

    fn motions() -> [Motion; 2] {
        // two genres of one dancer
        let dances = synth::corpus(1, 2, 4.0, 60.0).unwrap();
        [0, 1].map(|i| Motion {
            path: format!("{i}.bvh").into(),
            clip: dances[i].clip.clone(),
            source: Source::Plain,
            warnings: Vec::new(),
        })
    }

    fn settings(spectrum: Spectrum, method: Method) -> InterpolateOptions {
        let alignment = Alignment { at_s: [1.0, 1.0], ..Alignment::default() };
        InterpolateOptions { alignment, spectrum, keep: None, method }
    }

    #[test]
    fn half_way_lies_between_and_does_not_shake() {
        let [a, b] = motions();
        let adam = Method::Adam(Descent { strength: 0.5, rate: None, steps: 500 });
        for method in
            [adam, Method::Closed { amount: 0.5 }, Method::Plain(Descent { strength: 0.5, rate: None, steps: 100 })]
        {
            let done = interpolate(&a, &b, &settings(Spectrum::Dct, method)).unwrap();
            let r = &done.report;
            // made-up dances hardly shake at all: what is left of a band at the window's ends counts
            assert!(r.is_between && r.jitter_ratio.unwrap() < 1.3, "{r}");
            assert!(r.own.a_b < r.own.a_c.min(r.own.c_b) && r.stft.a_b < 1.0, "{r}");
            assert_eq!((r.frames, r.numbers), (128, 72 * 16));
            assert_eq!(done.clips[2].root(), done.clips[0].root(), "the first's path");
        }
        let all = interpolate(&a, &b, &settings(Spectrum::Dct, Method::Closed { amount: 1.0 })).unwrap().report;
        assert!((all.own.c_b - 1.0).abs() < 1e-9 && all.loss[1] < 1e-20);
        let none = interpolate(&a, &b, &settings(Spectrum::Pca, Method::Closed { amount: 0.0 })).unwrap();
        let worst = none.clips[0].rotations().iter().zip(none.clips[2].rotations());
        assert!(worst.map(|(p, q)| angle_between(*p, *q)).fold(0.0, f64::max) < 1e-9);
    }

    #[test]
    fn magnitudes_shake() {
        let [a, b] = motions();
        let adam = Method::Adam(Descent { strength: 0.5, rate: None, steps: 200 });
        let ratio = |kind| interpolate(&a, &b, &settings(kind, adam)).unwrap().report.jitter_ratio.unwrap();
        let (stft, dct) = (ratio(Spectrum::Stft), ratio(Spectrum::Dct));
        assert!(stft > 1.2 * dct, "{stft} {dct}");
    }

    #[test]
    fn a_report_says_it_all() {
        let [a, b] = motions();
        let report = interpolate(&a, &b, &settings(Spectrum::Pca, Method::Closed { amount: 0.5 })).unwrap().report;
        let text = report.to_string();
        for part in
            ["closed form, amount 0.5", "128 frames at 60 fps, 72 channels", "pca 16", "A-C", "jitter, m/s^3: A "]
        {
            assert!(text.contains(part), "{part} in {text}");
        }
    }

    #[test]
    fn what_cannot_be_is_refused() {
        let [a, b] = motions();
        let said = |s: InterpolateOptions| interpolate(&a, &b, &s).unwrap_err().to_string();
        let half = Method::Closed { amount: 0.5 };
        assert!(
            said(InterpolateOptions { keep: Some(129), ..settings(Spectrum::Dct, half) }).contains("expected 1 to 128")
        );
        assert!(
            said(InterpolateOptions { keep: Some(0), ..settings(Spectrum::Pca, half) }).contains("expected 1 to 128")
        );
        assert!(said(settings(Spectrum::Stft, half)).contains("no closed form"));
    }
}
