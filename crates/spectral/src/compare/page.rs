//! Both dancers in step.

use super::{Compared, FPS, WorstMoment};
use crate::Result;
use crate::interpolate::align::turned;
use kinelm_motion::Clip;
use kinelm_motion::resample::at_frames;
use kinelm_motion::rotation::heading;
use kinelm_view::panel::{Facts, Lines, Moment, Moments, Panel, Track};
use kinelm_view::{Figure, Page};

/// Frames on either side over which the alignment is averaged, so that the student moves evenly: a quarter of a second.
const SMOOTH: usize = 7;

impl Compared {
    /// A page that plays the teacher by its own clock and the student beside it in step: at any time the frames that
    /// are aligned. Both begin facing the same way; the student stands still where its clip has nothing. Beside them
    /// are the figures, the worst moments, the distance and the lag over time, and the joints.
    ///
    /// # Errors
    /// Those of [`Page::html`].
    pub fn page(&self, names: [&str; 2]) -> Result<String> {
        let [teacher, student] = self.in_step()?;
        let note = if self.report.mirrored { "in step, mirror image" } else { "in step" };
        let figures = [Figure::new(names[0], &teacher), Figure::new(names[1], &student).note(note)];
        Ok(Page::new(&figures).panels(&self.panels()).html()?)
    }

    fn panels(&self) -> Vec<Panel> {
        let from_s = self.path.from as f64 / FPS;
        let over_time = |title: &str, unit: &str, values: Vec<f64>| {
            let track = Track { name: String::new(), figure: Some(1), fps: FPS, from_s, values };
            Panel::Lines(Lines { title: title.into(), unit: unit.into(), tracks: vec![track] })
        };
        let late = |(n, frame): (usize, f64)| (frame - (self.path.from + n) as f64) / FPS;
        let moment = |m: &WorstMoment| {
            let digits = usize::from(m.distance_cm < 10.0);
            let label = format!("{:.digits$} cm, {}", m.distance_cm, in_words(m.joint.joint));
            Moment { label, at_s: m.at_s[0], figure: None }
        };
        let report = &self.report;
        let moments: Vec<Moment> = report.moments.iter().map(moment).collect();
        let joints = report.joints.iter().map(|j| vec![in_words(j.joint), format!("{:.1}", j.distance_cm)]);
        let facts = |title: &str, head: &[&str], rows| {
            Panel::Facts(Facts { title: title.into(), head: head.iter().map(|h| h.to_string()).collect(), rows })
        };
        let mut panels = vec![facts("The student", &[], report.facts().map(Vec::from).to_vec())];
        if !moments.is_empty() {
            panels.push(Panel::Moments(Moments { title: "Farthest apart".into(), moments }));
        }
        panels.push(over_time("Distance", "cm", self.distances_m.iter().map(|m| 100.0 * m).collect()));
        panels.push(over_time("Late", "s", self.course().into_iter().enumerate().map(late).collect()));
        panels.push(facts("Joints", &["joint", "cm"], joints.collect()));
        panels
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

/// A joint's name for people.
fn in_words(joint: &str) -> String {
    joint.replace('_', " ")
}
