//! The contract of every scheme, and clips to check it on.

use crate::scheme::dct::{DctConfig, Quantizer, Steps};
use crate::scheme::lapped::LappedConfig;
use crate::{
    JointTransform, QuantileConfig, RootRotation, SchemeConfig, Tokenizer, TokenizerConfig, UncodedPose, Words,
};
use kinelm_motion::rotation::exp_map;
use kinelm_motion::{Clip, Vec3, smpl};

/// A clip of 20 frames per second in which every joint swings and the body walks and turns; another for each seed.
pub fn bent(seed: u64, frames: usize) -> Clip {
    wild(seed, frames, 0.9, 0.05)
}

/// [`bent`] with joint angles up to `3 reach` radians and steps of up to `speed` metres a frame.
pub fn wild(seed: u64, frames: usize, reach: f64, speed: f64) -> Clip {
    let mut n = seed.wrapping_mul(0x9E37_79B9_7F4A_7C15) | 1;
    let mut next = move || {
        // xorshift; Marsaglia (2003)
        n ^= n << 13;
        n ^= n >> 7;
        n ^= n << 17;
        (n >> 11) as f64 / (1u64 << 53) as f64
    };
    let waves: Vec<[f64; 3]> = (0..75).map(|_| [next() * 2.0 - 1.0, 0.02 + 0.3 * next(), 6.3 * next()]).collect();
    let wave = |i: usize, f: usize| waves[i][0] * (waves[i][1] * f as f64 + waves[i][2]).sin();
    let mut at = Vec3::new(3.0 * next(), 0.9 + 0.1 * next(), 3.0 * next());
    let (mut root, mut rotations) = (Vec::new(), Vec::new());
    for f in 0..frames {
        root.push(at);
        at += Vec3::new(wave(72, f), 0.3 * wave(73, f), wave(74, f)) * speed;
        for j in 0..24 {
            let turn = if j == 0 { Vec3::Y * (0.07 * f as f64) } else { Vec3::ZERO };
            let v = Vec3::from_array(std::array::from_fn(|i| reach * 1.7 * wave(3 * j + i, f)));
            rotations.push(exp_map::from_vector(turn) * exp_map::from_vector(v));
        }
    }
    Clip::new(smpl::neutral(), 20.0, root, rotations).unwrap()
}

/// A small tokenizer of every scheme, for contracts that hold for all.
pub fn presets() -> Vec<(&'static str, Tokenizer)> {
    let clips: Vec<Clip> = (0..6).map(|seed| bent(seed, 150)).collect();
    let fit = |config: TokenizerConfig| Tokenizer::fit(&clips, config).unwrap();
    let uniform = || TokenizerConfig::uniform(&[0, 4, 16], 20.0, 90);
    let frames = |scheme| TokenizerConfig { root_rotation: RootRotation::HeadingDelta, scheme, ..uniform() };
    let joint_transform = JointTransform::Pca { components: 6 };
    let quantile = |joint_transform| QuantileConfig { bins: 90, joint_transform, ..Default::default() };
    let dct = || DctConfig { tile: 15, bins: 90, longest_run: 20, ..Default::default() };
    let lapped = |hop| LappedConfig { hop, levels: 5, runs: 9, ..Default::default() };
    let in_places = DctConfig { quantizer: Quantizer::Uniform, steps: Steps::LeverArm, keep: 0.3, ..dct() };
    vec![
        ("uniform", fit(uniform())),
        ("uniform, merged", fit(TokenizerConfig { merges: 60, ..uniform() })),
        ("uniform, headings", fit(frames(uniform().scheme))),
        ("quantile, headings", fit(frames(SchemeConfig::Quantile(quantile(JointTransform::None {}))))),
        ("quantile, pca", fit(frames(SchemeConfig::Quantile(quantile(joint_transform))))),
        ("dct", fit(TokenizerConfig { scheme: SchemeConfig::Dct(dct()), ..uniform() })),
        ("dct, headings, lever arms", fit(frames(SchemeConfig::Dct(in_places)))),
        ("lapped", fit(TokenizerConfig { scheme: SchemeConfig::Lapped(lapped(8)), ..uniform() })),
        ("lapped, headings, merged", fit(TokenizerConfig { merges: 40, ..frames(SchemeConfig::Lapped(lapped(15))) })),
    ]
}

/// Pelvis and left knee in 60 bins.
pub fn small() -> Tokenizer {
    Tokenizer::fit([&bent(1, 20)], TokenizerConfig::uniform(&[0, 4], 20.0, 60)).unwrap()
}

/// Codes are below the number of symbols and words of a right length; decoding takes whatever coding gives, and coding that
/// again gives the same; empty clips and clips of one frame work; `neutral` decodes to one who stands still.
pub fn check_scheme(t: &Tokenizer, clips: &[Clip]) {
    let symbols = t.vocabulary().characters();
    for clip in clips {
        for part in [clip.slice(0..0), clip.slice(0..1), clip.clone()] {
            let e = t.encode(&part).unwrap();
            t.check(&e.words).unwrap();
            assert_eq!(e.words.len(), part.frames().div_ceil(t.frames_per_word()));
            assert_eq!(e.padded as usize, e.words.len() * t.frames_per_word() - part.frames());
            assert!(e.words.codes().iter().all(|&k| u32::from(k) < symbols));
            let back = t.decode(&e.words, UncodedPose::Identity).unwrap();
            assert_eq!((back.frames(), back.fps()), (e.words.len() * t.frames_per_word(), t.fps()));
            let again = t.encode(&back).unwrap();
            assert_eq!(again.words, e.words);
            assert!(again.second_codes == 0 && again.clipped == 0, "{again:?}");
        }
    }
    let mut still = Words::new();
    (0..3).for_each(|_| still.push(&t.neutral()));
    let still = t.decode(&still, UncodedPose::Identity).unwrap();
    let last = still.frames() - 1;
    assert!((still.root()[last] - still.root()[0]).length() < 1e-9);
}
