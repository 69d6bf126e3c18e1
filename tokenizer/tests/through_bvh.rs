//! What a tokenizer decodes has the same codes after it was written as a BVH and read again.

use kinelm_motion::format::{ReadOptions, read, write};
use kinelm_motion::rotation::exp_map;
use kinelm_motion::{Clip, Motion, Vec3, retarget, smpl};
use kinelm_tokenizer::{
    JointTransform, QuantileConfig, RootRotation, SchemeConfig, Tokenizer, TokenizerConfig, UncodedPose,
};

/// One who turns round and round on a walk, every joint swinging, some beyond half a turn.
fn dancer(frames: usize) -> Clip {
    let wave = |i: usize, f: usize| (f as f64 * (0.03 + 0.002 * i as f64) + (i * i) as f64).sin();
    let root = (0..frames).map(|f| Vec3::new(wave(0, f), 0.95 + 0.05 * wave(1, f), 2.0 * wave(2, f) + 3.0)).collect();
    let turn = |i: usize| {
        let (f, j) = (i / 24, i % 24);
        let v = Vec3::new(wave(3 * j, f), wave(3 * j + 1, f), wave(3 * j + 2, f));
        let round = if j == 0 { Vec3::Y * (0.1 * f as f64) } else { Vec3::ZERO };
        exp_map::from_vector(round) * exp_map::from_vector(v * if j % 5 == 0 { 2.5 } else { 0.8 })
    };
    Clip::new(smpl::neutral(), 20.0, root, (0..frames * 24).map(turn).collect()).expect("finite")
}

/// The words of the clip, decoded, written, read and coded again.
fn check(clip: &Clip, config: TokenizerConfig) {
    let dir = tempfile::tempdir().expect("a folder");
    let what = format!("{config:?}");
    let t = Tokenizer::fit([clip], config).expect("a good clip");
    let words = t.encode(clip).expect("a good clip").words;
    let made = t.decode(&words, UncodedPose::Clip(clip)).expect("words of an encoder");
    let path = dir.path().join("made.bvh");
    let motion = Motion::new(&path, made);
    write(&path, &motion).expect("written");
    let back = read(&path, &ReadOptions::default()).expect("our own file");
    let back = retarget::to_smpl(&back).expect("our own rig");
    let again = t.encode(&back).expect("the same rate and rig").words;
    let differ = again.codes().iter().zip(words.codes()).filter(|(a, b)| a != b).count();
    assert_eq!((again.len(), differ), (words.len(), 0), "{what}");
}

#[test]
fn codes_survive_a_file() {
    let clip = dancer(600);
    let all: Vec<usize> = (0..24).collect();
    for root_rotation in [RootRotation::Absolute, RootRotation::HeadingDelta] {
        for joints in [&kinelm_motion::joints::THIRTEEN[..], &all] {
            for bins in [60, 360, 361, 1080] {
                check(&clip, TokenizerConfig { root_rotation, ..TokenizerConfig::uniform(joints, 20.0, bins) });
            }
            for joint_transform in [JointTransform::None {}, JointTransform::Pca { components: 30 }] {
                let scheme = SchemeConfig::Quantile(QuantileConfig { joint_transform, ..Default::default() });
                let joints = joints.to_vec();
                check(&clip, TokenizerConfig { root_rotation, joints, scheme, ..Default::default() });
            }
        }
    }
}
