//! Codes, text and ids into one another.

use crate::scheme::check_codes;
use crate::vocab::{FIRST_CHARACTER, SPACE, Special};
use crate::{Error, Result, Tokenizer, alphabet};

/// Codes read from ids that a model or a file gave.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Reading {
    /// (F, C) codes.
    pub codes: Vec<u16>,
    /// Ids that their place doesn't allow and that were replaced.
    pub replaced: u64,
    /// Ids left over behind the last whole word.
    pub left_over: usize,
}

impl Tokenizer {
    /// The words of codes (F, C): C characters and a space each, also the last, so that text and
    /// [ids](Tokenizer::ids_of_codes) agree token for token.
    ///
    /// # Errors
    /// [`Error::Codes`] when they don't make whole frames or one is too large.
    pub fn text(&self, codes: &[u16]) -> Result<String> {
        check_codes(self.channels(), self.vocabulary.characters(), codes)?;
        let mut text = String::with_capacity(codes.len() * 3);
        for word in codes.chunks_exact(self.word_length()) {
            text.extend(word.iter().filter_map(|&k| alphabet::character(k.into())));
            text.push(' ');
        }
        Ok(text)
    }

    /// The codes (F, C) of words with white space between them.
    ///
    /// # Errors
    /// [`Error::Text`] naming the word and the character, for a word that is too short or too long and for a character
    /// that is none of the alphabet's.
    pub fn codes_of_text(&self, text: &str) -> Result<Vec<u16>> {
        let (c, bins) = (self.word_length(), self.vocabulary.characters());
        let mut codes = Vec::with_capacity(text.len() / 2);
        for (w, word) in text.split_whitespace().enumerate() {
            let fail = |character: usize, found: String, expected: String| {
                Err(Error::Text { word: w + 1, character: character + 1, found, expected })
            };
            for (i, ch) in word.chars().enumerate() {
                if i == c {
                    let n = word.chars().count();
                    return fail(i, format!("a word of {n} characters"), format!("{c} characters, then a space"));
                }
                match alphabet::code(ch).filter(|&k| k < bins) {
                    Some(k) => codes.push(k as u16),
                    None => {
                        let last = alphabet::character(bins - 1).unwrap_or('?');
                        return fail(i, format!("{ch:?}"), format!("one of the {bins} characters '0' to {last:?}"));
                    }
                }
            }
            if codes.len() != (w + 1) * c {
                let n = codes.len() - w * c;
                return fail(n, format!("the end of a word of {n} characters"), format!("{c} characters"));
            }
        }
        Ok(codes)
    }

    /// The ids of codes (F, C): W a frame, the last of which is the space's.
    ///
    /// # Errors
    /// [`Error::Codes`] when they don't make whole frames or one is too large.
    pub fn ids_of_codes(&self, codes: &[u16]) -> Result<Vec<u32>> {
        let frames = check_codes(self.channels(), self.vocabulary.characters(), codes)?;
        let mut ids = Vec::with_capacity(codes.len() + frames);
        for word in codes.chunks_exact(self.word_length()) {
            ids.extend(word.iter().map(|&k| FIRST_CHARACTER + u32::from(k)));
            ids.push(SPACE);
        }
        Ok(ids)
    }

    /// The ids of text, as Hugging Face's loaders of our file give them: one a character, `<unk>` for one that is none of
    /// ours (a line end too); special and conditioning tokens that are written out are one id each.
    pub fn ids_of_text(&self, text: &str) -> Vec<u32> {
        let bins = self.vocabulary.characters();
        let mut ids = Vec::with_capacity(text.len());
        let mut rest = text.chars();
        while let Some(c) = rest.next() {
            ids.push(match alphabet::code(c).filter(|&k| k < bins) {
                Some(k) => FIRST_CHARACTER + k,
                None if c == ' ' => SPACE,
                None => {
                    let token = if c == '<' { self.token_after_bracket(rest.as_str()) } else { None };
                    if let Some((_, length)) = token {
                        rest = rest.as_str()[length..].chars();
                    }
                    token.map_or(Special::Unk.id(), |(id, _)| id)
                }
            });
        }
        ids
    }

    /// The id of the token whose `<` was just read, and the bytes that are left of it. No token holds another bracket.
    fn token_after_bracket(&self, rest: &str) -> Option<(u32, usize)> {
        let length = rest.find('>')? + 1;
        let id = self.vocabulary.id(&format!("<{}", &rest[..length]))?;
        Some((id, length))
    }

