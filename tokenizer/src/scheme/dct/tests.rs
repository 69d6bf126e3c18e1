//! The promises of the tiles over whole clips.

use super::*;
use crate::channel::RootRotation;
use crate::contract::{bent, wild};
use crate::scheme::line::Line;
use crate::scheme::series::Anchor;
use crate::scheme::{Fitted, SchemeConfig};
use crate::{Height, JointTransform, Tokenizer, TokenizerConfig};
use kinelm_motion::joints::THIRTEEN;
use kinelm_motion::metric::GeodesicError;
use kinelm_motion::rotation::angle_between;
use kinelm_motion::{Quat, Vec3};
use proptest::prelude::*;

const ALL: [usize; 24] = [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23];

fn fit(dct: DctConfig, root_rotation: RootRotation, joints: &[usize], clips: &[Clip]) -> Tokenizer {
    let scheme = SchemeConfig::Dct(dct);
    let config = TokenizerConfig { joints: joints.to_vec(), root_rotation, scheme, ..Default::default() };
    Tokenizer::fit(clips, config).unwrap()
}

fn training() -> Vec<Clip> {
    (0..6).map(|seed| bent(seed, 200)).collect()
}

fn pca(components: u32) -> JointTransform {
    JointTransform::Pca { components }
}

/// Settings of every kind.
fn settings() -> Vec<DctConfig> {
    let base = DctConfig::default;
    vec![
        base(),
        DctConfig { tile: 15, joint_transform: JointTransform::None {}, keep: 0.3, ..base() },
        DctConfig { tile: 30, joint_transform: JointTransform::Ica { components: 8 }, keep: 0.2, ..base() },
        DctConfig { tile: 120, quantizer: Quantizer::Uniform, bins: 1000, keep: 0.05, longest_run: 7, ..base() },
        DctConfig {
            joint_transform: pca(72),
            quantizer: Quantizer::Uniform,
            steps: Steps::LeverArm,
            step: Some(0.02),
            bins: 2000,
            keep: 1.0,
            ..base()
        },
        DctConfig { steps: Steps::LeverArm, ..base() },
    ]
}

/// Mean angle error of the coded joints, radians.
fn angle_error(t: &Tokenizer, a: &Clip, b: &Clip) -> f64 {
    let mut error = GeodesicError::new(t.channels().joints().to_vec());
    error.add(a, &b.slice(0..a.frames())).unwrap();
    error.mean()
}

/// A clip and what it comes back as, as long as the clip.
fn through(t: &Tokenizer, clip: &Clip) -> Clip {
    let words = t.encode(clip).unwrap().words;
    t.decode(&words, UncodedPose::Identity).unwrap().slice(0..clip.frames())
}

/// The quantised components of all words, without path and turn.
fn components(t: &Tokenizer, words: &Words) -> Vec<i32> {
    let closed = series::closed_count(t.channels()) * t.frames_per_word();
    let of = |word| {
        let mut numbers = vec![];
        t.scheme().numbers(t.channels(), word, &mut numbers);
        numbers.split_off(closed)
    };
    words.iter().flat_map(of).collect()
}

#[test]
fn contract() {
    let clips = [training(), vec![wild(9, 200, 1.2, 0.05)]].concat();
    for root_rotation in [RootRotation::Absolute, RootRotation::HeadingDelta] {
        for (dct, joints) in settings().into_iter().zip([&THIRTEEN[..], &ALL, &[0, 4], &THIRTEEN, &ALL, &[4, 17]]) {
            let l = dct.tile as usize;
            let t = fit(dct, root_rotation, joints, &clips);
            for clip in &clips {
                for part in [clip.slice(0..0), clip.slice(0..1), clip.slice(0..l), clip.clone()] {
                    let e = t.encode(&part).unwrap();
                    t.check(&e.words).unwrap();
                    assert_eq!(e.words.len(), part.frames().div_ceil(l));
                    assert_eq!(e.padded as usize, e.words.len() * l - part.frames());
                    let back = t.decode(&e.words, UncodedPose::Identity).unwrap();
                    assert_eq!(back.frames(), e.words.len() * l);
                    // coded again it loses no more: the same words but where a vector near half a turn took its twin
                    let again = t.decode(&t.encode(&back).unwrap().words, UncodedPose::Identity).unwrap();
                    let (first, second) = (angle_error(&t, &part, &back), angle_error(&t, &back, &again));
                    assert!(second <= first + 1e-9, "{:?}: {first} {second}", t.config());
                }
            }
        }
    }
}

