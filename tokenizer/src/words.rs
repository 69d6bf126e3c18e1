//! Converts between words, text and ids.

use crate::scheme::WordLength;
use crate::vocab::{FIRST_CHARACTER, SPACE, Special};
use crate::{Error, Result, Tokenizer, Words, alphabet};

/// Words parsed from the ids of a model or a file.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ParsedWords {
    /// The words.
    pub words: Words,
    /// Ids replaced because their slot doesn't allow them, and characters truncated or filled in.
    pub replaced: u64,
    /// Characters after the last complete word.
    pub left_over: usize,
}

impl Tokenizer {
    /// The text of words: their characters and a space after each, so that text and [ids](Tokenizer::ids_of_words) agree.
    ///
    /// # Errors
    /// [`Error::Codes`] for a word of the wrong length or a code that is too large.
    pub fn text(&self, words: &Words) -> Result<String> {
        self.check(words)?;
        let mut text = String::with_capacity(words.codes().len() * 3);
        for word in words.iter() {
            text.extend(word.iter().filter_map(|&k| alphabet::character(k.into())));
            text.push(' ');
        }
        Ok(text)
    }

    /// The words of a text. White space separates words of one length. In words of varying length, which may be empty, each
    /// space ends a word, and line ends are ignored.
    ///
    /// # Errors
    /// [`Error::Text`] with the word and the character, for a word of the wrong length and for an unknown character.
    pub fn words_of_text(&self, text: &str) -> Result<Words> {
        let mut words = Words::with_capacity(text.len() / 64, text.len() / 2);
        match self.word_length() {
            WordLength::Fixed(c) => {
                for word in text.split_whitespace() {
                    self.read_word(word, c, &mut words)?;
                    let n = words.word(words.len() - 1).len();
                    if n != c {
                        let found = format!("the end of a word of {n} characters");
                        return Err(text_error(words.len(), n + 1, found, format!("{c} characters")));
                    }
                }
            }
            WordLength::Varying { most } => {
                let text: String = text.chars().filter(|c| !matches!(c, '\r' | '\n')).collect();
                // the last space ends a word; `split` would see an empty one after it
                let whole = text.strip_suffix(' ').unwrap_or(&text);
                if !text.is_empty() {
                    whole.split(' ').try_for_each(|word| self.read_word(word, most, &mut words))?;
                }
            }
        }
        Ok(words)
    }

    fn read_word(&self, word: &str, most: usize, words: &mut Words) -> Result<()> {
        let characters = self.vocabulary.characters();
        let w = words.len() + 1;
        for (i, ch) in word.chars().enumerate() {
            if i == most {
                let n = word.chars().count();
                let found = format!("a word of {n} characters");
                return Err(text_error(w, i + 1, found, format!("{most} characters, then a space")));
            }
            match alphabet::code(ch).filter(|&k| k < characters) {
                Some(k) => words.push_code(k as u16),
                None => {
                    let last = alphabet::character(characters - 1).unwrap_or('?');
                    let expected = format!("one of the {characters} characters '0' to {last:?}");
                    return Err(text_error(w, i + 1, format!("{ch:?}"), expected));
                }
            }
        }
        words.end_word();
        Ok(())
    }

    /// The ids of words, each with its space, with the tokenizer's merges applied.
    ///
    /// # Errors
    /// [`Error::Codes`] for a word of the wrong length or a code that is too large.
    pub fn ids_of_words(&self, words: &Words) -> Result<Vec<u32>> {
        self.check(words)?;
        let mut ids = Vec::with_capacity(words.codes().len() + words.len());
        let (mut one, mut ranks) = (Vec::new(), Vec::new());
        for word in words.iter() {
            one.clear();
            one.extend(word.iter().map(|&k| FIRST_CHARACTER + u32::from(k)));
            self.merges.apply(&mut one, &mut ranks);
            ids.extend_from_slice(&one);
            ids.push(SPACE);
        }
        Ok(ids)
    }

    /// The ids of text, equal to those of Hugging Face's loaders: characters, with merges applied; `<unk>` for unknown
    /// characters, line ends included; one id for each special or conditioning token in the text.
    pub fn ids_of_text(&self, text: &str) -> Vec<u32> {
        let characters = self.vocabulary.characters();
        let mut ids = Vec::with_capacity(text.len());
        let (mut word, mut ranks) = (Vec::new(), Vec::new());
        let mut rest = text.chars();
        while let Some(c) = rest.next() {
            if let Some(k) = alphabet::code(c).filter(|&k| k < characters) {
                word.push(FIRST_CHARACTER + k);
                continue;
            }
            // specials are cut out before anything is merged, as Hugging Face's added tokens are
            let token = if c == '<' { self.token_after_bracket(rest.as_str()) } else { None };
            if let Some((_, length)) = token {
                rest = rest.as_str()[length..].chars();
            }
            self.merges.apply(&mut word, &mut ranks);
            ids.append(&mut word);
            ids.push(match token {
                Some((id, _)) => id,
                None if c == ' ' => SPACE,
                None => Special::Unk.id(),
            });
        }
        self.merges.apply(&mut word, &mut ranks);
        ids.append(&mut word);
        ids
    }

