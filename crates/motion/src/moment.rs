//! Times in a clip, and durations, as users write them: `2.5s`, `2.5`, `40f`, and `-1s` from the end.

use crate::error::compact;
use std::fmt;
use std::str::FromStr;

/// A time counted from the clip's first frame, or from its end if it is negative; or a duration.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Moment {
    /// Seconds.
    Seconds(f64),
    /// Frames of the file.
    Frames(f64),
    /// Frames at the rate of a model.
    Model(f64),
}

/// The rates and lengths that [`Moment::boundary`] needs.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Timebase {
    /// F, the clip's frames.
    pub frames: usize,
    /// The clip's rate, frames per second.
    pub fps: f64,
    /// Frames at the start of the file that reading dropped. Frame numbers count them.
    pub left_out: usize,
    /// The rate of the model's frames, if there is a model.
    pub model_fps: Option<f64>,
}

impl FromStr for Moment {
    type Err = String;

    fn from_str(text: &str) -> Result<Moment, String> {
        read(text, 's').ok_or_else(|| format!("`{text}` is no time; {EXPECTED}, with a - in front from the end"))
    }
}

/// The accepted forms where a bare number means seconds, for messages.
pub const EXPECTED: &str = "expected 2.5s, 2.5 or 40f";

/// Parses a time; `bare` is the unit (s, f or m) of a number without one.
fn read(text: &str, bare: char) -> Option<Moment> {
    let (number, unit) = match text.char_indices().last() {
        Some((at, unit @ ('s' | 'f' | 'm'))) => (&text[..at], unit),
        _ => (text, bare),
    };
    let number: f64 = number.parse().ok().filter(|number: &f64| number.is_finite())?;
    match unit {
        's' => Some(Moment::Seconds(number)),
        _ if number.fract() != 0.0 => None,
        'f' => Some(Moment::Frames(number)),
        _ => Some(Moment::Model(number)),
    }
}

impl fmt::Display for Moment {
    fn fmt(&self, out: &mut fmt::Formatter) -> fmt::Result {
        match self {
            Moment::Seconds(s) => write!(out, "{}s", compact(*s)),
            Moment::Frames(n) => write!(out, "{n}f"),
            Moment::Model(n) => write!(out, "{n}m"),
        }
    }
}

impl Moment {
    /// Parses a time in which a bare number means frames.
    ///
    /// # Errors
    /// Text that is no time; the message shows the accepted forms.
    pub fn in_frames(text: &str) -> Result<Moment, String> {
        read(text, 'f').ok_or_else(|| format!("`{text}` is no time; expected 40, 40f or 2.5s"))
    }

    /// The number in its own unit.
    pub fn number(self) -> f64 {
        let (Moment::Seconds(number) | Moment::Frames(number) | Moment::Model(number)) = self;
        number
    }

    /// The duration in seconds at `fps` frames per second.
    pub fn seconds(self, fps: f64) -> f64 {
        match self {
            Moment::Seconds(s) => s,
            Moment::Frames(n) | Moment::Model(n) => n / fps,
        }
    }

    /// The duration as the nearest whole number of frames at `fps`.
    pub fn frames(self, fps: f64) -> f64 {
        match self {
            Moment::Seconds(s) => (s * fps).round(),
            Moment::Frames(n) | Moment::Model(n) => n,
        }
    }

    /// The nearest frame boundary, 0 to F; `None` outside the clip, and for model frames without a model.
    pub fn boundary(self, scale: Timebase) -> Option<usize> {
        let (frames, left_out) = (scale.frames as f64, scale.left_out as f64);
        let (number, at) = match self {
            Moment::Seconds(s) => (s, (s * scale.fps).round()),
            Moment::Frames(n) if n.is_sign_negative() => (n, n),
            Moment::Frames(n) => (n, n - left_out),
            Moment::Model(n) => (n, (n * scale.fps / scale.model_fps?).round()),
        };
        // -0 means the end
        let at = if number.is_sign_negative() { frames + at } else { at };
        (0.0..=frames).contains(&at).then_some(at as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TIMEBASE: Timebase = Timebase { frames: 100, fps: 20.0, left_out: 0, model_fps: None };

    #[test]
    fn seconds_and_frames_from_either_end() {
        let boundary = |text: &str| text.parse::<Moment>().unwrap().boundary(TIMEBASE);
        assert_eq!([boundary("2s"), boundary("2.52"), boundary("40f"), boundary("0")], [40, 50, 40, 0].map(Some));
        assert_eq!([boundary("-1s"), boundary("-10f"), boundary("-0"), boundary("5s")], [80, 90, 100, 100].map(Some));
        assert_eq!([boundary("5.1s"), boundary("-5.1s"), boundary("101f"), boundary("3m")], [None; 4]);
        for text in ["", "f", "m", "2x", "1.5f", "1.5m", "nan", "inf", "2 s", "ä"] {
            assert!(text.parse::<Moment>().unwrap_err().contains("expected 2.5s"), "{text}");
        }
    }

    #[test]
    fn lengths_are_seconds_or_frames() {
        let of = |moment: Moment| (moment.seconds(20.0), moment.frames(20.0));
        assert_eq!(["2.5s", "2.5", "50f"].map(|text| of(text.parse().unwrap())), [(2.5, 50.0); 3]);
        assert_eq!(["50", "50f", "2.5s"].map(|text| of(Moment::in_frames(text).unwrap())), [(2.5, 50.0); 3]);
        assert_eq!(Moment::in_frames("2.5").unwrap_err(), "`2.5` is no time; expected 40, 40f or 2.5s");
    }

    #[test]
    fn frames_of_the_file_count_what_was_left_out_and_a_model_has_its_own() {
        let scale = Timebase { left_out: 10, model_fps: Some(8.0), ..TIMEBASE };
        let boundary = |text: &str| text.parse::<Moment>().unwrap().boundary(scale);
        assert_eq!([boundary("10f"), boundary("110f"), boundary("-10f"), boundary("2s")], [0, 100, 90, 40].map(Some));
        assert_eq!(
            [boundary("9f"), boundary("4m"), boundary("-4m"), boundary("5m")],
            [None, Some(10), Some(90), Some(13)]
        );
    }

    #[test]
    fn they_are_told_as_they_are_read() {
        for text in ["2.5s", "40f", "-3m", "-1s", "-0f"] {
            assert_eq!(text.parse::<Moment>().unwrap().to_string(), text);
        }
    }
}
