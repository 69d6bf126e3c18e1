//! Quantile bins on a line: each with the same number of training values.

use super::line::Scale;
use crate::{Error, Result};
use serde::{Deserialize, Serialize};

/// Bins between ascending edges, each with its decoded value. The first and the last are unbounded.
///
/// A bin includes its lower edge, as in `numpy.searchsorted(edges, x, side="right")`; a value within [`SLACK`] below an edge
/// counts as on it, so that rounding doesn't move decoded values to another bin.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Bins {
    /// Ascending, one fewer than bins.
    edges: Vec<f64>,
    /// Ascending, one per bin.
    values: Vec<f64>,
    /// The least and the greatest of the training values.
    range: [f64; 2],
}

/// Rounding error of numbers with six decimals in degrees or centimetres, in radians or metres.
pub const SLACK: f64 = 1.0 / (1u64 << 24) as f64;

/// Edges closer than this merge.
const LEAST_WIDTH: f64 = 4.0 * SLACK;

/// Bound of the fitted numbers in a file.
const LARGEST: f64 = 1e9;

impl Bins {
    /// Fits edges to the `i / bins` quantiles of sorted, finite training values, at least one. A bin's value is the median of its
    /// training values.
    ///
    /// Equal edges merge, and so does an empty first bin, so there may be fewer bins. An empty bin between two edges, possible with
    /// more bins than values, decodes to its middle.
    pub(crate) fn fitted(sorted: &[f64], bins: u32) -> Self {
        Bins::between(edges(sorted, bins), sorted)
    }

    /// As [`Bins::fitted`], for closed-loop steps, with at least 3 bins: two are for the extremes of the training values and 0,
    /// with edges halfway, so that the decoded walk doesn't lag after steady steps; and the bin of 0 decodes to 0.
    pub(crate) fn fitted_to_steps(sorted: &[f64], bins: u32) -> Self {
        // room for the two extremes, and pinning 0 adds none
        let mut fitted = Bins::fitted(sorted, bins - 2);
        let [low, high] = fitted.range;
        fitted.range = [low.min(0.0), high.max(0.0)];
        let [low, high] = fitted.range;
        let (first, last) = (fitted.values[0], fitted.values[fitted.values.len() - 1]);
        if first - low > 2.0 * LEAST_WIDTH {
            fitted.edges.insert(0, 0.5 * (first + low));
            fitted.values.insert(0, low);
        }
        if high - last > 2.0 * LEAST_WIDTH {
            fitted.edges.push(0.5 * (last + high));
            fitted.values.push(high);
        }
        fitted.pin_zero();
        fitted
    }

    /// Bins of equal width over a range that includes 0.
    pub(crate) fn even(low: f64, high: f64, bins: u32) -> Self {
        let width = (high - low) / f64::from(bins);
        let edges = (1..bins).map(|k| low + width * f64::from(k)).collect();
        let values = (0..bins).map(|k| low + width * (f64::from(k) + 0.5)).collect();
        Bins { edges, values, range: [low, high] }
    }

    /// Sets the value of 0's bin to 0, and moves an edge just above it, so that rounding stays in the bin.
    fn pin_zero(&mut self) {
        for (k, edge) in self.edges.iter_mut().enumerate().filter(|(_, e)| (0.0..=2.0 * SLACK).contains(*e)) {
            *edge = 0.0;
            // the bin below must not decode to 0 too, or its code would encode to this bin's
            self.values[k] = self.values[k].min(-2.0 * SLACK);
        }
        let zero = usize::from(self.code(0.0).0);
        self.values[zero] = 0.0;
    }

    /// A single bin of value 0, for a missing number.
    pub(crate) fn at_zero() -> Self {
        Bins { edges: Vec::new(), values: vec![0.0], range: [0.0; 2] }
    }

    fn between(edges: Vec<f64>, sorted: &[f64]) -> Self {
        let mut values = Vec::with_capacity(edges.len() + 1);
        let mut start = 0;
        for k in 0..=edges.len() {
            let end = edges.get(k).map_or(sorted.len(), |edge| sorted.partition_point(|x| x + SLACK < *edge));
            let low = if k == 0 { f64::NEG_INFINITY } else { edges[k - 1] };
            // a value at its upper edge would encode to the next bin, since edges have a slack
            let high = edges.get(k).map_or(f64::INFINITY, |edge| edge - 2.0 * SLACK);
            // the first and the last bin are not empty
            let middle = if start < end { quantile(&sorted[start..end], 0.5) } else { 0.5 * (low + high) };
            values.push(middle.min(high).max(low));
            start = end;
        }
        Bins { edges, values, range: [sorted[0], sorted[sorted.len() - 1]] }
    }

    /// The number of bins.
    #[allow(clippy::len_without_is_empty, reason = "there is always one")]
    pub fn len(&self) -> usize {
        self.values.len()
    }

    /// The edges between bins, ascending.
    pub fn edges(&self) -> &[f64] {
        &self.edges
    }

    /// The decoded values.
    pub fn values(&self) -> &[f64] {
        &self.values
    }

