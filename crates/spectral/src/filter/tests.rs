use super::*;
use kinelm_motion::rotation::{angle_between, exp_map};
use kinelm_motion::{Skeleton, synth};
use std::f64::consts::{PI, TAU};
use std::sync::Arc;

const FILTERS: [Filter; 4] = [
    Filter::Band { cutoff_hz: LOW_HZ },
    Filter::Band { cutoff_hz: MIDDLE_HZ },
    Filter::Butterworth { order: 2, cutoff_hz: 5.0 },
    Filter::Butterworth { order: 6, cutoff_hz: 5.0 },
];

/// Two joints at 60 frames a second; the root walks along x.
fn two(frames: usize, root: impl Fn(f64) -> Vec3, child: impl Fn(f64) -> Vec3) -> Clip {
    let names = vec!["root".into(), "child".into()];
    let skeleton = Skeleton::new(names, vec![None, Some(0)], vec![Vec3::ZERO, Vec3::Y], vec![]).unwrap();
    let times = || (0..frames).map(|f| f as f64 / 60.0);
    let rotations = times().flat_map(|t| [exp_map::from_vector(root(t)), exp_map::from_vector(child(t))]).collect();
    let path = times().map(|t| Vec3::new(0.8 * t, 1.0, 0.0)).collect();
    Clip::new(Arc::new(skeleton), 60.0, path, rotations).unwrap()
}

/// The largest angle between two clips' rotations, radians, the given frames at both ends left out.
fn apart(a: &Clip, b: &Clip, ends: usize) -> f64 {
    let n = a.rotations().len();
    let range = ends * a.joints()..n - ends * a.joints();
    a.rotations()[range.clone()]
        .iter()
        .zip(&b.rotations()[range])
        .map(|(&a, &b)| angle_between(a, b))
        .fold(0.0, f64::max)
}

#[test]
fn the_bands_of_the_thesis() {
    assert_eq!((LOW_HZ, MIDDLE_HZ), (3.515625, 7.265625));
    assert_eq!((coefficients(128, 60.0, LOW_HZ), coefficients(128, 60.0, MIDDLE_HZ)), (16, 32));
    // the same frequencies whatever the length and the rate
    assert_eq!((coefficients(256, 60.0, LOW_HZ), coefficients(64, 30.0, LOW_HZ)), (31, 16));
    assert_eq!(coefficients(1, 60.0, LOW_HZ), 1);
}

/// Several full turns of the root, and a joint that swings to and fro over 180 degrees: nothing breaks.
#[test]
fn spins_and_swings_over_half_a_turn_go_through() {
    let spin = |t: f64| Vec3::new(0.0, TAU * 1.1 * t, 0.0);
    let swing = |t: f64| Vec3::new(0.0, 0.0, PI + 0.9 * (TAU * 0.7 * t).cos());
    let clip = two(360, spin, swing);
    for filter in &FILTERS {
        let out = filter.apply(&clip).unwrap();
        assert!(out.too_fast.is_empty(), "{filter:?}");
        // 6.6 turns: where the signs would break, a whole turn would be smeared over the frames beside
        let (all, inside) = (apart(&clip, &out.clip, 0), apart(&clip, &out.clip, 30));
        assert!(inside < 0.012 && all < 0.16, "{filter:?}: {inside} inside, {all} at the ends");
        let steps = |c: &Clip| {
            (2..c.rotations().len()).map(|i| angle_between(c.rotations()[i - 2], c.rotations()[i])).fold(0.0, f64::max)
        };
        assert!(steps(&out.clip) < 1.2 * steps(&clip), "{filter:?}: no jumps");
    }
}

#[test]
fn shivering_goes_and_the_movement_stays() {
    let slow = |t: f64| Vec3::new(0.6 * (TAU * 0.9 * t).sin(), 0.2, 0.0);
    let shivering = |t: f64| slow(t) + Vec3::new(0.0, 0.0, 0.1 * (TAU * 13.0 * t).sin());
    let (clean, noisy) = (two(600, slow, slow), two(600, shivering, shivering));
    assert!(apart(&clean, &noisy, 30) > 0.09);
    for filter in &FILTERS {
        let out = filter.apply(&noisy).unwrap().clip;
        assert!(apart(&clean, &out, 30) < 0.03, "{filter:?}: {}", apart(&clean, &out, 30));
    }
}