    /// The codes of any ids.
    ///
    /// `<pad>`, `<bos>`, `<eos>` and conditioning tokens where a word would start are passed over. From there on each id
    /// takes its place in the word. One that its place doesn't allow is replaced by the code that stood there in the
    /// word before (in the first word by that of no step and no turn), at the end of a word by the space, and counted.
    /// A last word that lacks characters is left out.
    pub fn codes_of_ids(&self, ids: &[u32]) -> Reading {
        let c = self.word_length();
        let mut out = Reading { codes: Vec::with_capacity(ids.len()), ..Reading::default() };
        let mut before = self.scheme().neutral(self.channels());
        let (mut at, mut replaced_here) = (0, 0);
        for &id in ids {
            if at == 0 && self.stands_between_words(id) {
                continue;
            }
            let code = self.vocabulary.code_of_id(id);
            if at < c {
                replaced_here += u64::from(code.is_none());
                out.codes.push(code.unwrap_or(before[at]));
                at += 1;
                if at == c {
                    before.copy_from_slice(&out.codes[out.codes.len() - c..]);
                    out.replaced += std::mem::take(&mut replaced_here);
                }
            } else {
                out.replaced += u64::from(id != SPACE);
                at = 0;
            }
        }
        if at < c {
            out.left_over = at;
            out.codes.truncate(out.codes.len() - at);
        }
        out
    }

    fn stands_between_words(&self, id: u32) -> bool {
        let first = self.vocabulary.first_conditioning();
        [Special::Pad, Special::Bos, Special::Eos].iter().any(|s| s.id() == id)
            || (first..self.vocabulary.len()).contains(&id)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::contract::{bent, small};
    use crate::{Rest, TokenizerConfig};
    use proptest::prelude::*;

    fn tokenizer() -> Tokenizer {
        Tokenizer::fit([&bent(3, 40)], TokenizerConfig::uniform(&[0, 4], 20.0, 100)).unwrap()
    }

    #[test]
    fn text_and_ids_say_the_same() {
        let t = tokenizer();
        let codes = t.encode(&bent(5, 7)).unwrap().codes;
        let (text, ids) = (t.text(&codes).unwrap(), t.ids_of_codes(&codes).unwrap());
        assert_eq!(text.chars().count(), 7 * 10);
        assert_eq!(ids.len(), 7 * t.tokens_per_frame());
        assert_eq!(t.ids_of_text(&text), ids);
        assert_eq!(t.codes_of_text(&text).unwrap(), codes);
        assert_eq!(t.codes_of_text(&format!("{}\n", text.trim_end())).unwrap(), codes);
        assert_eq!(t.codes_of_ids(&ids), Reading { codes, replaced: 0, left_over: 0 });
        assert!(ids.iter().enumerate().all(|(i, &id)| t.grammar().allows(i, id)));
        assert_eq!(t.codes_of_text(" \n").unwrap(), Vec::<u16>::new());
    }

    #[test]
    fn bad_text_is_named() {
        let t = tokenizer();
        let error = |text: &str| t.codes_of_text(text).unwrap_err().to_string();
        assert_eq!(
            error("012345678 01234_678"),
            "word 2, character 6: found '_', expected one of the 100 characters '0' to '\u{4E25}'"
        );
        assert!(error("012345678 0123").starts_with("word 2, character 5: found the end of a word of 4"));
        assert!(error("0123456789").starts_with("word 1, character 10: found a word of 10"));
        assert!(error("01234567\u{4E26}").contains("word 1, character 9"));
        assert!(t.text(&[0; 10]).unwrap_err().to_string().contains("cut 1 off"));
        assert!(t.ids_of_codes(&[100; 9]).unwrap_err().to_string().contains("frame 0, translation x: code 100"));
    }

    #[test]
    fn wrong_ids_take_the_code_before() {
        let mut t = tokenizer();
        let genre = t.vocabulary_mut().add_conditioning("genre", "salsa").unwrap();
        let word = |k: u32| (0..9).map(move |i| 6 + k + i).chain([SPACE]);
        let mut ids: Vec<u32> = [1, genre].into_iter().chain(word(10)).chain(word(30)).collect();
        ids[2 + 10 + 4] = 9999;
        ids[2 + 10 + 9] = 3;
        ids.extend([7, 7]);
        let r = t.codes_of_ids(&ids);
        assert_eq!((r.replaced, r.left_over, r.codes.len()), (2, 2, 18));
        assert_eq!((r.codes[9 + 4], r.codes[9 + 5]), (14, 35));
        // the last word may lack its space
        assert_eq!(t.codes_of_ids(&ids[2..11]).codes.len(), 9);
        assert_eq!(t.codes_of_ids(&[4]).left_over, 1);
    }

    proptest! {
        #[test]
        fn any_ids_decode(ids in prop::collection::vec(0u32..130, 0..200)) {
            let t = small();
            let r = t.codes_of_ids(&ids);
            let clip = t.decode(&r.codes, Rest::Identity).unwrap();
            prop_assert_eq!(clip.frames(), r.codes.len() / t.word_length());
            prop_assert!(r.left_over < t.word_length());
        }
    }
}
