//! The promises of the uniform scheme over whole clips.

use super::*;
use crate::contract::{bent, check_scheme, wild};
use crate::{Fit, Tokenizer, TokenizerConfig, UncodedPose, Words};
use kinelm_motion::joints::THIRTEEN;
use kinelm_motion::rotation::{Axis, EulerOrder, angle_between, exp_map};
use kinelm_motion::smpl;
use proptest::prelude::*;

/// Half a bin, with what rounding may add.
const HALF: f64 = 0.5 + 1e-6;

/// The default, of thirteen joints.
fn thirteen() -> TokenizerConfig {
    TokenizerConfig { joints: THIRTEEN.to_vec(), ..TokenizerConfig::default() }
}

fn config(bins: u32, translation: Travel, height: Height) -> TokenizerConfig {
    let uniform = UniformConfig { bins, translation, height, ..Default::default() };
    TokenizerConfig { scheme: super::super::SchemeConfig::Uniform(uniform), ..thirteen() }
}

fn training() -> Vec<Clip> {
    (0..6).map(|seed| bent(seed, 120)).collect()
}

/// Largest translation error in bins along the axes in which each step was coded, over the frames where nothing clips
/// from the last clipped one on.
fn worst_step(t: &Tokenizer, clip: &Clip) -> [f64; 3] {
    let u = t.uniform().unwrap();
    let words = t.encode(clip).unwrap().words;
    let back = t.decode(&words, UncodedPose::Identity).unwrap();
    let start = clip.root()[0] * Vec3::new(1.0, 0.0, 1.0);
    let mut worst = [0.0f64; 3];
    let mut walk = Walk::new(0.0, Travel::Velocity, Height::Velocity);
    for f in 0..clip.frames() {
        let miss = clip.root()[f] - start - back.root()[f];
        let turned = if u.config.translation == Travel::Velocity { walk.turned_in(miss) } else { miss };
        for i in 0..3 {
            worst[i] = worst[i].max(turned[i].abs() / u.translation[i].width);
        }
        walk.face(back.pose(f)[0]);
    }
    worst
}

#[test]
fn contract() {
    let clips = [training(), vec![wild(9, 200, 2.0, 0.05)]].concat();
    for bins in [360, 361, 60, 1080, 24] {
        for (translation, height) in [
            (Travel::Velocity, Height::Floor),
            (Travel::Velocity, Height::Velocity),
            (Travel::Velocity, Height::Absolute),
            (Travel::Absolute, Height::Absolute),
        ] {
            let t = Tokenizer::fit(&clips, config(bins, translation, height)).unwrap();
            check_scheme(&t, &clips);
        }
    }
    for joints in [vec![4], vec![0], (0..24).collect()] {
        let t = Tokenizer::fit(&clips, TokenizerConfig::uniform(&joints, 20.0, 360)).unwrap();
        check_scheme(&t, &clips);
    }
}

#[test]
fn rotations_within_half_a_bin() {
    let clips: Vec<Clip> = (0..6).map(|seed| wild(seed, 300, 1.5, 0.05)).collect();
    for form in [Form::Centred, Form::Edge] {
        let uniform = UniformConfig { form, ..Default::default() };
        let t = Tokenizer::fit(
            &clips,
            TokenizerConfig {
                root_rotation: crate::RootRotation::Absolute,
                scheme: super::super::SchemeConfig::Uniform(uniform),
                ..thirteen()
            },
        )
        .unwrap();
        let bound = 0.5 * 3f64.sqrt() * 1f64.to_radians() + 1e-9;
        for clip in &clips {
            let e = t.encode(clip).unwrap();
            let back = t.decode(&e.words, UncodedPose::Identity).unwrap();
            let mut over = 0;
            for f in 0..clip.frames() {
                for j in 0..24 {
                    if THIRTEEN.contains(&j) {
                        over += u64::from(angle_between(clip.pose(f)[j], back.pose(f)[j]) > bound);
                    } else {
                        assert_eq!(back.pose(f)[j], Quat::IDENTITY);
                    }
                }
            }
            assert!(over <= e.second_codes, "{over} {}", e.second_codes);
        }
    }
}

#[test]
fn errors_of_the_walk_never_add_up() {
    let mut clips = training();
    clips.push(bent(77, 2000));
    for bins in [360, 361, 60, 1080] {
        for (translation, height) in [Height::Floor, Height::Velocity, Height::Absolute].map(|h| (Travel::Velocity, h))
        {
            let t = Tokenizer::fit(&clips, config(bins, translation, height)).unwrap();
            for clip in &clips {
                assert!(t.encode(clip).unwrap().clipped == 0);
                let worst = worst_step(&t, clip);
                assert!(worst.iter().all(|&w| w <= HALF), "{bins}: {worst:?}");
            }
        }
    }
}

