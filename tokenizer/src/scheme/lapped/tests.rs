use super::*;
use crate::contract::{bent, check_scheme, wild};
use crate::{RootRotation, SchemeConfig, Tokenizer, TokenizerConfig};
use kinelm_motion::metric::{BorderJerk, Mpjpe};
use kinelm_motion::rotation::angle_between;
use kinelm_motion::synth;

const ALL: [RootRotation; 2] = [RootRotation::Absolute, RootRotation::HeadingDelta];

fn config(joints: &[usize], root_rotation: RootRotation, lapped: LappedConfig) -> TokenizerConfig {
    let scheme = SchemeConfig::Lapped(lapped);
    TokenizerConfig { joints: joints.to_vec(), root_rotation, scheme, ..Default::default() }
}

fn fit(clips: &[Clip], root_rotation: RootRotation, lapped: LappedConfig) -> Tokenizer {
    Tokenizer::fit(clips, config(&(0..24).collect::<Vec<_>>(), root_rotation, lapped)).unwrap()
}

fn clips() -> Vec<Clip> {
    (1..5).map(|seed| bent(seed, 90 + 7 * seed as usize)).collect()
}

fn hop(hop: u32) -> LappedConfig {
    LappedConfig { hop, ..Default::default() }
}

fn lapped(t: &Tokenizer) -> &Lapped {
    match &t.fitted {
        crate::scheme::Fitted::Lapped(l) => l,
        other => panic!("{other:?}"),
    }
}

fn decode(t: &Tokenizer, words: &Words) -> Clip {
    t.decode(words, UncodedPose::Identity).unwrap()
}

/// With the words' word `at` changed to `word`.
fn changed(words: &Words, at: usize, word: &[u16]) -> Words {
    let mut out = Words::new();
    words.iter().enumerate().for_each(|(i, w)| out.push(if i == at { word } else { w }));
    out
}

#[test]
fn keeps_the_contract() {
    for root_rotation in ALL {
        for lapped in [
            hop(1),
            hop(2),
            hop(15),
            LappedConfig { joint_transform: LappedMix::None {}, levels: 2, runs: 3, ..hop(20) },
            LappedConfig { step_mm: 2.0, thrift: 0.0, ..hop(30) },
        ] {
            check_scheme(&fit(&clips(), root_rotation, lapped), &clips()[..2]);
        }
    }
    for joints in [vec![4], vec![0], vec![0, 4, 17]] {
        for root_rotation in ALL {
            check_scheme(&Tokenizer::fit(&clips(), config(&joints, root_rotation, hop(12))).unwrap(), &clips()[..1]);
        }
    }
}

#[test]
fn open_channels_keep_their_bound() {
    for root_rotation in ALL {
        for config in [hop(16), LappedConfig { joint_transform: LappedMix::None {}, thrift: 0.2, ..hop(25) }] {
            let t = fit(&clips(), root_rotation, config.clone());
            let clip = wild(9, 150, 0.7, 0.03);
            let words = t.encode(&clip).unwrap().words;
            let back = decode(&t, &words);
            let n = back.frames();
            let (was, is) = (open_rows(t.channels(), &clip, n), open_rows(t.channels(), &back, n));
            let k = was.len() / n;
            let squares: f64 = (0..n)
                .map(|f| {
                    let off: Vec<f64> = (0..k).map(|c| was[c * n + f] - is[c * n + f]).collect();
                    lapped(&t).weigh(&off).iter().map(|x| x * x).sum::<f64>()
                })
                .sum();
            let rms = (squares / n as f64).sqrt();
            assert!(rms < config.step() * (k as f64).sqrt(), "{rms}");
            assert!(rms > 0.0);
        }
    }
}

#[test]
fn errors_on_the_ground_never_add_up() {
    for root_rotation in ALL {
        let t = fit(&clips(), root_rotation, hop(10));
        let clip = wild(3, 2000, 0.3, 0.08);
        let back = decode(&t, &t.encode(&clip).unwrap().words);
        let root = root::Root::new(lapped(&t), t.channels());
        let start = clip.root()[0] * Vec3::new(1.0, 0.0, 1.0);
        let off = |f: usize| (clip.root()[f] - start - back.root()[f]).length();
        let mean = |range: std::ops::Range<usize>| range.clone().map(off).sum::<f64>() / range.len() as f64;
        assert!(
            mean(1800..2000) < 1.5 * mean(0..200) + root.displacement_step(),
            "{} {}",
            mean(0..200),
            mean(1800..2000)
        );
        // half a step of the way in each direction, and what the waves of the hops around leave
        assert!((0..2000).all(|f| off(f) < 0.05), "{:?}", (0..2000).map(off).fold(0.0, f64::max));
    }
}

