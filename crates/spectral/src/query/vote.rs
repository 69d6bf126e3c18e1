//! The vote of neighbours on a label, and the error of a share over many queries.

/// The vote of a window's neighbours.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Vote {
    /// The value that most of them have; of as many the one with the greater summed score, then the nearest one's.
    pub winner: usize,
    /// `-sum p log10 p` over their values, in bans: 0 if all are equal, 1 for ten different ones.
    pub entropy: f64,
}

/// The vote of neighbours by their values (below `values`) and scores, nearest first; `None` without any. See
/// docs/query.md, "Do neighbours share labels?".
pub fn vote(neighbours: impl IntoIterator<Item = (usize, f64)>, values: usize) -> Option<Vote> {
    let mut counts = vec![(0usize, 0.0f64); values];
    let mut order = Vec::new();
    for (value, score) in neighbours {
        if counts[value].0 == 0 {
            order.push(value);
        }
        counts[value].0 += 1;
        counts[value].1 += score;
    }
    let mut winner = *order.first()?;
    for &value in &order[1..] {
        let ((count, sum), (most, best)) = (counts[value], counts[winner]);
        if count > most || (count == most && sum > best) {
            winner = value;
        }
    }
    let all: usize = counts.iter().map(|c| c.0).sum();
    let shares = counts.iter().filter(|c| c.0 > 0).map(|c| c.0 as f64 / all as f64);
    // a sum of nothing but 0 is -0
    let entropy = shares.map(|p| -p * p.log10()).sum::<f64>().max(0.0);
    Some(Vote { winner, entropy })
}

/// Right answers and mean entropy over the queries of one recording after the other.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Tally {
    /// Per recording: right votes, queries.
    groups: Vec<(usize, usize)>,
    entropy: f64,
}

impl Tally {
    /// Counts an answer about a window of recording `group`.
    pub fn add(&mut self, group: usize, right: bool, entropy: f64) {
        if self.groups.len() <= group {
            self.groups.resize(group + 1, (0, 0));
        }
        self.groups[group].0 += usize::from(right);
        self.groups[group].1 += 1;
        self.entropy += entropy;
    }

    /// Queries.
    pub fn queries(&self) -> usize {
        self.groups.iter().map(|g| g.1).sum()
    }

    /// Share of right answers; `None` without queries.
    pub fn accuracy(&self) -> Option<f64> {
        let right: usize = self.groups.iter().map(|g| g.0).sum();
        (self.queries() > 0).then(|| right as f64 / self.queries() as f64)
    }

    /// Half of the 95 % interval of the accuracy over recordings, whose windows are alike: 1.96 standard errors of a ratio
    /// of sums over clusters; `None` with fewer than two recordings.
    ///
    /// Source: Cochran, "Sampling Techniques" (1977), section 6.4.
    pub fn half_interval(&self) -> Option<f64> {
        let (p, n) = (self.accuracy()?, self.queries() as f64);
        let groups: Vec<f64> =
            self.groups.iter().filter(|g| g.1 > 0).map(|&(right, queries)| right as f64 - p * queries as f64).collect();
        let count = groups.len() as f64;
        let squares: f64 = groups.iter().map(|d| d * d).sum();
        // over recordings, not windows: windows of one recording agree, and would make the interval too narrow
        (groups.len() > 1).then(|| 1.96 * (count / (count - 1.0) * squares).sqrt() / n)
    }

    /// Mean entropy, bans; `None` without queries.
    pub fn entropy(&self) -> Option<f64> {
        (self.queries() > 0).then(|| self.entropy / self.queries() as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn entropies_by_hand() {
        let of = |values: &[usize]| vote(values.iter().map(|&v| (v, 1.0)), 10).unwrap();
        assert_eq!(of(&[3; 10]), Vote { winner: 3, entropy: 0.0 });
        assert!((of(&[0, 0, 0, 0, 0, 1, 1, 1, 1, 1]).entropy - 2f64.log10()).abs() < 1e-12);
        assert!((of(&[0, 0, 0, 0, 0, 0, 0, 0, 0, 1]).entropy - 0.1412).abs() < 1e-4);
        assert!((of(&[0, 1, 2, 3, 4, 5, 6, 7, 8, 9]).entropy - 1.0).abs() < 1e-12);
        assert_eq!(vote([], 3), None);
    }

    #[test]
    fn ties_go_to_the_greater_sum() {
        let winner = |found: &[(usize, f64)]| vote(found.iter().copied(), 3).unwrap().winner;
        assert_eq!(winner(&[(0, 0.9), (1, 0.8), (1, 0.7), (0, 0.1)]), 1);
        assert_eq!(winner(&[(2, -1.0), (1, -1.5), (1, -1.6), (2, -4.0)]), 1, "distances count as minus");
        assert_eq!(winner(&[(2, 0.5), (1, 0.5)]), 2, "the nearest one's");
        assert_eq!(winner(&[(0, 0.9), (1, 0.2), (1, 0.1)]), 1);
    }

    #[test]
    fn intervals_are_over_recordings() {
        // ten recordings of ten windows: all right or all wrong is as if there were ten windows
        let (mut alike, mut apart) = (Tally::default(), Tally::default());
        for i in 0..100 {
            alike.add(i / 10, i % 20 < 10, 0.5);
            apart.add(i / 10, i % 2 == 0, 0.5);
        }
        assert_eq!((alike.queries(), alike.accuracy(), alike.entropy()), (100, Some(0.5), Some(0.5)));
        let expected = 1.96 * (10.0f64 / 9.0 * 10.0 * 25.0).sqrt() / 100.0;
        assert!((alike.half_interval().unwrap() - expected).abs() < 1e-12);
        assert!(apart.half_interval().unwrap() < 1e-12);
        assert_eq!((Tally::default().accuracy(), Tally::default().half_interval()), (None, None));
    }
}
