//! There and back in every form, on made-up dances and on real ones.

use super::*;
use kinelm_motion::format::{self, ReadOptions};
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::rotation::angle_between;
use kinelm_motion::{Motion, synth};
use kinelm_shared_data as shared_data;
use std::path::Path;

const FORMS: [Form; 3] = [Form::Positional, Form::Euler, Form::Quaternion];

fn made_up() -> Motion {
    let clip = synth::corpus(4, 1, 3.0, 30.0).unwrap().remove(0).clip;
    Motion::new("made-up", clip)
}

/// The largest distance of places and angle of local rotations.
fn apart(a: &Clip, b: &Clip) -> (f64, f64) {
    let places = a.positions().iter().zip(b.positions()).map(|(p, q)| (*p - q).length()).fold(0.0, f64::max);
    let angles = a.rotations().iter().zip(b.rotations()).map(|(p, q)| angle_between(*p, *q)).fold(0.0, f64::max);
    (places, angles)
}

/// A motion through a form as the network sees it: turned there and back, and as steps.
fn there_and_back(coder: &Coder, clip: &Clip) -> Vec<f64> {
    let c = coder.channels();
    let mut frames = coder.frames(clip);
    frames.chunks_exact_mut(c).for_each(|frame| coder.turn(frame, 2.0));
    frames.chunks_exact_mut(c).for_each(|frame| coder.turn(frame, -2.0));
    let start = [frames[0], frames[2]];
    frames_of_steps(&steps(&frames, c), c, start)
}

#[test]
fn rotations_come_back_and_points_as_points() {
    let motion = made_up();
    let rig = Rig::of(&motion);
    let whole = motion.clip.slice(0..motion.clip.frames() - 1);
    for form in FORMS {
        let coder = Coder::new(form, &rig).unwrap();
        let back = there_and_back(&coder, &motion.clip);
        let clip = coder.clip(&back, motion.clip.skeleton(), 30.0).unwrap();
        let (places, angles) = apart(&clip, &whole);
        match form {
            Form::Positional => assert!(places < 1e-4, "fitted: {places} m"),
            _ => assert!(places < 1e-6 && angles < 1e-6, "{form:?}: {places} m, {angles} rad"),
        }
        let own = coder.places(&back, motion.clip.skeleton());
        let expected = Coder::new(Form::Positional, &rig).unwrap();
        let expected = expected.places(&expected.frames(&whole), motion.clip.skeleton());
        let far = own.iter().zip(&expected).map(|(p, q)| (*p - *q).length()).fold(0.0, f64::max);
        assert!(far < 1e-6, "{form:?}: places {far} m apart");
    }
}

#[test]
fn a_turn_turns_the_whole_dance() {
    let motion = made_up();
    let (clip, by) = (&motion.clip, Quat::from_rotation_y(1.1));
    let root = clip.root().iter().map(|p| by * *p).collect();
    let mut rotations = clip.rotations().to_vec();
    rotations.iter_mut().step_by(clip.joints()).for_each(|q| *q = by * *q);
    let turned = Clip::new(clip.skeleton().clone(), 30.0, root, rotations).unwrap();
    for form in FORMS {
        let coder = Coder::new(form, &Rig::of(&motion)).unwrap();
        let mut frames = coder.frames(clip);
        frames.chunks_exact_mut(coder.channels()).for_each(|frame| coder.turn(frame, 1.1));
        let (a, b) = (coder.places(&frames, clip.skeleton()), coder.places(&coder.frames(&turned), clip.skeleton()));
        assert!(a.iter().zip(&b).all(|(p, q)| (*p - *q).length() < 1e-9), "{form:?}");
    }
}

#[test]
fn signs_run_on() {
    let motion = made_up();
    let coder = Coder::new(Form::Quaternion, &Rig::of(&motion)).unwrap();
    let frames = coder.frames(&motion.clip);
    let of = |frame: &[f64], j: usize| frame[3 + 4 * j..][..4].to_vec();
    for pair in frames.chunks_exact(coder.channels()).collect::<Vec<_>>().windows(2) {
        for j in 0..24 {
            let dot: f64 = of(pair[0], j).iter().zip(of(pair[1], j)).map(|(a, b)| a * b).sum();
            assert!(dot > 0.0);
        }
    }
}

#[test]
fn numbers_that_are_none_are_named() {
    let motion = made_up();
    let coder = Coder::new(Form::Euler, &Rig::of(&motion)).unwrap();
    let mut frames = coder.frames(&motion.clip);
    frames[2 * coder.channels() + 5] = f64::NAN;
    let message = coder.clip(&frames, motion.clip.skeleton(), 30.0).unwrap_err().to_string();
    assert_eq!(message, "frame 2, channel 5: found NaN, expected a number");
    assert!(steps(&[], 3).is_empty() && steps(&[1.0; 3], 3).is_empty());
}

/// A real clip at 30 frames a second without its beginning, its rate stated anew where it is.
fn real(path: &Path, fps_source: Option<f64>) -> Motion {
    let mut motion = format::read(path, &ReadOptions { fps_source, ..Default::default() }).unwrap();
    let clip = motion.clip.slice(10..motion.clip.frames().min(700));
    motion.clip = resample(&clip, 30.0, Method::Stride).unwrap();
    motion
}

#[test]
fn real_dances_come_back() {
    let Some(data) = shared_data::set("cmu-dance", "real_dances_come_back") else { return };
    let Some(other) = shared_data::set("bandai-1", "real_dances_come_back") else { return };
    // 43 joints and 14 end sites: 3 * 57, 3 + 3 * 43, 3 + 4 * 43
    let motions = [
        (real(&data.join("salsa/01.bvh"), Some(60.0)), [171, 132, 175]),
        (real(&data.join("indian/04.bvh"), None), [171, 132, 175]),
        (real(&other.join("dataset-1_dance-short_normal_001.bvh"), None), [0, 0, 0]),
        // the travel of the root's parent
        (real(&other.join("dataset-1_run_normal_001.bvh"), None), [0, 0, 0]),
    ];
    for (motion, widths) in motions {
        let (rig, clip) = (Rig::of(&motion), &motion.clip);
        for (form, width) in FORMS.into_iter().zip(widths) {
            let coder = Coder::new(form, &rig).unwrap();
            let (j, e) = (rig.joints(), rig.ends.len());
            assert_eq!(coder.channels(), [3 * (j + e), 3 + 3 * j, 3 + 4 * j][form as usize]);
            assert!(width == 0 || width == coder.channels(), "{form:?}");
            let back = there_and_back(&coder, clip);
            let whole = clip.slice(0..clip.frames() - 1);
            let found = coder.clip(&back, clip.skeleton(), 30.0).unwrap();
            let (places, angles) = apart(&found, &whole);
            let path = motion.path.display();
            match form {
                Form::Positional => assert!(places < 1e-3, "{path}: fitted, {places} m apart"),
                _ => assert!(places < 1e-6 && angles < 1e-6, "{path}, {form:?}: {places} m, {angles} rad"),
            }
        }
    }
}