#[test]
fn a_second_trip_loses_nothing() {
    let t = fit(&clips(), RootRotation::HeadingDelta, hop(20));
    for frames in [1, 2, 19, 20, 21, 97] {
        let once = decode(&t, &t.encode(&bent(8, frames)).unwrap().words);
        let twice = decode(&t, &t.encode(&once).unwrap().words);
        let mut moved = Mpjpe::default();
        moved.add(&once, &twice).unwrap();
        assert!(moved.max_mm() < 1e-6, "{frames}: {}", moved.max_mm());
    }
}

#[test]
fn a_changed_word_stays_in_its_window_and_what_follows_is_moved_as_one() {
    for root_rotation in ALL {
        let t = fit(&clips(), root_rotation, hop(14));
        let words = t.encode(&bent(6, 140)).unwrap().words;
        let other = t.encode(&wild(7, 14, 0.9, 0.08)).unwrap().words;
        let (a, b) = (decode(&t, &words), decode(&t, &changed(&words, 4, other.word(0))));
        let (from, to) = (4 * 14 - 7, 5 * 14 + 7);
        let turn = |f: usize| b.pose(f)[0] * a.pose(f)[0].conjugate();
        let moved = |f: usize| b.root()[f] - turn(139) * a.root()[f];
        for f in (0..from).chain(to..140) {
            let (before, pelvis) = (f < from, a.pose(f)[0]);
            for j in 1..24 {
                assert!(angle_between(a.pose(f)[j], b.pose(f)[j]) < 1e-9, "frame {f}, joint {j}");
            }
            assert!((a.root()[f].y - b.root()[f].y).abs() < 1e-9);
            if before || root_rotation == RootRotation::Absolute {
                assert!(angle_between(pelvis, b.pose(f)[0]) < 1e-9, "frame {f}");
            }
            if before {
                assert!((a.root()[f] - b.root()[f]).length() < 1e-9, "frame {f}");
            } else {
                assert!(angle_between(turn(f), turn(139)) < 1e-9, "frame {f}");
                assert!((moved(f) - moved(139)).length() < 1e-9, "frame {f}");
            }
        }
        assert!(angle_between(a.pose(62)[5], b.pose(62)[5]) > 1e-3, "something did change");
    }
}

#[test]
fn words_before_the_last_two_hold_when_a_clip_goes_on() {
    let whole = bent(5, 200);
    for root_rotation in ALL {
        for n in [1, 7, 20] {
            let t = fit(&clips(), root_rotation, hop(n));
            let words = t.encode(&whole).unwrap().words;
            for frames in 40..60 {
                let part = t.encode(&whole.slice(0..frames)).unwrap().words;
                let settled = part.len() - t.scheme().unsettled_words();
                assert_eq!(part.slice(0..settled), words.slice(0..settled), "{frames} frames in hops of {n}");
            }
        }
    }
}

#[test]
fn words_do_not_depend_on_where_one_faces() {
    let clip = bent(5, 100);
    let turned = |angle: f64| {
        let q = kinelm_motion::rotation::Axis::Y.turn(angle);
        let mut rotations = clip.rotations().to_vec();
        rotations.iter_mut().step_by(24).for_each(|r| *r = q * *r);
        let root = clip.root().iter().map(|p| q * *p).collect();
        Clip::new(clip.skeleton().clone(), clip.fps(), root, rotations).unwrap()
    };
    let t = fit(&clips(), RootRotation::HeadingDelta, hop(20));
    // by whole steps of the facing, so that it is told exactly
    let step = root::Root::new(lapped(&t), t.channels()).displacement_step() / lapped(&t).turn_arm;
    let (a, b) = (t.encode(&clip).unwrap().words, t.encode(&turned(40.0 * step)).unwrap().words);
    assert_ne!(a.word(0), b.word(0));
    assert_eq!(a.slice(1..5), b.slice(1..5));
}

