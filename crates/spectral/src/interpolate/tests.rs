use super::*;
use kinelm_motion::rotation::{angle_between, exp_map};
use kinelm_motion::{Quat, Vec3, synth};
use std::f64::consts::PI;

fn motions() -> [Motion; 2] {
    // two genres of one dancer
    let dances = synth::corpus(1, 2, 4.0, 60.0).unwrap();
    [0, 1].map(|i| Motion::new(format!("{i}.bvh"), dances[i].clip.clone()))
}

fn settings(spectrum: Spectrum, method: Method) -> InterpolateOptions {
    let alignment = Alignment { at_s: [1.0, 1.0], ..Alignment::default() };
    InterpolateOptions { alignment, coordinates: Coordinates::Relative, spectrum, keep: None, method }
}

#[test]
fn half_way_lies_between_and_does_not_shake() {
    let [a, b] = motions();
    let adam = Method::Adam(Descent { strength: 0.5, rate: None, steps: 500 });
    for method in
        [adam, Method::Closed { amount: 0.5 }, Method::Plain(Descent { strength: 0.5, rate: None, steps: 100 })]
    {
        let done = interpolate(&a, &b, &settings(Spectrum::Dct, method)).unwrap();
        let r = &done.report;
        // made-up dances hardly shake at all: what is left of a band at the window's ends counts
        assert!(r.is_between && r.jitter_ratio.unwrap() < 1.3, "{r}");
        assert!(r.own.a_b < r.own.a_c.min(r.own.c_b) && r.stft.a_b < 1.0, "{r}");
        assert_eq!((r.frames, r.numbers), (128, 72 * 16));
        let off = done.clips[2].root().iter().zip(done.clips[0].root()).map(|(c, a)| c.distance(*a));
        assert!(off.fold(0.0, f64::max) < 0.02, "the first's path");
    }
    let all = interpolate(&a, &b, &settings(Spectrum::Dct, Method::Closed { amount: 1.0 })).unwrap().report;
    assert!((all.own.c_b - 1.0).abs() < 1e-9 && all.loss[1] < 1e-20);
    let none = interpolate(&a, &b, &settings(Spectrum::Pca, Method::Closed { amount: 0.0 })).unwrap();
    let worst = none.clips[0].rotations().iter().zip(none.clips[2].rotations());
    assert!(worst.map(|(p, q)| angle_between(*p, *q)).fold(0.0, f64::max) < 1e-9);
}

/// Outside of a band nothing is changed, whatever the way there, and a band from 0 is the number alone.
#[test]
fn a_band_alone_is_moved() {
    let [a, b] = motions();
    let descent = Descent { strength: 1.0, rate: None, steps: 60 };
    for spectrum in [Spectrum::Dct, Spectrum::Pca] {
        for method in [Method::Closed { amount: 0.5 }, Method::Adam(descent), Method::Plain(descent)] {
            let banded = |keep| {
                let options = InterpolateOptions { keep: Some(keep), ..settings(spectrum, method) };
                let vectors = InterpolateOptions { coordinates: Coordinates::Vectors, ..options };
                interpolate(&a, &b, &vectors).unwrap()
            };
            let done = banded(4..16);
            assert_eq!(done.report.numbers, 72 * 12);
            assert!(done.report.transform.contains("4..16"), "{}", done.report.transform);
            if spectrum == Spectrum::Dct {
                for (k, d) in done.distances.iter().enumerate() {
                    match (4..16).contains(&k) {
                        true => assert!(d.after < 0.9 * d.before, "{k}: {d:?}"),
                        false => assert!((d.after - d.before).abs() < 1e-9, "{k}: {d:?}"),
                    }
                }
            } else {
                // orthonormal components: what is moved in two bands is what is moved in both at once
                let of = |keep| banded(keep).report.loss[0] * 72.0;
                assert!((12.0 * of(4..16) + 4.0 * of(0..4) - 16.0 * of(0..16)).abs() < 1e-6);
            }
        }
    }
    let whole = |keep| {
        let options = InterpolateOptions { keep, ..settings(Spectrum::Dct, Method::Closed { amount: 0.5 }) };
        interpolate(&a, &b, &options).unwrap()
    };
    let (default, band) = (whole(None), whole(Some(0..16)));
    assert_eq!((&default.clips[2], &default.report), (&band.clips[2], &band.report));
    assert_eq!(default.chart().rules.len(), 1);
}

#[test]
fn magnitudes_shake() {
    let [a, b] = motions();
    let adam = Method::Adam(Descent { strength: 0.5, rate: None, steps: 200 });
    let ratio = |kind| interpolate(&a, &b, &settings(kind, adam)).unwrap().report.jitter_ratio.unwrap();
    let (stft, dct) = (ratio(Spectrum::Stft), ratio(Spectrum::Dct));
    assert!(stft > 1.2 * dct, "{stft} {dct}");
}

#[test]
fn a_report_says_it_all() {
    let [a, b] = motions();
    let report = interpolate(&a, &b, &settings(Spectrum::Pca, Method::Closed { amount: 0.5 })).unwrap().report;
    let text = report.to_string();
    for part in ["closed form, amount 0.5", "128 frames at 60 fps, 72 channels", "pca 16", "A-C", "jitter, m/s^3: A "] {
        assert!(text.contains(part), "{part} in {text}");
    }
}

