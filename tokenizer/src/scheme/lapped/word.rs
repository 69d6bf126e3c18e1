//! Numbers of any size as characters, in an order fitted to them.
//!
//! Codes `0..2 L` are the numbers 1, -1, 2, -2 .. -L. The next [`DIGITS`] codes are digits: they add a multiple of L to the
//! magnitude of the following number. The last codes are runs of zeros.

use super::LARGEST;
use crate::scheme::runs::{Part, Runs};

/// Digits, for 1 to 16 times L.
const DIGITS: u32 = 16;

/// What a character says; places are in the order of the word's numbers.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Written {
    /// A digit of the number at a place.
    Digit { place: usize },
    /// The number at a place, complete.
    Number { place: usize, number: i32 },
    /// A number of zeros from a place on.
    Zeros { place: usize, count: usize },
}

/// Writes and reads the numbers of a word.
#[derive(Debug, Clone, Copy)]
pub(super) struct Writing<'a> {
    levels: i32,
    runs: Runs,
    order: &'a [u32],
}

impl<'a> Writing<'a> {
    pub(super) fn new(levels: u32, longest_run: u32, order: &'a [u32]) -> Self {
        // at the most 20,000 + 16 + 1,000 codes by the settings' limits, within the alphabet's 21,054
        Writing { levels: levels as i32, runs: Runs::new(2 * levels + DIGITS, longest_run), order }
    }

    pub(super) fn symbols(&self) -> u32 {
        self.runs.symbols()
    }

    /// The most characters of a number.
    pub(super) fn most_characters(&self) -> usize {
        1 + self.digits((LARGEST - 1) / self.levels).count()
    }

    /// A multiple of L in digits of 1 to 16, the highest first.
    fn digits(&self, mut count: i32) -> impl Iterator<Item = u16> + use<> {
        // 2^20 has at most 6 digits
        let (mut digits, mut n) = ([0; 8], 0);
        while count > 0 {
            // bijective base 16: without a digit 0, each count has one spelling
            let rest = (count - 1) % DIGITS as i32;
            digits[n] = rest as u16;
            n += 1;
            count = (count - 1 - rest) / DIGITS as i32;
        }
        (0..n).rev().map(move |i| digits[i])
    }

    /// Appends numbers to a word.
    pub(super) fn write(&self, numbers: &[i32], word: &mut Vec<u16>) {
        let mut writer = self.runs.writer(word);
        for &at in self.order {
            let number = numbers[at as usize];
            if number == 0 {
                writer.zeros(1);
                continue;
            }
            let beyond = number.abs() - 1;
            self.digits(beyond / self.levels).for_each(|d| writer.value(2 * self.levels as u16 + d));
            writer.value((2 * (beyond % self.levels) + i32::from(number < 0)) as u16);
        }
    }

    /// The numbers of any word: missing ones are zeros; excess ones, and digits without a number, are dropped.
    pub(super) fn read(&self, word: &[u16], numbers: &mut [i32]) {
        numbers.fill(0);
        for written in self.parse(word) {
            if let Written::Number { place, number } = written {
                let Some(&at) = self.order.get(place) else { return };
                numbers[at as usize] = number;
            }
        }
    }

    /// What each character of any word says.
    pub(super) fn parse(&self, word: &[u16]) -> impl Iterator<Item = Written> {
        let (mut place, mut digits) = (0, 0);
        word.iter().map(move |&code| match self.runs.part(code) {
            Part::Zeros(count) => {
                let zeros = Written::Zeros { place, count };
                (place, digits) = (place + count, 0);
                zeros
            }
            Part::Value(code) if i32::from(code) >= 2 * self.levels => {
                let digit = i32::from(code) - 2 * self.levels + 1;
                // bounded at every digit: any stream decodes, and a long row of digits must not overflow
                digits = (digits * DIGITS as i32 + digit).min(LARGEST);
                Written::Digit { place }
            }
            Part::Value(code) => {
                let size = i64::from(digits) * i64::from(self.levels) + i64::from(code / 2) + 1;
                let size = size.min(LARGEST.into()) as i32;
                let number = if code % 2 == 0 { size } else { -size };
                (place, digits) = (place + 1, 0);
                Written::Number { place: place - 1, number }
            }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn small_table() {
        let order = [2, 0, 1, 3];
        let w = Writing::new(3, 5, &order);
        assert_eq!(w.symbols(), 6 + 16 + 5);
        let word = |numbers: [i32; 4]| {
            let mut word = vec![];
            w.write(&numbers, &mut word);
            word
        };
        assert!(word([0; 4]).is_empty());
        assert_eq!(word([0, 0, 1, 0]), [0]);
        assert_eq!(word([-3, 0, 0, 0]), [22, 5]);
        assert_eq!(word([0, 0, 4, 0]), [6, 0], "three and one");
        assert_eq!(word([0, 0, -52, 0]), [6, 6, 1], "17 threes and one: digits 1 1");
        let read = |word: &[u16]| {
            let mut numbers = [9; 4];
            w.read(word, &mut numbers);
            numbers
        };
        assert_eq!(read(&[6, 6, 1]), [0, 0, -52, 0]);
        assert_eq!(read(&[6, 22, 0]), [1, 0, 0, 0], "digits before a run say nothing");
        assert_eq!(read(&[21; 50]), [0; 4]);
        assert_eq!(read(&[21, 21, 21, 21, 21, 21, 21, 0, 26, 0]), [0, 0, LARGEST, 0]);
    }

    proptest! {
        #[test]
        fn there_and_back(
            numbers in prop::collection::vec(prop_oneof![Just(0), -9i32..9, -LARGEST..=LARGEST], 40),
            levels in 1u32..300,
            runs in 1u32..60,
            seed in any::<u32>(),
        ) {
            let mut order: Vec<u32> = (0..40).collect();
            order.sort_by_key(|i| i.wrapping_mul(2_654_435_761).wrapping_add(seed) >> 3);
            let w = Writing::new(levels, runs, &order);
            let (mut word, mut back) = (vec![], vec![7; 40]);
            w.write(&numbers, &mut word);
            prop_assert!(word.iter().all(|&c| u32::from(c) < w.symbols()));
            prop_assert!(word.len() <= 40 * w.most_characters());
            w.read(&word, &mut back);
            prop_assert_eq!(back, numbers);
        }

        #[test]
        fn any_word_is_numbers(word in prop::collection::vec(0u16..100, 0..60), levels in 1u32..30) {
            let order: Vec<u32> = (0..20).rev().collect();
            let mut numbers = vec![7; 20];
            Writing::new(levels, 10, &order).read(&word, &mut numbers);
            prop_assert!(numbers.iter().all(|n| n.abs() <= LARGEST));
        }
    }
}
