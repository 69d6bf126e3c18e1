//! Run-length coding: a value is a character, and so is a run of zeros.

/// The meaning of a character.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// A value, by its code.
    Value(u16),
    /// A number of zeros, at least one.
    Zeros(usize),
}

/// Codes of values, `0..values`, then of runs: `values + n - 1` is n zeros.
///
/// Zeros at the end of a word are not written, so a word of zeros is empty.
///
/// ```
/// use kinelm_tokenizer::scheme::runs::{Part, Runs};
///
/// let (runs, mut word) = (Runs::new(10, 5), Vec::new());
/// runs.encode(&[None, None, Some(7), None], &mut word);
/// assert_eq!((&word[..], runs.part(11)), (&[11, 7][..], Part::Zeros(2)));
/// ```
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Runs {
    values: u16,
    longest: u16,
}

impl Runs {
    /// `values` codes of values, and runs of up to `longest` zeros; longer runs take several characters.
    ///
    /// # Panics
    /// When `longest` is 0, or the codes exceed the alphabet.
    pub fn new(values: u32, longest: u32) -> Self {
        let fits = longest > 0 && values.saturating_add(longest) <= crate::alphabet::SIZE;
        assert!(fits, "{values} values and runs of {longest} don't fit the alphabet");
        Runs { values: values as u16, longest: longest as u16 }
    }

    /// The number of codes.
    pub fn symbols(&self) -> u32 {
        u32::from(self.values) + u32::from(self.longest)
    }

    /// The meaning of a code. Codes from [`Runs::symbols`] on are longer runs.
    pub fn part(&self, code: u16) -> Part {
        if code < self.values { Part::Value(code) } else { Part::Zeros(usize::from(code - self.values) + 1) }
    }

    /// Appends to `word`.
    pub fn writer<'a>(&self, word: &'a mut Vec<u16>) -> Writer<'a> {
        Writer { runs: *self, word, zeros: 0 }
    }

    /// Appends numbers to `word`: `None` is zero, `Some` the code of a value.
    pub fn encode(&self, numbers: &[Option<u16>], word: &mut Vec<u16>) {
        let mut writer = self.writer(word);
        for number in numbers {
            match number {
                Some(code) => writer.value(*code),
                None => writer.zeros(1),
            }
        }
    }

    /// The numbers of any word: missing ones are zeros, and excess ones are dropped.
    pub fn decode(&self, word: &[u16], numbers: &mut [Option<u16>]) {
        numbers.fill(None);
        let mut at = 0;
        for &code in word {
            if at >= numbers.len() {
                return;
            }
            match self.part(code) {
                Part::Value(code) => {
                    numbers[at] = Some(code);
                    at += 1;
                }
                Part::Zeros(n) => at += n,
            }
        }
    }
}

/// Writes a word part by part. Zeros are held back until a value follows, so those at the end are dropped.
#[derive(Debug)]
pub struct Writer<'a> {
    runs: Runs,
    word: &'a mut Vec<u16>,
    zeros: usize,
}

impl Writer<'_> {
    /// Some zeros.
    pub fn zeros(&mut self, count: usize) {
        self.zeros += count;
    }

    /// A value, or one character of it.
    pub fn value(&mut self, code: u16) {
        debug_assert!(code < self.runs.values, "value {code} of {}", self.runs.values);
        while self.zeros > 0 {
            // longest runs first, so that a number of zeros has one spelling
            let run = self.zeros.min(usize::from(self.runs.longest));
            self.word.push(self.runs.values + (run - 1) as u16);
            self.zeros -= run;
        }
        self.word.push(code);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn small_table() {
        let runs = Runs::new(10, 3);
        assert_eq!(runs.symbols(), 13);
        let word = |numbers: &[Option<u16>]| {
            let mut word = vec![9];
            runs.encode(numbers, &mut word);
            word[1..].to_vec()
        };
        let (o, x) = (None, Some(7));
        assert!(word(&[]).is_empty());
        assert!(word(&[o; 5]).is_empty(), "zeros at the end are the space's");
        assert_eq!(word(&[x, o, x, o, o]), [7, 10, 7]);
        assert_eq!(word(&[o, o, o, x]), [12, 7]);
        assert_eq!(word(&[o, o, o, o, o, o, o, x]), [12, 12, 10, 7], "seven are three, three and one");

        let numbers = |word: &[u16]| {
            let mut numbers = [Some(1); 4];
            runs.decode(word, &mut numbers);
            numbers
        };
        assert_eq!(numbers(&[]), [o; 4]);
        assert_eq!(numbers(&[10, 7, 12, 7, 7]), [o, x, o, o], "a run past the end is cut there, and what follows");
        assert_eq!(numbers(&[7, 7, 7, 7, 7]), [x; 4]);
        assert_eq!(numbers(&[u16::MAX, 7]), [o; 4]);
    }

    #[test]
    #[should_panic(expected = "alphabet")]
    fn no_more_than_the_alphabet() {
        Runs::new(21_000, 55);
    }

    proptest! {
        #[test]
        fn there_and_back(
            numbers in prop::collection::vec(prop_oneof![3 => Just(None), 1 => (0u16..50).prop_map(Some)], 0..300),
            longest in 1u32..400,
        ) {
            let runs = Runs::new(50, longest);
            let (mut word, mut back) = (vec![], vec![Some(3); numbers.len()]);
            runs.encode(&numbers, &mut word);
            prop_assert!(word.len() <= numbers.len() && word.iter().all(|&k| u32::from(k) < runs.symbols()));
            prop_assert!(word.last().is_none_or(|&k| k < 50), "the last one is no run");
            runs.decode(&word, &mut back);
            prop_assert_eq!(back, numbers);
        }

        #[test]
        fn any_word_is_numbers(word in prop::collection::vec(any::<u16>(), 0..50), places in 0usize..60, longest in 1u32..80) {
            let runs = Runs::new(50, longest);
            let mut numbers = vec![None; places];
            runs.decode(&word, &mut numbers);
            prop_assert!(numbers.iter().flatten().all(|&k| k < 50));
            // written again it says the same
            let (mut again, mut back) = (vec![], vec![None; places]);
            runs.encode(&numbers, &mut again);
            runs.decode(&again, &mut back);
            prop_assert_eq!(back, numbers);
        }
    }
}
