//! Interpolation of two dances: the rotations of the first move until their spectrum is the second's, or between.
//!
//! [`Alignment`] makes two clips comparable, [`Relative`] makes their rotations numbers, `descent::descend` moves the
//! first's, [`interpolate()`] does all of it and measures the result. The root's path stays the first's but for its fast
//! part, which turns with the body. Source: the motion-language thesis; docs/interpolation.md.
//!
//! Only rotations are blended, without a look at contacts: feet may slide or sink.

pub mod align;
mod chart;
mod descent;
mod distance;
mod relative;
mod report;
mod vectors;

pub use align::{Aligned, Alignment};
pub use descent::{Descent, Method};
pub use distance::SpectralDistance;
pub use relative::Relative;
pub use report::{JITTER_BOUND, Likeness, Report};

use super::pca::PcaFit;
use super::{LowDct, PcaBasis, Series, Stft, Transform, WindowSpec};
use crate::{Error, Result};
use kinelm_motion::metric::jitter;
use kinelm_motion::resample::{self, resample};
use kinelm_motion::{Clip, Motion};
use kinelm_view::plot::Chart;
use serde::Serialize;
use std::ops::Range;
use vectors::{to_nearest_branches, unwound};

/// Frames of the longest window that a basis is fitted to: its covariance has their square.
const MAX_PCA_FRAMES: usize = 1024;
/// Windows of a basis that begin within one: components of few windows shake, and what is moved along them.
const PCA_HOPS: usize = 16;

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

/// Which numbers of the rotations are blended.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
#[cfg_attr(feature = "clap", derive(clap::ValueEnum))]
#[serde(rename_all = "lowercase")]
pub enum Coordinates {
    /// Turns about the vertical and small rotations, of which the slow part carries the fast one.
    #[default]
    Relative,
    /// Unwound rotation vectors, as in the thesis (compat): a dancer who turns flips.
    Vectors,
}

/// How two dances are blended.
#[derive(Debug, Clone, PartialEq)]
pub struct InterpolateOptions {
    /// Which parts of them.
    pub alignment: Alignment,
    /// The numbers of the rotations that are blended.
    pub coordinates: Coordinates,
    /// The spectrum of these numbers.
    pub spectrum: Spectrum,
    /// The band of coefficients or components that are moved, numbered from 0; `None`: those up to 3.5 Hz, the first 16
    /// of a basis.
    pub keep: Option<Range<usize>>,
    /// How far, and how it gets there.
    pub method: Method,
}

/// Two dances and the one between.
#[derive(Debug, Clone)]
pub struct Interpolated {
    /// The first's window, the second's on the first's rig, and the one between, on the first's rig.
    pub clips: [Clip; 3],
    /// Notes on the changes that made the two comparable.
    pub notes: Vec<String>,
    /// The measures of the blend.
    pub report: Report,
    /// How far the first and the one between are from the second, by frequency.
    pub distances: Vec<SpectralDistance>,
    /// The band of cosine coefficients that was moved, if it was one.
    band: Option<Range<usize>>,
}

impl Interpolated {
    /// The distances to the second dance before and after, by frequency.
    pub fn chart(&self) -> Chart {
        let Report { frames, fps, .. } = self.report;
        distance::chart(&self.distances, self.band.clone().map(|band| (band, frames, fps)))
    }
}

/// Interpolates from the first dance towards the second.
///
/// # Errors
/// Errors of `Alignment::of` and `descent::descend`; more coefficients than frames; a basis of more components than
/// the clips have series, or over a window of more than 1,024 frames.
pub fn interpolate(a: &Motion, b: &Motion, options: &InterpolateOptions) -> Result<Interpolated> {
    let Aligned { a: first, b: second, notes } = options.alignment.of(a, b)?;
    let (frames, channels) = (first.frames(), 3 * first.joints());
    let band = options.band(frames)?;
    let transform = options.transform(frames, band.clone(), [a, b])?;
    let method = options.method.resolve(channels * transform.kept());
    let descend = |a: &[f64], b: &[f64]| descent::descend(&transform, channels, a, b, method);
    let vectors_a = unwound(&first)?;
    let near_a = |clip: &Clip| -> Result<Series> {
        let mut series = unwound(clip)?;
        to_nearest_branches(&mut series, &vectors_a);
        Ok(series)
    };
    // on a's branches: a vector and its twin are one rotation and two features
    let vectors_b = near_a(&second)?;
    let (third, [from, to], moved) = match options.coordinates {
        Coordinates::Relative => {
            let (relative, [from, to]) = Relative::of([&first, &second]);
            let moved = descend(&from, &to)?;
            // magnitudes have no slow part of their own, so all of the rotation is moved
            let slow = if options.spectrum == Spectrum::Stft { frames } else { band.end };
            (relative.moved(&first, &from, &moved.window, slow)?, [from, to], moved)
        }
        Coordinates::Vectors => {
            let moved = descend(&vectors_a.numbers, &vectors_b.numbers)?;
            let third = Series { numbers: moved.window.clone(), ..vectors_a.clone() }.apply_to(&first)?;
            (third, [&vectors_a, &vectors_b].map(|series| series.numbers.clone()), moved)
        }
    };
    let vectors = [&vectors_a.numbers, &vectors_b.numbers, &near_a(&third)?.numbers];
    let stft = Likeness::of(&Transform::Stft(Stft::new(frames, false)), channels, vectors);
    let shakes = [&first, &second, &third].map(|clip| jitter(clip).unwrap_or(0.0));
    let larger = shakes[0].max(shakes[1]);
    let report = Report {
        frames,
        fps: first.fps(),
        channels,
        coordinates: options.coordinates,
        transform: options.spectrum.in_words(&transform, &band),
        numbers: channels * transform.kept(),
        method: in_words(method),
        stft,
        own: Likeness::of(&transform, channels, [&from, &to, &moved.window]),
        loss: moved.loss,
        jitter: shakes,
        // two dances that don't move have no jitter to compare with
        jitter_ratio: (larger > 0.0).then(|| shakes[2] / larger),
        is_between: stft.a_c > stft.a_b && stft.c_b > stft.a_b,
        is_smooth: shakes[2] <= JITTER_BOUND * larger,
    };
    let distances = distance::distances(options.spectrum, frames, first.fps(), [&from, &to, &moved.window]);
    let band = (options.spectrum == Spectrum::Dct).then_some(band);
    Ok(Interpolated { clips: [first, second, third], notes, report, distances, band })
}

