//! Static tables: the bits of numbers by their frequency in training.

use std::collections::BTreeMap;

/// Bits of a number that training lacks, after its escape symbol.
pub const ESCAPED_BITS: f64 = 16.0;

/// The symbols of a table.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Alphabet {
    /// `0..n`, with add-one counts.
    Known(u32),
    /// The numbers of that slot in training, and an escape.
    Seen,
}

/// The frequency of each number in each slot. Adding and merging in any order gives the same counts.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Counts {
    places: Vec<BTreeMap<i32, u64>>,
}

impl Counts {
    /// Counts the numbers of a word, one per slot. Words may have different lengths.
    pub fn add(&mut self, numbers: &[i32]) {
        self.reach(numbers.len());
        for (place, &x) in self.places.iter_mut().zip(numbers) {
            *place.entry(x).or_insert(0) += 1;
        }
    }

    /// Counts a number in a slot.
    pub fn add_at(&mut self, place: usize, number: i32) {
        self.reach(place + 1);
        *self.places[place].entry(number).or_insert(0) += 1;
    }

    /// Adds other counts.
    pub fn merge(&mut self, other: &Counts) {
        self.reach(other.places.len());
        for (place, counts) in self.places.iter_mut().zip(&other.places) {
            for (&x, &n) in counts {
                *place.entry(x).or_insert(0) += n;
            }
        }
    }

    fn reach(&mut self, places: usize) {
        if self.places.len() < places {
            self.places.resize(places, BTreeMap::new());
        }
    }

    /// The number of counted numbers.
    #[cfg(test)]
    pub fn total(&self) -> u64 {
        self.places.iter().flat_map(BTreeMap::values).sum()
    }

    /// The bits of all these numbers under the tables of `train`, one table per slot, with add-one counts.
    ///
    /// With n(v) of the T training numbers of the slot:
    /// - [`Alphabet::Known`] of A numbers: `p(v) = (n(v) + 1) / (T + A)`;
    /// - [`Alphabet::Seen`], A the number of distinct ones: `p(v) = (n(v) + 1) / (T + A + 1)` for those, and
    ///   `1 / (T + A + 1)` for the escape, followed by [`ESCAPED_BITS`]. A slot that training lacks costs only the bits after
    ///   the escape.
    pub fn bits(&self, train: &Counts, alphabet: Alphabet) -> f64 {
        let empty = BTreeMap::new();
        let at = |place: usize| train.places.get(place).unwrap_or(&empty);
        self.places.iter().enumerate().map(|(place, counts)| bits_at(counts, at(place), alphabet)).sum()
    }
}

/// The bits of one slot's numbers.
fn bits_at(test: &BTreeMap<i32, u64>, train: &BTreeMap<i32, u64>, alphabet: Alphabet) -> f64 {
    // add-one counts, so that no number has probability 0 and infinitely many bits
    let seen = train.values().sum::<u64>() as f64;
    let (whole, unseen) = match alphabet {
        Alphabet::Known(size) => (seen + f64::from(size), 0.0),
        Alphabet::Seen => (seen + train.len() as f64 + 1.0, ESCAPED_BITS),
    };
    let one = |(x, &n): (&i32, &u64)| {
        let (count, more) = train.get(x).map_or((1.0, unseen), |&t| (t as f64 + 1.0, 0.0));
        n as f64 * ((whole / count).log2() + more)
    };
    test.iter().map(one).sum()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn counts(words: &[&[i32]]) -> Counts {
        let mut c = Counts::default();
        words.iter().for_each(|w| c.add(w));
        c
    }

    #[test]
    fn a_known_alphabet_by_hand() {
        // place 0: 5 5 6 of eight numbers: p(5) = 3/11, p(6) = 2/11, p(0) = 1/11; place 1: only 1s, p(1) = 4/11
        let train = counts(&[&[5, 1], &[5, 1], &[6, 1]]);
        let bits = counts(&[&[5, 1], &[0, 1]]).bits(&train, Alphabet::Known(8));
        let expected = (11.0f64 / 3.0).log2() + 11f64.log2() + 2.0 * (11.0f64 / 4.0).log2();
        assert!((bits - expected).abs() < 1e-12, "{bits} {expected}");
        assert_eq!(counts(&[&[3]]).bits(&Counts::default(), Alphabet::Known(8)), 3.0, "nothing learnt: log2 of eight");
    }

    #[test]
    fn an_open_alphabet_by_hand() {
        // 5 5 6: T = 3, A = 2, whole 6: p(5) = 3/6, p(6) = 2/6, p(escape) = 1/6
        let train = counts(&[&[5], &[5], &[6]]);
        let bits = |x: i32| counts(&[&[x]]).bits(&train, Alphabet::Seen);
        assert!((bits(5) - 1.0).abs() < 1e-12);
        assert!((bits(6) - 3f64.log2()).abs() < 1e-12);
        assert!((bits(-70) - (6f64.log2() + 16.0)).abs() < 1e-12);
        assert_eq!(counts(&[&[5, 1]]).bits(&train, Alphabet::Seen), 1.0 + 16.0, "a place never seen");
    }

    #[test]
    fn probabilities_sum_to_one() {
        let train = counts(&[&[1], &[1], &[4], &[7]]);
        let p = |x: i32, a: Alphabet| (-counts(&[&[x]]).bits(&train, a)).exp2();
        let known: f64 = (0..9).map(|x| p(x, Alphabet::Known(9))).sum();
        let seen: f64 = [1, 4, 7].iter().map(|&x| p(x, Alphabet::Seen)).sum();
        let escape = p(100, Alphabet::Seen) * ESCAPED_BITS.exp2();
        assert!((known - 1.0).abs() < 1e-12 && (seen + escape - 1.0).abs() < 1e-12);
    }

    #[test]
    fn order_changes_nothing() {
        let (a, b) = (counts(&[&[1, 2, 3], &[4]]), counts(&[&[1, 5], &[4, 2]]));
        let (mut ab, mut ba) = (a.clone(), b.clone());
        ab.merge(&b);
        ba.merge(&a);
        assert_eq!(ab, ba);
        assert_eq!(ab, counts(&[&[4, 2], &[1, 5], &[4], &[1, 2, 3]]));
        assert_eq!(ab.total(), 8);
        let mut by_place = Counts::default();
        [(1, 5), (0, 1), (1, 2), (0, 4)].iter().for_each(|&(p, x)| by_place.add_at(p, x));
        assert_eq!(by_place, b);
    }
}
