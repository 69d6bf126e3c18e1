//! Our `tokenizer.json` in Hugging Face's loaders: the Rust crate here, Python's by a golden file.

#[path = "../examples/golden_tokenizer.rs"]
mod golden_tokenizer;

use golden_tokenizer::golden;
use kinelm_tokenizer::{Tokenizer, Words};
use serde_json::Value;

/// Our tokenizers and what Python made of them: with characters alone, and with merges.
fn both() -> [(Tokenizer, Value); 2] {
    let text = include_str!("golden/tokenizer_ids.json");
    let mut file: Value = serde_json::from_str(text).expect("the golden file is JSON");
    [(golden(0), file["plain"].take()), (golden(50), file["merged"].take())]
}

fn numbers(v: &Value) -> Vec<u32> {
    v.as_array().expect("a list").iter().map(|n| n.as_u64().expect("a number") as u32).collect()
}

#[test]
fn python_gives_the_same_ids() {
    for (ours, file) in both() {
        assert_eq!(file["sha256"], ours.hash(), "the golden file is of another tokenizer: make it again by its script");
        assert_eq!(file["size"], ours.vocabulary().len());
        for case in file["cases"].as_array().expect("a list") {
            let text = case["text"].as_str().expect("text");
            assert_eq!(ours.ids_of_text(text), numbers(&case["ids"]), "{text:?}");
        }
        let codes: Vec<u16> = numbers(&file["codes"]).into_iter().map(|k| k as u16).collect();
        let (words, ids) = (Words::fixed(codes, 9), numbers(&file["cases"][0]["ids"]));
        assert_eq!(file["cases"][0]["text"], ours.text(&words).expect("codes below 80"));
        assert_eq!(ours.ids_of_words(&words).expect("whole words"), ids);
        assert_eq!(ours.words_of_ids(&ids).words, words);
    }
}

#[test]
fn merges_are_learnt_and_used() {
    let [_, (ours, file)] = both();
    assert!(ours.vocabulary().merged() >= 30, "{}", ours.vocabulary().merged());
    let (characters, ids) = (&file["cases"][1]["text"], numbers(&file["cases"][1]["ids"]));
    assert!(ids.len() * 2 < characters.as_str().expect("text").chars().count(), "{} ids", ids.len());
}

#[test]
fn the_rust_crate_gives_the_same_ids_and_text() {
    for (ours, file) in both() {
        let dir = tempfile::tempdir().expect("a folder");
        let path = dir.path().join("tokenizer.json");
        ours.save(&path).expect("written");
        let theirs = tokenizers::Tokenizer::from_file(&path).expect("their loader takes it");
        assert_eq!(theirs.get_vocab_size(true), ours.vocabulary().len() as usize);
        for case in file["cases"].as_array().expect("a list") {
            let text = case["text"].as_str().expect("text");
            let plain = theirs.encode(text, false).expect("encoded");
            assert_eq!(plain.get_ids(), ours.ids_of_text(text), "{text:?}");
            let with_bos = theirs.encode(text, true).expect("encoded");
            assert_eq!((with_bos.get_ids()[0], &with_bos.get_ids()[1..]), (1, plain.get_ids()));
            assert_eq!(case["decoded"], theirs.decode(plain.get_ids(), false).expect("decoded"));
        }
        for (id, token) in ours.vocabulary().iter() {
            assert_eq!(theirs.id_to_token(id).as_deref(), Some(&*token));
        }
    }
}

#[test]
fn saved_by_them_our_part_is_gone_and_we_say_so() {
    let dir = tempfile::tempdir().expect("a folder");
    let path = dir.path().join("tokenizer.json");
    golden(0).save(&path).expect("written");
    tokenizers::Tokenizer::from_file(&path).expect("loaded").save(&path, true).expect("saved");
    let error = kinelm_tokenizer::Tokenizer::load(&path).expect_err("no part of ours").to_string();
    assert!(error.contains("tokenizer.json: no part of kinelm's in it"), "{error}");
}
