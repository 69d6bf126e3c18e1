//! Frames a second of coding and decoding: `cargo bench -p kinelm-tokenizer`.

use divan::counter::ItemsCount;
use divan::{Bencher, black_box};
use kinelm_motion::rotation::exp_map;
use kinelm_motion::{Clip, Vec3, smpl};
use kinelm_tokenizer::{DctConfig, JointTransform, SchemeConfig, Tokenizer, TokenizerConfig, UncodedPose};
use rayon::prelude::*;
use std::f64::consts::PI;

const CLIPS: usize = 8;
const FRAMES: usize = 4000;
const JOINTS: [&[usize]; 2] = [
    &kinelm_motion::joints::THIRTEEN,
    &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23],
];

fn main() {
    divan::main();
}

/// One who walks in circles and swings every joint.
fn clip(seed: usize) -> Clip {
    let wave = |i: usize, f: usize| (f as f64 * 0.05 * (1.0 + i as f64 / 40.0) + (i * (seed + 3)) as f64).sin();
    let root = (0..FRAMES).map(|f| Vec3::new(2.0 * wave(0, f), 0.95 + 0.03 * wave(1, f), 2.0 * wave(2, f))).collect();
    let joint = |f: usize, j: usize| {
        let turn = if j == 0 { (0.03 * f as f64 + PI).rem_euclid(2.0 * PI) - PI } else { 0.0 };
        exp_map::from_vector(Vec3::Y * turn)
            * exp_map::from_vector(Vec3::new(wave(3 * j, f), wave(3 * j + 1, f), wave(3 * j + 2, f)) * 0.6)
    };
    let rotations = (0..FRAMES * 24).map(|i| joint(i / 24, i % 24)).collect();
    Clip::new(smpl::neutral(), 20.0, root, rotations).expect("finite")
}

fn set(joints: usize) -> (Tokenizer, Vec<Clip>) {
    let clips: Vec<Clip> = (0..CLIPS).map(clip).collect();
    let config = TokenizerConfig::uniform(JOINTS[usize::from(joints == 24)], 20.0, 360);
    (Tokenizer::fit(&clips, config).expect("good clips"), clips)
}

#[divan::bench(args = [13, 24])]
fn encode_one_thread(bencher: Bencher, joints: usize) {
    let (t, clips) = set(joints);
    bencher.counter(ItemsCount::new(CLIPS * FRAMES)).bench(|| {
        let codes: usize = clips.iter().map(|c| t.encode(black_box(c)).expect("good").words.codes().len()).sum();
        assert_eq!(codes, CLIPS * FRAMES * t.channels().len());
    });
}

#[divan::bench(args = [13, 24])]
fn encode_all_threads(bencher: Bencher, joints: usize) {
    let (t, clips) = set(joints);
    bencher.counter(ItemsCount::new(CLIPS * FRAMES)).bench(|| {
        let codes: usize = clips.par_iter().map(|c| t.encode(black_box(c)).expect("good").words.codes().len()).sum();
        assert_eq!(codes, CLIPS * FRAMES * t.channels().len());
    });
}

#[divan::bench(args = [13, 24])]
fn decode_one_thread(bencher: Bencher, joints: usize) {
    let (t, clips) = set(joints);
    let words: Vec<_> = clips.iter().map(|c| t.encode(c).expect("good").words).collect();
    bencher.counter(ItemsCount::new(CLIPS * FRAMES)).bench(|| {
        let frames: usize = words.iter().map(|w| t.decode(w, UncodedPose::Identity).expect("good").frames()).sum();
        assert_eq!(frames, CLIPS * FRAMES);
    });
}

/// The thesis's scheme: PCA to three of five components, tiles of 60 frames.
fn tiles(joints: usize) -> (Tokenizer, Vec<Clip>) {
    let (uniform, clips) = set(joints);
    let components = if joints == 24 { 42 } else { 23 };
    let dct = DctConfig { joint_transform: JointTransform::Pca { components }, ..DctConfig::default() };
    let config = TokenizerConfig { scheme: SchemeConfig::Dct(dct), ..uniform.config().clone() };
    (Tokenizer::fit(&clips, config).expect("good clips"), clips)
}

#[divan::bench(args = [13, 24])]
fn dct_encode_all_threads(bencher: Bencher, joints: usize) {
    let (t, clips) = tiles(joints);
    bencher.counter(ItemsCount::new(CLIPS * FRAMES)).bench(|| {
        let words: usize = clips.par_iter().map(|c| t.encode(black_box(c)).expect("good").words.len()).sum();
        assert_eq!(words, CLIPS * FRAMES.div_ceil(60));
    });
}

#[divan::bench(args = [13, 24])]
fn dct_decode_all_threads(bencher: Bencher, joints: usize) {
    let (t, clips) = tiles(joints);
    let words: Vec<_> = clips.iter().map(|c| t.encode(c).expect("good").words).collect();
    bencher.counter(ItemsCount::new(CLIPS * FRAMES)).bench(|| {
        let frames: usize = words.par_iter().map(|w| t.decode(w, UncodedPose::Identity).expect("good").frames()).sum();
        assert_eq!(frames, CLIPS * FRAMES.div_ceil(60) * 60);
    });
}

#[divan::bench(args = [13, 24])]
fn ids_and_back(bencher: Bencher, joints: usize) {
    let (t, clips) = set(joints);
    let words = t.encode(&clips[0]).expect("good").words;
    bencher.counter(ItemsCount::new(FRAMES)).bench(|| {
        let ids = t.ids_of_words(black_box(&words)).expect("whole words");
        assert_eq!(t.words_of_ids(&ids).words.len(), words.len());
    });
}
