//! The parsers of option values that several commands take: numbers, rates, times, lengths.

use crate::model::run::TOKENIZER;
use crate::spectral::windows::{MAX_FRAMES, MIN_FRAMES};
use clap::builder::{OsStringValueParser, TypedValueParser};
use kinelm_motion::moment::{EXPECTED, Moment};
use kinelm_motion::resample::MOST_FPS;
use std::ffi::OsString;
use std::ops::{Range, RangeInclusive};
use std::path::PathBuf;

/// The parser of a run folder, or `ready`: kinelm's own model, unless a folder has that name.
pub fn run_folder() -> impl TypedValueParser<Value = PathBuf> {
    OsStringValueParser::new().try_map(|name: OsString| {
        let path = PathBuf::from(&name);
        if name == kinelm_ready::NAME && !path.exists() {
            return kinelm_ready::run().map_err(|e| e.to_string());
        }
        Ok(path)
    })
}

/// The parser of a tokenizer's file, or `ready`: that of kinelm's own model, unless a file has that name.
pub fn tokenizer_file() -> impl TypedValueParser<Value = PathBuf> {
    OsStringValueParser::new().try_map(|name: OsString| {
        let path = PathBuf::from(&name);
        if name == kinelm_ready::NAME && !path.exists() {
            return kinelm_ready::run().map(|run| run.join(TOKENIZER)).map_err(|e| e.to_string());
        }
        Ok(path)
    })
}

/// A positive, finite number.
pub fn positive(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(x) if x > 0.0 && x.is_finite() => Ok(x),
        _ => Err("expected a positive number".into()),
    }
}

/// A rate in frames per second.
pub fn rate(text: &str) -> Result<f64, String> {
    let wrong = || format!("expected a rate above 0, at most {MOST_FPS} frames per second");
    positive(text).ok().filter(|fps| *fps <= MOST_FPS).ok_or_else(wrong)
}

/// A whole number from 1 on.
pub fn count(text: &str) -> Result<usize, String> {
    text.parse().ok().filter(|&n| n > 0).ok_or("expected a whole number from 1 on".into())
}

/// Numbers from 0 on: the first K, or FROM..TO as Rust has it, without TO.
pub fn band(text: &str) -> Result<Range<usize>, String> {
    let band = match text.split_once("..") {
        None => text.parse().ok().map(|end| 0..end),
        Some((from, to)) => from.parse().ok().zip(to.parse().ok()).map(|(from, to)| from..to),
    };
    let wrong = "expected a whole number from 1 on, or a band as 4..16, whose end is above its first".to_string();
    band.filter(|band| !band.is_empty()).ok_or(wrong)
}

/// A whole number in a range.
pub fn within(range: RangeInclusive<usize>) -> impl Fn(&str) -> Result<usize, String> + Clone {
    move |text| {
        let wrong = || format!("expected {} to {}", range.start(), range.end());
        text.parse().ok().filter(|n| range.contains(n)).ok_or_else(wrong)
    }
}

/// The frames of a window of a search.
pub fn window(text: &str) -> Result<usize, String> {
    within(MIN_FRAMES..=MAX_FRAMES)(text)
}

/// A time from the start on, where there is no model; a bare number is seconds.
pub fn time(text: &str) -> Result<Moment, String> {
    match moment(text)? {
        Moment::Model(_) => Err(format!("`{text}`: there is no model; {EXPECTED}")),
        // -0 is the start too
        time if time.number().is_sign_negative() && time.number() != 0.0 => Err("expected a time from 0 on".into()),
        time => Ok(time),
    }
}

/// A time that may be before the start.
pub fn any_time(text: &str) -> Result<Moment, String> {
    let before = text.strip_prefix('-').map(|after| time(after).map(|_| ()));
    before.unwrap_or_else(|| time(text).map(|_| ()))?;
    text.parse()
}

/// A time in seconds, where there are no frames.
pub fn seconds(text: &str) -> Result<f64, String> {
    match time(text)? {
        Moment::Seconds(s) => Ok(s),
        _ => Err(format!("`{text}`: there are no frames here; expected seconds, as 2.5s or 2.5")),
    }
}

/// A duration in seconds, above 0.
pub fn seconds_above_0(text: &str) -> Result<f64, String> {
    seconds(text).and_then(|s| if s > 0.0 { Ok(s) } else { Err("expected more than 0 s".into()) })
}

/// A duration above 0; a bare number is seconds.
pub fn length(text: &str) -> Result<Moment, String> {
    above_0(moment(text)?)
}

/// A duration above 0; a bare number is frames.
pub fn length_in_frames(text: &str) -> Result<Moment, String> {
    above_0(Moment::in_frames(text)?)
}

/// Seconds or frames that a length may have at most, so that it is a number of frames at any rate.
const LONGEST: f64 = 1e9;

fn above_0(length: Moment) -> Result<Moment, String> {
    match length.number() {
        n if n <= 0.0 => Err(format!("{length}: expected more than nothing")),
        n if n > LONGEST => Err(format!("{length}: expected at most {LONGEST:e} seconds or frames")),
        _ => Ok(length),
    }
}

/// A time or a length; a bare number is seconds.
fn moment(text: &str) -> Result<Moment, String> {
    text.parse().map_err(|_| format!("`{text}` is no time; {EXPECTED}"))
}

/// A number of frames at `fps`, in a range; a bare number is frames.
pub fn frames_at(fps: f64, range: RangeInclusive<u32>) -> impl Fn(&str) -> Result<u32, String> + Clone {
    move |text| {
        let frames = Moment::in_frames(text)?.frames(fps);
        let within = (f64::from(*range.start())..=f64::from(*range.end())).contains(&frames);
        let wrong = || format!("{frames} frames; expected {} to {}", range.start(), range.end());
        if within { Ok(frames as u32) } else { Err(wrong()) }
    }
}

/// A fraction, 0 to 1.
pub fn share(text: &str) -> Result<f64, String> {
    text.parse().ok().filter(|s| (0.0..=1.0).contains(s)).ok_or("expected a number from 0 to 1".into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_length_is_refused_with_what_it_may_be() {
        assert_eq!(length("inf").unwrap_err(), "`inf` is no time; expected 2.5s, 2.5 or 40f");
        assert_eq!(length("1e308").unwrap_err(), "1e308s: expected at most 1e9 seconds or frames");
        assert_eq!(length_in_frames("0").unwrap_err(), "0f: expected more than nothing");
        assert_eq!(length("40f"), Ok(Moment::Frames(40.0)));
        assert_eq!(time("-1s").unwrap_err(), "expected a time from 0 on");
        assert_eq!(any_time("-1s"), Ok(Moment::Seconds(-1.0)));
    }

    #[test]
    fn a_band_has_its_first_and_not_its_end() {
        assert_eq!((band("16"), band("0..16"), band("4..16")), (Ok(0..16), Ok(0..16), Ok(4..16)));
        for wrong in ["0", "-1", "x", "4..4", "5..4", "..4", "4..", "4..=16", "1..2..3"] {
            assert!(band(wrong).unwrap_err().contains("a band as 4..16"), "{wrong}");
        }
    }
}
