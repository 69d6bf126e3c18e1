//! Ids: specials, the space, the characters, merged tokens, then conditioning tokens.

use crate::{Error, Result, alphabet};
use std::borrow::Cow;
use std::collections::{HashMap, HashSet};

/// The special tokens, at ids 0 to 4.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
#[repr(u32)]
pub enum Special {
    /// Fills a batch.
    Pad = 0,
    /// Begins every window.
    Bos = 1,
    /// Ends a clip.
    Eos = 2,
    /// A token to be predicted.
    Mask = 3,
    /// An unknown character.
    Unk = 4,
}

impl Special {
    /// All, by id.
    pub const ALL: [Special; 5] = [Special::Pad, Special::Bos, Special::Eos, Special::Mask, Special::Unk];

    /// Its id.
    pub const fn id(self) -> u32 {
        self as u32
    }

    /// Its text.
    pub const fn token(self) -> &'static str {
        ["<pad>", "<bos>", "<eos>", "<mask>", "<unk>"][self as usize]
    }
}

/// The id of the space.
pub const SPACE: u32 = 5;

/// The id of code 0's character.
pub(crate) const FIRST_CHARACTER: u32 = 6;

/// Tokens and their ids. Ids never change: conditioning tokens are appended.
///
/// ```
/// use kinelm_tokenizer::Vocabulary;
///
/// let mut vocabulary = Vocabulary::new(60);
/// assert_eq!((vocabulary.id("<bos>"), vocabulary.id("A")), (Some(1), Some(6 + 10)));
/// assert_eq!(vocabulary.add_conditioning("genre", "salsa")?, 66);
/// # Ok::<(), kinelm_tokenizer::Error>(())
/// ```
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Vocabulary {
    characters: u32,
    /// Pairs of ids that are merged, in the order of training.
    merges: Vec<(u32, u32)>,
    /// The codes of each merged token, by id.
    merged: Vec<Vec<u16>>,
    conditioning: Vec<String>,
}

/// The longest merged token; no word is longer.
const LONGEST_TOKEN: usize = 1 << 14;

impl Vocabulary {
    /// The vocabulary of a number of characters, without merges.
    pub fn new(characters: u32) -> Self {
        Vocabulary { characters, merges: Vec::new(), merged: Vec::new(), conditioning: Vec::new() }
    }

    /// Adds merged tokens. A pair whose characters equal an existing token gives that token.
    ///
    /// # Errors
    /// [`Error::Setting`] for a pair with unknown ids, a repeated pair, and tokens longer than any word.
    pub(crate) fn with_merges(mut self, merges: &[(u32, u32)]) -> Result<Self> {
        let (mut known, mut pairs) = (HashSet::new(), HashSet::new());
        for &(a, b) in merges {
            let mut codes = Vec::new();
            let fits = self.expand(a, &mut codes) && self.expand(b, &mut codes) && codes.len() <= LONGEST_TOKEN;
            if !fits || !pairs.insert((a, b)) {
                return Err(Error::setting(
                    "merges",
                    format!("the pair {a} {b}"),
                    "ids of characters or of tokens merged before, each pair once",
                ));
            }
            // two pairs of the same characters are one token, as in Hugging Face's loaders, whose vocabulary is by text
            if known.insert(codes.clone()) {
                self.merged.push(codes);
            }
        }
        self.merges = merges.to_vec();
        Ok(self)
    }

    /// Pairs of ids that are merged, in the order of training.
    pub fn merges(&self) -> &[(u32, u32)] {
        &self.merges
    }

    /// The number of merged tokens; two pairs may give one token.
    pub fn merged(&self) -> u32 {
        self.merged.len() as u32
    }

    /// Each pair and its merged id.
    pub(crate) fn merge_table(&self) -> impl Iterator<Item = ((u32, u32), u32)> {
        let ids: HashMap<&[u16], u32> = self.merged.iter().map(Vec::as_slice).zip(self.first_merged()..).collect();
        self.merges.iter().map(move |&(a, b)| {
            let mut codes = Vec::new();
            self.expand(a, &mut codes);
            self.expand(b, &mut codes);
            ((a, b), ids[codes.as_slice()])
        })
    }