impl InterpolateOptions {
    /// The band that is moved in a window of `frames`.
    fn band(&self, frames: usize) -> Result<Range<usize>> {
        let band = self.keep.clone().unwrap_or_else(|| match self.spectrum {
            Spectrum::Pca => 0..PcaBasis::KEEP.min(frames),
            _ => 0..self.alignment.low(frames),
        });
        match band {
            Range { start: 0, end } if end == 0 || end > frames => {
                Err(Error::invalid_parameter("keep", end, format!("1 to {frames}, the window's frames")))
            }
            Range { start, end } if start >= end || end > frames => {
                let expected = format!("the first below the end, and that at most {frames}, the window's frames");
                Err(Error::invalid_parameter("keep", format!("{start}..{end}"), expected))
            }
            band => Ok(band),
        }
    }

    fn transform(&self, frames: usize, band: Range<usize>, clips: [&Motion; 2]) -> Result<Transform> {
        match self.spectrum {
            Spectrum::Dct => Ok(Transform::Dct(LowDct::of_band(frames, band))),
            Spectrum::Stft => Ok(Transform::Stft(Stft::new(frames, false))),
            Spectrum::Pca => Ok(Transform::Pca(self.basis(frames, band.end, clips)?.without_first(band.start))),
        }
    }

    /// A basis fitted to all windows of both clips, with a hop of a sixteenth of a window.
    fn basis(&self, frames: usize, keep: usize, clips: [&Motion; 2]) -> Result<PcaBasis> {
        if frames > MAX_PCA_FRAMES {
            let (needs, most) = (format!("windows of {frames} frames"), format!("{MAX_PCA_FRAMES} frames"));
            return Err(Error::limit("a fitted basis", needs, most, "take DCT"));
        }
        let spec = WindowSpec { frames, hop: (frames / PCA_HOPS).max(1), fps: self.alignment.fps };
        let mut fit = PcaFit::new(frames);
        let mut count = 0;
        for motion in clips {
            let series = self.series(&motion.clip)?;
            for start in spec.starts(series.frames, 0) {
                fit.add(&series.window(start, frames));
                count += series.channels.len();
            }
        }
        // fewer series than components leave directions that no series has
        if count < keep {
            return Err(Error::invalid_parameter(
                "keep",
                keep,
                format!("at most {count}, the series that the clips have"),
            ));
        }
        fit.finish(keep)
    }

    /// The numbers of a whole clip: of vectors those that are unwound in each window.
    fn series(&self, clip: &Clip) -> Result<Series> {
        let series = Series::of(clip, &[], self.alignment.fps, false)?;
        Ok(match self.coordinates {
            Coordinates::Vectors => series,
            Coordinates::Relative => {
                let clip = resample(clip, self.alignment.fps, resample::Method::Auto)?;
                Series { numbers: Relative::of([&clip]).1.concat(), raw: true, ..series }
            }
        })
    }
}

impl Coordinates {
    fn in_words(self) -> &'static str {
        match self {
            Coordinates::Relative => "relative rotations",
            Coordinates::Vectors => "rotation vectors",
        }
    }
}

impl Spectrum {
    /// `dct`, `pca` or `stft`, with its size.
    fn in_words(self, transform: &Transform, band: &Range<usize>) -> String {
        let kept = if band.start == 0 { band.end.to_string() } else { format!("{}..{}", band.start, band.end) };
        match transform {
            Transform::Dct(t) => format!("dct {kept} of {}", t.length()),
            Transform::Pca(_) => format!("pca {kept}"),
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

#[cfg(test)]
mod tests;