    /// Numbers of the tables: edges, values and the range.
    pub fn numbers(&self) -> u64 {
        (self.edges.len() + self.values.len() + 2) as u64
    }

    /// Checks the tables of a file, of at most `bins` bins.
    pub(crate) fn validate(&self, field: &'static str, bins: u32) -> Result<()> {
        let fine = |xs: &[f64]| xs.iter().all(|x| x.abs() < LARGEST) && xs.windows(2).all(|w| w[0] <= w[1]);
        let counts = self.values.len() == self.edges.len() + 1 && self.values.len() <= bins as usize;
        let good = counts && fine(&self.edges) && fine(&self.values) && fine(&self.range);
        good.then_some(()).ok_or_else(|| {
            Error::setting(
                field,
                format!("{} edges, {} values", self.edges.len(), self.values.len()),
                format!("at most {bins} values, one more than edges, all finite and ascending"),
            )
        })
    }
}

impl Scale for Bins {
    fn code(&self, value: f64) -> (u16, bool) {
        let value = value.min(f64::MAX); // NaN takes the last bin
        let at = self.edges.partition_point(|edge| *edge <= value + SLACK);
        let [low, high] = self.range;
        (at as u16, value < low - SLACK || value > high + SLACK)
    }

    fn value(&self, code: u16) -> f64 {
        self.values[usize::from(code).min(self.values.len() - 1)]
    }
}

/// The edges, ascending.
fn edges(sorted: &[f64], bins: u32) -> Vec<f64> {
    let mut edges: Vec<f64> = Vec::with_capacity(bins as usize);
    for i in 1..bins {
        let edge = quantile(sorted, f64::from(i) / f64::from(bins));
        if edge > edges.last().unwrap_or(&sorted[0]) + LEAST_WIDTH {
            edges.push(edge);
        }
    }
    edges
}

/// The `q` quantile of sorted values, at least one, by linear interpolation; equal to `numpy.quantile` to the bit.
pub(crate) fn quantile(sorted: &[f64], q: f64) -> f64 {
    let at = (sorted.len() - 1) as f64 * q;
    let low = at.floor();
    let t = at - low;
    let i = (low as usize).min(sorted.len() - 1);
    let (a, b) = (sorted[i], sorted[(i + 1).min(sorted.len() - 1)]);
    // NumPy's two forms: each is exact at its own end, and monotonic across the middle
    if t < 0.5 { a + (b - a) * t } else { b - (b - a) * (1.0 - t) }
}

#[cfg(test)]
mod tests {
    use super::super::angle::Angles;
    use super::super::angle::Form;
    use super::super::line::Line;
    use super::*;
    use kinelm_motion::Vec3;
    use kinelm_motion::rotation::exp_map;
    use proptest::prelude::*;
    use serde_json::Value;
    use std::f64::consts::{PI, TAU};

    fn golden() -> Value {
        serde_json::from_str(include_str!("../../tests/golden/bins.json")).unwrap()
    }

    fn numbers(v: &Value) -> Vec<f64> {
        v.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
    }

    /// Of a decimal form with 17 digits.
    const ROUNDING: f64 = 1e-15;

    #[test]
    fn quantile_bins_are_numpys() {
        for case in golden()["quantile"].as_array().unwrap() {
            let name = case["name"].as_str().unwrap();
            let mut training = numbers(&case["training"]);
            training.sort_by(f64::total_cmp);
            let bins = Bins::fitted(&training, case["bins"].as_u64().unwrap() as u32);
            let near = |ours: &[f64], theirs: &[f64], slack: f64| {
                assert_eq!(ours.len(), theirs.len(), "{name}");
                for (a, b) in ours.iter().zip(theirs) {
                    assert!((a - b).abs() <= slack * b.abs().max(1.0), "{name}: {a} {b}");
                }
            };
            near(&bins.edges, &numbers(&case["edges"]), ROUNDING);
            // a median at its bin's upper edge is moved below it
            near(bins.values(), &numbers(&case["medians"]), ROUNDING + 2.0 * SLACK);
            let codes: Vec<f64> = numbers(&case["values"]).iter().map(|x| f64::from(bins.code(*x).0)).collect();
            assert_eq!(codes, numbers(&case["codes"]), "{name}");
        }
    }

    #[test]
    fn uniform_bins_are_numpys() {
        for case in golden()["uniform"].as_array().unwrap() {
            let n = case["bins"].as_u64().unwrap() as u32;
            for (v, wanted) in case["vectors"].as_array().unwrap().iter().zip(case["codes"].as_array().unwrap()) {
                let q = exp_map::from_vector(Vec3::from_slice(&numbers(v)));
                for (form, key) in [(Form::Edge, "edge"), (Form::Centred, "centred")] {
                    let codes = Angles::new(form, n).code(q).0.map(f64::from);
                    assert_eq!(codes.to_vec(), numbers(&wanted[key]), "{n} bins, {key}, {v}");
                }
            }
        }
    }

