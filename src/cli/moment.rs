//! Moments of a clip as a call names them: `2.5s`, `2.5`, `40f`, and `-1s` from the end.

use std::str::FromStr;

/// A moment, counted from the clip's first frame, or from its end where it is negative.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Moment {
    /// Seconds.
    Seconds(f64),
    /// Frames of the file.
    Frames(f64),
}

impl FromStr for Moment {
    type Err = String;

    fn from_str(text: &str) -> Result<Moment, String> {
        let (number, frames) = match text.strip_suffix('f') {
            Some(number) => (number, true),
            None => (text.strip_suffix('s').unwrap_or(text), false),
        };
        let wrong = || format!("`{text}` is no moment; expected 2.5s, 2.5 or 40f, with a - in front from the end");
        let number: f64 = number.parse().map_err(|_| wrong())?;
        match number.is_finite() && (!frames || number.fract() == 0.0) {
            true => Ok(if frames { Moment::Frames(number) } else { Moment::Seconds(number) }),
            false => Err(wrong()),
        }
    }
}

impl Moment {
    /// The border between frames that lies nearest, of a clip of so many `frames`; `None` outside of it.
    pub fn border(self, frames: usize, fps: f64) -> Option<usize> {
        let at = match self {
            Moment::Seconds(s) => (s * fps).round(),
            Moment::Frames(n) => n,
        };
        // -0 is the end too
        let at = if at.is_sign_negative() { frames as f64 + at } else { at };
        (0.0..=frames as f64).contains(&at).then_some(at as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds_and_frames_from_either_end() {
        let border = |text: &str| text.parse::<Moment>().unwrap().border(100, 20.0);
        assert_eq!([border("2s"), border("2.52"), border("40f"), border("0")], [40, 50, 40, 0].map(Some));
        assert_eq!([border("-1s"), border("-10f"), border("-0"), border("5s")], [80, 90, 100, 100].map(Some));
        assert_eq!([border("5.1s"), border("-5.1s"), border("101f")], [None; 3]);
        for text in ["", "f", "2m", "1.5f", "nan", "inf", "2 s"] {
            assert!(text.parse::<Moment>().unwrap_err().contains("expected 2.5s"), "{text}");
        }
    }
}
