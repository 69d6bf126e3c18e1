//! Smoothed targets of cross-entropy: a bin's mass is spread over the bins around it.

use crate::bins::Bins;

/// The shares of a target's mass for its neighbours: w_d ~ exp(-d^2 / (2 width^2)) at distance d, up to three widths.
#[derive(Debug, Clone, PartialEq)]
pub struct Smoothing {
    /// By distance, not yet brought to a sum of 1.
    weights: Vec<f64>,
}

impl Smoothing {
    /// A kernel of this width in bins.
    ///
    /// # Panics
    /// If the width is no positive number.
    pub fn new(width: f64) -> Smoothing {
        assert!(width > 0.0 && width.is_finite(), "a kernel {width} bins wide");
        let reach = (3.0 * width).floor() as usize;
        let weight = |d: usize| (-((d * d) as f64) / (2.0 * width * width)).exp();
        Smoothing { weights: (0..=reach).map(weight).collect() }
    }

    /// Bins on each side that get something.
    pub fn reach(&self) -> usize {
        self.weights.len() - 1
    }

    /// Calls `take` with the columns that share the mass of `target`, and their shares, which sum to 1: round the circle, or
    /// cut at the ends.
    ///
    /// A target among no bins gets all.
    pub fn shares(&self, target: u32, bins: Bins, mut take: impl FnMut(u32, f64)) {
        let Bins { first, count, circular } = bins;
        if count == 0 {
            return take(target, 1.0);
        }
        let (at, reach) = (target - first, self.reach() as u32);
        let (down, up) = match circular {
            // the opposite bin of an even circle counts once, as an upper one
            true => (reach.min((count - 1) / 2), reach.min(count / 2)),
            false => (reach.min(at), reach.min(count - 1 - at)),
        };
        // normalised per target: at an end, what falls outside goes to the bins inside
        let sum: f64 = self.weights[..=down as usize].iter().chain(&self.weights[1..=up as usize]).sum();
        for d in (1..=down).rev() {
            take(first + (at + count - d) % count, self.weights[d as usize] / sum);
        }
        for d in 0..=up {
            take(first + (at + d) % count, self.weights[d as usize] / sum);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn shares(width: f64, target: u32, bins: Bins) -> Vec<(u32, f64)> {
        let mut all = Vec::new();
        Smoothing::new(width).shares(target, bins, |column, share| all.push((column, share)));
        all
    }

    #[test]
    fn mass_goes_to_neighbours_round_the_circle_or_up_to_the_ends() {
        // 2.25 bins: two neighbours on each side
        let w = |d: f64| (-d * d / (2.0 * 0.75 * 0.75)).exp();
        let sum = w(0.0) + 2.0 * w(1.0) + 2.0 * w(2.0);
        let circle = shares(0.75, 6, Bins { first: 6, count: 8, circular: true });
        assert_eq!(circle.iter().map(|s| s.0).collect::<Vec<_>>(), [12, 13, 6, 7, 8]);
        for ((_, share), d) in circle.iter().zip([2.0, 1.0, 0.0, 1.0, 2.0]) {
            assert!((share - w(d) / sum).abs() < 1e-15);
        }
        let ends = shares(0.75, 7, Bins { first: 6, count: 8, circular: false });
        let sum = w(1.0) + w(0.0) + w(1.0) + w(2.0);
        assert_eq!(ends.iter().map(|s| s.0).collect::<Vec<_>>(), [6, 7, 8, 9]);
        assert!((ends[3].1 - w(2.0) / sum).abs() < 1e-15);
    }

    #[test]
    fn no_bin_gets_twice_and_all_shares_sum_to_1() {
        for (count, circular) in
            [(1, true), (2, true), (3, true), (4, true), (5, true), (360, true), (1, false), (4, false)]
        {
            for target in 10..10 + count {
                let all = shares(1.1, target, Bins { first: 10, count, circular });
                let mut columns: Vec<u32> = all.iter().map(|s| s.0).collect();
                columns.sort_unstable();
                columns.dedup();
                assert_eq!(columns.len(), all.len());
                assert!(columns.iter().all(|c| (10..10 + count).contains(c)));
                assert!((all.iter().map(|s| s.1).sum::<f64>() - 1.0).abs() < 1e-12);
                assert!(all.iter().all(|s| s.1 <= all.iter().find(|s| s.0 == target).unwrap().1));
            }
        }
        assert_eq!(shares(2.0, 5, Bins::NONE), [(5, 1.0)]);
    }
}
