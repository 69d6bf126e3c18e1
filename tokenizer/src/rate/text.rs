//! Counts of the texts of many clips.

use super::{Alphabet, Bytes, Counts};
use crate::{Encoded, Result, SPACE, Tokenizer, WordLength, alphabet};

/// Word lengths, bytes and number frequencies of the texts of clips. All are counts, so adding and merging in any order gives
/// the same.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct TextCounts {
    /// Clips.
    pub clips: u64,
    /// Frames at the tokenizer's rate, without the padding of last tiles.
    pub frames: u64,
    /// Frames of the source files.
    pub source_frames: u64,
    /// Words.
    pub words: u64,
    /// Tokens without the spaces; as many as characters without merges.
    pub tokens: u64,
    /// Tokens of the longest word without its space.
    pub longest_word: u64,
    /// Characters without the spaces.
    pub characters: u64,
    /// Their bytes in UTF-8.
    pub utf8: u64,
    /// Values outside the bins, clipped to the last one.
    pub clipped: u64,
    /// Rotations with a second code.
    pub second_codes: u64,
    /// Frames of padding in last tiles.
    pub padded: u64,
    numbers: Counts,
    written: Counts,
    first: Counts,
    differences: Counts,
}

impl TextCounts {
    /// Counts the words of a clip of `frames` frames and `source_frames` in its file.
    ///
    /// # Errors
    /// [`Error::Codes`](crate::Error::Codes) for words of another tokenizer.
    pub fn add(&mut self, tokenizer: &Tokenizer, encoded: &Encoded, frames: u64, source_frames: u64) -> Result<()> {
        let words = &encoded.words;
        self.clips += 1;
        self.frames += frames;
        self.source_frames += source_frames;
        self.words += words.len() as u64;
        self.characters += words.codes().len() as u64;
        self.utf8 += words.codes().iter().map(|&k| utf8_length(k.into())).sum::<u64>();
        self.clipped += encoded.clipped;
        self.second_codes += encoded.second_codes;
        self.padded += encoded.padded;
        self.add_numbers(tokenizer, encoded);
        self.add_tokens(tokenizer, encoded)
    }

    fn add_numbers(&mut self, tokenizer: &Tokenizer, encoded: &Encoded) {
        let (scheme, channels) = (tokenizer.scheme(), tokenizer.channels());
        let by_frames = scheme.frames_per_word() == 1;
        let symbols = scheme.symbols() as i32;
        let (mut before, mut now, mut steps) = (Vec::new(), Vec::new(), Vec::new());
        for (i, word) in encoded.words.iter().enumerate() {
            now.clear();
            scheme.numbers(channels, word, &mut now);
            self.numbers.add(&now);
            if by_frames && i == 0 {
                self.first.add(&now);
            } else if by_frames {
                steps.clear();
                // modulo the symbols, the difference has as many values as a code, and circular bins have no jump
                steps.extend(now.iter().zip(&before).map(|(a, b): (&i32, &i32)| (a - b).rem_euclid(symbols)));
                self.differences.add(&steps);
            }
            std::mem::swap(&mut before, &mut now);
        }
    }

    fn add_tokens(&mut self, tokenizer: &Tokenizer, encoded: &Encoded) -> Result<()> {
        let ids = tokenizer.ids_of_words(&encoded.words)?;
        let mut length = 0;
        for &id in &ids {
            if id == SPACE {
                self.longest_word = self.longest_word.max(length);
                length = 0;
            } else {
                length += 1;
                self.tokens += 1;
            }
        }
        if by_place(tokenizer) {
            let codes: Vec<i32> = encoded.words.codes().iter().map(|&k| k.into()).collect();
            encoded.words.length().into_iter().for_each(|c| codes.chunks_exact(c).for_each(|w| self.written.add(w)));
        } else {
            ids.iter().for_each(|&id| self.written.add_at(0, id as i32));
        }
        Ok(())
    }