    fn first_merged(&self) -> u32 {
        FIRST_CHARACTER + self.characters
    }

    /// Appends the codes of a character or a merged token; `false` for every other id.
    pub fn expand(&self, id: u32, codes: &mut Vec<u16>) -> bool {
        if let Some(code) = self.code_of_id(id) {
            codes.push(code);
            return true;
        }
        match id.checked_sub(self.first_merged()).and_then(|i| self.merged.get(i as usize)) {
            Some(token) => {
                codes.extend_from_slice(token);
                true
            }
            None => false,
        }
    }

    /// The characters of an id: 0 for the space, specials and conditioning tokens.
    pub fn length_of_id(&self, id: u32) -> usize {
        if self.code_of_id(id).is_some() {
            return 1;
        }
        id.checked_sub(self.first_merged()).and_then(|i| self.merged.get(i as usize)).map_or(0, Vec::len)
    }

    /// V, the number of ids.
    #[allow(clippy::len_without_is_empty, reason = "the specials are always there")]
    pub fn len(&self) -> u32 {
        self.first_conditioning() + self.conditioning.len() as u32
    }

    /// The number of characters.
    pub fn characters(&self) -> u32 {
        self.characters
    }

    /// The code of a character's id; `None` for every other id.
    pub fn code_of_id(&self, id: u32) -> Option<u16> {
        id.checked_sub(FIRST_CHARACTER).filter(|&k| k < self.characters).map(|k| k as u16)
    }