#[test]
fn what_cannot_be_is_refused() {
    let [a, b] = motions();
    let said = |s: InterpolateOptions| interpolate(&a, &b, &s).unwrap_err().to_string();
    let half = Method::Closed { amount: 0.5 };
    assert!(
        said(InterpolateOptions { keep: Some(0..129), ..settings(Spectrum::Dct, half) }).contains("expected 1 to 128")
    );
    assert!(
        said(InterpolateOptions { keep: Some(0..0), ..settings(Spectrum::Pca, half) }).contains("expected 1 to 128")
    );
    for [from, upto] in [[4, 129], [16, 4], [7, 7]] {
        let (band, found) = (from..upto, &*format!("{from}..{upto}"));
        let text = said(InterpolateOptions { keep: Some(band), ..settings(Spectrum::Dct, half) });
        assert!(text.contains(found) && text.contains("at most 128"), "{text}");
    }
    assert!(said(settings(Spectrum::Stft, half)).contains("no closed form"));
}

/// A dance in which one joint turns, besides what it does, by an angle over time about the vertical of its parent, and
/// all joints shake as in a capture.
fn turning(dance: &Motion, joint: usize, angle: impl Fn(f64) -> f64) -> Motion {
    let (clip, j) = (&dance.clip, dance.clip.joints());
    let shaken = |(i, q): (usize, &Quat)| {
        let phases = Vec3::new(7.1, 11.3, 5.7) * i as f64;
        *q * exp_map::from_vector(0.002 * Vec3::new(phases.x.sin(), phases.y.sin(), phases.z.sin()))
    };
    let mut rotations: Vec<Quat> = clip.rotations().iter().enumerate().map(shaken).collect();
    for f in 0..clip.frames() {
        let own = &mut rotations[f * j + joint];
        *own = Quat::from_rotation_y(angle(f as f64 / clip.fps())) * *own;
    }
    let clip = Clip::new(clip.skeleton().clone(), clip.fps(), clip.root().to_vec(), rotations).unwrap();
    Motion::new(dance.path.clone(), clip)
}

/// The fastest step of any joint from frame to frame, radians.
fn fastest(clip: &Clip) -> f64 {
    let j = clip.joints();
    clip.rotations().iter().zip(&clip.rotations()[j..]).map(|(p, q)| angle_between(*p, *q)).fold(0.0, f64::max)
}

#[test]
fn dancers_who_turn_do_not_flip() {
    let [a, b] = motions();
    let facing = |t: f64| PI + 0.3 * (5.0 * t).sin();
    type Turn<'a> = &'a dyn Fn(f64) -> f64;
    let turns: [(&str, Turn<'_>, Turn<'_>); 5] = [
        ("several turns", &|t| 7.0 * t, &|t| 9.0 * t + 1.0),
        ("opposite ways", &|t| 5.0 * t, &|t| -6.0 * t),
        ("one turns", &|_| 0.0, &|t| 8.0 * t),
        ("there and back", &|t| 4.0 * (2.0 * t).sin(), &|t| -4.0 * (2.5 * t).sin()),
        ("facing each other", &|_| 0.0, &facing),
    ];
    // the body, and a joint that no person turns so far
    for joint in [0, 15] {
        for (name, of_a, of_b) in turns {
            let (a, b) = (turning(&a, joint, of_a), turning(&b, joint, of_b));
            for (spectrum, keep_heading) in [(Spectrum::Dct, false), (Spectrum::Pca, false), (Spectrum::Dct, true)] {
                let mut options = settings(spectrum, Method::Closed { amount: Descent::STRENGTH });
                options.alignment.keep_heading = keep_heading;
                let done = interpolate(&a, &b, &options).unwrap();
                let [of_a, of_b, of_c] = [0, 1, 2].map(|i| fastest(&done.clips[i]));
                let ratio = done.report.jitter_ratio.unwrap();
                let what =
                    format!("{name}, joint {joint}, {spectrum:?}: {of_a:.3} {of_b:.3} {of_c:.3} rad, {ratio:.2}");
                assert!(of_c < 1.1 * of_a.max(of_b), "{what}");
                assert!(ratio < JITTER_BOUND, "{what}");
            }
        }
    }
}

#[test]
fn rotation_vectors_of_dancers_who_turn_flip() {
    let [a, b] = motions();
    let (a, b) = (turning(&a, 0, |t| 5.0 * t), turning(&b, 0, |t| -6.0 * t));
    let options = InterpolateOptions {
        coordinates: Coordinates::Vectors,
        ..settings(Spectrum::Dct, Method::Closed { amount: Descent::STRENGTH })
    };
    let done = interpolate(&a, &b, &options).unwrap();
    assert_eq!(done.clips[2].root(), done.clips[0].root(), "the first's path");
    let [of_a, of_b, of_c] = [0, 1, 2].map(|i| fastest(&done.clips[i]));
    assert!(of_c > 3.0 * of_a.max(of_b) && !done.report.is_smooth, "{of_a} {of_b} {of_c} {}", done.report);
}