#[test]
fn borders_are_no_rougher_than_the_rest() {
    let dances: Vec<Clip> = synth::corpus(1, 4, 8.0, 20.0).unwrap().into_iter().map(|d| d.clip).collect();
    for n in [10, 20] {
        let t = fit(&dances, RootRotation::HeadingDelta, hop(n));
        let mut jerk = BorderJerk::new(n as usize);
        for dance in &dances {
            let back = decode(&t, &t.encode(dance).unwrap().words).slice(0..dance.frames());
            jerk.add(dance, &back).unwrap();
        }
        let ratio = jerk.ratio().unwrap();
        assert!(ratio <= 1.05, "{n}: {ratio}");
    }
}

#[test]
fn any_codes_are_a_clip() {
    let t = fit(&clips(), RootRotation::HeadingDelta, hop(9));
    let symbols = t.scheme().symbols();
    let mut n = 1u32;
    for _ in 0..200 {
        let mut words = Words::new();
        for _ in 0..8 {
            let mut next = || {
                n = n.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
                n >> 8
            };
            let length = next() % 400;
            words.push(&(0..length).map(|_| (next() % symbols) as u16).collect::<Vec<_>>());
        }
        let clip = decode(&t, &words);
        assert_eq!(clip.frames(), 72);
        assert!(clip.rotations().iter().all(|q| (q.length() - 1.0).abs() < 1e-9));
        t.encode(&clip).unwrap();
    }
}

#[test]
fn who_stands_still_says_nothing() {
    let still = Clip::new(smpl::neutral(), 20.0, vec![Vec3::Y; 50], vec![Quat::IDENTITY; 1200]).unwrap();
    let t = Tokenizer::fit([&still], config(&[0, 4], RootRotation::HeadingDelta, hop(20))).unwrap();
    let e = t.encode(&still).unwrap();
    assert!(e.words.iter().all(<[u16]>::is_empty) && e.words.len() == 3 && e.padded == 10);
    let back = decode(&t, &e.words);
    assert!(back.root().iter().all(|p| (*p - Vec3::Y).length() < 1e-12));
    // and what is new moves all the same
    let far = wild(3, 40, 0.5, 0.1);
    let off = decode(&t, &t.encode(&far).unwrap().words);
    assert!((0..40).all(|f| angle_between(off.pose(f)[4], far.pose(f)[4]) < 0.6));
}

#[test]
fn settings_and_files_are_checked() {
    LappedConfig::default().validate().unwrap();
    let bad = |change: fn(&mut LappedConfig)| {
        let mut c = LappedConfig::default();
        change(&mut c);
        c.validate().unwrap_err().to_string()
    };
    assert!(bad(|c| c.hop = 0).contains("hop"));
    assert!(bad(|c| c.hop = 241).contains("240"));
    assert!(bad(|c| c.step_mm = f64::NAN).contains("step_mm"));
    assert!(bad(|c| c.thrift = 0.3).contains("thrift"));
    assert!(bad(|c| c.tip_m = 0.0).contains("tip_m"));
    assert!(bad(|c| c.levels = 0).contains("levels"));
    assert!(bad(|c| c.runs = 0).contains("runs"));
    let json = r#"{"type":"lapped","hop":30,"joint_transform":{"type":"none"}}"#;
    let read: SchemeConfig = serde_json::from_str(json).unwrap();
    assert_eq!(read, SchemeConfig::Lapped(LappedConfig { joint_transform: LappedMix::None {}, ..hop(30) }));
    assert!(serde_json::from_str::<SchemeConfig>(r#"{"type":"lapped","window":3}"#).is_err());

    let t = fit(&clips(), RootRotation::HeadingDelta, hop(4));
    assert_eq!(Tokenizer::from_json(&t.to_json()).unwrap(), t);
    let refused = |change: fn(&mut Lapped)| {
        let mut l = lapped(&t).clone();
        change(&mut l);
        l.validate(t.channels()).is_err()
    };
    assert!(refused(|l| l.order[3] = l.order[4]));
    assert!(refused(|l| l.order[3] = u32::MAX));
    assert!(refused(|l| l.thresholds[0] = 2000));
    assert!(refused(|l| l.mean[0] = f64::INFINITY));
    assert!(refused(|l| l.turn_arm = 0.0));
    assert!(refused(|l| l.inverse.truncate(5)));
}
