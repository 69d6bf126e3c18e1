//! Words of codes.

use std::ops::Range;

/// Codes, split into words.
///
/// A word is one frame or one tile of frames; its characters are codes below the scheme's number of symbols, without the
/// space that ends a word in a text.
///
/// ```
/// use kinelm_tokenizer::Words;
///
/// let mut words = Words::fixed(vec![1, 2, 3, 4], 2);
/// words.push(&[5]);
/// assert_eq!((words.len(), words.word(1), words.codes()), (3, &[3, 4][..], &[1, 2, 3, 4, 5][..]));
/// ```
#[derive(Debug, Clone, PartialEq, Eq, Hash, Default)]
pub struct Words {
    codes: Vec<u16>,
    /// Per word, the codes up to its end.
    ends: Vec<usize>,
}

impl Words {
    /// No words.
    pub fn new() -> Self {
        Words::default()
    }

    /// No words, with capacity.
    pub fn with_capacity(words: usize, codes: usize) -> Self {
        Words { codes: Vec::with_capacity(codes), ends: Vec::with_capacity(words) }
    }

    /// Words of one length.
    ///
    /// # Panics
    /// If `length` is 0 or the codes are not whole words.
    pub fn fixed(codes: Vec<u16>, length: usize) -> Self {
        assert!(codes.len().is_multiple_of(length), "{} codes are no whole words of {length}", codes.len());
        let ends = (1..=codes.len() / length).map(|i| i * length).collect();
        Words { codes, ends }
    }

    /// Appends a word.
    pub fn push(&mut self, word: &[u16]) {
        self.codes.extend_from_slice(word);
        self.ends.push(self.codes.len());
    }

    /// Appends a character to the word that the next [`Words::end_word`] ends.
    pub fn push_code(&mut self, code: u16) {
        self.codes.push(code);
    }

    /// Ends the word of the characters pushed since the last one ended.
    pub fn end_word(&mut self) {
        self.ends.push(self.codes.len());
    }

    /// The number of words.
    pub fn len(&self) -> usize {
        self.ends.len()
    }

    /// Whether there are no words.
    pub fn is_empty(&self) -> bool {
        self.ends.is_empty()
    }

    /// A word's characters.
    ///
    /// # Panics
    /// If there is no such word.
    pub fn word(&self, index: usize) -> &[u16] {
        let start = if index == 0 { 0 } else { self.ends[index - 1] };
        &self.codes[start..self.ends[index]]
    }

    /// All words.
    pub fn iter(&self) -> impl ExactSizeIterator<Item = &[u16]> {
        (0..self.len()).map(|i| self.word(i))
    }

    /// The characters of all words, one word after the other.
    pub fn codes(&self) -> &[u16] {
        // without the characters of a word that hasn't ended
        &self.codes[..self.ends.last().copied().unwrap_or(0)]
    }

    /// A view of the codes, (words, characters of a word); `None` when lengths differ.
    #[cfg(feature = "ndarray")]
    pub fn view(&self) -> Option<ndarray::ArrayView2<'_, u16>> {
        let length = self.iter().next().map_or(0, <[u16]>::len);
        let even = self.iter().all(|word| word.len() == length);
        even.then(|| ndarray::ArrayView2::from_shape((self.len(), length), self.codes()).expect("whole words"))
    }

    /// Some of the words.
    ///
    /// # Panics
    /// If the range is out of bounds.
    pub fn slice(&self, words: Range<usize>) -> Words {
        let start = if words.start == 0 { 0 } else { self.ends[words.start - 1] };
        let ends: Vec<usize> = self.ends[words].iter().map(|end| end - start).collect();
        let codes = self.codes[start..start + ends.last().copied().unwrap_or(0)].to_vec();
        Words { codes, ends }
    }

    /// The length of all words; `None` when lengths differ or there are no words.
    pub fn length(&self) -> Option<usize> {
        let first = self.iter().next()?.len();
        self.iter().all(|w| w.len() == first).then_some(first)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_of_any_length() {
        let mut w = Words::new();
        w.push(&[1, 2, 3]);
        w.push(&[]);
        w.push_code(4);
        w.end_word();
        assert_eq!((w.len(), w.codes()), (3, &[1, 2, 3, 4][..]));
        assert_eq!(w.iter().map(<[u16]>::len).collect::<Vec<_>>(), [3, 0, 1]);
        assert_eq!(w.word(2), [4]);
        assert_eq!(w.slice(1..3).iter().collect::<Vec<_>>(), [&[][..], &[4]]);
        assert_eq!(w.slice(1..1), Words::new());
        assert_eq!((w.length(), w.slice(0..1).length(), Words::new().length()), (None, Some(3), None));
        assert_eq!(Words::fixed(vec![1, 2, 3, 4], 2).slice(1..2), Words::fixed(vec![3, 4], 2));
    }

    #[cfg(feature = "ndarray")]
    #[test]
    fn a_view_is_of_words_of_one_length() {
        let mut w = Words::fixed(vec![1, 2, 3, 4, 5, 6], 3);
        let view = w.view().unwrap();
        assert_eq!((view.shape(), view[(1, 2)]), (&[2, 3][..], 6));
        w.push(&[7]);
        assert_eq!(w.view(), None);
        assert_eq!(Words::new().view().unwrap().shape(), [0, 0]);
    }
}
