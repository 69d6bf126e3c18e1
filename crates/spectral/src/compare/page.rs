//! Both dancers in step.

use super::Compared;
use crate::Result;
use crate::interpolate::align::turned;
use kinelm_motion::resample::at_frames;
use kinelm_motion::rotation::heading;
use kinelm_motion::Clip;
use kinelm_view::{Figure, page};

/// Frames on either side over which the alignment is averaged, so that the student moves evenly: a quarter of a second.
const SMOOTH: usize = 7;

impl Compared {
    /// A page that plays the teacher by its own clock and the student beside it in step: at any time the frames that are
    /// aligned. Both begin facing the same way; the student stands still where its clip has nothing.
    ///
    /// # Errors
    /// Those of [`page()`].
    pub fn page(&self, names: [&str; 2]) -> Result<String> {
        let [teacher, student] = self.in_step()?;
        let note = if self.report.mirrored { "in step, mirror image" } else { "in step" };
        Ok(page(&[Figure::new(names[0], &teacher), Figure::new(names[1], &student).note(note)])?)
    }

    /// The student's frame at each of the teacher's, averaged.
    fn course(&self) -> Vec<f64> {
        let path = &self.path.student;
        let at = |n: usize| {
            // as far to both sides, so that a straight line stays one up to its ends
            let reach = SMOOTH.min(n).min(path.len() - 1 - n);
            let around = &path[n - reach..=n + reach];
            around.iter().sum::<usize>() as f64 / around.len() as f64
        };
        (0..path.len()).map(at).collect()
    }

    /// The teacher, and the student in step with it.
    fn in_step(&self) -> Result<[Clip; 2]> {
        let [teacher, student] = &self.clips;
        let course = self.course();
        let times: Vec<f64> = (0..teacher.frames())
            .map(|frame| course[frame.saturating_sub(self.path.from).min(course.len() - 1)])
            .collect();
        let front = |clip: Clip| turned(&clip, -heading(clip.pose(self.path.from)[0]).unwrap_or(0.0));
        Ok([front(teacher.clone())?, front(at_frames(student, &times)?)?])
    }
}