#[test]
fn coded_again_is_the_same() {
    // no joint comes near half a turn
    let clips: Vec<Clip> = (0..4).map(|seed| wild(seed, 130, 0.3, 0.05).slice(0..15)).collect();
    for dct in settings() {
        let t = fit(DctConfig { tile: 15, ..dct }, RootRotation::HeadingDelta, &THIRTEEN, &clips);
        for clip in &clips {
            let e = t.encode(clip).unwrap();
            let again = t.encode(&t.decode(&e.words, UncodedPose::Identity).unwrap()).unwrap();
            // all but the path, whose start is another: the first place as it was decoded
            assert_eq!(components(&t, &again.words), components(&t, &e.words), "{:?}", t.config());
        }
    }
}

/// The stated bound: keep = 1, a step, nothing clipped.
#[test]
fn within_half_a_step() {
    let arms = series::lever_arms();
    for (steps, tile, step) in [(Steps::Equal, 60, 0.05), (Steps::LeverArm, 30, 0.01), (Steps::Equal, 15, 0.2)] {
        for root_rotation in [RootRotation::Absolute, RootRotation::HeadingDelta] {
            let dct = DctConfig {
                tile,
                joint_transform: JointTransform::None {},
                keep: 1.0,
                bins: 20_000,
                quantizer: Quantizer::Uniform,
                steps,
                step: Some(step),
                longest_run: 100,
                height: Height::Floor,
            };
            let clips: Vec<Clip> = (0..3).map(|seed| wild(seed, 250, 1.0, 0.05)).collect();
            let t = fit(dct, root_rotation, &ALL, &clips[..2]);
            for clip in &clips {
                assert_eq!(t.encode(clip).unwrap().clipped, 0);
                let back = through(&t, clip);
                for frames in tiles(clip.frames(), tile as usize).filter(|f| f.len() == tile as usize) {
                    check_tile(clip, &back, frames, step, |j| if steps == Steps::LeverArm { arms[j] } else { 1.0 });
                }
            }
        }
    }
}

fn check_tile(clip: &Clip, back: &Clip, frames: Range<usize>, step: f64, weight: impl Fn(usize) -> f64) {
    let n = frames.len() as f64;
    let (rms, any) = (0.5 * step * (1.0 + 1e-9), step * (0.5 * n).sqrt());
    let shift = clip.root()[0] * Vec3::new(1.0, 0.0, 1.0);
    let mut path = Vec3::ZERO;
    for f in frames.clone() {
        let miss = clip.root()[f] - shift - back.root()[f];
        assert!(miss.length() <= 3f64.sqrt() * any, "{f}: {miss}");
        path += miss * miss;
    }
    assert!((path / n).element_sum().sqrt() <= 3f64.sqrt() * rms, "path of {frames:?}: {path}");
    for j in 0..24 {
        let angle = |f: usize| angle_between(clip.pose(f)[j], back.pose(f)[j]) * weight(j);
        let square = frames.clone().map(|f| angle(f).powi(2)).sum::<f64>();
        assert!((square / n).sqrt() <= 3f64.sqrt() * rms, "joint {j} of {frames:?}: {square}");
        assert!(frames.clone().all(|f| angle(f) <= 3f64.sqrt() * any), "joint {j} of {frames:?}");
    }
}

#[test]
fn the_error_is_what_was_left_out() {
    let clips = training();
    let dct = DctConfig { joint_transform: JointTransform::None {}, keep: 0.1, bins: 5000, ..Default::default() };
    let t = fit(dct.clone(), RootRotation::Absolute, &THIRTEEN, &clips);
    let Fitted::Dct(fitted) = &t.fitted else { panic!("another scheme") };
    let mut tile = Tile::new(&dct, t.channels(), &fitted.mix, fitted.first_height);
    tile.analyse(&clips[1], start(&clips[1]), 0..60);
    let (whole, mut coded) = (tile.series.clone(), tile.series.clone());
    let mut codes = vec![None; coded.len()];
    fitted.quantise(&mut coded, &mut vec![], &mut codes);
    // the share, to the number: of 180 of the path and of 39 times 60 components
    let count = |codes: &[Option<u16>]| codes.iter().flatten().count();
    assert_eq!((count(&codes[..180]), count(&codes[180..])), (18, 234));
    let least =
        whole[180..].iter().zip(&codes[180..]).filter(|(_, k)| k.is_some()).map(|(x, _)| x.abs()).fold(9e9, f64::min);
    assert!(whole[180..].iter().zip(&codes[180..]).all(|(x, k)| k.is_some() || x.abs() <= least));
    let left_out: f64 = whole[180..].iter().zip(&coded[180..]).map(|(a, b)| (a - b).powi(2)).sum();
    let mut open = vec![0.0; 39 * 60];
    series::open(t.channels(), &clips[1], 0..60, 60, &mut open);
    tile.series = coded;
    tile.anchor = Anchor::new(fitted.first_height);
    tile.synthesise();
    let missed: f64 = open.iter().zip(&tile.open).map(|(a, b)| (a - b).powi(2)).sum();
    assert!((missed - left_out).abs() < 1e-9 * left_out, "{missed} {left_out}");
}

