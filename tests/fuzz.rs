//! Sound files changed at random, and every reader over them: no panic, whatever the bytes. The readers are those of
//! `fuzz/`, where a fuzzer drives them for longer.

#[path = "../fuzz/src/lib.rs"]
mod readers;

use kinelm_motion::format::{self, bvh::BvhSource, glb, json};
use kinelm_motion::joints::THIRTEEN;
use kinelm_motion::{Clip, Motion, synth};
use kinelm_tokenizer::{LappedConfig, SchemeConfig, Tokenizer, TokenizerConfig};
use rand_chacha::rand_core::RngCore;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;

/// Changed files a seed file.
const ROUNDS: u64 = 24;
/// Seed files of a kind, at most.
const SEEDS: usize = 8;
/// Longer files would be read too seldom.
const LONGEST: usize = 32 << 10;

/// What a change may write over text and over numbers.
const PIECES: [&[u8]; 14] = [
    b"",
    b"-1",
    b"0",
    b"1e308",
    b"nan",
    b"99999999999999999999",
    b"\"",
    b"}",
    b"[[[[[[[[",
    b"\n",
    b"\xff\xff\xff\xff",
    b"\x00\x00\x00\x00\x00\x00\x00\x80",
    b"\xf0\x9f\x92\x83",
    b" \t ",
];

/// A few changes of `bytes`: bits turned, stretches left out, doubled, cut off, written over.
fn changed(bytes: &[u8], rng: &mut impl RngCore) -> Vec<u8> {
    let mut bytes = bytes.to_vec();
    for _ in 0..1 + rng.next_u32() % 4 {
        let n = bytes.len();
        let at = rng.next_u64() as usize % (n + 1);
        let end = (at + 1 + rng.next_u32() as usize % 16).min(n);
        match rng.next_u32() % 6 {
            0 if at < n => bytes[at] ^= 1 << (rng.next_u32() % 8),
            1 if at < n => drop(bytes.drain(at..end)),
            2 if at < n => {
                let stretch = bytes[at..end].repeat(1 + rng.next_u32() as usize % 3);
                bytes.splice(at..at, stretch);
            }
            3 => bytes.truncate(at),
            _ => {
                let piece = PIECES[rng.next_u32() as usize % PIECES.len()];
                bytes.splice(at.min(end)..end, piece.iter().copied());
            }
        }
    }
    bytes
}

/// Files of a folder of the repository.
fn files(folder: &str, extension: &str) -> Vec<Vec<u8>> {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join(folder);
    let mut all: Vec<_> = std::fs::read_dir(&folder).expect("a folder of the repository").flatten().collect();
    all.sort_by_key(std::fs::DirEntry::path);
    let paths = all.iter().map(std::fs::DirEntry::path).filter(|p| p.extension().is_some_and(|e| e == extension));
    paths.map(|p| std::fs::read(p).expect("a file of the repository")).filter(|bytes| bytes.len() < LONGEST).collect()
}

fn dances() -> Vec<Clip> {
    synth::corpus(1, 2, 1.5, 20.0).expect("made-up dances").into_iter().map(|dance| dance.clip).collect()
}

fn tokenizers() -> Vec<Tokenizer> {
    let uniform = TokenizerConfig { merges: 5, ..TokenizerConfig::uniform(&[0, 4], 20.0, 12) };
    let lapped = TokenizerConfig {
        scheme: SchemeConfig::Lapped(LappedConfig::default()),
        ..TokenizerConfig::uniform(&THIRTEEN, 20.0, 360)
    };
    [uniform, lapped].map(|config| Tokenizer::fit(&dances(), config).expect("good settings")).into()
}

