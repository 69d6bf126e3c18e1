//! The spectra of a clip as charts.

use super::filter::{LOW_HZ, MIDDLE_HZ};
use super::{LowDct, Series, Stft};
use crate::{Error, Result};
use kinelm_linalg::symmetric_eigen;
use kinelm_motion::Clip;
use kinelm_view::plot::{Chart, Heat, Look, Rule, Scale, Series as Curve};

/// The most joints of a charted clip: the time of the embedding grows with the cube of their number.
const MAX_JOINTS: usize = 512;
/// Decibels of the darkest colour below the loudest.
const DEPTH_DB: f64 = 60.0;

/// Which part of a clip is charted, and how.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SpectrumOptions {
    /// The joint of spectrogram and coefficients, by its number in the clip's skeleton.
    pub joint: usize,
    /// Seconds left out at the beginning.
    pub from_s: f64,
    /// Seconds from there on; `None`: to the end.
    pub seconds: Option<f64>,
    /// Frames per second, to which the clip is brought.
    pub fps: f64,
    /// Leave out the mean pose, which outweighs all movement: the mean of every component, and the magnitude at 0 Hz.
    pub no_dc: bool,
}

/// Three charts: the spectrogram of a joint, the spectral embedding of the body, a joint's coefficients.
///
/// Spectrogram: magnitudes over windows of 16 frames, hop 8, of the joint's rotation vector (the root of the sum of the
/// squares of its three components), in dB of its loudest. Embedding: [`embedding`]. Coefficients: of a cosine transform
/// over the whole stretch, the joint's and the mean of all joints', with the two bands of [`super::filter`] marked.
///
/// # Errors
/// A joint that isn't there; a stretch of fewer than 16 frames; a rate that can't be had.
pub fn charts(clip: &Clip, options: &SpectrumOptions) -> Result<[Chart; 3]> {
    let names = clip.skeleton().names();
    let joint = options.joint;
    let name = names
        .get(joint)
        .ok_or_else(|| Error::invalid_parameter("joint", joint, format!("below {}, the clip's joints", names.len())))?;
    if names.len() > MAX_JOINTS {
        return Err(Error::limit("the charts", format!("{} joints", names.len()), format!("{MAX_JOINTS} joints"), ""));
    }
    let series = stretch(&Series::of(clip, &[], options.fps, false)?, options)?;
    let stft = Stft::new(series.frames, options.no_dc);
    let spectrum = |c: usize| {
        let mean = series.channel(c).iter().sum::<f64>() / series.frames as f64;
        // a window spreads a constant over the frequency beside 0 too
        let off = if options.no_dc { mean } else { 0.0 };
        stft.magnitudes(&series.channel(c).iter().map(|x| x - off).collect::<Vec<f64>>())
    };
    let spectra: Vec<Vec<f64>> = (0..series.channels.len()).map(spectrum).collect();
    let of_joint = length(&spectra[3 * joint..3 * joint + 3]);
    let heat = |values: Vec<f64>, limits: [f64; 2], label: &str, title: String| {
        // a cell is drawn about its frequency, half a bin to either side
        let half = 0.5 * series.fps / (stft.bins() - 1) as f64 * 0.5;
        let places = stft.frames() as f64 * Stft::HOP as f64 / series.fps;
        // a window's column is the hop about its middle
        let first = options.from_s + 0.5 * (Stft::WINDOW - Stft::HOP) as f64 / series.fps;
        Chart {
            title,
            x: "time, s".into(),
            y: "frequency, Hz".into(),
            scales: (Scale::Linear, Scale::Linear),
            heat: Some(Heat {
                x: [first, first + places],
                y: [if options.no_dc { half } else { -half }, 0.5 * series.fps + half],
                columns: stft.frames(),
                values,
                limits,
                label: label.into(),
            }),
            ..Chart::default()
        }
    };
    // above 0, so that a joint at rest has decibels instead of NaN
    let loudest = of_joint.iter().fold(0.0f64, |m, x| m.max(*x)).max(f64::MIN_POSITIVE);
    let decibels = of_joint.iter().map(|x| 20.0 * (x / loudest).log10()).map(|d| d.max(-DEPTH_DB)).collect();
    let embedded = embedding(&spectra)?;
    let limits = embedded.iter().fold([0.0f64; 2], |[low, high], &x| [low.min(x), high.max(x)]);
    Ok([
        heat(decibels, [-DEPTH_DB, 0.0], "dB of the loudest", format!("Spectrogram of {name}")),
        heat(embedded, limits, "first component", "Spectral embedding of the body".into()),
        coefficients(&series, joint, name, options.no_dc),
    ])
}

