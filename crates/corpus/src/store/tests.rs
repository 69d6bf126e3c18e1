use super::*;
use crate::samples::{small, tokenizer};
use crate::{CorpusWriter, Count};
use std::fs;
use std::io::{Seek, Write};

#[test]
fn what_was_written_is_read() {
    let tmp = tempfile::tempdir().unwrap();
    let dir = tmp.path().join("c");
    let (manifest, ids) = small(&dir);
    assert!(dir.join("tokens.u16").is_file());
    let c = Corpus::open(&dir).unwrap();
    assert_eq!(*c.manifest(), manifest);
    assert_eq!(c.tokenizer(), &tokenizer());
    assert_eq!(manifest.count, Count { clips: 3, frames: 3 });
    assert_eq!(manifest.splits[&Split::Train], Count { clips: 2, frames: 3 });
    let train: Vec<_> = c.split(Split::Train).map(|r| c.clip_ids(r).unwrap()).collect();
    assert_eq!(train, [ids[0].clone(), ids[2].clone()]);
    // a word is six characters and a space
    assert_eq!(c.word_ids(&c.clips()[0], 1..2).unwrap(), ids[0][7..]);
    assert_eq!((c.tokens_per_frame(Split::Train), c.tokens_per_frame(Split::Valid)), (7.0, 0.0));
    assert_eq!((c.tokens().len(), c.clips()[1].frames, c.clips()[0].clipped), (3 * 7, 0, 2));
    assert_eq!(fs::read_dir(tmp.path()).unwrap().count(), 1, "nothing is left beside the corpus");
}

#[test]
fn ids_that_the_tokenizer_has_not_are_refused() {
    let tmp = tempfile::tempdir().unwrap();
    let dir = tmp.path().join("c");
    small(&dir);
    let (tokens, manifest) = (dir.join("tokens.u16"), dir.join(MANIFEST));
    let mut bytes = fs::read(&tokens).unwrap();
    let before = FileRecord::of(&bytes).sha256;
    // the high byte of the fifth id, which becomes 16,384 or more
    bytes[9] = 0x40;
    fs::write(&tokens, &bytes).unwrap();
    let text = fs::read_to_string(&manifest).unwrap().replace(&before, &FileRecord::of(&bytes).sha256);
    fs::write(&manifest, text).unwrap();
    let message = Corpus::open(&dir).unwrap_err().to_string();
    assert!(message.contains("tokens.u16: found id 16") && message.contains("expected ids below"), "{message}");
}

#[test]
fn damage_is_named() {
    let tmp = tempfile::tempdir().unwrap();
    let dir = tmp.path().join("c");
    let says = || Corpus::open(&dir).unwrap_err().to_string();
    assert!(says().contains("found nothing, expected a corpus folder"));
    small(&dir);
    let intact: Vec<_> = [MANIFEST, CLIPS, "tokens.u16", TOKENIZER].map(|f| (f, fs::read(dir.join(f)).unwrap())).into();
    let manifest = String::from_utf8(intact[0].1.clone()).unwrap();
    let mut other = tokenizer();
    other.vocabulary_mut().add_conditioning("genre", "salsa").unwrap();
    for (file, bytes, expected) in [
        (
            MANIFEST,
            manifest.replace("\"version\": 5", "\"version\": 9").into_bytes(),
            "found version 9, expected version 5; use a newer kinelm",
        ),
        (
            MANIFEST,
            manifest.replace("\"version\": 5", "\"version\": 1").into_bytes(),
            "found version 1, expected version 5; make it again",
        ),
        (MANIFEST, manifest[..40].into(), "corpus.json:"),
        (MANIFEST, manifest.replace("\"fps\"", "\"fpz\"").into_bytes(), "fpz"),
        (CLIPS, b"{}\n".to_vec(), "clips.jsonl: found 3 bytes"),
        // 3 words of 7 tokens of 2 bytes
        ("tokens.u16", vec![0; 41], "found 41 bytes, expected 42 bytes"),
        ("tokens.u16", vec![0; 42], "SHA-256"),
        (TOKENIZER, b"{}".to_vec(), "tokenizer.json"),
        (TOKENIZER, other.to_json().into_bytes(), "put back the tokenizer.json"),
    ] {
        fs::write(dir.join(file), bytes).unwrap();
        let said = says();
        assert!(said.contains(expected), "{said}");
        intact.iter().for_each(|(f, b)| fs::write(dir.join(f), b).unwrap());
    }
    Corpus::open(&dir).unwrap();
    fs::remove_file(dir.join(MANIFEST)).unwrap();
    assert!(says().contains("no corpus.json"));
}

