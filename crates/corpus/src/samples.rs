//! A small tokenizer and corpus for the tests.

use super::record::{ClipRecord, Failure, Manifest, Split};
use super::writer::{CorpusWriter, NewClip};
use crate::Result;
use kinelm_motion::{Clip, Quat, Vec3, smpl};
use kinelm_tokenizer::{Tokenizer, TokenizerConfig};
use std::collections::BTreeMap;
use std::path::Path;

/// `frames` frames of a body that walks along z.
pub fn walk(frames: usize) -> Clip {
    let root = (0..frames).map(|f| Vec3::new(0.0, 0.97, 0.05 * f as f64)).collect();
    Clip::new(smpl::neutral(), 20.0, root, vec![Quat::IDENTITY; 24 * frames]).unwrap()
}

/// The dance of a body that also turns about the vertical, at this many turns a second.
pub fn spinning(clip: &Clip, turns_a_second: f64) -> Clip {
    let mut rotations = clip.rotations().to_vec();
    for (f, pose) in rotations.chunks_exact_mut(clip.joints()).enumerate() {
        pose[0] = Quat::from_rotation_y(std::f64::consts::TAU * turns_a_second * f as f64 / clip.fps()) * pose[0];
    }
    Clip::new(clip.skeleton().clone(), clip.fps(), clip.root().to_vec(), rotations).unwrap()
}

/// Six characters and a space a frame.
pub fn tokenizer() -> Tokenizer {
    Tokenizer::fit([&walk(5)], TokenizerConfig::uniform(&[0], 20.0, 60)).unwrap()
}

/// The tokens of a walk.
pub fn words(frames: usize) -> Vec<u32> {
    let t = tokenizer();
    t.ids_of_words(&t.encode(&walk(frames)).unwrap().words).unwrap()
}

pub fn clip(name: &str, key: usize, split: Split, frames: usize) -> NewClip {
    let labels = BTreeMap::from([("genre".to_string(), "salsa".to_string())]);
    let (name, take, sha256) = (name.to_string(), name.to_string(), "0".repeat(64));
    let record = ClipRecord {
        name,
        labels,
        split,
        take,
        key,
        sha256,
        frames,
        clipped: 2,
        second_codes: 1,
        source: 0,
        floor_m: None,
        read: Default::default(),
        beats: None,
        offset: 0,
        tokens: 0,
        music: None,
    };
    NewClip { record, music: Vec::new() }
}

pub fn begin(dir: &Path, force: bool) -> Result<CorpusWriter> {
    CorpusWriter::create(dir, &tokenizer(), &["data".to_string()], None, force)
}

/// Clips a, b, c of 2, 0 and 1 frames, the second of them in test, and a file that failed.
pub fn small(dir: &Path) -> (Manifest, [Vec<u32>; 3]) {
    let ids = [2, 0, 1].map(words);
    let mut w = begin(dir, false).unwrap();
    w.push(clip("a", 0, Split::Train, 2), &ids[0]).unwrap();
    w.push(clip("b", 2, Split::Test, 0), &ids[1]).unwrap();
    w.push(clip("c", 5, Split::Train, 1), &ids[2]).unwrap();
    w.fail(Failure { key: 1, name: "x".into(), why: "damaged".into() });
    (w.finish().unwrap(), ids)
}