/// The spectral embedding of a body: of the spectrograms of its channels, all of one shape, the first principal component,
/// a picture of that shape and of length 1 whose sum isn't negative. The mean spectrogram is taken off before.
///
/// Zeros where all channels have the same spectrogram. Source: the thesis; docs/interpolation.md, "Pictures".
///
/// # Errors
/// Numbers beyond all range.
///
/// # Panics
/// When the spectrograms differ in length.
pub fn embedding(spectra: &[Vec<f64>]) -> Result<Vec<f64>> {
    let (c, n) = (spectra.len(), spectra.first().map_or(0, Vec::len));
    assert!(spectra.iter().all(|s| s.len() == n), "spectrograms of one shape");
    let mean: Vec<f64> = (0..n).map(|i| spectra.iter().map(|s| s[i]).sum::<f64>() / c as f64).collect();
    // or the spectrogram that all channels share would be the first component
    let off: Vec<Vec<f64>> = spectra.iter().map(|s| s.iter().zip(&mean).map(|(x, m)| x - m).collect()).collect();
    // of C channels and many more numbers: the small one of the two products
    let mut products = vec![0.0; c * c];
    for i in 0..c {
        for j in 0..=i {
            products[i * c + j] = off[i].iter().zip(&off[j]).map(|(a, b)| a * b).sum();
        }
    }
    let (values, vectors) = symmetric_eigen(c, &products).ok_or_else(|| {
        Error::unsupported("a spectral embedding", "the spectra are not finite; are the rotations right?")
    })?;
    let mut picture = vec![0.0; n];
    if values.first().is_none_or(|v| *v <= 0.0) {
        return Ok(picture);
    }
    for (share, spectrum) in vectors[..c].iter().zip(&off) {
        picture.iter_mut().zip(spectrum).for_each(|(p, x)| *p += share * x);
    }
    let size = picture.iter().map(|x| x * x).sum::<f64>().sqrt();
    // an eigenvector has no sign of its own: the same clip must give the same picture everywhere
    let sign = if picture.iter().sum::<f64>() < 0.0 { -1.0 } else { 1.0 };
    picture.iter_mut().for_each(|x| *x *= sign / size);
    Ok(picture)
}

/// The part of a series that is charted.
fn stretch(series: &Series, options: &SpectrumOptions) -> Result<Series> {
    let at = |s: f64| (s * series.fps).round() as usize;
    let start = at(options.from_s).min(series.frames);
    let frames = options.seconds.map_or(series.frames - start, |s| at(s).min(series.frames - start));
    if frames < Stft::WINDOW {
        let found = format!("{frames} frames at {} fps from {} s on", series.fps, options.from_s);
        let expected = format!("at least {}, a window of the spectrogram", Stft::WINDOW);
        return Err(Error::invalid("the stretch to draw", found, expected));
    }
    Ok(series.slice(start, frames))
}

/// At every place the length of the vector of several series.
fn length(series: &[Vec<f64>]) -> Vec<f64> {
    (0..series[0].len()).map(|i| series.iter().map(|s| s[i] * s[i]).sum::<f64>().sqrt()).collect()
}