    /// Adds other counts of the same tokenizer.
    pub fn merge(&mut self, other: &TextCounts) {
        for (own, others) in [
            (&mut self.clips, other.clips),
            (&mut self.frames, other.frames),
            (&mut self.source_frames, other.source_frames),
            (&mut self.words, other.words),
            (&mut self.tokens, other.tokens),
            (&mut self.characters, other.characters),
            (&mut self.utf8, other.utf8),
            (&mut self.clipped, other.clipped),
            (&mut self.second_codes, other.second_codes),
            (&mut self.padded, other.padded),
        ] {
            *own += others;
        }
        self.longest_word = self.longest_word.max(other.longest_word);
        self.numbers.merge(&other.numbers);
        self.written.merge(&other.written);
        self.first.merge(&other.first);
        self.differences.merge(&other.differences);
    }

    /// Mean tokens of a word, without its space.
    pub fn mean_word(&self) -> f64 {
        if self.words == 0 { 0.0 } else { self.tokens as f64 / self.words as f64 }
    }

    /// Order-0 bits per frame of the words' numbers: a static table per number of the word (a channel of a frame, a coefficient
    /// of a tile), fitted on `train`, [`Alphabet::Seen`]. Runs and merges don't change it.
    pub fn order0_bits_per_frame(&self, train: &TextCounts) -> f64 {
        self.a_frame(self.numbers.bits(&train.numbers, Alphabet::Seen))
    }

    /// Order-0 bits per frame of the text, static tables fitted on `train`, [`Alphabet::Known`]. Words of one length without
    /// merges: a table per slot over the characters, and the space costs nothing. Others: one table over all tokens and the
    /// space.
    pub fn written_bits_per_frame(&self, train: &TextCounts, tokenizer: &Tokenizer) -> f64 {
        // the text of a clip has no specials; the space counts as one more symbol
        let vocabulary = tokenizer.vocabulary();
        let spaces = u32::from(!by_place(tokenizer));
        let alphabet = vocabulary.characters() + vocabulary.merged() + spaces;
        self.a_frame(self.written.bits(&train.written, Alphabet::Known(alphabet)))
    }

    /// Order-0 bits per frame of the differences to the previous frame, modulo the number of symbols; a clip's first frame costs
    /// what its codes cost. A table per channel, fitted on `train`, [`Alphabet::Known`]. `None` when words are not frames.
    pub fn difference_bits_per_frame(&self, train: &TextCounts, tokenizer: &Tokenizer) -> Option<f64> {
        if tokenizer.frames_per_word() != 1 {
            return None;
        }
        let alphabet = Alphabet::Known(tokenizer.scheme().symbols());
        let first = self.first.bits(&train.numbers, alphabet);
        Some(self.a_frame(first + self.differences.bits(&train.differences, alphabet)))
    }

    fn a_frame(&self, bits: f64) -> f64 {
        if self.frames == 0 { 0.0 } else { bits / self.frames as f64 }
    }

    /// The sizes of these texts, and of the tokenizer's alphabet and tables.
    pub fn bytes(&self, tokenizer: &Tokenizer) -> Bytes {
        let characters = tokenizer.vocabulary().characters();
        Bytes {
            smpl: self.source_frames * 75 * 4,
            characters: self.characters + self.words,
            utf8: self.utf8 + self.words,
            alphabet: (0..characters).map(utf8_length).sum::<u64>() + 4 * tokenizer.scheme().fitted_numbers(),
        }
    }
}

/// Whether each character of a word has its own slot.
fn by_place(tokenizer: &Tokenizer) -> bool {
    matches!(tokenizer.word_length(), WordLength::Fixed(_)) && tokenizer.vocabulary().merged() == 0
}

