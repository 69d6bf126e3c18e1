//! Frames a second of coding and decoding made-up motion, as one line of JSON: what `scripts/bench/tokenize_rate.py` stands
//! beside numpy.
//!
//!     cargo run --release -p kinelm-tokenizer --example tokenize_rate -- THREADS

use kinelm_motion::joints::THIRTEEN;
use kinelm_motion::rotation::exp_map;
use kinelm_motion::{Clip, Vec3, smpl};
use kinelm_tokenizer::{
    DctConfig, JointTransform, SchemeConfig, Tokenizer, TokenizerConfig, UncodedPose, UniformConfig, Words,
};
use rayon::prelude::*;
use std::time::Instant;

const CLIPS: usize = 8;
const FRAMES: usize = 4020;

/// The best of so many runs counts.
const RUNS: usize = 7;

/// One who walks in circles and swings every joint: the formula is also in the script.
fn clip(seed: usize) -> Clip {
    let wave = |i: usize, f: usize| (f as f64 * 0.05 * (1.0 + i as f64 / 40.0) + (i * (seed + 3)) as f64).sin();
    let root =
        (0..FRAMES).map(|f| Vec3::new(2.0 * wave(72, f), 0.95 + 0.03 * wave(73, f), 2.0 * wave(74, f))).collect();
    let vector = |f: usize, j: usize| Vec3::new(wave(3 * j, f), wave(3 * j + 1, f), wave(3 * j + 2, f)) * 0.8;
    let rotations = (0..FRAMES * 24).map(|i| exp_map::from_vector(vector(i / 24, i % 24))).collect();
    Clip::new(smpl::neutral(), 60.0, root, rotations).expect("finite")
}

fn best(frames: usize, mut work: impl FnMut()) -> f64 {
    let seconds = |_| {
        let start = Instant::now();
        work();
        start.elapsed().as_secs_f64()
    };
    frames as f64 / (0..RUNS).map(seconds).fold(f64::INFINITY, f64::min)
}

fn main() {
    let threads = std::env::args().nth(1).and_then(|n| n.parse().ok()).unwrap_or(1);
    rayon::ThreadPoolBuilder::new().num_threads(threads).build_global().expect("the first pool");
    let clips: Vec<Clip> = (0..CLIPS).map(clip).collect();
    let dct = DctConfig { joint_transform: JointTransform::Pca { components: 39 }, ..DctConfig::default() };
    let schemes = [("uniform", SchemeConfig::Uniform(UniformConfig::default())), ("dct", SchemeConfig::Dct(dct))];
    let rates = schemes.map(|(name, scheme)| {
        let config = TokenizerConfig { joints: THIRTEEN.to_vec(), fps: 60.0, scheme, ..Default::default() };
        let t = Tokenizer::fit(&clips, config).expect("good clips");
        let words: Vec<Words> = clips.iter().map(|c| t.encode(c).expect("good").words).collect();
        let encode = best(CLIPS * FRAMES, || {
            let again: Vec<Words> = clips.par_iter().map(|c| t.encode(c).expect("good").words).collect();
            assert_eq!(again, words);
        });
        let decode = best(CLIPS * FRAMES, || {
            let frames: usize =
                words.par_iter().map(|w| t.decode(w, UncodedPose::Identity).expect("good").frames()).sum();
            assert_eq!(frames, CLIPS * FRAMES);
        });
        format!("\"{name}\": {{\"encode\": {encode:.0}, \"decode\": {decode:.0}}}")
    });
    println!("{{\"threads\": {threads}, {}}}", rates.join(", "));
}