#[test]
fn the_path_is_filtered_too_and_a_stand_stays() {
    let still = |_: f64| Vec3::new(0.1, -2.0, 0.4);
    let clip = two(240, still, still);
    for filter in &FILTERS {
        let out = filter.apply(&clip).unwrap().clip;
        assert!(apart(&clip, &out, 0) < 1e-9);
        let worst = clip.root().iter().zip(out.root()).map(|(a, b)| (*a - *b).length()).fold(0.0, f64::max);
        // a walk that the cosine transform turns about at the ends
        assert!(worst < 0.04, "{filter:?}: {worst} m");
        assert_eq!((out.frames(), out.fps()), (240, 60.0));
    }
    let jolted: Vec<Vec3> =
        clip.root().iter().enumerate().map(|(i, p)| *p + Vec3::Y * if i % 2 == 0 { 0.02 } else { -0.02 }).collect();
    let jolted = Clip::new(clip.skeleton().clone(), 60.0, jolted, clip.rotations().to_vec()).unwrap();
    for filter in &FILTERS {
        let out = filter.apply(&jolted).unwrap().clip;
        let worst = out.root()[30..210].iter().map(|p| (p.y - 1.0).abs()).fold(0.0, f64::max);
        assert!(worst < 2e-3, "{filter:?}: {worst}");
    }
}

/// Filtering by all coefficients, and again what was filtered.
#[test]
fn all_of_it_is_the_clip_and_twice_is_once() {
    let clip = synth::corpus(1, 1, 3.0, 60.0).unwrap().remove(0).clip;
    let whole = Filter::Coefficients { keep: clip.frames() }.apply(&clip).unwrap();
    assert!(apart(&clip, &whole.clip, 0) < 1e-9 && whole.coefficients == Some([clip.frames(); 2]));
    let once = FILTERS[0].apply(&clip).unwrap().clip;
    let twice = FILTERS[0].apply(&once).unwrap().clip;
    let (first, second) = (apart(&clip, &once, 0), apart(&once, &twice, 0));
    assert!(first > 0.02 && second < 0.1 * first, "{first}, then {second}");
}

#[test]
fn turning_faster_than_the_band_is_counted() {
    // 12 turns a second are a wave of 6 Hz
    let clip = two(300, |t| Vec3::new(0.0, TAU * 12.0 * t, 0.0), |_| Vec3::X);
    let out = FILTERS[0].apply(&clip).unwrap();
    assert!(out.too_fast.len() > 250 && out.too_fast.iter().all(|&(_, joint)| joint == 0), "{}", out.too_fast.len());
    assert!(FILTERS[1].apply(&clip).unwrap().too_fast.is_empty());
    // what is attenuated evenly is not lost: a Butterworth filter leaves a steady spin as it is
    let out = Filter::Butterworth { order: 1, cutoff_hz: 7.0 }.apply(&clip).unwrap();
    assert!(out.too_fast.is_empty() && apart(&clip, &out.clip, 30) < 1e-6, "{}", apart(&clip, &out.clip, 30));
}

#[test]
fn what_cannot_be_is_refused() {
    let clip = two(40, |_| Vec3::ZERO, |_| Vec3::ZERO);
    let said = |f: Filter| f.apply(&clip).unwrap_err().to_string();
    let beyond = said(Filter::Band { cutoff_hz: 30.0 });
    assert!(beyond.contains("30 Hz at 60 frames per second") && beyond.contains("half the rate"), "{beyond}");
    assert!(said(Filter::Band { cutoff_hz: f64::NAN }).contains("half the rate"));
    assert!(said(Filter::Coefficients { keep: 41 }).contains("expected 1 to 40"));
    assert!(said(Filter::Coefficients { keep: 0 }).contains("expected 1 to 40"));
    assert!(said(Filter::Butterworth { order: 2, cutoff_hz: 31.0 }).contains("half the rate"));
    let short = FILTERS[2].apply(&clip.slice(0..9)).unwrap_err().to_string();
    assert!(short.contains("9 frames are too few"), "{short}");
    assert!(FILTERS[0].apply(&clip.slice(0..0)).unwrap_err().to_string().contains("no frames"));
    let one = FILTERS[0].apply(&clip.slice(0..1)).unwrap();
    assert_eq!(one.coefficients, Some([1, 1]));
}
