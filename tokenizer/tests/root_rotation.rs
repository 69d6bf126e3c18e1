//! What coding the pelvis absolutely or by heading steps does to bits and errors of real motion, where it is on hand.
//!
//! `cargo test --release -p kinelm-tokenizer --test root_rotation -- --nocapture` prints the figures.

mod prepared;

use kinelm_motion::rotation::{angle_between, exp_map};
use kinelm_motion::{Clip, Vec3};
use kinelm_tokenizer::{
    Height, QuantileConfig, RootRotation, SchemeConfig, Tokenizer, TokenizerConfig, UncodedPose, UniformConfig, Words,
};
use rayon::prelude::*;

/// Bits a frame: of all channels, and of the pelvis's three characters alone.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Bits {
    all: f64,
    pelvis: f64,
}

/// Cross-entropy of the test words under a static table a channel, fitted on the training words with add-one counts.
/// `number` gives what is counted at a place of a frame, from `low..=high`, `None` where a clip's frame has none.
fn bits(
    train: &[Words],
    test: &[Words],
    low: i32,
    high: i32,
    number: impl Fn(&Words, usize, usize) -> Option<i32>,
) -> Bits {
    let length = train[0].word(0).len();
    let column = |words: &[Words], place: usize| -> Vec<usize> {
        let of = |w: &Words| (0..w.len()).filter_map(|f| number(w, f, place)).collect::<Vec<_>>();
        words.iter().flat_map(of).map(|n| (n - low) as usize).collect()
    };
    let per_channel = (0..length).map(|place| {
        let mut counts = vec![1.0; (high - low + 1) as usize];
        column(train, place).into_iter().for_each(|n| counts[n] += 1.0);
        let total: f64 = counts.iter().sum();
        let tested = column(test, place);
        tested.iter().map(|&n| -(counts[n] / total).log2()).sum::<f64>() / tested.len() as f64
    });
    let per_channel: Vec<f64> = per_channel.collect();
    Bits { all: per_channel.iter().sum(), pelvis: per_channel[3..6].iter().sum() }
}

/// A clip that faces another way: turned about the vertical.
fn turned(clip: &Clip, radians: f64) -> Clip {
    let turn = exp_map::from_vector(Vec3::Y * radians);
    let root = clip.root().iter().map(|p| turn * *p).collect();
    let mut rotations = clip.rotations().to_vec();
    rotations.iter_mut().step_by(24).for_each(|q| *q = turn * *q);
    Clip::new(clip.skeleton().clone(), clip.fps(), root, rotations).expect("as good as the clip")
}

/// Order-0 bits of codes, and of a code less that of the frame before.
fn measure(t: &Tokenizer, train: &[&Clip], test: &[&Clip]) -> [Bits; 2] {
    let words = |clips: &[&Clip]| -> Vec<Words> {
        clips.par_iter().map(|c| t.encode(c).expect("a prepared clip").words).filter(|w| !w.is_empty()).collect()
    };
    let (train, test) = (words(train), words(test));
    let top = t.scheme().symbols() as i32 - 1;
    let code = |w: &Words, f: usize, place: usize| i32::from(w.word(f)[place]);
    let order0 = bits(&train, &test, 0, top, |w, f, place| Some(code(w, f, place)));
    let step = |w: &Words, f: usize, place: usize| Some(code(w, f, place) - code(w, f.checked_sub(1)?, place));
    [order0, bits(&train, &test, -top, top, step)]
}

/// Largest angle between a clip's pelvis and its decoding, degrees, and how many second codes there are.
fn worst_pelvis(t: &Tokenizer, clips: &[&Clip]) -> (f64, u64) {
    let of = |clip: &&Clip| {
        let e = t.encode(clip).expect("a prepared clip");
        let back = t.decode(&e.words, UncodedPose::Identity).expect("codes of an encoder");
        let off = |f: usize| angle_between(clip.pose(f)[0], back.pose(f)[0]).to_degrees();
        ((0..clip.frames()).map(off).fold(0.0, f64::max), e.second_codes)
    };
    clips.par_iter().map(of).reduce(|| (0.0, 0), |a, b| (a.0.max(b.0), a.1 + b.1))
}

fn check(set: &str, test: &str, skip: usize) {
    let Some(clips) = prepared::clips(set, test, skip) else { return };
    let of = |split: &str| clips.iter().filter(|(_, s)| s == split).map(|(c, _)| c).collect::<Vec<_>>();
    let (train, test) = (of("train"), of("test"));
    // multiples of the golden angle: all ways alike
    let elsewhere: Vec<Clip> = test.iter().enumerate().map(|(i, clip)| turned(clip, 2.399_963 * i as f64)).collect();
    let elsewhere: Vec<&Clip> = elsewhere.iter().collect();
    let frames: usize = test.iter().map(|c| c.frames()).sum();
    println!("{set}: {} clips to train, {} to test ({frames} frames), 20 frames/s, 13 joints", train.len(), test.len());
    // heights as steps: the clips are as they are in the world
    let uniform = UniformConfig { height: Height::Velocity, ..Default::default() };
    let quantile = QuantileConfig { height: Height::Velocity, ..Default::default() };
    for scheme in [SchemeConfig::Uniform(uniform), SchemeConfig::Quantile(quantile)] {
        let of = |root_rotation| figures(&scheme, root_rotation, &train, &test, &elsewhere);
        let [absolute, delta] = [RootRotation::Absolute, RootRotation::HeadingDelta].map(of);
        assert!(delta[0].pelvis < absolute[0].pelvis, "a facing costs bits: {absolute:?} {delta:?}");
        assert!(delta[1].pelvis < absolute[1].pelvis, "so does a jump at half a turn: {absolute:?} {delta:?}");
        assert!((delta[2].all - delta[0].all).abs() < 0.5, "words don't say where one faces: {delta:?}");
        assert!(absolute[2].pelvis > delta[2].pelvis + 4.0, "{absolute:?} {delta:?}");
    }
}

/// Bits of codes, of differences, and both of the test clips `elsewhere`; prints them.
fn figures(
    scheme: &SchemeConfig,
    root_rotation: RootRotation,
    train: &[&Clip],
    test: &[&Clip],
    elsewhere: &[&Clip],
) -> [Bits; 4] {
    let config = TokenizerConfig { root_rotation, scheme: scheme.clone(), ..Default::default() };
    let t = Tokenizer::fit(train.iter().copied(), config).expect("good clips");
    let [codes, differences] = measure(&t, train, test);
    let [codes_there, differences_there] = measure(&t, train, elsewhere);
    let (worst, second) = worst_pelvis(&t, test);
    println!(
        "  {} {root_rotation:?}, bits/frame of all channels (of the pelvis):",
        if t.uniform().is_some() { "uniform" } else { "quantile" }
    );
    for (what, bits) in [
        ("order-0", codes),
        ("differences", differences),
        ("order-0, turned", codes_there),
        ("differences, turned", differences_there),
    ] {
        println!("    {what:19} {:7.2} ({:5.2})", bits.all, bits.pelvis);
    }
    println!("    pelvis off by at most {worst:.3} degrees; {second} second codes");
    if t.uniform().is_some() && second == 0 {
        assert!(worst <= 0.5 + 0.5f64.sqrt() + 1e-6, "half a bin of the turn and of each number of the tilt");
    }
    [codes, differences, codes_there, differences_there]
}

#[test]
fn cmu_dance() {
    check("cmu-dance", "root_rotation::cmu_dance", 10);
}

#[test]
fn bandai_2() {
    check("bandai-2", "root_rotation::bandai_2", 0);
}
