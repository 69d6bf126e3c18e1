//! Uniform bins over an interval, for translations.

use crate::{Error, Result};
use serde::{Deserialize, Serialize};

/// Bins of equal width, one of which decodes to `offset`. Values outside are clipped to the first or last bin.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Line {
    /// Width of a bin, metres.
    pub width: f64,
    /// The code whose value is `offset`.
    pub zero: u16,
    /// 0, or half a bin when bins have an edge at 0.
    pub offset: f64,
    /// Number of bins.
    pub bins: u32,
}

/// Bins of one number.
pub trait Scale {
    /// The code of a value, and whether it is clipped.
    fn code(&self, value: f64) -> (u16, bool);

    /// The value of a code; codes beyond the bins have the last one's.
    fn value(&self, code: u16) -> f64;
}

impl Scale for Line {
    fn code(&self, value: f64) -> (u16, bool) {
        Line::code(self, value)
    }

    fn value(&self, code: u16) -> f64 {
        Line::value(self, code)
    }
}

/// The least width of a fitted range, metres.
const NARROWEST: f64 = 0.01;

/// Margin on each side, as a fraction of the training range.
const MARGIN: f64 = 0.025;

impl Line {
    /// Fits bins to training values: their range with a margin of 2.5 % on each side, at least 1 cm wide, shifted by at most half
    /// a bin so that 0, which the range includes, is a bin's value.
    pub(crate) fn fitted(low: f64, high: f64, bins: u32) -> Self {
        let (low, high) = (low.min(0.0), high.max(0.0));
        let span = high - low;
        // with fewer than 21 bins the shift could exceed the margin, so the bins are wider
        let n = f64::from(bins);
        let wide = (span * (1.0 + 2.0 * MARGIN)).max(span * n / (n - 1.0)).max(NARROWEST);
        let first = 0.5 * (low + high) - 0.5 * wide;
        let width = wide / n;
        // the bin whose middle is nearest to 0; its middle becomes 0, which shifts all bins by at most half a width
        let zero = (-first / width - 0.5).round().clamp(0.0, n - 1.0);
        Line { width, zero: zero as u16, offset: 0.0, bins }
    }

    /// The narrowest bins over a range that includes 0, with 0 as a bin's value.
    pub(crate) fn over(low: f64, high: f64, bins: u32) -> Self {
        let n = f64::from(bins);
        let width = ((high - low) / (n - 1.0)).max(NARROWEST / n);
        let zero = (-low / width).round().clamp(0.0, n - 1.0);
        Line { width, zero: zero as u16, offset: 0.0, bins }
    }

    /// The code of a value, and whether it is clipped: more than half a bin from its decoded value.
    pub fn code(&self, value: f64) -> (u16, bool) {
        let k = nearest_whole((value - self.offset) / self.width); // saturates
        let k = k.saturating_add(self.zero.into()).clamp(0, i64::from(self.bins) - 1) as u16;
        // 1e-9 of slack, since a value exactly between two bins is not clipped
        (k, (value - self.value(k)).abs() > 0.5 * self.width * (1.0 + 1e-9))
    }

    /// The value of a code, metres.
    pub fn value(&self, code: u16) -> f64 {
        (f64::from(code) - f64::from(self.zero)) * self.width + self.offset
    }

    pub(crate) fn validate(&self, bins: u32) -> Result<()> {
        let good = self.bins == bins
            && (1e-9..1e7).contains(&self.width)
            && u32::from(self.zero) < bins
            && self.offset.abs() <= self.width;
        good.then_some(()).ok_or_else(|| {
            Error::setting(
                "translation bins",
                format!("{self:?}"),
                format!("{bins} bins of a width of 1e-9 to 1e7 m, one of them at 0"),
            )
        })
    }
}

/// `x.round()` without a call into the C library.
///
/// Rounds halves away from zero. The summand is the largest number below a half, so that numbers just below a half round down.
pub(super) fn nearest_whole(x: f64) -> i64 {
    (x + 0.499_999_999_999_999_94_f64.copysign(x)) as i64
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn nearest_whole_is_round() {
        for x in [0.0, 0.5, 0.499_999_999_999_999_94, 1.5, 2.5, 179.5, 1e9 + 0.5, 4503599627370495.5, f64::NAN, 1e300] {
            for x in [x, -x, x.next_up(), x.next_down()] {
                assert_eq!(nearest_whole(x), x.round() as i64, "{x}");
            }
        }
    }

    #[test]
    fn a_fitted_range_has_its_margins() {
        let l = Line::fitted(-0.35, 0.35, 360);
        assert!((l.width * 360.0 - 0.735).abs() < 1e-12);
        assert_eq!((l.value(l.zero), l.code(0.0)), (0.0, (l.zero, false)));
        let still = Line::fitted(0.0, 0.0, 360);
        assert!((still.width * 360.0 - 0.01).abs() < 1e-15);
    }

    #[test]
    fn over_a_range_nothing_clips() {
        for (low, high) in [(-0.4, 0.3), (-1e-9, 0.7), (0.0, 0.0), (-0.2, 0.0)] {
            for bins in [2, 3, 20, 360] {
                let l = Line::over(low, high, bins);
                for k in 0..=100 {
                    let v = low + (high - low) * f64::from(k) / 100.0;
                    assert!(!l.code(v).1, "{v} of {low}..{high} in {l:?}");
                }
                l.validate(bins).unwrap();
            }
        }
        assert!((Line::over(-0.5, 0.5, 360).width * 359.0 - 1.0).abs() < 1e-12);
    }

    #[test]
    fn values_outside_are_clipped() {
        let l = Line::fitted(-0.1, 0.3, 100);
        assert_eq!(l.code(1e300), (99, true));
        assert_eq!(l.code(-1e300), (0, true));
        assert_eq!(l.code(f64::INFINITY).0, 99);
        assert!(!l.code(l.value(99) + 0.4999 * l.width).1);
        assert!(l.code(l.value(99) + 0.5001 * l.width).1);
    }

    proptest! {
        #[test]
        fn the_span_never_clips(low in -2.0..0.0f64, high in 0.0..2.0f64, bins in 2u32..2000, t in 0.0..=1.0f64) {
            let l = Line::fitted(low, high, bins);
            let v = low + t * (high - low);
            let (k, clipped) = l.code(v);
            prop_assert!(!clipped);
            prop_assert!((l.value(k) - v).abs() <= 0.5 * l.width * (1.0 + 1e-9));
        }

        #[test]
        fn values_keep_their_code(low in -2.0..0.0f64, high in 0.0..2.0f64, bins in 2u32..2000) {
            let l = Line::fitted(low, high, bins);
            for k in 0..bins as u16 {
                prop_assert_eq!(l.code(l.value(k)), (k, false));
            }
        }
    }
}
