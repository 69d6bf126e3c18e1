//! Words, text and ids of every kind of word.

use super::*;
use crate::contract::{bent, small};
use crate::{TokenizerConfig, UncodedPose};
use proptest::prelude::*;

fn tokenizer() -> Tokenizer {
    Tokenizer::fit([&bent(3, 40)], TokenizerConfig::uniform(&[0, 4], 20.0, 100)).unwrap()
}

/// As [`tokenizer`], with merged tokens.
fn merged() -> Tokenizer {
    let config = TokenizerConfig { merges: 40, ..TokenizerConfig::uniform(&[0, 4], 20.0, 100) };
    Tokenizer::fit(&[bent(3, 400), bent(4, 400)], config).unwrap()
}

#[test]
fn text_and_ids_say_the_same() {
    let t = tokenizer();
    let words = t.encode(&bent(5, 7)).unwrap().words;
    let (text, ids) = (t.text(&words).unwrap(), t.ids_of_words(&words).unwrap());
    assert_eq!(text.chars().count(), 7 * 10);
    assert_eq!(ids.len(), 7 * t.tokens_per_word().unwrap());
    assert_eq!(t.ids_of_text(&text), ids);
    assert_eq!(t.words_of_text(&text).unwrap(), words);
    assert_eq!(t.words_of_text(&format!("{}\n", text.trim_end())).unwrap(), words);
    assert_eq!(t.words_of_ids(&ids), ParsedWords { words, replaced: 0, left_over: 0 });
    assert_eq!(t.words_of_text(" \n").unwrap(), Words::new());
}

#[test]
fn merged_ids_say_the_same_with_fewer() {
    let t = merged();
    assert!(t.vocabulary().merged() > 20, "{}", t.vocabulary().merged());
    let words = t.encode(&bent(3, 50)).unwrap().words;
    let ids = t.ids_of_words(&words).unwrap();
    assert!(ids.len() < 50 * 10 - 10, "{} tokens", ids.len());
    assert_eq!(t.ids_of_text(&t.text(&words).unwrap()), ids);
    assert_eq!(t.words_of_ids(&ids), ParsedWords { words, replaced: 0, left_over: 0 });
    assert_eq!(Tokenizer::from_json(&t.to_json()).unwrap(), t);
}

#[test]
fn bad_text_is_named() {
    let t = tokenizer();
    let error = |text: &str| t.words_of_text(text).unwrap_err().to_string();
    assert_eq!(
        error("012345678 01234_678"),
        "word 2, character 6: found '_', expected one of the 100 characters '0' to '\u{4E25}'"
    );
    assert!(error("012345678 0123").starts_with("word 2, character 5: found the end of a word of 4"));
    assert!(error("0123456789").starts_with("word 1, character 10: found a word of 10"));
    assert!(error("01234567\u{4E26}").contains("word 1, character 9"));
    let words = |codes: &[u16], length| Words::fixed(codes.to_vec(), length);
    assert!(t.text(&words(&[0; 10], 10)).unwrap_err().to_string().contains("word 0: 10 characters, expected 9"));
    let large = t.ids_of_words(&words(&[100; 9], 9)).unwrap_err().to_string();
    assert_eq!(large, "word 0, translation x: code 100, expected one below 100");
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
    let r = t.words_of_ids(&ids);
    assert_eq!((r.replaced, r.left_over, r.words.len()), (2, 2, 2));
    assert_eq!((r.words.word(1)[4], r.words.word(1)[5]), (14, 35));
    // the last word may lack its space
    assert_eq!(t.words_of_ids(&ids[2..11]).words.len(), 1);
    assert_eq!(t.words_of_ids(&[4]).left_over, 1);
}

#[test]
fn merged_words_are_cut_and_filled_at_spaces() {
    let t = merged();
    let word = |k: u32, n: u32| (0..n).map(move |i| 6 + k + i);
    let ids: Vec<u32> = word(10, 9).chain([SPACE]).chain(word(30, 4)).chain([3, SPACE]).chain(word(50, 12)).collect();
    let r = t.words_of_ids(&ids);
    assert_eq!((r.words.len(), r.replaced, r.left_over), (2, 6, 12));
    assert_eq!(r.words.word(1), [30, 31, 32, 33, 14, 15, 16, 17, 18]);
    let longer: Vec<u32> = ids.iter().copied().chain([SPACE]).collect();
    assert_eq!(t.words_of_ids(&longer).words.word(2), (50..59).collect::<Vec<u16>>());
    assert_eq!(t.words_of_ids(&longer).replaced, 9);
}

proptest! {
    #[test]
    fn any_ids_decode(ids in prop::collection::vec(0u32..130, 0..200)) {
        for t in [small(), merged()] {
            let r = t.words_of_ids(&ids);
            let clip = t.decode(&r.words, UncodedPose::Identity).unwrap();
            prop_assert_eq!(clip.frames(), r.words.len());
        }
    }
}
