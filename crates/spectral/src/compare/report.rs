//! The figures of a comparison.

use super::{Aligned, BodyPoses, FPS};
use comfy_table::{CellAlignment, ContentArrangement, Table, presets};
use kinelm_motion::smpl;
use kinelm_store::counted;
use serde::Serialize;
use std::fmt;

/// Frames over which a moment is measured: a second.
const MOMENT: usize = 30;
/// Moments that are reported at most.
const MOMENTS: usize = 5;

/// How a student's dance differs from the teacher's. All figures but `other_image_cm` are those of the nearer image.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct Comparison {
    /// N, aligned frames, 30 a second.
    pub frames: usize,
    /// When they begin in the teacher's clip and in the student's, seconds.
    pub from_s: [f64; 2],
    /// The mean distance of the joints in aligned frames, cm.
    pub distance_cm: f64,
    /// Whether the student's mirror image is nearer than the student.
    pub mirrored: bool,
    /// The distance of the other image: of the mirror image, or of the student if that is nearer.
    pub other_image_cm: f64,
    /// How much later the student is where the teacher's clip begins, frames; below 0 is earlier.
    pub lag_frames: i64,
    /// The same in seconds.
    pub lag_s: f64,
    /// The student's tempo over the teacher's: above 1 is faster.
    pub tempo: f64,
    /// Whether lag and tempo are at the ends of what is searched: then the true ones may be beyond.
    pub at_limit: [bool; 2],
    /// The mean cosine of `query`'s windows, aligned; `None` for less than a window.
    pub cosine: Option<f64>,
    /// (K) the joints, the most different first.
    pub joints: Vec<JointDistance>,
    /// The seconds in which they differ most, in order of time: up to five, apart by a second or more.
    pub moments: Vec<WorstMoment>,
}

/// How far apart a joint is.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct JointDistance {
    /// SMPL's name.
    pub joint: &'static str,
    /// The mean over aligned frames, cm.
    pub distance_cm: f64,
}

/// A second in which the two differ.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct WorstMoment {
    /// Its middle in the teacher's clip and in the student's, seconds.
    pub at_s: [f64; 2],
    /// The mean distance of the joints, cm.
    pub distance_cm: f64,
    /// The joint that is farthest apart, over the second.
    pub joint: JointDistance,
}

impl Comparison {
    pub(super) fn of(
        teacher: &BodyPoses,
        aligned: &Aligned,
        compared: &[usize],
        mirrored: bool,
        other_m: f64,
        cosine: Option<f64>,
        band: i64,
    ) -> Comparison {
        let path = &aligned.path;
        let farthest_first = |frames: std::ops::Range<usize>| {
            let mut sums = vec![0.0; compared.len()];
            for n in frames.clone() {
                let each = teacher.distances(path.from + n, &aligned.poses, path.student[n]);
                sums.iter_mut().zip(each).for_each(|(sum, m)| *sum += m);
            }
            let mean = |(&joint, sum): (&usize, f64)| JointDistance {
                joint: smpl::NAMES[joint],
                distance_cm: 100.0 * sum / frames.len() as f64,
            };
            let mut joints: Vec<_> = compared.iter().zip(sums).map(mean).collect();
            joints.sort_by(|a, b| b.distance_cm.total_cmp(&a.distance_cm));
            joints
        };
        let seconds = |frame: usize| frame as f64 / FPS;
        let moment = |from: usize, distance_cm: f64| {
            let frames = from..(from + MOMENT).min(path.student.len());
            let middle = (frames.start + frames.end) / 2;
            let at_s = [path.from + middle, path.student[middle]].map(seconds);
            WorstMoment { at_s, distance_cm, joint: farthest_first(frames).swap_remove(0) }
        };
        let lag = aligned.line.lag();
        Comparison {
            frames: path.student.len(),
            from_s: [path.from, path.student[0]].map(seconds),
            distance_cm: 100.0 * aligned.mean_m(),
            mirrored,
            other_image_cm: 100.0 * other_m,
            lag_frames: lag,
            lag_s: lag as f64 / FPS,
            tempo: aligned.line.tempo(),
            at_limit: aligned.line.at_limits(band),
            cosine,
            joints: farthest_first(0..path.student.len()),
            moments: worst(&aligned.distances_m).into_iter().map(|(from, m)| moment(from, 100.0 * m)).collect(),
        }
    }
}

