//! Labels that hold for a part of a dance: `genre=salsa@0s:10s`.
//!
//! Where they change, the window is read again with other conditioning tokens in front: a model knows one value per field of
//! its window.

use crate::request::TimedLabel;
use crate::{Error, Result};
use kinelm_corpus::Conditions;
use kinelm_motion::moment::Timebase;
use std::collections::BTreeMap;
use std::ops::Range;

/// The fronts of a dance's windows, each with its first frame; the first from 0. `always`
/// holds throughout, `timed` for a time each.
///
/// # Errors
/// Fields and values that the model doesn't know; a time outside the dance; two values of a field at a time.
pub(crate) fn fronts(
    conditions: &Conditions,
    always: &BTreeMap<String, String>,
    timed: &[TimedLabel],
    scale: Timebase,
) -> Result<Vec<(usize, Vec<u32>)>> {
    let mut spans: Vec<Range<usize>> = Vec::new();
    for (i, label) in timed.iter().enumerate() {
        conditions.requested(&[(label.field.clone(), label.value.clone())])?;
        let frames = label.span().frames(scale).map_err(|e| Error::unsupported_parameter("labels", e))?;
        let meets = |(other, span): &(&TimedLabel, &Range<usize>)| {
            other.field == label.field && span.start < frames.end && frames.start < span.end
        };
        let other = timed[..i].iter().zip(&spans).find(meets).map(|(other, _)| other.to_string());
        let other = other.or(always.get(&label.field).map(|value| format!("{}={value}", label.field)));
        if let Some(other) = other {
            let expected = format!("one value of {} at a time", label.field);
            return Err(Error::invalid_parameter("labels", format!("{label} and {other}"), expected));
        }
        spans.push(frames);
    }
    // conditioning is constant between two borders
    let mut borders: Vec<usize> = spans.iter().flat_map(|s| [s.start, s.end]).chain([0]).collect();
    borders.sort_unstable();
    borders.dedup();
    let front = |frame: usize| {
        let here = timed.iter().zip(&spans).filter(|(_, span)| span.contains(&frame));
        let here = here.map(|(label, _)| (label.field.clone(), label.value.clone()));
        let all: Vec<_> = always.clone().into_iter().chain(here).collect();
        Ok((frame, conditions.requested(&all)?))
    };
    let fronts = borders.into_iter().filter(|&frame| frame == 0 || frame < scale.frames).map(front);
    let mut fronts = fronts.collect::<Result<Vec<_>>>()?;
    // a border at which nothing changes is none: windows of a masked model end at changes
    fronts.dedup_by(|b, a| a.1 == b.1);
    Ok(fronts)
}

#[cfg(test)]
mod tests {
    use super::*;
    use kinelm_corpus::samples::tokenizer;

    fn conditions() -> Conditions {
        let mut t = tokenizer();
        for (field, value) in [("genre", "salsa"), ("genre", "waltz"), ("dancer", "61")] {
            t.vocabulary_mut().add_conditioning(field, value).unwrap();
        }
        Conditions::new(&["genre".into(), "dancer".into()], t.vocabulary())
    }

    fn found(always: &[(&str, &str)], timed: &[&str]) -> std::result::Result<Vec<(usize, Vec<u32>)>, String> {
        let always = always.iter().map(|(f, v)| (f.to_string(), v.to_string())).collect();
        let timed: Vec<TimedLabel> = timed.iter().map(|text| text.parse()).collect::<std::result::Result<_, _>>()?;
        let scale = Timebase { frames: 40, fps: 20.0, left_out: 0, model_fps: Some(20.0) };
        fronts(&conditions(), &always, &timed, scale).map_err(|e| e.to_string())
    }

    #[test]
    fn fronts_change_where_labels_do_and_gaps_are_unknown() {
        assert_eq!(found(&[], &[]), Ok(vec![(0, vec![1, 4, 4])]));
        let dancer = [("dancer", "61")];
        // salsa, nothing, waltz to the end
        let timed = ["genre=salsa@0s:0.5s", "genre=waltz@1s:"];
        assert_eq!(found(&dancer, &timed), Ok(vec![(0, vec![1, 66, 68]), (10, vec![1, 4, 68]), (20, vec![1, 67, 68])]));
        // where nothing changes, nothing is read again
        assert_eq!(found(&[], &["genre=salsa@:1s", "genre=salsa@1s:"]), Ok(vec![(0, vec![1, 66, 4])]));
    }

    #[test]
    fn labels_that_cannot_hold_are_refused() {
        let said = |always: &[(&str, &str)], timed: &[&str]| found(always, timed).unwrap_err();
        assert!(said(&[], &["genre=salsa@0s:9s"]).contains("`labels`: genre=salsa@0s:9s: 9s lies outside"));
        let two = said(&[], &["genre=salsa@0s:1s", "genre=waltz@0.5s:"]);
        assert!(
            two.contains("genre=waltz@0.5s: and genre=salsa@0s:1s; expected one value of genre at a time"),
            "{two}"
        );
        assert!(said(&[("genre", "waltz")], &["genre=salsa@0s:1s"]).contains("and genre=waltz; expected one value"));
        assert!(said(&[], &["mood=glad@0s:1s"]).contains("`labels` with mood=glad: this model knows"));
        assert!(said(&[], &["genre=house@0s:1s"]).contains("`labels` with genre=house: this model knows"));
        assert!(said(&[], &["genre@0s:1s"]).contains("expected FIELD=VALUE"));
        assert!(said(&[], &["=a"]).contains("expected FIELD=VALUE"));
        let label: TimedLabel = "genre=a@b@2s:".parse().unwrap();
        assert_eq!((label.value.as_str(), label.to_string().as_str()), ("a@b", "genre=a@b@2s:"));
    }
}