    /// The token of an id.
    pub fn token(&self, id: u32) -> Option<Cow<'_, str>> {
        if let Some(special) = Special::ALL.get(id as usize) {
            return Some(special.token().into());
        }
        if id == SPACE {
            return Some(" ".into());
        }
        if let Some(code) = self.code_of_id(id) {
            return alphabet::character(code.into()).map(|c| c.to_string().into());
        }
        // lower ids have returned by now, so neither difference is below 0
        if let Some(codes) = self.merged.get((id - self.first_merged()) as usize) {
            return codes.iter().map(|&k| alphabet::character(k.into())).collect::<Option<String>>().map(Cow::from);
        }
        self.conditioning.get((id - self.first_conditioning()) as usize).map(|t| t.as_str().into())
    }

    /// The id of a token.
    pub fn id(&self, token: &str) -> Option<u32> {
        if let Some(special) = Special::ALL.iter().find(|s| s.token() == token) {
            return Some(special.id());
        }
        if token == " " {
            return Some(SPACE);
        }
        let mut chars = token.chars();
        if let (Some(c), None) = (chars.next(), chars.next()) {
            return alphabet::code(c).filter(|&k| k < self.characters).map(|k| FIRST_CHARACTER + k);
        }
        // before merged tokens: none has a bracket, so the order only saves the conversion to codes
        if let Some(at) = self.conditioning.iter().position(|t| t == token) {
            return Some(self.first_conditioning() + at as u32);
        }
        let codes: Vec<u16> = token.chars().map(|c| alphabet::code(c).map(|k| k as u16)).collect::<Option<_>>()?;
        let at = self.merged.iter().position(|t| *t == codes)?;
        Some(self.first_merged() + at as u32)
    }

    /// The conditioning tokens, such as `<genre:salsa>`, in the order of their ids.
    pub fn conditioning(&self) -> &[String] {
        &self.conditioning
    }

    /// The id of the first conditioning token, whether there is one or not.
    pub fn first_conditioning(&self) -> u32 {
        self.first_merged() + self.merged()
    }

    /// Removes the conditioning tokens.
    pub(crate) fn clear_conditioning(&mut self) {
        self.conditioning.clear();
    }

    /// The id of `<field:value>`, appended if it is new.
    ///
    /// # Errors
    /// [`Error::Conditioning`] when the field or the value is empty, longer than 200 bytes, or holds `<`, `>`, a control
    /// character, or (the field) a colon.
    pub fn add_conditioning(&mut self, field: &str, value: &str) -> Result<u32> {
        let fail = |what: &str| {
            Err(Error::Conditioning {
                field: field.escape_debug().collect(),
                value: value.escape_debug().collect(),
                what: what.into(),
            })
        };
        if field.is_empty() || value.is_empty() || field.len() > 200 || value.len() > 200 {
            return fail("expected 1 to 200 bytes on either side of the colon");
        }
        // the first colon ends the field, and brackets delimit a token in text
        if field.contains(':')
            || [field, value].iter().any(|s| s.contains(|c: char| matches!(c, '<' | '>') || c.is_control()))
        {
            return fail("expected no <, > or control character, and no colon in the field; rename the label");
        }
        let token = format!("<{field}:{value}>");
        if let Some(id) = self.id(&token) {
            return Ok(id);
        }
        self.conditioning.push(token);
        Ok(self.len() - 1)
    }

    /// The id of `<field:value>` if it was added.
    pub fn conditioning_id(&self, field: &str, value: &str) -> Option<u32> {
        self.id(&format!("<{field}:{value}>"))
    }

    /// All tokens with their ids, by id.
    pub fn iter(&self) -> impl Iterator<Item = (u32, Cow<'_, str>)> {
        (0..self.len()).filter_map(|id| self.token(id).map(|t| (id, t)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_and_tokens_are_one_to_one() {
        let mut v = Vocabulary::new(360);
        assert_eq!(v.add_conditioning("genre", "salsa").unwrap(), 366);
        assert_eq!(v.add_conditioning("dancer", "two words: 61").unwrap(), 367);
        assert_eq!(v.add_conditioning("genre", "salsa").unwrap(), 366);
        assert_eq!(v.len(), 368);
        for (id, token) in v.iter() {
            assert_eq!(v.id(&token), Some(id), "{token}");
        }
        assert_eq!(v.iter().count(), 368);
        assert_eq!(v.token(368), None);
        assert_eq!(v.conditioning_id("genre", "salsa"), Some(366));
        assert_eq!(
            (v.id("<pad>"), v.id("<unk>"), v.id(" "), v.id("0"), v.id("一")),
            (Some(0), Some(4), Some(5), Some(6), Some(68))
        );
        assert_eq!(v.id("\u{4F2A}"), None, "code 360");
    }

    #[test]
    fn merged_tokens_stand_before_conditioning() {
        // "01", "012" twice over: once as 01 2, once as 0 12
        let v = Vocabulary::new(60).with_merges(&[(6, 7), (7, 8), (66, 8), (6, 67)]).unwrap();
        assert_eq!((v.merges().len(), v.merged(), v.first_conditioning()), (4, 3, 69));
        assert_eq!(v.merge_table().map(|(_, into)| into).collect::<Vec<_>>(), [66, 67, 68, 68]);
        assert_eq!((v.token(68).as_deref(), v.id("012"), v.length_of_id(68)), (Some("012"), Some(68), 3));
        for (id, token) in v.iter() {
            assert_eq!(v.id(&token), Some(id), "{token}");
        }
        let error = |m: &[(u32, u32)]| Vocabulary::new(60).with_merges(m).unwrap_err().to_string();
        assert!(error(&[(6, 66)]).contains("pair 6 66"));
        assert!(error(&[(6, 5)]).contains("pair 6 5"));
        assert!(error(&[(6, 7), (6, 7)]).contains("each pair once"));
    }

    #[test]
    fn codes_and_ids() {
        let v = Vocabulary::new(62);
        assert_eq!(
            (v.code_of_id(5), v.code_of_id(6), v.code_of_id(67), v.code_of_id(68)),
            (None, Some(0), Some(61), None)
        );
    }

    #[test]
    fn a_vocabulary_of_no_use_is_refused() {
        let mut v = Vocabulary::new(60);
        for (f, x) in [("", "a"), ("a", ""), ("a:b", "c"), ("a", "b>c"), ("a", "b\n"), ("<", "a")] {
            assert!(v.add_conditioning(f, x).is_err(), "{f:?} {x:?}");
        }
        assert_eq!(v.len(), 66);
    }
}
