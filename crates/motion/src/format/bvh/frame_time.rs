//! Frame times and the rates that they mean: docs/motion-files.md.

use super::text::number;
use crate::error::compact;
use crate::resample::MOST_FPS;
use crate::{Error, Result};

/// The usual frame rates, ascending. If the digits of a frame time allow several rates, the nearest of these is used.
pub const USUAL_FPS: [u128; 9] = [24, 25, 30, 50, 60, 90, 100, 120, 240];

/// Parses a frame time; an error contains what was expected and what to do.
pub(crate) fn check(word: &[u8]) -> std::result::Result<f64, (&'static str, String)> {
    const EXPECTED: &str = "seconds from 0.0001 to 1";
    match number(word) {
        Ok(t) if t <= 1.0 && t * MOST_FPS >= 1.0 - 1e-9 => Ok(t),
        Ok(t) if t > 1.0 => Err((EXPECTED, format!("if {t} is a rate, write {:.6}", 1.0 / t))),
        Ok(_) => Err((EXPECTED, "write the seconds of a frame, 0.008333 for 120 frames a second".into())),
        Err(bad) => Err((EXPECTED, bad.help().to_owned())),
    }
}

/// Frames per second of a frame time's text; `None` if it is no frame time.
///
/// A whole rate `n` fits if `1/n`, rounded or truncated to the decimals of the text, is the text. Of the fitting rates the
/// nearest usual one is used, else the nearest one; if none fits, the rate is the reciprocal.
pub fn rate(text: &str) -> Option<f64> {
    let seconds = check(text.as_bytes()).ok()?;
    let exact = 1.0 / seconds;
    let Some((digits, unit)) = decimal(text) else { return Some(exact) };
    let fits = |n: u128| {
        // in integers, so that no text is misjudged by the rounding of a double; exporters truncate or round
        let (cut, rounded) = (unit / n, (2 * unit + n) / (2 * n));
        n > 0 && (cut == digits || rounded == digits)
    };
    let nearness = |n: &u128| (*n as f64 - exact).abs();
    let nearest = |all: &[u128]| {
        all.iter().copied().filter(|&n| n > 0 && fits(n)).min_by(|a, b| nearness(a).total_cmp(&nearness(b)))
    };
    let whole = exact.floor() as u128;
    // few digits fit several rates: 0.03 is 30 fps as well as 33
    let n = nearest(&USUAL_FPS).or_else(|| nearest(&[whole, whole + 1]));
    Some(n.map_or(exact, |n| n as f64))
}

/// The text as `digits / unit`, with `unit` a power of ten; digits after the thirtieth decimal are dropped.
fn decimal(text: &str) -> Option<(u128, u128)> {
    let text = text.trim_start_matches('+').to_ascii_lowercase();
    let (mantissa, exponent) = text.split_once('e').unwrap_or((&text, "0"));
    let (whole, fraction) = mantissa.split_once('.').unwrap_or((mantissa, ""));
    let places = (fraction.len() as i64).checked_sub(exponent.parse::<i64>().ok()?)?;
    let all = format!("{whole}{fraction}");
    // 10^30, doubled in `fits`, stays below 2^128
    let cut = (places - 30).max(0);
    let kept = (all.len() as i64 - cut).max(0) as usize;
    let kept = if kept == 0 { "0" } else { all.get(..kept)? };
    let unit = 10u128.checked_pow(u32::try_from((places - cut).max(0)).ok()?)?;
    // a text without decimals, such as 1 or 10e-1, has unit 1
    Some((kept.parse::<u128>().ok()?, unit)).filter(|_| places >= 0)
}

/// The shortest frame time, with at least six decimals, that reads back as this rate, both here and in programs that only
/// take the reciprocal (Blender does so in single precision).
///
/// Some rates that aren't whole are not the reciprocal of any double; they come back to within one part in 10^15.
///
/// # Errors
/// [`Invalid`](kinelm_store::Error::Invalid) for a rate below 1, which no BVH can have, and one whose frame time would be 0.
pub fn text(fps: f64) -> Result<String> {
    if !(fps >= 1.0 && fps.is_finite()) {
        return Err(bad_rate(fps, "at least 1"));
    }
    let seconds = 1.0 / fps;
    let tries = (6..=30).map(|places| format!("{seconds:.places$}"));
    let found = tries.into_iter().find(|t| rate(t) == Some(fps) && is_exact(t, fps));
    let text = found.unwrap_or_else(|| format!("{seconds:.20}"));
    match rate(&text) {
        Some(_) => Ok(text),
        None => Err(bad_rate(fps, "a rate whose frame time is not 0")),
    }
}

fn bad_rate(fps: f64, expected: &str) -> Error {
    Error::invalid("the rate of a BVH", format!("{} frames per second", compact(fps)), expected)
}

/// Whether the reciprocal is the rate to a tenth of single precision.
pub(crate) fn is_exact(text: &str, fps: f64) -> bool {
    text.parse::<f64>().is_ok_and(|seconds| (1.0 / seconds / fps - 1.0).abs() < 5e-9)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn rates_that_are_meant() {
        for (text, want) in [
            ("0.016", 60.0),
            ("0.017", 60.0),
            ("0.0167", 60.0),
            ("0.033", 30.0),
            ("0.00833333", 120.0),
            ("0.0083", 120.0),
            ("0.03333", 30.0),
            ("0.0416667", 24.0),
            ("0.05", 20.0),
            (".1", 10.0),
            ("1", 1.0),
            ("0.01", 100.0),
            ("8.33333e-3", 120.0),
            ("3.33333E-02", 30.0),
            ("0.0333333333333333333333333333333333333", 30.0),
            ("0.008333333333333333333333333333333333333333333", 120.0),
        ] {
            assert_eq!(rate(text), Some(want), "{text}");
        }
        assert!((rate("0.0333667").unwrap() - 29.97).abs() < 1e-3);
        assert!((rate("0.0417083750417").unwrap() - 23.976).abs() < 1e-6);
        for bad in ["0", "-0.01", "nan", "30", "1.0001", "x", "0,03", "1e-400"] {
            assert_eq!(rate(bad), None, "{bad}");
        }
    }

    #[test]
    fn whole_rates_come_back() {
        for n in 1..=2000 {
            assert_eq!(rate(&text(n as f64).unwrap()), Some(n as f64), "{n}");
        }
        assert_eq!(text(60.0).unwrap(), "0.0166666667");
        assert_eq!(text(20.0).unwrap(), "0.050000");
        for n in 1..=240 {
            // as Blender reads it
            let seconds: f64 = text(n as f64).unwrap().parse().unwrap();
            assert_eq!((n as f64 / (1.0 / seconds)) as f32, 1.0, "{n}");
        }
        assert!(text(0.5).is_err() && text(f64::NAN).is_err() && text(1e30).is_err());
    }

    proptest! {
        #[test]
        fn other_rates_come_back(fps in 1.0..1000.0f64) {
            let back = rate(&text(fps).unwrap()).unwrap();
            prop_assert!((back / fps - 1.0).abs() < 1e-15);
        }
    }
}
