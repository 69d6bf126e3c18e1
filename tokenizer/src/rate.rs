//! Rates of a text: word length, seconds in a context, bytes, bits.

mod counts;
mod text;

pub use counts::{Alphabet, Counts, ESCAPED_BITS};
pub use text::TextCounts;

/// Seconds of motion in a context of `tokens`, with words of `word` tokens on average, at `rate` words per second.
///
/// Counts the space: `tokens / (word + 1) / rate`.
///
/// ```
/// // 13 joints, 20 frames per second
/// let seconds = kinelm_tokenizer::rate::seconds_in_context(1024, 42.0, 20.0);
/// assert!((seconds - 1.191).abs() < 1e-3);
/// ```
pub fn seconds_in_context(tokens: usize, word: f64, rate: f64) -> f64 {
    tokens as f64 / (word + 1.0) / rate
}

/// [`seconds_in_context`] without counting the space, as published tables have it (compat).
pub fn seconds_in_context_compat(tokens: usize, word: f64, rate: f64) -> f64 {
    tokens as f64 / word / rate
}

/// Sizes of a text and of its motion.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Bytes {
    /// 72 + 3 f32 numbers per frame at the source's rate.
    pub smpl: u64,
    /// Characters of the text, spaces included.
    pub characters: u64,
    /// Bytes of the text in UTF-8.
    pub utf8: u64,
    /// The alphabet in UTF-8, and 4 bytes per bin value and number of a fitted table.
    pub alphabet: u64,
}

impl Bytes {
    /// `smpl / (characters + alphabet)`.
    pub fn factor_chars(&self) -> f64 {
        self.smpl as f64 / (self.characters + self.alphabet) as f64
    }

    /// `smpl / (utf8 + alphabet)`.
    pub fn factor_utf8(&self) -> f64 {
        self.smpl as f64 / (self.utf8 + self.alphabet) as f64
    }

    /// `smpl / (bits / 8 + alphabet)`, `bits` the order-0 entropy of the whole text.
    pub fn factor_entropy(&self, bits: f64) -> f64 {
        self.smpl as f64 / (bits / 8.0 + self.alphabet as f64)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seconds() {
        assert!((seconds_in_context(1024, 42.0, 20.0) - 1.1907).abs() < 1e-4);
        assert!((seconds_in_context_compat(1024, 42.0, 20.0) - 1.2190).abs() < 1e-4);
        assert!((seconds_in_context(1024, 75.0, 20.0) - 0.6737).abs() < 1e-4);
    }

    #[test]
    fn factors() {
        let b = Bytes { smpl: 1800, characters: 20, utf8: 20, alphabet: 328 };
        assert!((b.factor_chars() - 1800.0 / 348.0).abs() < 1e-12);
        assert!((b.factor_entropy(160.0) - b.factor_utf8()).abs() < 1e-12);
    }
}
