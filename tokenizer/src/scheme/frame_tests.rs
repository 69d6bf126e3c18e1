//! The promises of every scheme whose word is one frame.

use crate::contract::{bent, check_scheme, wild};
use crate::scheme::SchemeConfig;
use crate::scheme::mix::JointTransform;
use crate::scheme::pelvis::Split;
use crate::scheme::quantile::{Pooled, QuantileConfig};
use crate::{RootRotation, Tokenizer, TokenizerConfig, UncodedPose, UniformConfig, Words};
use kinelm_motion::joints::THIRTEEN;
use kinelm_motion::rotation::{angle_between, exp_map};
use kinelm_motion::{Clip, Quat, Vec3, smpl};
use proptest::prelude::*;
use rayon::prelude::*;
use std::sync::LazyLock;

const ROOTS: [RootRotation; 2] = [RootRotation::Absolute, RootRotation::HeadingDelta];

/// The default, of thirteen joints.
fn thirteen() -> TokenizerConfig {
    TokenizerConfig { joints: THIRTEEN.to_vec(), ..TokenizerConfig::default() }
}

fn schemes(bins: u32, joint_transform: JointTransform) -> [SchemeConfig; 3] {
    let uniform = UniformConfig { bins, joint_transform: joint_transform.clone(), ..Default::default() };
    let quantile = |pooled| {
        SchemeConfig::Quantile(QuantileConfig {
            bins,
            pooled,
            joint_transform: joint_transform.clone(),
            ..Default::default()
        })
    };
    [SchemeConfig::Uniform(uniform), quantile(Pooled::Channel), quantile(Pooled::Global)]
}

/// Every frame scheme without a joint transform, and with.
fn plain(bins: u32) -> Vec<TokenizerConfig> {
    of_all(schemes(bins, JointTransform::None {}).to_vec())
}

fn mixed(bins: u32, components: u32) -> Vec<TokenizerConfig> {
    let transforms = [JointTransform::Pca { components }, JointTransform::Ica { components }];
    of_all(transforms.into_iter().flat_map(|t| schemes(bins, t)).collect())
}

fn of_all(schemes: Vec<SchemeConfig>) -> Vec<TokenizerConfig> {
    let with =
        |scheme: &SchemeConfig, root_rotation| TokenizerConfig { root_rotation, scheme: scheme.clone(), ..thirteen() };
    schemes.iter().flat_map(|s| ROOTS.map(|root| with(s, root))).collect()
}

fn training() -> Vec<Clip> {
    (0..4).map(|seed| bent(seed, 120)).collect()
}

/// Everything that is turned with the body, turned about the vertical.
fn turned(clip: &Clip, radians: f64) -> Clip {
    let turn = exp_map::from_vector(Vec3::Y * radians);
    let root = clip.root().iter().map(|p| turn * *p).collect();
    let mut rotations = clip.rotations().to_vec();
    rotations.iter_mut().step_by(24).for_each(|q| *q = turn * *q);
    Clip::new(clip.skeleton().clone(), clip.fps(), root, rotations).unwrap()
}

fn still(frames: usize) -> Clip {
    let pose = bent(3, 1);
    let root = vec![Vec3::new(0.3, 0.9, -2.0); frames];
    Clip::new(smpl::neutral(), 20.0, root, pose.rotations().repeat(frames)).unwrap()
}

#[test]
fn contract_of_all() {
    let mut clips = training();
    clips.extend([still(40), bent(8, 2), bent(9, 1)]);
    for config in [plain(360), plain(24), mixed(360, 20), mixed(60, 72)].concat() {
        println!("{config:?}");
        check_scheme(&Tokenizer::fit(&clips, config).unwrap(), &clips);
    }
}

#[test]
fn contract_near_half_a_turn() {
    let clips = [wild(9, 200, 2.0, 0.05), wild(5, 200, 1.5, 0.3)];
    for config in [plain(360), plain(361), plain(7)].concat() {
        println!("{config:?}");
        check_scheme(&Tokenizer::fit(&clips, config).unwrap(), &clips);
    }
}

#[test]
fn constant_channels_and_clips_of_one_frame() {
    for clips in [vec![still(30)], vec![bent(1, 1)], vec![still(1), bent(2, 0)]] {
        for config in [plain(360), mixed(360, 13)].concat() {
            let t = Tokenizer::fit(&clips, config).unwrap();
            check_scheme(&t, &clips[..1]);
            // what lies outside all training values is coded too, and reported
            assert!(t.encode(&bent(7, 20)).unwrap().clipped > 0);
        }
    }
}

