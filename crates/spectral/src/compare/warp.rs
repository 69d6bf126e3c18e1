//! Dynamic time warping within a band around a line.

use super::body::BodyPoses;
use super::line::Line;
use crate::{Error, Result};

/// Cells of the band: one byte each.
const MOST_CELLS: usize = 1 << 28;
/// The student's steps for one frame of the teacher, the straight one first, so that it wins ties.
const STEPS: [usize; 3] = [1, 0, 2];

/// The aligned frames.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct Path {
    /// The teacher's first frame that the student has.
    pub from: usize,
    /// (N) the student's frame at each of the teacher's from there on.
    pub student: Vec<usize>,
}

/// The path of the least sum of distances that is at most `band` frames of the student away from a line.
///
/// For each frame of the teacher the student goes on by none, one or two frames, so a path has as many steps as the
/// teacher has frames and its mean needs no correction. Both ends are open: any frame of the band may be the first and
/// the last.
///
/// Source: Sakoe and Chiba, "Dynamic Programming Algorithm Optimization for Spoken Word Recognition" (1978), the band
/// of their equation 8; the steps are `asymmetric` of Giorgino, "Computing and Visualizing Dynamic Time Warping
/// Alignments in R" (2009), which has open ends in section 3.4.
///
/// # Errors
/// [`Limit`](kinelm_store::Error::Limit) for a band of more than 2^28 cells.
pub(super) fn path(teacher: &BodyPoses, student: &BodyPoses, line: Line, band: usize) -> Result<Path> {
    let overlap = line.overlap(student.frames());
    let (from, width) = (overlap.start, 2 * band + 1);
    if overlap.len().saturating_mul(width) > MOST_CELLS {
        let needs = format!("{} frames with a band of {width}", overlap.len());
        return Err(Error::limit("alignment", needs, format!("{MOST_CELLS} cells"), "take parts, or a smaller `band`"));
    }
    // the cell k of a row is the student's frame low + k, which may be outside the clip
    let low = |row: usize| line.at(from + row) - band as i64;
    let mut back = vec![0u8; overlap.len() * width];
    let (mut last, mut next) = (vec![0.0; width], vec![0.0; width]);
    for row in 0..overlap.len() {
        let shift = if row == 0 { 0 } else { low(row) - low(row - 1) };
        for k in 0..width {
            let frame = usize::try_from(low(row) + k as i64).ok().filter(|frame| *frame < student.frames());
            let before = |step: usize| -> f64 {
                let cell = usize::try_from(k as i64 + shift - step as i64).ok();
                cell.and_then(|cell| last.get(cell)).copied().unwrap_or(f64::INFINITY)
            };
            let (mut step, mut cost) = (0, 0.0);
            if row > 0 {
                (step, cost) = STEPS
                    .map(|step| (step, before(step)))
                    .into_iter()
                    .fold((1, f64::INFINITY), |best, one| if one.1 < best.1 { one } else { best });
            }
            next[k] = match frame {
                Some(frame) if cost < f64::INFINITY => cost + teacher.distance(from + row, student, frame),
                _ => f64::INFINITY,
            };
            back[row * width + k] = step as u8;
        }
        std::mem::swap(&mut last, &mut next);
    }
    // of equals the one nearest to the line
    let ends = (0..width).min_by(|&a, &b| last[a].total_cmp(&last[b]).then(a.abs_diff(band).cmp(&b.abs_diff(band))));
    let Some(end) = ends.filter(|_| !overlap.is_empty()) else { return Ok(Path { from, student: Vec::new() }) };
    let mut at = low(overlap.len() - 1) + end as i64;
    let mut frames = vec![0; overlap.len()];
    for row in (0..overlap.len()).rev() {
        frames[row] = at as usize;
        at -= i64::from(back[row * width + (at - low(row)) as usize]);
    }
    Ok(Path { from, student: frames })
}
