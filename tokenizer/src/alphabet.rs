//! The characters of the bins: `0-9 A-Z a-z`, then the CJK ideographs from U+4E00.
//!
//! None is white space or combining, and Unicode normalisation and case mapping change none of them.
//!
//! ```
//! use kinelm_tokenizer::alphabet::{character, code};
//!
//! assert_eq!((character(10), code('A'), code(' ')), (Some('A'), Some(10), None));
//! ```

/// The characters of the first codes.
const ASCII: &[u8; 62] = b"0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz";

/// U+4E00, the character of code 62.
const CJK: u32 = 0x4E00;

/// The number of characters: 62, and U+4E00 to U+9FFF.
pub const SIZE: u32 = 62 + 0x5200;

/// The character of a code; `None` from [`SIZE`] on.
pub fn character(code: u32) -> Option<char> {
    match ASCII.get(code as usize) {
        Some(&b) => Some(char::from(b)),
        None if code < SIZE => char::from_u32(CJK + code - 62),
        None => None,
    }
}

/// The code of a character; the inverse of [`character`].
pub fn code(c: char) -> Option<u32> {
    match c {
        '0'..='9' => Some(c as u32 - '0' as u32),
        'A'..='Z' => Some(c as u32 - 'A' as u32 + 10),
        // after 10 digits and 26 capitals
        'a'..='z' => Some(c as u32 - 'a' as u32 + 36),
        '\u{4E00}'..='\u{9FFF}' => Some(c as u32 - CJK + 62),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_code_has_one_character() {
        for k in 0..SIZE {
            let c = character(k).unwrap();
            assert_eq!(code(c), Some(k));
            assert!(!c.is_whitespace() && c.to_lowercase().count() == 1);
        }
        assert_eq!(character(SIZE), None);
        assert_eq!(
            [0, 9, 10, 35, 36, 61, 62, 359].map(|k| character(k).unwrap()),
            ['0', '9', 'A', 'Z', 'a', 'z', '一', '\u{4F29}']
        );
        assert!([' ', '_', 'é', '\u{3000}', '\u{A000}'].iter().all(|&c| code(c).is_none()));
    }

    #[test]
    fn utf8_length_of_360() {
        let bytes: usize = (0..360).map(|k| character(k).unwrap().len_utf8()).sum();
        assert_eq!(bytes, 62 + 3 * 298);
    }
}