#[test]
fn a_clipped_step_is_caught_up() {
    let t = Tokenizer::fit(&training(), thirteen()).unwrap();
    let clip = bent(3, 100);
    let mut root = clip.root().to_vec();
    root[50..].iter_mut().for_each(|p| *p += Vec3::new(0.3, 0.05, -0.2));
    let jump = Clip::new(clip.skeleton().clone(), 20.0, root, clip.rotations().to_vec()).unwrap();
    let e = t.encode(&jump).unwrap();
    assert!(e.clipped > 0);
    let back = t.decode(&e.words, UncodedPose::Identity).unwrap();
    let miss = |f: usize| (jump.root()[f] - back.root()[f] - jump.root()[0] * Vec3::new(1.0, 0.0, 1.0)).length();
    assert!(miss(50) > 0.1 && miss(99) < 0.002, "{} {}", miss(50), miss(99));
}

#[test]
fn one_who_stands_still_has_one_word() {
    let t = Tokenizer::fit(&training(), thirteen()).unwrap();
    let height = t.uniform().unwrap().first_height();
    let place = Vec3::new(5.0, height, -7.0);
    let still = Clip::new(smpl::neutral(), 20.0, vec![place; 9], vec![Quat::IDENTITY; 9 * 24]).unwrap();
    let e = t.encode(&still).unwrap();
    let neutral = t.scheme().neutral(t.channels());
    assert!(e.words.iter().all(|word| word == neutral));
    let back = t.decode(&e.words, UncodedPose::Identity).unwrap();
    assert_eq!((back.root()[0].x, back.root()[0].z), (0.0, 0.0));
    assert!((back.root()[8].y - height).abs() < 1e-12);
}

#[test]
fn steps_are_seen_from_the_body() {
    let walk = |heading: f64| {
        let turn = exp_map::from_vector(Vec3::Y * heading);
        let root = (0..20).map(|f| turn * Vec3::new(0.0, 0.0, 0.05 * f as f64) + Vec3::Y).collect();
        let mut poses = vec![Quat::IDENTITY; 20 * 24];
        (0..20).for_each(|f| poses[f * 24] = turn);
        Clip::new(smpl::neutral(), 20.0, root, poses).unwrap()
    };
    let degrees = |d: f64| d.to_radians();
    let t = Tokenizer::fit(&[walk(0.0), walk(degrees(90.0))], thirteen()).unwrap();
    let of = |h: f64| t.encode(&walk(degrees(h))).unwrap().words;
    // whole degrees, so that the decoded heading is the true one; frame 1 steps ahead whatever the heading
    for h in [90.0, 37.0, -120.0] {
        assert_eq!(of(h).word(1)[..3], of(0.0).word(1)[..3], "{h}");
    }
}

#[test]
fn fit_in_parts_and_in_any_order_is_the_same() {
    let clips = training();
    let whole = Tokenizer::fit(&clips, thirteen()).unwrap();
    let part = |range: &[usize]| {
        let mut fit = Fit::new(thirteen()).unwrap();
        range.iter().for_each(|&i| fit.add(&clips[i]).unwrap());
        fit
    };
    let (mut a, b) = (part(&[5, 2, 0]), part(&[4, 1, 3]));
    a.merge(&b).unwrap();
    assert_eq!((a.clips(), a.frames()), (6, 720));
    assert_eq!(a.finish().unwrap().to_json(), whole.to_json());
    assert!(part(&[0]).merge(&Fit::new(TokenizerConfig::uniform(&[0], 20.0, 360)).unwrap()).is_err());
}

#[test]
fn the_fitted_range_is_that_of_the_training_steps() {
    let mut poses = vec![Vec3::new(1.0, 0.9, 2.0); 11];
    poses[4..].iter_mut().for_each(|p| p.x += 0.2);
    poses[7..].iter_mut().for_each(|p| p.x -= 0.1);
    let clip = |y: f64| {
        let root = poses.iter().map(|p| *p + Vec3::Y * y).collect();
        Clip::new(smpl::neutral(), 20.0, root, vec![Quat::IDENTITY; 11 * 24]).unwrap()
    };
    let t = Tokenizer::fit(&[clip(0.0), clip(0.4)], config(360, Travel::Velocity, Height::Velocity)).unwrap();
    let [x, y, z] = *t.uniform().unwrap().translation();
    assert!((x.width * 360.0 - 0.3 * 1.05).abs() < 1e-9);
    assert!((x.value(0) - 0.5 * x.width + 0.1 + 0.0075).abs() <= 0.5 * x.width + 1e-12);
    assert!((y.width * 360.0 - 0.4 * 1.05).abs() < 1e-9, "first steps of 20 cm up and down");
    assert!((z.width * 360.0 - 0.01).abs() < 1e-12);
    assert!((t.uniform().unwrap().first_height() - 1.1).abs() < 1e-9);
}