/// The first frames of the worst seconds and their mean distances: above the mean of all, the worst first taken, none
/// within a second of another, in order of time.
fn worst(distances: &[f64]) -> Vec<(usize, f64)> {
    let mean = |all: &[f64]| all.iter().sum::<f64>() / all.len() as f64;
    let usual = mean(distances);
    let windows = distances.windows(MOMENT.min(distances.len())).map(mean).enumerate();
    let mut left: Vec<_> = windows.filter(|(_, m)| *m > usual * (1.0 + 1e-9)).collect();
    left.sort_by(|a, b| b.1.total_cmp(&a.1));
    let mut taken: Vec<(usize, f64)> = Vec::new();
    for (from, m) in left {
        if taken.len() < MOMENTS && taken.iter().all(|(other, _)| other.abs_diff(from) >= 2 * MOMENT) {
            taken.push((from, m));
        }
    }
    taken.sort_by_key(|(from, _)| *from);
    taken
}

impl Comparison {
    /// Name and value of the figures as one reads them, without joints and moments.
    pub fn facts(&self) -> [[String; 2]; 6] {
        let image = if self.mirrored { "not mirrored" } else { "mirrored" };
        let limit = self.at_limit.map(|is_at| if is_at { ", at the limit of the search" } else { "" });
        let lag = match self.lag_frames {
            0 => "none".into(),
            n => {
                let side = if n > 0 { "late" } else { "early" };
                format!(
                    "{:.2} s {side}, {}{}",
                    self.lag_s.abs(),
                    counted(n.unsigned_abs() as usize, "frames"),
                    limit[0]
                )
            }
        };
        let faster = match (100.0 * (self.tempo - 1.0)).round() {
            0.0 => "the same".into(),
            by => format!("{:.0} % {}", by.abs(), if by > 0.0 { "faster" } else { "slower" }),
        };
        let image = format!("{} ({image} {:.1} cm)", if self.mirrored { "yes" } else { "no" }, self.other_image_cm);
        let cosine = self.cosine.map_or("too short".into(), |cosine| format!("{cosine:.3}"));
        let rows = [
            ("distance", format!("{:.1} cm", self.distance_cm)),
            ("lag", lag),
            ("tempo", format!("{:.3}, {faster}{}", self.tempo, limit[1])),
            ("mirrored", image),
            ("cosine", cosine),
            ("compared", format!("{:.1} s", self.frames as f64 / FPS)),
        ];
        rows.map(|(name, value)| [name.to_string(), value])
    }
}

impl fmt::Display for Comparison {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for [name, value] in self.facts() {
            writeln!(f, "{name:<10} {value}")?;
        }
        let table = |head: Vec<&str>, rows: Vec<Vec<String>>, right: &[usize]| {
            let mut table = Table::new();
            table.load_style(presets::UTF8_FULL_CONDENSED);
            table.set_content_arrangement(ContentArrangement::Disabled);
            table.set_header(head).add_rows(rows);
            for &i in right {
                table.column_mut(i).into_iter().for_each(|c| c.set_cell_alignment(CellAlignment::Right));
            }
            table
        };
        let joints = self.joints.iter().map(|j| vec![j.joint.to_string(), format!("{:.1}", j.distance_cm)]);
        write!(f, "{}", table(vec!["joint", "cm"], joints.collect(), &[1]))?;
        let moment = |m: &WorstMoment| {
            let [teacher, student] = m.at_s.map(|s| format!("{s:.1}"));
            let joint = format!("{} {:.1}", m.joint.joint, m.joint.distance_cm);
            vec![teacher, student, format!("{:.1}", m.distance_cm), joint]
        };
        if !self.moments.is_empty() {
            let rows = self.moments.iter().map(moment).collect();
            let head = vec!["teacher, s", "student, s", "cm", "farthest, cm"];
            write!(f, "\n{}", table(head, rows, &[0, 1, 2]))?;
        }
        Ok(())
    }
}