#[test]
fn errors_of_the_path_never_add_up() {
    for root_rotation in [RootRotation::Absolute, RootRotation::HeadingDelta] {
        let t = fit(DctConfig { tile: 30, ..Default::default() }, root_rotation, &THIRTEEN, &training());
        let clip = bent(77, 3000);
        let back = through(&t, &clip);
        let miss = |f: usize| (clip.root()[f] - back.root()[f] - (clip.root()[0] - back.root()[0])).length();
        let worst = |frames: Range<usize>| frames.map(miss).fold(0.0, f64::max);
        assert!(worst(2700..3000) < 2.0 * worst(0..300).max(0.02), "{} {}", worst(0..300), worst(2700..3000));
    }
}

#[test]
fn words_do_not_depend_on_where_one_faces() {
    let t = fit(DctConfig { tile: 15, ..Default::default() }, RootRotation::HeadingDelta, &THIRTEEN, &training());
    let clip = bent(2, 90);
    let words = t.encode(&clip).unwrap().words;
    for turn in [0.7, 2.0, -2.9] {
        let turn = super::super::pelvis::about_y(turn);
        let root = clip.root().iter().map(|p| turn * *p).collect();
        let rotations =
            clip.rotations().iter().enumerate().map(|(i, q)| if i % 24 == 0 { turn * *q } else { *q }).collect();
        let turned = Clip::new(clip.skeleton().clone(), 20.0, root, rotations).unwrap();
        let turned = t.encode(&turned).unwrap().words;
        // the first word turns from heading 0, and how its end was rounded moves path and turn of the next ones by a bin
        assert_eq!(components(&t, &turned), components(&t, &words));
    }
}

#[test]
fn bins_and_matrices_are_checked() {
    let t = fit(DctConfig::default(), RootRotation::HeadingDelta, &[0, 4], &training());
    let Fitted::Dct(fitted) = &t.fitted else { panic!("another scheme") };
    fitted.validate(t.channels()).unwrap();
    let wrong = |f: fn(&mut DctTiles)| {
        let mut d = fitted.clone();
        f(&mut d);
        d.validate(t.channels()).unwrap_err().to_string()
    };
    assert!(wrong(|d| d.turn = None).contains("heading_delta"));
    assert!(wrong(|d| d.first_height = f64::NAN).contains("first_height"));
    assert!(wrong(|d| d.path = Table::Uniform(Line::fitted(-1.0, 1.0, 360))).contains("other kind"));
    assert!(wrong(|d| d.config.joint_transform = pca(2)).contains("2 components of 5 channels"));
    assert!(wrong(|d| d.config.bins = 20).contains("20"));
    let bad = |f: fn(&mut DctConfig)| {
        let mut c = DctConfig::default();
        f(&mut c);
        c.validate().unwrap_err().to_string()
    };
    assert!(bad(|c| c.tile = 14).contains("15 to 120"));
    assert!(bad(|c| c.keep = 0.0).contains("keep"));
    assert!(bad(|c| c.keep = f64::NAN).contains("keep"));
    assert!(bad(|c| c.bins = 1).contains("2 bins"));
    assert!(bad(|c| c.bins = 21_000).contains("21054"));
    assert!(bad(|c| c.step = Some(0.1)).contains("quantile"));
    assert!(bad(|c| (c.quantizer, c.step) = (Quantizer::Uniform, Some(0.0))).contains("1e-6 to 10"));
    assert!(bad(|c| c.joint_transform = pca(0)).contains("components"));
    assert_eq!(t.scheme().fitted_numbers(), 5 + 25 + fitted.tables().map(|(_, t)| t.numbers()).sum::<u64>() + 1);
}