#[test]
fn heights_above_the_floor() {
    let clips = training();
    let t = Tokenizer::fit(&clips, config(360, Travel::Velocity, Height::Floor)).unwrap();
    let ys = || clips.iter().flat_map(|c| c.root().iter().map(|p| p.y));
    let (low, high) = (ys().fold(f64::MAX, f64::min), ys().fold(f64::MIN, f64::max));
    let margin = 0.1 * (high - low);
    let [from, to] = t.height_range().unwrap();
    assert!((from - low + margin).abs() < 1e-12 && (to - high - margin).abs() < 1e-12);
    // the bins reach over the range and a bin further at most
    let (u, y) = (t.uniform().unwrap(), t.uniform().unwrap().translation()[1]);
    let ends = [y.value(0) + u.first_height(), y.value(359) + u.first_height()];
    assert!((ends[0] - from).abs() <= y.width && (ends[1] - to).abs() <= y.width, "{ends:?} {from} {to}");
    let at = |heights: &[f64]| {
        let root = heights.iter().map(|&y| Vec3::new(0.0, y, 0.0)).collect();
        let clip = Clip::new(smpl::neutral(), 20.0, root, vec![Quat::IDENTITY; 24 * heights.len()]).unwrap();
        let e = t.encode(&clip).unwrap();
        (e.off_range, t.decode(&e.words, UncodedPose::Identity).unwrap().root().iter().map(|p| p.y).collect::<Vec<_>>())
    };
    // each height by itself: no step is too large, nothing adds up
    let (off, back) = at(&[low, high, low, 0.5 * (low + high)]);
    assert_eq!(off, 0);
    for (a, b) in [low, high, low, 0.5 * (low + high)].iter().zip(back) {
        assert!((a - b).abs() <= HALF * y.width);
    }
    // outside it clamps, is counted, and the next frame is right again
    let (off, back) = at(&[to + 1.0, low, from - 1.0]);
    assert_eq!(off, 2);
    assert!((back[0] - to).abs() <= y.width && (back[2] - from).abs() <= y.width);
    assert!((back[1] - low).abs() <= HALF * y.width);
    // whatever is drawn: a minute of any codes stays within the range
    let words = Words::fixed((0..1200 * 42).map(|i| (i * 7919 % 360) as u16).collect(), 42);
    let drawn = t.decode(&words, UncodedPose::Identity).unwrap();
    assert!(drawn.root().iter().all(|p| p.y >= from - y.width && p.y <= to + y.width));
}

#[test]
fn absolute_places() {
    let t = Tokenizer::fit(&training(), config(360, Travel::Absolute, Height::Absolute)).unwrap();
    let at = |x: f64, y: f64| {
        let root = vec![Vec3::new(1.0, y, 2.0), Vec3::new(1.0 + x, y, 2.0)];
        let e = t.encode(&Clip::new(smpl::neutral(), 20.0, root, vec![Quat::IDENTITY; 48]).unwrap()).unwrap();
        (e.words.word(1)[0], e.words.word(1)[1], e.clipped)
    };
    assert_eq!(at(1.0, 1.0), (237, 237, 0));
    assert_eq!(at(5.4, 1.0), (359, 237, 1));
    assert_eq!(at(-5.4, 0.0), (0, 180, 1));
    let worst = worst_step(&t, &bent(2, 100));
    assert!(worst.iter().all(|&w| w <= HALF), "{worst:?}");
}

#[test]
fn what_cannot_be_coded_is_named() {
    let t = Tokenizer::fit(&training(), thirteen()).unwrap();
    let error = |clip: &Clip| t.encode(clip).unwrap_err().to_string();
    assert!(error(&bent(1, 3).with_fps(30.0).unwrap()).contains("resample it first (`fps`)"));
    let far = Clip::new(smpl::neutral(), 20.0, vec![Vec3::ZERO, Vec3::X * 1e300], vec![Quat::IDENTITY; 48]).unwrap();
    assert!(error(&far).starts_with("frame 1, translation:"));
    let one = kinelm_motion::Skeleton::new(vec!["a".into()], vec![None], vec![Vec3::ZERO], vec![]).unwrap();
    let other = Clip::new(std::sync::Arc::new(one), 20.0, vec![Vec3::ZERO], vec![Quat::IDENTITY]).unwrap();
    assert!(error(&other).contains("retarget it first"));
    assert!(t.decode(&Words::fixed(vec![0; 42], 42), UncodedPose::Clip(&other)).is_err());
    assert!(
        t.decode(&Words::fixed(vec![360; 42], 42), UncodedPose::Identity).unwrap_err().to_string().contains("code 360")
    );
    assert!(Tokenizer::fit(&[], thirteen()).unwrap_err().to_string().contains("no training clip"));
    assert!(Tokenizer::fit(&[bent(1, 0)], thirteen()).is_err());
}