#[test]
fn no_frame_is_nothing_to_fit() {
    for config in [plain(360), mixed(360, 13)].concat() {
        let error = Tokenizer::fit(&[bent(1, 0)], config).unwrap_err().to_string();
        assert!(error.contains("no training clip"), "{error}");
    }
}

#[test]
fn joints_without_the_pelvis_and_all_joints() {
    for joints in [vec![4], vec![0], (0..24).collect()] {
        for config in [plain(360), mixed(360, 13)].concat() {
            let t = Tokenizer::fit(&training(), TokenizerConfig { joints: joints.clone(), ..config }).unwrap();
            check_scheme(&t, &training()[..1]);
        }
    }
}

#[test]
fn words_do_not_say_where_one_faces() {
    let delta = |configs: Vec<TokenizerConfig>| {
        configs.into_iter().filter(|c| c.root_rotation == RootRotation::HeadingDelta).collect::<Vec<_>>()
    };
    for config in [delta(plain(360)), delta(mixed(360, 20))].concat() {
        let t = Tokenizer::fit(&training(), config.clone()).unwrap();
        for clip in [bent(11, 150), wild(12, 150, 1.2, 0.05)] {
            let words = t.encode(&clip).unwrap().words;
            for degrees in [1.0, 90.0, 137.0, 180.0, 359.0] {
                let other = t.encode(&turned(&clip, f64::to_radians(degrees))).unwrap().words;
                assert_eq!(other.slice(1..150), words.slice(1..150), "{degrees} {config:?}");
                let (a, b) = (words.word(0), other.word(0));
                let differ: Vec<usize> = (0..a.len()).filter(|&i| a[i] != b[i]).collect();
                assert_eq!(differ, [3], "{degrees}: the first frame says it once");
            }
            // between whole bins only rounding may differ: of the turn, and of steps seen from it
            let other = t.encode(&turned(&clip, 0.123)).unwrap().words;
            for (a, b) in words.iter().zip(other.iter()).skip(1) {
                assert_eq!(a[4..], b[4..]);
                assert!(a[3].abs_diff(b[3]) <= 1 || a[3].abs_diff(b[3]) == 359);
            }
        }
    }
}

#[test]
fn turn_and_tilt_within_half_a_bin() {
    let scheme = schemes(360, JointTransform::None {})[0].clone();
    let config = TokenizerConfig { root_rotation: RootRotation::HeadingDelta, scheme, ..thirteen() };
    let t = Tokenizer::fit(&training(), config).unwrap();
    let bin = 1f64.to_radians();
    for clip in [bent(21, 2000), wild(22, 500, 1.5, 0.05)] {
        let e = t.encode(&clip).unwrap();
        let back = t.decode(&e.words, UncodedPose::Identity).unwrap();
        let mut over = 0;
        for f in 0..clip.frames() {
            let (was, is) = (clip.pose(f)[0], back.pose(f)[0]);
            let split = Split::of(was).unwrap();
            // nearer to half a turn the tilt has a twin, or no turn
            if split.tilt.w > 1.5 * bin {
                let decoded = Split::of(is).unwrap();
                let off = (exp_map::to_vector(split.tilt) - exp_map::to_vector(decoded.tilt)).abs() / bin;
                let turn = angle_between(
                    exp_map::from_vector(Vec3::Y * split.turn),
                    exp_map::from_vector(Vec3::Y * decoded.turn),
                );
                assert!(off.max_element() <= 0.5 + 1e-6 && turn <= (0.5 + 1e-6) * bin, "frame {f}: {off} {turn}");
            }
            over += u64::from(angle_between(was, is) > (0.5 + 0.5f64.sqrt()) * bin + 1e-9);
        }
        assert!(over <= e.second_codes, "{over} {}", e.second_codes);
    }
}

