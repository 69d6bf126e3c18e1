//! Maps numbers to pixels; tick marks.

use super::{Chart, Scale};

/// One axis: its scale and range.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Axis {
    scale: Scale,
    pub low: f64,
    pub high: f64,
}

impl Axis {
    /// Slightly wider than the numbers.
    fn around(scale: Scale, numbers: impl Iterator<Item = f64>) -> Axis {
        let (low, high) = numbers.fold((f64::MAX, f64::MIN), |(l, h), v| (l.min(v), h.max(v)));
        match scale {
            Scale::Log => {
                // a single point needs a range, too
                // 8 % of the range on each side, at most a factor of 1.15
                let wider = if high > 1.001 * low { (high / low).powf(0.08).min(1.15) } else { 1.5 };
                Axis { scale, low: low / wider, high: high * wider }
            }
            Scale::Linear => {
                // a single value gets a range of its own size, 0 one of 1
                let wider = if high > low { 0.04 * (high - low) } else { 0.5 * high.abs().max(1.0) };
                Axis { scale, low: low - wider, high: high + wider }
            }
        }
    }

    /// A linear axis with exactly this range.
    pub fn exactly([low, high]: [f64; 2]) -> Axis {
        if high > low {
            Axis { scale: Scale::Linear, low, high }
        } else {
            // `along` divides by the range
            Axis::around(Scale::Linear, [low].into_iter())
        }
    }

    /// Relative position of a number: 0 at the lower end, 1 at the upper.
    pub fn along(&self, v: f64) -> f64 {
        match self.scale {
            Scale::Log => (v / self.low).ln() / (self.high / self.low).ln(),
            Scale::Linear => (v - self.low) / (self.high - self.low),
        }
    }

    /// Whether the axis includes a number.
    pub fn reaches(&self, v: f64) -> bool {
        (self.low..=self.high).contains(&v)
    }

    /// The tick marks.
    pub fn ticks(&self) -> Vec<f64> {
        match self.scale {
            Scale::Log => log_ticks(self.low, self.high),
            Scale::Linear => linear_ticks(self.low, self.high),
        }
    }
}

/// The axes of a chart and their frame.
pub struct Axes {
    pub x: Axis,
    pub y: Axis,
    /// Left, top, right, bottom.
    pub frame: [i32; 4],
}

impl Axes {
    /// The axes for all points of a chart, or of its heat map.
    pub fn of(chart: &Chart, frame: [i32; 4]) -> Axes {
        if let Some(heat) = &chart.heat {
            return Axes { x: Axis::exactly(heat.x), y: Axis::exactly(heat.y), frame };
        }
        let points = || chart.series.iter().flat_map(|s| chart.drawable(s));
        let (x, y) = chart.scales;
        Axes { x: Axis::around(x, points().map(|p| p.0)), y: Axis::around(y, points().map(|p| p.1)), frame }
    }

    /// The pixel of a point.
    pub fn at(&self, (x, y): (f64, f64)) -> (i32, i32) {
        let [left, top, right, bottom] = self.frame.map(f64::from);
        let px = left + self.x.along(x) * (right - left);
        let py = bottom - self.y.along(y) * (bottom - top);
        (px.round() as i32, py.round() as i32)
    }
}

/// 1, 2 and 5 times every power of ten within the limits; only powers over a wide range, more over a narrow one, and linear ticks
/// within a factor of two.
fn log_ticks(low: f64, high: f64) -> Vec<f64> {
    if high < 2.0 * low {
        return linear_ticks(low, high);
    }
    let powers = low.log10().floor() as i32..=high.log10().ceil() as i32;
    let heads: &[f64] = match (high / low).log10() {
        wide if wide > 3.5 => &[1.0],
        narrow if narrow < 1.0 => &[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 7.0],
        _ => &[1.0, 2.0, 5.0],
    };
    // a power of ten below 1 is not exact, its inverse is
    let power = |p: i32| if p < 0 { 1.0 / 10f64.powi(-p) } else { 10f64.powi(p) };
    let all = powers.flat_map(|p| heads.iter().map(move |h| h * power(p)));
    all.filter(|v| (low..=high).contains(v)).collect()
}

/// Multiples of 1, 2 or 5 of a power of ten inside the limits, at most eight.
fn linear_ticks(low: f64, high: f64) -> Vec<f64> {
    // the step is at least this, so eight steps cover the range
    let rough = (high - low) / 8.0;
    let power = 10f64.powf(rough.log10().floor());
    let step = [1.0, 2.0, 5.0, 10.0].into_iter().map(|h| h * power).find(|s| *s >= rough).unwrap_or(10.0 * power);
    let (first, last) = ((low / step).ceil() as i64, (high / step).floor() as i64);
    // multiples, not sums: 0.1 added ten times is not 1
    (first..=last).map(|i| i as f64 * step).collect()
}

/// The number with few digits.
pub fn number(v: f64) -> String {
    match v.abs() {
        large if large >= 10_000.0 => format!("{}k", v / 1000.0),
        0.0 => "0".into(),
        // 1e-12 of rounding: 3e-7, not 2.9999999999999997e-7
        small if small < 1e-3 => format!("{:e}", short(v, 1e12)),
        _ => short(v, 1e6).to_string(),
    }
}

/// Rounds away the digits of rounding errors.
fn short(v: f64, unit: f64) -> f64 {
    (v * unit).round() / unit
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn marks_on_an_axis() {
        assert_eq!(log_ticks(0.9, 12.0), [1.0, 2.0, 5.0, 10.0]);
        assert_eq!(log_ticks(2.9, 12.0), [3.0, 4.0, 5.0, 7.0, 10.0]);
        assert_eq!(log_ticks(0.009, 1100.0), [0.01, 0.1, 1.0, 10.0, 100.0, 1000.0]);
        assert_eq!(log_ticks(270.0, 385.0), [280.0, 300.0, 320.0, 340.0, 360.0, 380.0]);
        assert_eq!(linear_ticks(-0.3, 10.2), [0.0, 2.0, 4.0, 6.0, 8.0, 10.0]);
        assert_eq!(linear_ticks(-120.0, 3120.0), [0.0, 500.0, 1000.0, 1500.0, 2000.0, 2500.0, 3000.0]);
        let narrow: Vec<String> = linear_ticks(1.019, 1.046).into_iter().map(number).collect();
        assert_eq!(narrow.join(" "), "1.02 1.025 1.03 1.035 1.04 1.045");
        assert_eq!([0.05, 1.0, 200.0, 20000.0, 0.0].map(number), ["0.05", "1", "200", "20k", "0"]);
        assert_eq!([1e-7, 0.0002, -0.00015, -3.5].map(number), ["1e-7", "2e-4", "-1.5e-4", "-3.5"]);
    }

    #[test]
    fn an_axis_holds_its_numbers_and_one_number_too() {
        for scale in [Scale::Log, Scale::Linear] {
            let one = Axis::around(scale, [3.0].into_iter());
            assert!(one.low < 3.0 && 3.0 < one.high && (one.along(3.0) - 0.5).abs() < 0.2);
            let many = Axis::around(scale, [3.0, 1.0, 90.0].into_iter());
            assert!([1.0, 3.0, 90.0].iter().all(|v| many.reaches(*v)));
            assert!(many.along(1.0) < many.along(3.0) && many.along(90.0) < 1.0);
        }
        let zero = Axis::around(Scale::Linear, [0.0, 0.0].into_iter());
        assert!(zero.low < 0.0 && zero.high > 0.0);
    }
}