#[test]
fn joints_that_are_not_coded_come_from_where_the_caller_says() {
    let t = Tokenizer::fit(&training(), thirteen()).unwrap();
    let clip = bent(1, 5);
    let words = t.encode(&clip).unwrap().words;
    let pose: [Quat; 24] = std::array::from_fn(|j| clip.pose(2)[j]);
    let held = t.decode(&words, UncodedPose::Pose(&pose)).unwrap();
    assert_eq!((held.pose(4)[3], held.pose(0)[15]), (clip.pose(2)[3], clip.pose(2)[15]));
    let short = clip.slice(0..2);
    let along = t.decode(&words, UncodedPose::Clip(&short)).unwrap();
    assert_eq!((along.pose(0)[3], along.pose(4)[3]), (clip.pose(0)[3], clip.pose(1)[3]));
    assert_eq!(along.pose(4)[4], held.pose(4)[4]);
}

#[test]
fn six_decimals_of_degrees_and_centimetres_change_no_code() {
    let six = |x: f64| (x * 1e6).round() / 1e6;
    let order = EulerOrder([Axis::Z, Axis::X, Axis::Y]);
    for bins in [360, 361, 1080] {
        let clips = [bent(1, 200), wild(2, 200, 2.0, 0.04)];
        let t = Tokenizer::fit(&clips, TokenizerConfig::uniform(&THIRTEEN, 20.0, bins)).unwrap();
        for clip in &clips {
            let words = t.encode(clip).unwrap().words;
            let made = t.decode(&words, UncodedPose::Identity).unwrap();
            let root = made.root().iter().map(|p| Vec3::from_array(p.to_array().map(|x| six(x * 100.0) / 100.0)));
            let through = |q: &Quat| order.to_quat(order.from_quat(*q, 0.0).map(|a| six(a.to_degrees()).to_radians()));
            let rotations = made.rotations().iter().map(through).collect();
            let read = Clip::new(smpl::neutral(), 20.0, root.collect(), rotations).unwrap();
            assert_eq!(t.encode(&read).unwrap().words, words, "{bins}");
        }
    }
}

/// Streams of three frames each.
const STREAMS: usize = 100_000;

#[test]
fn any_codes_are_a_finite_clip() {
    let velocity = Tokenizer::fit(&training(), TokenizerConfig::uniform(&[0, 4], 20.0, 360)).unwrap();
    let edge = UniformConfig { form: Form::Edge, translation: Travel::Absolute, ..Default::default() };
    let scheme = super::super::SchemeConfig::Uniform(edge);
    let edge =
        Tokenizer::fit(&training(), TokenizerConfig { joints: vec![0, 4], scheme, ..Default::default() }).unwrap();
    let mut n = 1u64;
    for stream in 0..STREAMS {
        let codes: Vec<u16> = (0..27)
            .map(|_| {
                n = n.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1_442_695_040_888_963_407); // Knuth, MMIX
                ((n >> 33) % 360) as u16
            })
            .collect();
        let words = Words::fixed(codes, 9);
        for t in [&velocity, &edge] {
            let clip = t.decode(&words, UncodedPose::Identity).unwrap();
            assert!(clip.root().iter().all(|p| p.is_finite()) && clip.rotations().iter().all(|q| q.is_finite()));
            if stream % 8 == 0 {
                t.encode(&clip).unwrap();
            }
        }
    }
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(64))]
    #[test]
    fn coded_again_is_the_same(seed in any::<u64>(), reach in 0.1..2.5f64, speed in 0.0..0.3f64, bins in prop::sample::select(vec![360u32, 361, 60, 1080])) {
        let clip = wild(seed, 60, reach, speed);
        // fitted on another clip, so that steps clip too
        let t = Tokenizer::fit(&[bent(1, 50)], TokenizerConfig::uniform(&THIRTEEN, 20.0, bins)).unwrap();
        let words = t.encode(&clip).unwrap().words;
        let back = t.decode(&words, UncodedPose::Identity).unwrap();
        prop_assert_eq!(t.encode(&back).unwrap().words, words);
    }
}
