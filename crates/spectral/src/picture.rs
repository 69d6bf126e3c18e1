//! The spectra of clips as charts and panels.

use super::filter::{LOW_HZ, MIDDLE_HZ};
use super::{LowDct, Series, Stft};
use crate::{Error, Result};
use kinelm_linalg::symmetric_eigen;
use kinelm_motion::Clip;
use kinelm_view::panel::{Bands, Panel, Track};
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

/// The most clips of one picture.
pub const MAX_CLIPS: usize = 8;

/// The spectra of a clip: the spectrogram of a joint, the spectral embedding of the body, a joint's coefficients.
///
/// Spectrogram: magnitudes over windows of 16 frames, hop 8, of the joint's rotation vector (the root of the sum of the
/// squares of its three components). Embedding: [`embedding`]. Coefficients: of a cosine transform over the whole
/// stretch.
#[derive(Debug, Clone, PartialEq)]
pub struct Spectra {
    clip: String,
    joint: String,
    from_s: f64,
    fps: f64,
    no_dc: bool,
    /// N, frames of the stretch.
    frames: usize,
    /// B, the frequencies, without 0 Hz where that is left out.
    bins: usize,
    /// (T, B) both.
    spectrogram: Vec<f64>,
    embedding: Vec<f64>,
    /// (N) the joint's, and the mean of all joints'.
    coefficients: [Vec<f64>; 2],
}

impl Spectra {
    /// The spectra of a clip that is called `name` beside others.
    ///
    /// # Errors
    /// A joint that isn't there; a stretch of fewer than 16 frames; a rate that can't be had.
    pub fn of(name: &str, clip: &Clip, options: &SpectrumOptions) -> Result<Spectra> {
        let &SpectrumOptions { joint, from_s, no_dc, .. } = options;
        let names = clip.skeleton().names();
        let joint_name = names.get(joint).ok_or_else(|| {
            Error::invalid_parameter("joint", joint, format!("below {}, the clip's joints", names.len()))
        })?;
        if names.len() > MAX_JOINTS {
            let found = format!("{} joints", names.len());
            return Err(Error::limit("the charts", found, format!("{MAX_JOINTS} joints"), ""));
        }
        let series = stretch(&Series::of(clip, &[], options.fps, false)?, options)?;
        let stft = Stft::new(series.frames, no_dc);
        let spectrum = |c: usize| {
            let mean = series.channel(c).iter().sum::<f64>() / series.frames as f64;
            // a window spreads a constant over the frequency beside 0 too
            let off = if no_dc { mean } else { 0.0 };
            stft.magnitudes(&series.channel(c).iter().map(|x| x - off).collect::<Vec<f64>>())
        };
        let spectra: Vec<Vec<f64>> = (0..series.channels.len()).map(spectrum).collect();
        Ok(Spectra {
            clip: name.into(),
            joint: joint_name.clone(),
            from_s,
            fps: series.fps,
            no_dc,
            frames: series.frames,
            bins: stft.bins() - usize::from(no_dc),
            spectrogram: length(&spectra[3 * joint..3 * joint + 3]),
            embedding: embedding(&spectra)?,
            coefficients: coefficients(&series, joint),
        })
    }

    /// The part of a clip that the spectra are of.
    pub fn part_of(&self, clip: &Clip) -> Clip {
        let at = |s: f64| ((s * clip.fps()).round() as usize).min(clip.frames());
        // of a slow clip that part may be less than a frame
        let from = at(self.from_s).min(clip.frames().saturating_sub(1));
        clip.slice(from..at(self.from_s + self.frames as f64 / self.fps).max(from + 1))
    }

    /// The frequency of a row.
    fn hz(&self, row: usize) -> f64 {
        (row + usize::from(self.no_dc)) as f64 * self.fps / Stft::WINDOW as f64
    }

    fn decibels(&self, loudest: f64) -> Vec<f64> {
        self.spectrogram.iter().map(|x| (20.0 * (x / loudest).log10()).max(-DEPTH_DB)).collect()
    }

    /// A chart of numbers (T, B).
    fn heat(&self, title: String, values: Vec<f64>, limits: [f64; 2], label: &str) -> Chart {
        // a cell is drawn about its frequency, half a bin to either side
        let half = 0.5 * self.fps / Stft::WINDOW as f64;
        let places = values.len() / self.bins;
        // a window's column is the hop about its middle
        let first = self.from_s + 0.5 * (Stft::WINDOW - Stft::HOP) as f64 / self.fps;
        Chart {
            title,
            x: "time, s".into(),
            y: "frequency, Hz".into(),
            scales: (Scale::Linear, Scale::Linear),
            heat: Some(Heat {
                x: [first, first + (places * Stft::HOP) as f64 / self.fps],
                y: [self.hz(0) - half, 0.5 * self.fps + half],
                columns: places,
                values,
                limits,
                label: label.into(),
            }),
            ..Chart::default()
        }
    }