/// Sound files for a reader.
fn seeds(target: &str) -> Vec<Vec<u8>> {
    let own = |text: &str| vec![text.as_bytes().to_vec()];
    match target {
        "bvh" => dances()
            .iter()
            .map(|c| BvhSource::for_skeleton(c.skeleton()).and_then(|s| s.to_bytes(c)).unwrap())
            .collect(),
        "amc" => {
            let read = |name| files("crates/motion/tests/golden", name).concat();
            vec![[read("asf"), vec![0], read("amc")].concat()]
        }
        "amass" => files("crates/motion/tests/golden/amass", "npz"),
        "body_model" => files("crates/motion/tests/golden/body", "npz"),
        "aist" => files("crates/motion/tests/golden/aist", "pkl"),
        "glb" => {
            let vrma = |c: &Clip| format::to_bytes(Path::new("a.vrma"), &Motion::new("a.vrma", c.clone())).unwrap();
            dances().iter().flat_map(|c| [glb::to_bytes(&[("dance", c)]).unwrap(), vrma(c)]).collect()
        }
        "json" => dances().iter().map(json::write).collect(),
        "skeleton_map" => files("configs/skeleton", "toml"),
        "joint_list" => own("root,right_arm,left_knee,7,13,head"),
        "tokenizer" => tokenizers().iter().map(|t| t.to_json().into_bytes()).collect(),
        "text" => {
            let uniform = Tokenizer::fit(&dances(), TokenizerConfig::uniform(&THIRTEEN, 20.0, 360)).unwrap();
            let words = uniform.encode(&dances()[0]).unwrap().words;
            vec![uniform.text(&words).unwrap().into_bytes()]
        }
        "settings" => files("configs/tokenizer", "toml"),
        "labels" => own("clip,genre,split,fps,skip\n\"a/01\",salsa,train,60,1\na/02,\"mar\"\"tial\",test,,\n"),
        "train_file" => files("configs/train", "toml"),
        "weights" => {
            let header = r#"{"a":{"dtype":"F32","shape":[2],"data_offsets":[0,8]}}"#;
            let bytes = [&(header.len() as u64).to_le_bytes()[..], header.as_bytes(), &[0; 8]].concat();
            vec![bytes]
        }
        "sidecar" => {
            own(r#"{"schema": 3, "kinelm": "0", "output": {"file": "a.bvh", "sha256": "00"}, "read": {"skip": 1}}"#)
        }
        "folders" => own("version = 2\n[model]\nlayers = 1\n{\"version\": 3, \"clips\": {}}"),
        "music" => ["wav", "flac", "mp3", "ogg", "m4a", "mp4", "aac", "opus"]
            .iter()
            .flat_map(|extension| files("crates/music/tests/sounds", extension))
            .collect(),
        "beats" => own("# made by kinelm: beats of song.mp3, seconds\n0.500\n1.013\t1\n\n 1.5,2 # two\n"),
        other => panic!("no sound file for {other}"),
    }
}

#[test]
fn no_reader_panics_over_changed_files() {
    for (name, read) in readers::TARGETS {
        let seeds = seeds(name);
        assert!(!seeds.is_empty(), "{name}: no sound file under {LONGEST} bytes");
        let step = seeds.len().div_ceil(SEEDS);
        for (i, seed) in seeds.iter().step_by(step).enumerate() {
            for round in 0..ROUNDS {
                let mut rng = kinelm_store::random::stream(7, name, i as u64, round);
                // the first as it is
                let bytes = if round == 0 { seed.clone() } else { changed(seed, &mut rng) };
                let done = catch_unwind(AssertUnwindSafe(|| read(&bytes)));
                assert!(done.is_ok(), "{name}: file {i}, round {round}: {}", String::from_utf8_lossy(&bytes));
            }
        }
    }
}

#[test]
fn every_reader_has_a_target_of_the_fuzzer() {
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz");
    let manifest = std::fs::read_to_string(folder.join("Cargo.toml")).unwrap();
    for (name, _) in readers::TARGETS {
        let target = std::fs::read_to_string(folder.join(format!("fuzz_targets/{name}.rs"))).unwrap();
        assert!(target.contains(&format!("kinelm_fuzz::{name}(data)")), "{name}");
        assert!(manifest.contains(&format!("name = \"{name}\"")), "{name}");
    }
    assert_eq!(std::fs::read_dir(folder.join("fuzz_targets")).unwrap().count(), readers::TARGETS.len());
}
