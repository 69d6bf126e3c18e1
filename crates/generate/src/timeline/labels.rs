//! Labels of a timeline.

use super::fault::{Fault, times};
use crate::request::{Segment, TimedLabel};
use kinelm_corpus::labels::parse_pair;
use kinelm_motion::moment::Moment;
use std::ops::Range;

/// The labels of all segments in seconds of the dance, and the frame up to which any of them holds.
///
/// # Errors
/// A segment without a clip and labels; joints or a moment without a clip; two values of a field at a time.
pub(super) fn timed_labels(segments: &[Segment], fps: f64) -> Result<(Vec<TimedLabel>, usize), Fault> {
    let mut labels: Vec<(usize, TimedLabel, Range<usize>)> = Vec::new();
    for (n, segment) in segments.iter().enumerate() {
        let wrong = |found: String, expected: &str| Fault::Segment(n, found, expected.into());
        if segment.clip.is_none() {
            if segment.labels.is_empty() {
                return Err(wrong("neither a clip nor labels".into(), "clip = \"NAME\", labels, or both"));
            }
            if segment.joints != "all" || segment.at != Default::default() {
                return Err(wrong("joints or at without a clip".into(), "the clip that they belong to"));
            }
        }
        let frames = times(n, segment, fps)?;
        let [from, to] = [frames.start, frames.end].map(|frame| Some(Moment::Seconds(frame as f64 / fps)));
        for (field, value) in &segment.labels {
            let label = format!("{field}={value}");
            parse_pair(&label).map_err(|e| wrong(e.to_string(), "a field and its value"))?;
            let meets = |held: &Range<usize>| held.start < frames.end && frames.start < held.end;
            if let Some((other, ..)) = labels.iter().find(|(_, other, held)| other.field == *field && meets(held)) {
                let found = format!("{label}, while segment {} says what {field} is too", other + 1);
                return Err(wrong(found, "one value of a field at a time"));
            }
            let label = TimedLabel { field: field.clone(), value: value.clone(), from, to };
            labels.push((n, label, frames.clone()));
        }
    }
    let last = labels.iter().map(|(_, _, frames)| frames.end).max().unwrap_or(0);
    Ok((labels.into_iter().map(|(_, label, _)| label).collect(), last))
}