#[test]
fn records_that_lie_are_refused() {
    let tmp = tempfile::tempdir().unwrap();
    let dir = tmp.path().join("c");
    small(&dir);
    let clips = fs::read_to_string(dir.join(CLIPS)).unwrap();
    let manifest = fs::read_to_string(dir.join(MANIFEST)).unwrap();
    for (from, to, expected) in [
        ("\"offset\":14", "\"offset\":13", "found clip b at token 13, expected token 14"),
        ("\"frames\":1", "\"frames\":2", "clip c of 2 frames in 7 tokens, expected 2 words of 7"),
        ("\"tokens\":7", "\"tokens\":14", "clip c of 1 frames in 14 tokens"),
        ("\"frames\":1", "\"frames\":18446744073709551615", "18446744073709551615 words of 7"),
        ("\"source\":0", "\"source\":1", "one of the 1 sources"),
        ("\"key\":2", "\"key\":two", "clips.jsonl:2:"),
    ] {
        let lying = clips.replacen(from, to, 1);
        assert_ne!(lying, clips, "{from}");
        let (old, new) = (FileRecord::of(clips.as_bytes()), FileRecord::of(lying.as_bytes()));
        let signed = manifest
            .replace(&old.sha256, &new.sha256)
            .replace(&format!("\"bytes\": {}", old.bytes), &format!("\"bytes\": {}", new.bytes));
        fs::write(dir.join(CLIPS), lying).unwrap();
        fs::write(dir.join(MANIFEST), signed).unwrap();
        let said = Corpus::open(&dir).unwrap_err().to_string();
        assert!(said.contains(expected), "{said}");
    }
}

#[test]
fn a_trusted_corpus_is_read_behind_its_2_32nd_token() {
    let tmp = tempfile::tempdir().unwrap();
    let dir = tmp.path().join("c");
    let (mut manifest, ids) = small(&dir);
    // two clips of zeros that take no room on the disk, then c
    let word = manifest.tokens_per_word.unwrap();
    // as long as the second clip still begins before token 2^32: it ends after that
    let frames = (u32::MAX as usize - 6) / word;
    let text = fs::read_to_string(dir.join(CLIPS)).unwrap();
    let mut clips: Vec<ClipRecord> = text.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    let mut next = 0;
    for (clip, frames) in clips.iter_mut().zip([frames, 2, 1]) {
        (clip.offset, clip.frames, clip.tokens) = (next, frames, frames * word);
        next += clip.tokens;
    }
    assert!(clips[2].offset > 1 << 32 && clips[1].offset < 1 << 32);
    let lines: String = clips.iter().map(|clip| serde_json::to_string(clip).unwrap() + "\n").collect();
    manifest.clips = FileRecord::of(lines.as_bytes());
    manifest.tokens.bytes = 2 * next as u64;
    fs::write(dir.join(CLIPS), lines).unwrap();
    fs::write(dir.join(MANIFEST), serde_json::to_string(&manifest).unwrap()).unwrap();
    let mut file = fs::File::options().write(true).open(dir.join("tokens.u16")).unwrap();
    file.set_len(0).unwrap();
    file.seek(std::io::SeekFrom::Start(2 * clips[2].offset as u64)).unwrap();
    file.write_all(&manifest.token_type.to_bytes(&ids[2])).unwrap();
    let options = CorpusOptions { trust: true, streamed: true, ..CorpusOptions::default() };
    let corpus = Corpus::open_with(&dir, options).unwrap();
    assert_eq!(corpus.tokens().len(), next);
    assert_eq!(corpus.clip_ids(&corpus.clips()[2]).unwrap(), ids[2]);
    assert_eq!(corpus.word_ids(&corpus.clips()[1], 1..2).unwrap(), vec![0; word]);
    assert_eq!(corpus.words(&corpus.clips()[0]).len(), frames);
}

#[test]
fn what_is_trusted_is_not_hashed_and_its_ids_are_refused_where_they_are_read() {
    let tmp = tempfile::tempdir().unwrap();
    let dir = tmp.path().join("c");
    small(&dir);
    let tokens = dir.join("tokens.u16");
    let mut bytes = fs::read(&tokens).unwrap();
    // the high byte of the fifth id, which becomes 16,384 or more
    bytes[9] = 0x40;
    fs::write(&tokens, &bytes).unwrap();
    assert!(Corpus::open(&dir).unwrap_err().to_string().contains("SHA-256"));
    let corpus = Corpus::open_with(&dir, CorpusOptions { trust: true, ..CorpusOptions::default() }).unwrap();
    let message = corpus.clip_ids(&corpus.clips()[0]).unwrap_err().to_string();
    assert!(message.contains("tokens.u16: found id 16") && message.contains("expected ids below"), "{message}");
}

#[test]
fn an_empty_corpus_opens() {
    let tmp = tempfile::tempdir().unwrap();
    let dir = tmp.path().join("c");
    CorpusWriter::create(&dir, &tokenizer(), &[], None, false).unwrap().finish().unwrap();
    assert!(Corpus::open(&dir).unwrap().tokens().is_empty());
}