#[test]
fn a_changed_code_turns_or_shifts_what_follows() {
    for config in plain(360) {
        let t = Tokenizer::fit(&training(), config.clone()).unwrap();
        let words = t.encode(&bent(5, 40)).unwrap().words;
        let before = t.decode(&words, UncodedPose::Identity).unwrap();
        for place in 0..42 {
            let mut codes = words.codes().to_vec();
            codes[10 * 42 + place] = (codes[10 * 42 + place] + 5) % 360;
            let after = t.decode(&Words::fixed(codes, 42), UncodedPose::Identity).unwrap();
            let has_turn = config.root_rotation == RootRotation::HeadingDelta;
            for f in (0..40).filter(|&f| f != 10) {
                let (a, b) = (before.pose(f), after.pose(f));
                assert_eq!(a[1..], b[1..], "{place} {f}");
                let turn = b[0] * a[0].conjugate();
                assert!(f > 10 && has_turn && place == 3 || angle_between(a[0], b[0]) < 1e-12);
                assert!((turn.x.abs() + turn.z.abs()) < 1e-12, "about the vertical");
            }
            // steps after that are the same, turned and shifted
            for f in 12..40 {
                let turn = after.pose(30)[0] * before.pose(30)[0].conjugate();
                let step = |c: &Clip| c.root()[f] - c.root()[f - 1];
                assert!((step(&after) - turn * step(&before)).length() < 1e-9, "{place} {f} {config:?}");
            }
            assert_eq!(before.root()[..10], after.root()[..10]);
        }
    }
}

#[test]
fn one_thread_is_eight() {
    let clips: Vec<Clip> = (0..24).map(|seed| bent(seed, 50)).collect();
    for config in [plain(360), mixed(360, 20)].concat() {
        let t = Tokenizer::fit(&clips, config).unwrap();
        let one: Vec<_> = clips.iter().map(|c| t.encode(c).unwrap()).collect();
        let pool = rayon::ThreadPoolBuilder::new().num_threads(8).build().unwrap();
        let eight: Vec<_> = pool.install(|| clips.par_iter().map(|c| t.encode(c).unwrap()).collect());
        assert_eq!(one, eight);
    }
}

#[test]
fn a_joint_transform_has_no_places() {
    for config in mixed(360, 13) {
        let t = Tokenizer::fit(&training(), config.clone()).unwrap();
        assert!(t.scheme().slot_channels(t.channels()).unwrap_err().contains("joint transform"));
        let turn = usize::from(config.root_rotation == RootRotation::HeadingDelta);
        assert_eq!(t.encode(&training()[0]).unwrap().words.length(), Some(3 + turn + 13));
    }
}

#[test]
fn all_components_keep_the_pose() {
    for config in mixed(1080, 39) {
        let t = Tokenizer::fit(&training(), config.clone()).unwrap();
        let clip = &training()[2];
        let back = t.decode(&t.encode(clip).unwrap().words, UncodedPose::Identity).unwrap();
        let worst = (0..clip.frames())
            .flat_map(|f| THIRTEEN.map(|j| angle_between(clip.pose(f)[j], back.pose(f)[j])))
            .fold(0.0f64, f64::max);
        assert!(worst < 0.3, "{worst} {config:?}");
    }
}

/// Fitted on one clip, so that much lies outside its values.
static FITTED: LazyLock<Vec<Tokenizer>> = LazyLock::new(|| {
    let configs = [plain(360), mixed(360, 13)].concat();
    configs.into_iter().map(|config| Tokenizer::fit(&[bent(1, 50)], config).unwrap()).collect()
});

fn any_pose(seed: u64, reach: f64) -> Clip {
    wild(seed, 40, reach, 0.2)
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]
    #[test]
    fn any_motion_keeps_its_words(seed in any::<u64>(), reach in 0.1..2.5f64, bins in prop::sample::select(vec![3u32, 60, 360])) {
        let clip = any_pose(seed, reach);
        for config in plain(bins) {
            // fitted on another clip, so that values lie outside too
            let t = Tokenizer::fit(&[bent(1, 50)], config).unwrap();
            let words = t.encode(&clip).unwrap().words;
            let back = t.decode(&words, UncodedPose::Identity).unwrap();
            prop_assert_eq!(t.encode(&back).unwrap().words, words);
        }
    }

    #[test]
    fn any_codes_are_a_finite_clip(codes in prop::collection::vec(0u16..360, 5 * 42)) {
        for t in &*FITTED {
            let length = t.scheme().neutral(t.channels()).len();
            let whole = codes.len() / length * length;
            let clip = t.decode(&Words::fixed(codes[..whole].to_vec(), length), UncodedPose::Identity).unwrap();
            prop_assert!(clip.root().iter().all(|p| p.is_finite()));
            prop_assert!(clip.rotations().iter().all(|q: &Quat| q.is_finite()));
        }
    }
}