    #[test]
    fn equal_edges_merge() {
        let mostly_still = [vec![0.0; 90], (1..=10).map(f64::from).collect()].concat();
        let bins = Bins::fitted(&mostly_still, 10);
        assert_eq!((bins.len(), bins.value(0), bins.code(0.0).0), (2, 0.0, 0));
        assert_eq!((bins.value(1), bins.value(7)), (5.5, 5.5), "a code above the bins left is the last one's");
        let still = Bins::fitted(&[0.25; 40], 360);
        assert_eq!((still.len(), still.code(0.25), still.code(0.3)), (1, (0, false), (0, true)));
        // above the least value, or nothing would be in the first bin
        let low = Bins::fitted(&[[0.0; 6], [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]].concat(), 4);
        assert!(low.edges[0] > 0.0 && low.code(0.0).0 == 0 && low.value(0) == 0.0, "{low:?}");
        assert_eq!(Bins::fitted(&[7.0], 5).values(), [7.0]);
    }

    #[test]
    fn steps_stand_still_and_keep_up() {
        let mut steps: Vec<f64> = (0..1000).map(|i| (f64::from(i) * 0.37).sin() * 0.2 + 0.01).collect();
        steps.sort_by(f64::total_cmp);
        let bins = Bins::fitted_to_steps(&steps, 60);
        assert_eq!((bins.len(), bins.value(bins.code(0.0).0)), (60, 0.0));
        assert_eq!((bins.value(0), bins.value(59)), (steps[0], steps[999]));
        assert_eq!(bins.values()[1], Bins::fitted(&steps, 58).values()[0], "else medians");
        let ahead: Vec<f64> = (1..=100).map(f64::from).collect();
        let bins = Bins::fitted_to_steps(&ahead, 10);
        assert_eq!((bins.value(0), bins.value(9)), (0.0, 100.0));
        assert_eq!((bins.code(3.0).0, bins.code(98.0).0), (0, 9), "from halfway to the next value on");
        bins.validate("steps", 10).unwrap();
        for (still, values) in [(0.25, vec![0.0, 0.25]), (-0.25, vec![-0.25, 0.0]), (0.0, vec![0.0])] {
            assert_eq!(Bins::fitted_to_steps(&[still; 900], 360).values(), values);
        }
    }

    #[test]
    fn what_a_file_says_is_checked() {
        let bins = Bins::fitted(&[1.0, 2.0, 3.0, 4.0, 5.0], 3);
        bins.validate("tilt", 3).unwrap();
        assert!(bins.validate("tilt", 2).unwrap_err().to_string().contains("tilt"));
        let wrong = |f: fn(&mut Bins)| {
            let mut b = bins.clone();
            f(&mut b);
            b.validate("tilt", 3).is_err()
        };
        assert!(wrong(|b| b.edges[0] = f64::NAN));
        assert!(wrong(|b| b.edges.swap(0, 1)));
        assert!(wrong(|b| b.values[2] = f64::INFINITY));
        assert!(wrong(|b| _ = b.values.pop()));
        assert!(wrong(|b| b.range = [1.0, 0.0]));
        assert!(serde_json::from_str::<Bins>(r#"{"edges":[],"values":[1],"range":[1,1],"more":0}"#).is_err());
    }

    proptest! {
        #[test]
        fn values_keep_their_code(
            xs in prop::collection::vec(prop_oneof![-3.0..3.0f64, -1e-7..1e-7f64, Just(0.5), Just(0.0)], 1..200),
            bins in 3u32..400, more in -4.0..4.0f64, noise in -1e-9..1e-9f64,
        ) {
            let mut xs = xs;
            xs.sort_by(f64::total_cmp);
            for b in [Bins::fitted(&xs, bins), Bins::fitted_to_steps(&xs, bins)] {
                b.validate("values", bins).unwrap();
                for x in xs.iter().chain([&more, &0.0]) {
                    let (k, _) = b.code(*x);
                    prop_assert!(usize::from(k) < b.len());
                    prop_assert_eq!(b.code(b.value(k) + noise), (k, false), "{} {:?}", x, b);
                }
                prop_assert!(xs.iter().all(|x| !b.code(*x).1));
            }
        }

        #[test]
        fn the_line_has_numpys_edges(low in -2.0..0.0f64, high in 0.0..2.0f64, bins in 2u32..500, x in -2.0..2.0f64) {
            let l = Line::fitted(low, high, bins);
            let edges: Vec<f64> = (1..bins as u16).map(|k| 0.5 * (l.value(k - 1) + l.value(k))).collect();
            let k = edges.partition_point(|e| *e <= x) as i64;
            prop_assert!((i64::from(l.code(x).0) - k).abs() <= 1);
            prop_assert!(edges.iter().any(|e| (e - x).abs() < 1e-12) || i64::from(l.code(x).0) == k);
        }
    }

    #[test]
    fn a_quarter_turn_in_uniform_edges() {
        let a = Angles::new(Form::Centred, 360);
        let q = exp_map::from_vector(Vec3::new(0.0, 0.5 * PI, 0.0));
        assert_eq!((a.code(q).0, a.width()), ([180, 270, 180], TAU / 360.0));
    }
}
