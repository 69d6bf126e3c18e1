//! Two dancers compared: how far apart they are, how late and how fast one is, and where they differ most.
//!
//! Both clips are put on the neutral SMPL body at 30 frames a second, without place and heading (`body`). The line of a
//! lag and a tempo along which they are nearest (`line`) is what a straight change of time explains; dynamic time
//! warping around it (`warp`) aligns the rest, and distances are those of aligned frames. All of it is done with the
//! student's mirror image too, and the nearer of the two is reported. Source: the motion-language thesis compares
//! teacher and student by spectral windows (sections 3.4 and 3.8), which are too flat for it; the alignment is ours
//! (docs/compare.md).
//!
//! **Letters**: F frames of a clip, N aligned frames, K joints.

mod body;
mod line;
mod page;
mod report;
#[cfg(test)]
mod tests;
mod warp;

pub use line::TEMPI;
pub use report::{Comparison, JointDistance, WorstMoment};

use crate::query::Distance;
use crate::{Error, LowDct, Result, Series, Transform};
use body::BodyPoses;
use kinelm_motion::mirror::mirror;
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::{Clip, Motion, joints, retarget};
use line::{Line, nearest_line};
use std::ops::RangeInclusive;
use warp::{Path, path};

/// Frames per second at which clips are aligned.
pub const FPS: f64 = 30.0;
/// Seconds of a band.
pub const BAND_S: RangeInclusive<f64> = 0.1..=30.0;
/// Frames and rate of the windows of the cosine: those of `query`.
const WINDOW: (usize, f64) = (128, 60.0);

/// How two dancers are compared.
#[derive(Debug, Clone, PartialEq)]
pub struct CompareOptions {
    /// A list of joints for [`joints::parse`]; the pelvis is in the place of the other's anyway, and doesn't count.
    pub joints: String,
    /// The greatest lag, and how far the alignment may be off a straight line, seconds: [`BAND_S`].
    pub band_s: f64,
}

impl Default for CompareOptions {
    fn default() -> Self {
        CompareOptions { joints: "24".into(), band_s: 1.0 }
    }
}

/// Two dancers, aligned.
#[derive(Debug, Clone)]
pub struct Compared {
    /// The figures.
    pub report: Comparison,
    /// The teacher, and the student or its mirror image, on the neutral body at [`FPS`].
    clips: [Clip; 2],
    path: Path,
    /// (N) distances of aligned frames, metres.
    distances_m: Vec<f64>,
}

/// Compares a student with a teacher.
///
/// ```
/// use kinelm_motion::{Motion, synth};
/// use kinelm_spectral::compare::compare;
///
/// let dance = synth::corpus(1, 1, 6.0, 30.0)?.remove(0).clip;
/// // the student begins half a second earlier in the dance, so that it is always ahead
/// let early = Motion::new("student.bvh", dance.slice(15..dance.frames()));
/// let compared = compare(&Motion::new("teacher.bvh", dance), &early, &Default::default())?;
/// assert_eq!((compared.report.lag_frames, compared.report.distance_cm < 0.1), (-15, true));
/// # Ok::<(), kinelm_spectral::Error>(())
/// ```
///
/// # Errors
/// A clip without frames, or of a rig that can't be put on the neutral body; joints that there are none of; a band
/// outside [`BAND_S`] or too large for both clips' lengths.
pub fn compare(teacher: &Motion, student: &Motion, options: &CompareOptions) -> Result<Compared> {
    if !BAND_S.contains(&options.band_s) {
        let expected = format!("{} to {} seconds", BAND_S.start(), BAND_S.end());
        return Err(Error::invalid_parameter("band", options.band_s, expected));
    }
    let mut compared = joints::parse(&options.joints)?.joints;
    compared.retain(|joint| *joint != 0);
    if compared.is_empty() {
        let expected = "joints besides the pelvis, which is in one place with the other's";
        return Err(Error::invalid_parameter("joints", &options.joints, expected));
    }
    let on_body = |motion: &Motion| -> Result<Clip> {
        let clip = resample(&retarget::to_smpl(motion)?, FPS, Method::Auto)?;
        match clip.frames() {
            0 => Err(Error::file(&motion.path, "no frames", "at least one", "")),
            _ => Ok(clip),
        }
    };
    let (teacher, student) = (on_body(teacher)?, on_body(student)?);
    let own = BodyPoses::of(&teacher, &compared);
    let aligned = |student: Clip| -> Result<Aligned> {
        let poses = BodyPoses::of(&student, &compared);
        let band = (options.band_s * FPS).round() as i64;
        let line = nearest_line(&own, &poses, band);
        let path = path(&own, &poses, line, band as usize)?;
        let pairs = path.student.iter().enumerate().map(|(n, &frame)| own.distance(path.from + n, &poses, frame));
        let distances_m: Vec<f64> = pairs.collect();
        Ok(Aligned { student, poses, line, path, distances_m })
    };
    let image = aligned(mirror(&student)?)?;
    let plain = aligned(student)?;
    let mirrored = image.mean_m() < plain.mean_m();
    let (nearer, other) = if mirrored { (image, plain) } else { (plain, image) };
    let cosine = cosine(&teacher, &nearer, &compared)?;
    let report = Comparison::of(
        &own,
        &nearer,
        &compared,
        mirrored,
        other.mean_m(),
        cosine,
        (options.band_s * FPS).round() as i64,
    );
    Ok(Compared { report, clips: [teacher, nearer.student], path: nearer.path, distances_m: nearer.distances_m })
}

/// A student beside the teacher.
struct Aligned {
    student: Clip,
    poses: BodyPoses,
    line: Line,
    path: Path,
    distances_m: Vec<f64>,
}

impl Aligned {
    fn mean_m(&self) -> f64 {
        self.distances_m.iter().sum::<f64>() / self.distances_m.len() as f64
    }
}

/// The mean cosine of the features of `query` (DCT) over the teacher's windows, half a window apart, each with the
/// student's window from the aligned frame on; `None` where no two windows fit.
fn cosine(teacher: &Clip, aligned: &Aligned, compared: &[usize]) -> Result<Option<f64>> {
    let (frames, fps) = WINDOW;
    let [a, b] = [teacher, &aligned.student].map(|clip| Series::of(clip, compared, fps, false));
    let (a, b, transform) = (a?, b?, Transform::Dct(LowDct::new(frames, LowDct::KEEP)));
    let feature = |series: &Series, start: usize| -> Vec<f32> {
        let feature = transform.feature(&series.window(start, frames), series.channels.len());
        feature.into_iter().map(|x| x as f32).collect()
    };
    let times = (fps / FPS) as usize;
    let pairs = aligned.path.student.iter().enumerate().step_by(frames / 2 / times);
    let starts = pairs.map(|(n, &frame)| [times * (aligned.path.from + n), times * frame]);
    let fitting = starts.filter(|[i, j]| i + frames <= a.frames && j + frames <= b.frames);
    let cosines: Vec<f64> = fitting.map(|[i, j]| Distance::Cosine.score(&feature(&a, i), &feature(&b, j))).collect();
    Ok((!cosines.is_empty()).then(|| cosines.iter().sum::<f64>() / cosines.len() as f64))
}