#[test]
fn little_to_learn_from() {
    for root_rotation in [RootRotation::Absolute, RootRotation::HeadingDelta] {
        for dct in settings() {
            let still =
                Clip::new(smpl::neutral(), 20.0, vec![Vec3::new(2.0, 0.9, 1.0)], vec![Quat::IDENTITY; 24]).unwrap();
            let t = fit(dct, root_rotation, &THIRTEEN, std::slice::from_ref(&still));
            let words = t.encode(&still).unwrap().words;
            assert_eq!((words.len(), words.word(0)), (1, &[][..]), "one who stands still says nothing");
            let back = t.decode(&words, UncodedPose::Identity).unwrap();
            assert!((back.root()[7] - Vec3::new(0.0, 0.9, 0.0)).length() < 1e-12);
            t.decode(&t.encode(&bent(1, 130)).unwrap().words, UncodedPose::Identity).unwrap();
        }
    }
    let nothing = Tokenizer::fit(
        &[bent(1, 0)],
        TokenizerConfig { scheme: SchemeConfig::Dct(DctConfig::default()), ..Default::default() },
    );
    assert!(nothing.unwrap_err().to_string().contains("no training clip"));
    let far = Clip::new(smpl::neutral(), 20.0, vec![Vec3::ZERO, Vec3::X * 1e300], vec![Quat::IDENTITY; 48]).unwrap();
    let t = fit(DctConfig::default(), RootRotation::Absolute, &[0], &training());
    assert!(t.encode(&far).unwrap_err().to_string().starts_with("frame 1, translation:"));
}

#[test]
fn the_largest_share_with_ties() {
    let of = |x: &[f64], share: f64| {
        let mut kept = vec![];
        largest(x, share, &mut vec![], |i, _| kept.push(i));
        kept
    };
    assert_eq!(of(&[1.0, -3.0, 2.0, 0.0], 0.5), [1, 2]);
    assert_eq!(of(&[1.0, -1.0, 1.0, -1.0], 0.5), [0, 1], "of equal ones the first");
    assert_eq!(of(&[5.0, 1.0, 1.0, 1.0, 7.0], 0.6), [0, 1, 4]);
    assert_eq!(of(&[5.0, 1.0], 1e-9), [0], "at least one");
    assert_eq!(of(&[0.0, 0.0, 0.0], 1.0), [0, 1, 2]);
    assert_eq!(of(&(0..60).map(f64::from).collect::<Vec<_>>(), 0.1).len(), 6, "0.1 times 60 is 6, not 7");
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(48))]
    #[test]
    fn any_words_are_a_clip(seed in any::<u64>(), lengths in prop::collection::vec(0usize..400, 1..6)) {
        let mut n = seed | 1;
        let mut next = move || {
            n = n.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407); // Knuth, MMIX
            (n >> 33) as u32
        };
        for (dct, root_rotation) in settings().into_iter().zip([RootRotation::Absolute, RootRotation::HeadingDelta].into_iter().cycle()) {
            let t = fit(DctConfig { joint_transform: pca(3), ..dct }, root_rotation, &[0, 4], &[bent(1, 150)]);
            let WordLength::Varying { most } = t.word_length() else { panic!("words of one length") };
            let mut words = Words::new();
            for &length in &lengths {
                let word: Vec<u16> = (0..length.min(most)).map(|_| (next() % t.scheme().symbols()) as u16).collect();
                words.push(&word);
            }
            let clip = t.decode(&words, UncodedPose::Identity).unwrap();
            prop_assert_eq!(clip.frames(), words.len() * t.frames_per_word());
            prop_assert!(clip.root().iter().all(|p| p.is_finite()) && clip.rotations().iter().all(|q| q.is_finite()));
            let mut numbers = vec![];
            words.iter().for_each(|word| t.scheme().numbers(t.channels(), word, &mut numbers));
            prop_assert_eq!(numbers.len(), words.len() * most);
        }
    }

    #[test]
    fn short_and_wild_clips(seed in any::<u64>(), frames in 1usize..70, reach in 0.1..2.5f64, speed in 0.0..0.3f64) {
        let clip = wild(seed, frames, reach, speed);
        for dct in settings() {
            let t = fit(dct, RootRotation::HeadingDelta, &THIRTEEN, &[bent(1, 100)]);
            let back = through(&t, &clip);
            prop_assert!(back.rotations().iter().all(|q| q.is_normalized()));
        }
    }
}