    /// A panel of numbers (T, B), the highest frequency at the top.
    fn bands(&self, figure: usize, title: String, unit: &str, values: &[f64], limits: [f64; 2]) -> Panel {
        let track = |row: usize| Track {
            name: format!("{:.1} Hz", self.hz(row)),
            figure: Some(figure),
            fps: self.fps / Stft::HOP as f64,
            // the middle of the first window
            from_s: 0.5 * Stft::WINDOW as f64 / self.fps,
            values: values.iter().skip(row).step_by(self.bins).copied().collect(),
        };
        let tracks = (0..self.bins).rev().map(track).collect();
        Panel::Bands(Bands { title, unit: unit.into(), tracks, range: Some(limits) })
    }
}

const DECIBELS: &str = "dB of the loudest";
const COMPONENT: &str = "first component";

/// The scale of several clips: the loudest magnitude, and the least and the greatest of their embeddings.
fn scale(all: &[Spectra]) -> (f64, [f64; 2]) {
    // above 0, so that a joint at rest has decibels instead of NaN
    let loudest = all.iter().flat_map(|s| &s.spectrogram).fold(f64::MIN_POSITIVE, |m, x| m.max(*x));
    let limits = |[low, high]: [f64; 2], x: &f64| [low.min(*x), high.max(*x)];
    (loudest, all.iter().flat_map(|s| &s.embedding).fold([0.0; 2], limits))
}

/// The name of something of a clip, with the clip's where there are several.
fn titled(what: String, all: &[Spectra], of: &Spectra) -> String {
    if all.len() > 1 { format!("{what}, {}", of.clip) } else { what }
}

/// A spectrogram of each clip, in dB of the loudest of all, an embedding of each on one scale, and the coefficients of
/// all with the two bands of [`super::filter`] marked: rows of as many charts as clips, or of one clip a row of three.
///
/// # Errors
/// More than [`MAX_CLIPS`] clips.
pub fn charts(all: &[Spectra]) -> Result<Vec<Chart>> {
    if all.len() > MAX_CLIPS {
        let why = format!("{MAX_CLIPS} clips in one picture");
        return Err(Error::limit("the charts", format!("{} clips", all.len()), why, ""));
    }
    let (loudest, limits) = scale(all);
    let spectrogram = |s: &Spectra| {
        let title = titled(format!("Spectrogram of {}", s.joint), all, s);
        s.heat(title, s.decibels(loudest), [-DEPTH_DB, 0.0], DECIBELS)
    };
    let embedded = |s: &Spectra| {
        let title = titled("Spectral embedding of the body".into(), all, s);
        s.heat(title, s.embedding.clone(), limits, COMPONENT)
    };
    let mut charts: Vec<Chart> = all.iter().map(spectrogram).chain(all.iter().map(embedded)).collect();
    charts.push(coefficient_chart(all));
    Ok(charts)
}