/// Coefficients over frequency: of one joint, and the mean of all.
fn coefficients(series: &Series, joint: usize, name: &str, no_dc: bool) -> Chart {
    let dct = LowDct::new(series.frames, series.frames);
    let of = |joint: usize| length(&[0, 1, 2].map(|axis| dct.forward(series.channel(3 * joint + axis))));
    let all: Vec<Vec<f64>> = (0..series.joints.len()).map(of).collect();
    let mean = (0..series.frames).map(|k| all.iter().map(|x| x[k]).sum::<f64>() / all.len() as f64);
    let hz = |k: usize| k as f64 * series.fps / (2 * series.frames) as f64;
    let curve = |name: &str, look, values: Vec<f64>| Curve {
        name: name.into(),
        // the mean is the first coefficient
        points: values.into_iter().enumerate().skip(usize::from(no_dc)).map(|(k, x)| (hz(k), x)).collect(),
        look,
        colour: None,
    };
    let rule = |x: f64, what: &str| Rule { x, name: format!("{what}: {x:.1} Hz") };
    Chart {
        title: "Coefficients, and the bands that are kept".into(),
        x: "frequency, Hz".into(),
        y: "size of the coefficient, radians".into(),
        scales: (Scale::Linear, Scale::Log),
        series: vec![
            curve(name, Look::Line, all[joint].clone()),
            curve("mean of all joints", Look::Line, mean.collect()),
        ],
        rules: vec![rule(LOW_HZ, "low"), rule(MIDDLE_HZ, "low and middle")],
        ..Chart::default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_motion::rotation::exp_map;
    use kinelm_motion::{Skeleton, Vec3};
    use std::f64::consts::TAU;
    use std::sync::Arc;

    /// Two joints: one swings at 7.5 Hz, which is a bin of the spectrogram, the other stands.
    fn swinging(frames: usize) -> Clip {
        let names = vec!["root".into(), "arm".into()];
        let s = Skeleton::new(names, vec![None, Some(0)], vec![Vec3::ZERO, Vec3::Y], vec![]).unwrap();
        let swing = |f: usize| Vec3::new(0.0, 0.3 * (TAU * 7.5 * f as f64 / 60.0).sin(), 0.0);
        let pose = |f: usize| [exp_map::from_vector(Vec3::X), exp_map::from_vector(swing(f))];
        Clip::new(Arc::new(s), 60.0, vec![Vec3::ZERO; frames], (0..frames).flat_map(pose).collect()).unwrap()
    }

    #[test]
    fn a_swing_stands_at_its_frequency() {
        let options = SpectrumOptions { joint: 1, from_s: 0.5, seconds: Some(2.0), fps: 60.0, no_dc: false };
        let [spectrogram, embedding, coefficients] = charts(&swinging(240), &options).unwrap();
        let heat = spectrogram.heat.unwrap();
        assert_eq!((heat.columns, heat.values.len()), (14, 14 * 9));
        assert_eq!((heat.x[0], heat.y), (0.5 + 4.0 / 60.0, [-1.875, 31.875]));
        for column in heat.values.chunks(9) {
            let loudest = (0..9).max_by(|&a, &b| column[a].total_cmp(&column[b])).unwrap();
            assert_eq!(loudest, 2, "7.5 Hz of 3.75 each: {column:?}");
            assert!(column[2] > -0.1 && column[5] < -50.0);
        }
        let embedded = embedding.heat.unwrap();
        // the standing root holds all of 0 Hz and outweighs the swing
        assert!(embedded.values.chunks(9).all(|c| c[0] > c[2]));
        let [_, moving, _] = charts(&swinging(240), &SpectrumOptions { no_dc: true, ..options }).unwrap();
        let heat = moving.heat.unwrap();
        assert!(heat.values.chunks(8).all(|c| c[1] > 0.15 && c[1] > 1.5 * c[0]) && heat.y[0] == 1.875);
        let joint = &coefficients.series[0];
        let (hz, _) = joint.points.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
        assert!((hz - 7.5).abs() < 0.26 && joint.name == "arm", "{hz}");
        assert_eq!(coefficients.rules.len(), 2);
    }

    #[test]
    fn the_first_component_of_pictures() {
        // along (3, 4): channels are its multiples about a mean
        let spectra: Vec<Vec<f64>> =
            [-1.0, 0.5, 2.0, -3.0].iter().map(|a| vec![7.0 + 3.0 * a, 1.0 + 4.0 * a]).collect();
        let picture = embedding(&spectra).unwrap();
        assert!((picture[0] - 0.6).abs() < 1e-12 && (picture[1] - 0.8).abs() < 1e-12, "{picture:?}");
        assert_eq!(embedding(&[vec![1.0, 2.0], vec![1.0, 2.0]]).unwrap(), [0.0, 0.0]);
        assert!(embedding(&[vec![1e200, 0.0], vec![0.0, 1.0]]).is_err());
    }

    #[test]
    fn what_cannot_be_drawn_is_said() {
        let clip = swinging(60);
        let said = |w: SpectrumOptions| charts(&clip, &w).unwrap_err().to_string();
        let all = SpectrumOptions { fps: 60.0, ..SpectrumOptions::default() };
        assert!(said(SpectrumOptions { joint: 2, ..all.clone() }).contains("`joint` is 2; expected below 2"));
        assert!(said(SpectrumOptions { from_s: 0.8, ..all.clone() }).contains("is 12 frames at 60 fps from 0.8 s on"));
        assert!(said(SpectrumOptions { from_s: 9.0, ..all.clone() }).contains("is 0 frames"));
        assert!(said(SpectrumOptions { seconds: Some(0.1), ..all }).contains("is 6 frames"));
    }
}