    /// The id of the token whose `<` was just read, and its remaining bytes. No token contains another bracket.
    fn token_after_bracket(&self, rest: &str) -> Option<(u32, usize)> {
        let length = rest.find('>')? + 1;
        let id = self.vocabulary.id(&format!("<{}", &rest[..length]))?;
        Some((id, length))
    }

    /// The words of any stream of ids.
    ///
    /// Leading `<pad>`, `<bos>`, `<eos>` and conditioning tokens are skipped. Then:
    /// - words of one length without merges: each id takes the next slot. An id that its slot doesn't allow is replaced by the
    ///   previous word's code (in the first word that of no movement), at the end of a word by the space. An incomplete last
    ///   word is dropped.
    /// - other words: each space ends a word; ids of no character are dropped; a long word is truncated, a short one of fixed
    ///   length is filled with the previous word's characters (one of varying length ends in zeros). Characters after the last
    ///   space are dropped, unless they are a complete word of fixed length.
    ///
    /// Replaced, truncated and filled characters are counted.
    pub fn words_of_ids(&self, ids: &[u32]) -> ParsedWords {
        match self.tokens_per_word() {
            Some(w) => self.words_by_count(ids, w - 1),
            None => self.words_by_space(ids, self.word_length()),
        }
    }

    fn words_by_count(&self, ids: &[u32], c: usize) -> ParsedWords {
        let mut codes: Vec<u16> = Vec::with_capacity(ids.len());
        let mut before = self.neutral();
        let (mut at, mut replaced, mut replaced_here) = (0, 0, 0);
        for &id in ids {
            if at == 0 && self.is_between_words(id) {
                continue;
            }
            let code = self.vocabulary.code_of_id(id);
            if at < c {
                // counted only if the word is completed: an incomplete last word is dropped
                replaced_here += u64::from(code.is_none());
                codes.push(code.unwrap_or(before[at]));
                at += 1;
                if at == c {
                    before.copy_from_slice(&codes[codes.len() - c..]);
                    replaced += std::mem::take(&mut replaced_here);
                }
            } else {
                replaced += u64::from(id != SPACE);
                at = 0;
            }
        }
        let left_over = if at < c { at } else { 0 };
        codes.truncate(codes.len() - left_over);
        ParsedWords { words: Words::fixed(codes, c), replaced, left_over }
    }

    fn words_by_space(&self, ids: &[u32], length: WordLength) -> ParsedWords {
        let most = match length {
            WordLength::Fixed(c) => c,
            WordLength::Varying { most } => most,
        };
        let mut out = ParsedWords { words: Words::with_capacity(ids.len() / 32, ids.len()), ..ParsedWords::default() };
        let fills = matches!(length, WordLength::Fixed(_));
        let mut before = if fills { self.neutral() } else { Vec::new() };
        let mut word = Vec::new();
        let mut end = |word: &mut Vec<u16>, out: &mut ParsedWords| {
            out.replaced += (word.len().saturating_sub(most)) as u64;
            word.truncate(most);
            if fills {
                out.replaced += (most - word.len()) as u64;
                word.extend_from_slice(&before[word.len()..]);
                before.copy_from_slice(word);
            }
            out.words.push(word);
            word.clear();
        };
        for &id in ids {
            if id == SPACE {
                end(&mut word, &mut out);
            } else if !self.vocabulary.expand(id, &mut word) {
                out.replaced += u64::from(!(word.is_empty() && self.is_between_words(id)));
            }
        }
        match length {
            WordLength::Fixed(c) if word.len() == c => end(&mut word, &mut out),
            _ => out.left_over = word.len(),
        }
        out
    }

    fn is_between_words(&self, id: u32) -> bool {
        let first = self.vocabulary.first_conditioning();
        [Special::Pad, Special::Bos, Special::Eos].iter().any(|s| s.id() == id)
            || (first..self.vocabulary.len()).contains(&id)
    }

    /// Refuses words of the wrong length and codes that are too large.
    pub(crate) fn check(&self, words: &Words) -> Result<()> {
        let symbols = self.vocabulary.characters();
        let length = self.word_length();
        for (w, word) in words.iter().enumerate() {
            let n = word.len();
            let expected = match length {
                WordLength::Fixed(c) if n != c => c.to_string(),
                WordLength::Varying { most } if n > most => format!("at most {most}"),
                _ => continue,
            };
            return Err(Error::Codes(format!("word {w}: {n} characters, expected {expected}")));
        }
        if let Some(at) = words.codes().iter().position(|&k| u32::from(k) >= symbols) {
            return Err(Error::Codes(self.name_code(words, at, symbols)));
        }
        Ok(())
    }

    fn name_code(&self, words: &Words, at: usize, symbols: u32) -> String {
        let mut place = at;
        let word = words.iter().position(|w| {
            let here = place < w.len();
            place -= if here { 0 } else { w.len() };
            here
        });
        let channel =
            self.scheme().slot_channels(self.channels()).ok().and_then(|p| p.get(place).map(ToString::to_string));
        let channel = channel.unwrap_or_else(|| format!("character {place}"));
        let (word, code) = (word.unwrap_or(0), words.codes()[at]);
        format!("word {word}, {channel}: code {code}, expected one below {symbols}")
    }
}

fn text_error(word: usize, character: usize, found: String, expected: String) -> Error {
    Error::Text { word, character, found, expected }
}

#[cfg(test)]
#[path = "words_tests.rs"]
mod tests;