/// The same for a page whose figures are the parts of the clips, in this order.
pub fn panels(all: &[Spectra]) -> Vec<Panel> {
    let (loudest, limits) = scale(all);
    let spectrogram = |(i, s): (usize, &Spectra)| {
        let title = titled(format!("Spectrogram of {}", s.joint), all, s);
        s.bands(i, title, DECIBELS, &s.decibels(loudest), [-DEPTH_DB, 0.0])
    };
    let embedded = |(i, s): (usize, &Spectra)| {
        s.bands(i, titled("Spectral embedding of the body".into(), all, s), COMPONENT, &s.embedding, limits)
    };
    let spectrograms = all.iter().enumerate().map(spectrogram);
    spectrograms.chain(all.iter().enumerate().map(embedded)).collect()
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

/// The lengths of the coefficients of one joint, and the mean of all joints', (N) each.
fn coefficients(series: &Series, joint: usize) -> [Vec<f64>; 2] {
    let dct = LowDct::new(series.frames, series.frames);
    let of = |joint: usize| length(&[0, 1, 2].map(|axis| dct.forward(series.channel(3 * joint + axis))));
    let mut all: Vec<Vec<f64>> = (0..series.joints.len()).map(of).collect();
    let mean = (0..series.frames).map(|k| all.iter().map(|x| x[k]).sum::<f64>() / all.len() as f64).collect();
    [all.swap_remove(joint), mean]
}

/// Coefficients over frequency.
fn coefficient_chart(all: &[Spectra]) -> Chart {
    let curve = |s: &Spectra, name: String, values: &[f64]| Curve {
        name,
        // the mean is the first coefficient
        points: values.iter().enumerate().skip(usize::from(s.no_dc)).map(|(k, x)| (hz_of(s, k), *x)).collect(),
        look: Look::Line,
        colour: None,
    };
    let curves = |s: &Spectra| {
        let [joint, mean] = &s.coefficients;
        let names = [s.joint.clone(), "mean of all joints".into()].map(|name| titled(name, all, s));
        let [own, of_all] = names;
        [curve(s, own, joint), curve(s, of_all, mean)]
    };
    let rule = |x: f64, what: &str| Rule { x, name: format!("{what}: {x:.1} Hz") };
    Chart {
        title: "Coefficients, and the bands that are kept".into(),
        x: "frequency, Hz".into(),
        y: "size of the coefficient, radians".into(),
        scales: (Scale::Linear, Scale::Log),
        series: all.iter().flat_map(curves).collect(),
        rules: vec![rule(LOW_HZ, "low"), rule(MIDDLE_HZ, "low and middle")],
        ..Chart::default()
    }
}

/// The frequency of a coefficient over the stretch.
fn hz_of(s: &Spectra, k: usize) -> f64 {
    k as f64 * s.fps / (2 * s.frames) as f64
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
        let one = |options: &SpectrumOptions| Spectra::of("a", &swinging(240), options).unwrap();
        let drawn = |options: &SpectrumOptions| -> [Chart; 3] { charts(&[one(options)]).unwrap().try_into().unwrap() };
        let [spectrogram, embedding, coefficients] = drawn(&options);
        assert_eq!(spectrogram.title, "Spectrogram of arm");
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
        let [_, moving, _] = drawn(&SpectrumOptions { no_dc: true, ..options });
        let heat = moving.heat.unwrap();
        assert!(heat.values.chunks(8).all(|c| c[1] > 0.15 && c[1] > 1.5 * c[0]) && heat.y[0] == 1.875);
        let joint = &coefficients.series[0];
        let (hz, _) = joint.points.iter().copied().max_by(|a, b| a.1.total_cmp(&b.1)).unwrap();
        assert!((hz - 7.5).abs() < 0.26 && joint.name == "arm", "{hz}");
        assert_eq!(coefficients.rules.len(), 2);
    }

    /// The same swing at a third of its size, beside it: 20 log10(1/3) dB lower on the loudest's scale.
    #[test]
    fn several_clips_have_one_scale() {
        let loud = swinging(240);
        let rotations = loud.rotations().iter().enumerate().map(|(i, q)| match i % 2 {
            0 => *q,
            _ => exp_map::from_vector(exp_map::to_vector(*q) / 3.0),
        });
        let quiet = Clip::new(loud.skeleton().clone(), 60.0, loud.root().to_vec(), rotations.collect()).unwrap();
        let options = SpectrumOptions { joint: 1, from_s: 0.5, seconds: Some(2.0), fps: 60.0, no_dc: true };
        let all = [("loud", &loud), ("quiet", &quiet)].map(|(name, clip)| Spectra::of(name, clip, &options).unwrap());
        let found = charts(&all).unwrap();
        let titles: Vec<&str> = found.iter().map(|chart| chart.title.as_str()).collect();
        assert_eq!(
            titles[..3],
            ["Spectrogram of arm, loud", "Spectrogram of arm, quiet", "Spectral embedding of the body, loud"]
        );
        let heat = |i: usize| found[i].heat.as_ref().unwrap();
        assert_eq!((found.len(), heat(0).limits, heat(2).limits), (5, heat(1).limits, heat(3).limits));
        // the row of 7.5 Hz
        let off = heat(1).values[1] - heat(0).values[1];
        assert!((off - 20.0 * (1.0f64 / 3.0).log10()).abs() < 1e-6, "{off}");
        assert_eq!(found[4].series.len(), 4);
        let part = all[0].part_of(&loud);
        assert_eq!((part.frames(), part.pose(0)), (120, loud.pose(30)));
        let panels = panels(&all);
        let Panel::Bands(Bands { title, tracks, range, .. }) = &panels[1] else { panic!("no bands") };
        assert_eq!((panels.len(), title.as_str(), *range), (4, "Spectrogram of arm, quiet", Some([-60.0, 0.0])));
        assert_eq!((tracks.len(), tracks[0].name.as_str(), tracks[6].name.as_str()), (8, "30.0 Hz", "7.5 Hz"));
        assert_eq!((tracks[6].fps, tracks[6].from_s, tracks[6].figure), (7.5, 8.0 / 60.0, Some(1)));
        assert_eq!(tracks[6].values, heat(1).values.iter().skip(1).step_by(8).copied().collect::<Vec<_>>());
        assert!(charts(&vec![all[0].clone(); 9]).unwrap_err().to_string().contains("8 clips"));
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
        let said = |w: SpectrumOptions| Spectra::of("a", &clip, &w).unwrap_err().to_string();
        let all = SpectrumOptions { fps: 60.0, ..SpectrumOptions::default() };
        assert!(said(SpectrumOptions { joint: 2, ..all.clone() }).contains("`joint` is 2; expected below 2"));
        assert!(said(SpectrumOptions { from_s: 0.8, ..all.clone() }).contains("is 12 frames at 60 fps from 0.8 s on"));
        assert!(said(SpectrumOptions { from_s: 9.0, ..all.clone() }).contains("is 0 frames"));
        assert!(said(SpectrumOptions { seconds: Some(0.1), ..all }).contains("is 6 frames"));
    }
}
