//! Joints for a time: `left_arm@4s:8s`.

use kinelm_motion::moment::{Moment, Timebase};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::ops::Range;
use std::str::FromStr;

/// Joints for a time: `JOINTS[@FROM:TO]`, half-open. Without a time: throughout.
///
/// ```
/// use kinelm_generate::request::Span;
/// use kinelm_motion::moment::Timebase;
///
/// let span: Span = "left_arm@1s:-1s".parse()?;
/// let clip = Timebase { frames: 100, fps: 20.0, left_out: 0, model_fps: None };
/// assert_eq!((span.joints.as_str(), span.frames(clip)?), ("left_arm", 20..80));
/// # Ok::<(), String>(())
/// ```
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct Span {
    /// As [`kinelm_motion::joints::parse`] takes them, or as a rig names its own.
    pub joints: String,
    /// Beginning; `None`: from the first frame.
    pub from: Option<Moment>,
    /// End, exclusive; `None`: to the last frame.
    pub to: Option<Moment>,
}

impl FromStr for Span {
    type Err = String;

    fn from_str(text: &str) -> Result<Span, String> {
        let (joints, time) = match text.rsplit_once('@') {
            // a joint of a rig may have an @ in its name
            Some((joints, time)) if is_time(time) => (joints, Some(time)),
            Some((_, time)) if is_meant_as_time(time) => {
                return Err(format!(
                    "`{text}`: `{time}` is no time; expected FROM:TO, as in left_arm@4s:8s, each such as 2.5s, 2.5 or 40f, with a \
                     - in front from the end"
                ));
            }
            _ => (text, None),
        };
        if joints.trim().is_empty() {
            return Err(format!("`{text}` names no joints; expected JOINTS or JOINTS@FROM:TO, as in left_arm@4s:8s"));
        }
        let Some(time) = time else { return Ok(Span { joints: joints.into(), from: None, to: None }) };
        let Some((from, to)) = time.split_once(':') else {
            return Err(format!(
                "`{text}`: {time} is a moment, not a time; expected FROM:TO, or {time}: for all from then on"
            ));
        };
        let moment = |text: &str| if text.is_empty() { Ok(None) } else { text.parse().map(Some) };
        Ok(Span { joints: joints.into(), from: moment(from)?, to: moment(to)? })
    }
}

/// Whether text is `[T]:[T]`, or a lone `T`.
fn is_time(text: &str) -> bool {
    let is_moment = |text: &str| text.is_empty() || text.parse::<Moment>().is_ok();
    match text.split_once(':') {
        Some((from, to)) => is_moment(from) && is_moment(to),
        None => !text.is_empty() && is_moment(text),
    }
}

/// Whether a text that is no time was meant as one: it, or a part after a colon, begins as numbers do. A joint of a rig may do so
/// in quotes.
fn is_meant_as_time(text: &str) -> bool {
    let begins = |text: &str| text.trim_start().starts_with(|c: char| c.is_ascii_digit() || "-+.:".contains(c));
    !text.ends_with('"') && (text.is_empty() || begins(text) || text.split(':').skip(1).any(begins))
}

impl fmt::Display for Span {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        out.write_str(&self.joints)?;
        if self.from.is_none() && self.to.is_none() {
            return Ok(());
        }
        let text = |moment: Option<Moment>| moment.map(|m| m.to_string()).unwrap_or_default();
        write!(out, "@{}:{}", text(self.from), text(self.to))
    }
}

impl From<Span> for String {
    fn from(span: Span) -> String {
        span.to_string()
    }
}

impl TryFrom<String> for Span {
    type Error = String;

    fn try_from(text: String) -> Result<Span, String> {
        text.parse()
    }
}

impl Span {
    /// The frames of a clip in this time.
    ///
    /// # Errors
    /// A moment outside the clip; a time without a frame.
    pub fn frames(&self, scale: Timebase) -> Result<Range<usize>, String> {
        let border = |moment: Option<Moment>, otherwise: usize| match moment.map(|m| (m, m.boundary(scale))) {
            None => Ok(otherwise),
            Some((_, Some(border))) => Ok(border),
            Some((moment, None)) => {
                let (frames, s) = (scale.frames, scale.frames as f64 / scale.fps);
                let counted = match scale.left_out {
                    0 => String::new(),
                    n => format!(", counted from {n} as f"),
                };
                Err(format!("{self}: {moment} lies outside the clip, which has {frames} frames{counted}, {s:.2} s"))
            }
        };
        let (from, to) = (border(self.from, 0)?, border(self.to, scale.frames)?);
        if from >= to {
            return Err(format!(
                "{self}: from frame {from} to frame {to} there is nothing; expected an end after the beginning"
            ));
        }
        Ok(from..to)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn span(text: &str) -> Span {
        text.parse().unwrap()
    }

    #[test]
    fn a_time_is_told_from_a_name() {
        let [plain, both] = ["root,left_arm", "left_arm@4s:8s"].map(span);
        assert_eq!((plain.joints.as_str(), plain.from, plain.to), ("root,left_arm", None, None));
        assert_eq!((both.joints.as_str(), both.from), ("left_arm", Some(Moment::Seconds(4.0))));
        assert_eq!(
            (span("all@:30m").to, span("all@-2s:").from),
            (Some(Moment::Model(30.0)), Some(Moment::Seconds(-2.0)))
        );
        // no time after it: a joint with an @ in its name
        assert_eq!(span("Hip@Left").joints, "Hip@Left");
        assert_eq!(span("Hip@Left@1:2").joints, "Hip@Left");
        assert_eq!(span("all@:"), Span { joints: "all".into(), from: None, to: None });
        let lone = "left_arm@4s".parse::<Span>().unwrap_err();
        assert!(lone.contains("or 4s: for all from then on"), "{lone}");
        for wrong in ["4-8", "4s-8s", "4s..8s", "4s:8x", "a:8s", "1.5f:3f", "4:8:9", " 4:8", "-1s", ""] {
            let text = format!("left_arm@{wrong}");
            let said = text.parse::<Span>().unwrap_err();
            let expected = format!("`{wrong}` is no time; expected FROM:TO, as in left_arm@4s:8s");
            assert!(said.contains(&expected) || wrong == "-1s", "{said}");
        }
        assert_eq!(span("rig:\"Hip@2nd\"").joints, "rig:\"Hip@2nd\"");
        assert!("@1:2".parse::<Span>().unwrap_err().contains("names no joints"));
    }

    #[test]
    fn spans_are_printed_as_they_are_parsed() {
        for text in ["left_arm@4s:8s", "all", "root,head@:-1s", "feet@10f:"] {
            assert_eq!(span(text).to_string(), text);
        }
        assert_eq!(span("root@1:2.5").to_string(), "root@1s:2.5s");
    }

    #[test]
    fn frames_are_within_the_clip() {
        let scale = Timebase { frames: 100, fps: 20.0, left_out: 10, model_fps: Some(10.0) };
        assert_eq!(span("all@1s:2s").frames(scale), Ok(20..40));
        assert_eq!(span("all@20f:-1s").frames(scale), Ok(10..80));
        assert_eq!(span("all").frames(scale), Ok(0..100));
        for (text, expected) in [
            ("all@1s:9s", "9s lies outside the clip, which has 100 frames, counted from 10 as f, 5.00 s"),
            ("all@2s:1s", "from frame 40 to frame 20 there is nothing"),
            ("all@1.01s:1.02s", "from frame 20 to frame 20"),
        ] {
            let wrong = span(text).frames(scale).unwrap_err();
            assert!(wrong.contains(expected), "{wrong}");
        }
    }
}