fn utf8_length(code: u32) -> u64 {
    alphabet::character(code).map_or(0, char::len_utf8) as u64
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contract::{bent, small};
    use crate::{TokenizerConfig, Words};

    fn counts(t: &Tokenizer, words: Words, frames: u64) -> TextCounts {
        let mut c = TextCounts::default();
        c.add(t, &Encoded { words, ..Encoded::default() }, frames, 3 * frames).unwrap();
        c
    }

    /// Nine channels of 60 bins; all but the first say 7.
    fn words(first: &[u16]) -> Words {
        Words::fixed(first.iter().flat_map(|&k| [k, 7, 7, 7, 7, 7, 7, 7, 7]).collect(), 9)
    }

    #[test]
    fn frame_words_by_hand() {
        let t = small();
        let (train, test) = (counts(&t, words(&[5, 5, 6]), 3), counts(&t, words(&[5, 6]), 2));
        assert_eq!((test.words, test.tokens, test.characters, test.longest_word), (2, 18, 18, 9));
        assert_eq!(test.mean_word(), 9.0);
        // numbers: 5 5 6, 7 7 7: T = 3, A = 2 and 1; whole 6 and 5
        let numbers = (6.0f64 / 3.0).log2() + (6.0f64 / 2.0).log2() + 16.0 * (5.0f64 / 4.0).log2();
        assert!((test.order0_bits_per_frame(&train) - numbers / 2.0).abs() < 1e-12);
        // characters: 60 of them
        let rest = (63.0f64 / 4.0).log2();
        let first = (63.0f64 / 3.0).log2();
        let written = first + (63.0f64 / 2.0).log2() + 16.0 * rest;
        assert!((test.written_bits_per_frame(&train, &t) - written / 2.0).abs() < 1e-12);
        // differences in training 0 1, and 0 0 elsewhere; in test 1 and 0: p = 2/62 and 3/62
        let differences = first + 8.0 * rest + (62.0f64 / 2.0).log2() + 8.0 * (62.0f64 / 3.0).log2();
        assert!((test.difference_bits_per_frame(&train, &t).unwrap() - differences / 2.0).abs() < 1e-12);
        // a width and a zero for each coordinate, the first height; 60 values
        let b = counts(&t, words(&[59, 59]), 2).bytes(&t);
        assert_eq!((b.smpl, b.characters, b.utf8, b.alphabet), (1800, 20, 20, 60 + 240 + 28));
    }

    #[test]
    fn merged_words_cost_tokens_and_spaces() {
        let clips = [bent(1, 40), bent(2, 40)];
        let config = TokenizerConfig { merges: 50, ..TokenizerConfig::uniform(&[0, 4], 20.0, 12) };
        let t = Tokenizer::fit(&clips, config).unwrap();
        let words = t.encode(&clips[0]).unwrap().words;
        let ids = t.ids_of_words(&words).unwrap();
        let c = counts(&t, words.clone(), 40);
        assert_eq!((c.tokens + c.words, c.characters), (ids.len() as u64, 360));
        assert!(c.tokens < c.characters && c.longest_word <= 9);
        let alphabet = f64::from(12 + t.vocabulary().merged() + 1);
        let p = |id: u32| (ids.iter().filter(|&&i| i == id).count() as f64 + 1.0) / (ids.len() as f64 + alphabet);
        let bits: f64 = ids.iter().map(|&id| -p(id).log2()).sum();
        assert!((c.written_bits_per_frame(&c, &t) - bits / 40.0).abs() < 1e-9);
        let plain = Tokenizer::fit(&clips, TokenizerConfig::uniform(&[0, 4], 20.0, 12)).unwrap();
        let unmerged = counts(&plain, words, 40);
        assert_eq!(c.order0_bits_per_frame(&c), unmerged.order0_bits_per_frame(&unmerged), "merging changes no number");
    }

    #[test]
    fn clips_add_up_in_any_order() {
        let t = small();
        let one = |seed: u64| {
            let clip = bent(seed, 10 + seed as usize);
            let mut c = TextCounts::default();
            c.add(&t, &t.encode(&clip).unwrap(), clip.frames() as u64, 99).unwrap();
            c
        };
        let sum = |order: [u64; 3]| {
            order.iter().fold(TextCounts::default(), |mut all, &seed| {
                all.merge(&one(seed));
                all
            })
        };
        assert_eq!(sum([3, 4, 5]), sum([5, 3, 4]));
        assert_eq!((sum([3, 4, 5]).clips, sum([3, 4, 5]).frames), (3, 42));
    }
}
