//! The promises of the tokenizer on real motion, where it is on hand.

mod prepared;

use kinelm_motion::rotation::{angle_between, exp_map, heading};
use kinelm_motion::{Clip, Vec3};
use kinelm_tokenizer::{
    Fit, Height, RootRotation, SchemeConfig, Tokenizer, TokenizerConfig, UncodedPose, UniformConfig,
};
use rayon::prelude::*;

/// Half a bin, with what rounding may add.
const HALF: f64 = 0.5 + 1e-6;

#[derive(Default, Debug, Clone, Copy)]
struct Found {
    frames: usize,
    rotations: u64,
    second: u64,
    clipped: u64,
    /// Rotations beyond half a bin, or beyond `sqrt(3)/2` bins as an angle.
    over: u64,
    /// Bins.
    worst_component: f64,
    worst_step: f64,
    /// Of a pelvis coded as turn and tilt, degrees.
    worst_pelvis: f64,
    /// Degrees.
    worst_angle: f64,
}

impl Found {
    fn and(self, b: Found) -> Found {
        Found {
            frames: self.frames + b.frames,
            rotations: self.rotations + b.rotations,
            second: self.second + b.second,
            clipped: self.clipped + b.clipped,
            over: self.over + b.over,
            worst_component: self.worst_component.max(b.worst_component),
            worst_step: self.worst_step.max(b.worst_step),
            worst_pelvis: self.worst_pelvis.max(b.worst_pelvis),
            worst_angle: self.worst_angle.max(b.worst_angle),
        }
    }
}

/// Encodes and decodes a clip: the errors, after checking that coding again gives the same codes.
fn measure(t: &Tokenizer, clip: &Clip) -> Found {
    let encoded = t.encode(clip).expect("a prepared clip");
    let back = t.decode(&encoded.words, UncodedPose::Identity).expect("codes of an encoder");
    let again = t.encode(&back).expect("a decoded clip");
    assert_eq!(again.words, encoded.words);
    let uniform = t.uniform().expect("uniform bins");
    let bin = uniform.angles().width();
    let mut found =
        Found { frames: clip.frames(), second: encoded.second_codes, clipped: encoded.clipped, ..Default::default() };
    let start = clip.root()[0] * Vec3::new(1.0, 0.0, 1.0);
    let mut facing = 0.0;
    for f in 0..clip.frames() {
        for &j in t.channels().joints() {
            let (was, is) = (clip.pose(f)[j], back.pose(f)[j]);
            found.rotations += 1;
            if j == 0 && t.config().root_rotation == RootRotation::HeadingDelta {
                found.worst_pelvis = found.worst_pelvis.max(angle_between(was, is).to_degrees());
                continue;
            }
            let code = t.channels().joints().iter().position(|&k| k == j).expect("coded") * 3 + 3;
            let decoded = uniform.angles().vector([0, 1, 2].map(|i| encoded.words.word(f)[code + i]));
            let v = exp_map::to_vector(was);
            let miss = |v: Vec3| (v - decoded).abs().max_element() / bin;
            let component = exp_map::twin(v).map_or(miss(v), |t| miss(v).min(miss(t)));
            let angle = angle_between(was, is);
            found.over += u64::from(component > HALF || angle > 0.75f64.sqrt() * bin + 1e-9);
            found.worst_component = found.worst_component.max(component);
            found.worst_angle = found.worst_angle.max(angle.to_degrees());
        }
        let miss = exp_map::from_vector(Vec3::Y * -facing) * (clip.root()[f] - start - back.root()[f]);
        for (i, line) in uniform.translation().iter().enumerate() {
            found.worst_step = found.worst_step.max(miss[i].abs() / line.width);
        }
        facing = heading(back.pose(f)[0]).unwrap_or(facing);
    }
    found
}

fn check(set: &str, test: &str, skip: usize) {
    let Some(clips) = prepared::clips(set, test, skip) else { return };
    let clips: Vec<(Clip, bool)> = clips.into_iter().map(|(clip, split)| (clip, split == "train")).collect();
    let (thirteen, all) = (&kinelm_motion::joints::THIRTEEN[..], &(0..24).collect::<Vec<_>>()[..]);
    let steps = SchemeConfig::Uniform(UniformConfig { height: Height::Velocity, ..Default::default() });
    let old = (RootRotation::Absolute, steps);
    let new = (RootRotation::default(), SchemeConfig::default());
    for (joints, (root_rotation, scheme)) in [(thirteen, &old), (all, &old), (thirteen, &new), (all, &new)] {
        let joints = joints.to_vec();
        let config =
            TokenizerConfig { joints, root_rotation: *root_rotation, scheme: scheme.clone(), ..Default::default() };
        let mut fit = Fit::new(config).expect("good settings");
        clips.iter().filter(|(_, trains)| *trains).for_each(|(clip, _)| fit.add(clip).expect("a prepared clip"));
        let t = fit.finish().expect("training clips");
        let all = clips.par_iter().map(|(clip, trains)| {
            let found = measure(&t, clip);
            assert!(!trains || found.clipped == 0, "a training clip clips: {found:?}");
            assert!(found.clipped > 0 || found.worst_step <= HALF, "{found:?}");
            found
        });
        let found = all.reduce(Found::default, Found::and);
        println!("{set}, {} clips, {} joints, {root_rotation:?}: {found:?}", clips.len(), t.channels().joints().len());
        assert!(found.over <= found.second && found.second * 1000 <= found.rotations, "{found:?}");
        assert!(found.worst_component <= 1.0 && found.worst_angle <= 3f64.sqrt() + 1e-9, "{found:?}");
        // half a bin of the turn, and of each number of the tilt
        assert!(found.worst_pelvis <= 0.5 + 0.5f64.sqrt() + 1e-6, "{found:?}");
        assert!(found.rotations > 10_000);
    }
}

#[test]
fn cmu_dance() {
    check("cmu-dance", "tokenizer::cmu_dance", 10);
}

#[test]
fn bandai_1() {
    check("bandai-1", "tokenizer::bandai_1", 0);
}

#[test]
fn bandai_2() {
    check("bandai-2", "tokenizer::bandai_2", 0);
}
