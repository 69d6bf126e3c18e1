//! Meanings of all schemes against what decoding gives.

use crate::contract::{bent, presets, wild};
use crate::meaning::{Legend, Meaning, Unit};
use crate::scheme::Fitted;
use crate::scheme::pelvis::Split;
use crate::scheme::series::{lever_arms, open, open_count, open_joints};
use crate::{
    DctConfig, JointTransform, LappedConfig, LappedMix, RootRotation, SchemeConfig, Steps, Tokenizer, TokenizerConfig,
    UncodedPose, Words,
};
use kinelm_motion::Clip;
use std::f64::consts::{PI, TAU};

/// Angles well within half a turn, so that rotation vectors have no twins.
fn calm(frames: usize) -> Clip {
    wild(11, frames, 0.25, 0.05)
}

/// The presets, and what no preset has: tiles without a joint transform and with independent components.
fn all() -> Vec<(&'static str, Tokenizer)> {
    let fit = |root_rotation, scheme| {
        let config = TokenizerConfig { root_rotation, scheme, ..TokenizerConfig::uniform(&[0, 4, 16], 20.0, 90) };
        Tokenizer::fit(&[bent(1, 150), bent(2, 150)], config).unwrap()
    };
    let dct = |joint_transform, steps| DctConfig { tile: 15, bins: 90, joint_transform, steps, ..DctConfig::default() };
    let lapped = LappedConfig { hop: 8, levels: 5, runs: 9, joint_transform: LappedMix::None {}, ..Default::default() };
    let (none, ica) = (JointTransform::None {}, JointTransform::Ica { components: 5 });
    let own = [
        ("dct, none", RootRotation::HeadingDelta, SchemeConfig::Dct(dct(none, Steps::LeverArm))),
        ("dct, ica", RootRotation::HeadingDelta, SchemeConfig::Dct(dct(ica, Steps::Equal))),
        ("lapped, none", RootRotation::HeadingDelta, SchemeConfig::Lapped(lapped)),
    ];
    presets().into_iter().chain(own.map(|(name, rotation, scheme)| (name, fit(rotation, scheme)))).collect()
}

#[test]
fn every_character_has_a_meaning() {
    for (name, t) in &all() {
        let legend = t.legend();
        for series in &legend.series {
            let sum: f64 = series.joints.iter().map(|(_, share)| share).sum();
            assert!((0.9..1.0 + 1e-9).contains(&sum), "{name}, {}: {sum}", series.name);
            assert!(series.joints.iter().all(|(j, _)| t.config().joints.contains(j) || *j == 0), "{name}");
        }
        let (words, mut values) = (t.encode(&calm(140)).unwrap().words, 0);
        for word in words.iter() {
            let meanings = t.meanings(word);
            assert_eq!(meanings.len(), word.len(), "{name}");
            let mut next = 0;
            for meaning in meanings {
                match meaning {
                    Meaning::Value { number, value } => {
                        assert!(number == next && value.is_finite(), "{name}: {number} at {next}");
                        (next, values) = (number + 1, values + 1);
                    }
                    Meaning::Digit { number } => assert_eq!(number, next, "{name}"),
                    Meaning::Zeros(range) => {
                        assert!(range.start == next && !range.is_empty(), "{name}: {range:?} at {next}");
                        next = range.end;
                    }
                    Meaning::Nothing => panic!("{name}: a character without a meaning in {word:?}"),
                }
            }
            assert!(next <= legend.numbers.len());
        }
        assert!(values > 100 && legend.numbers.iter().all(|n| n.series < legend.series.len()), "{name}");
    }
}

#[test]
fn characters_after_the_last_number_have_none() {
    let (_, t) = presets().into_iter().find(|(name, _)| *name == "dct").unwrap();
    let most = t.legend().numbers.len();
    // the longest run, of 20 zeros, until the word is full
    let word = vec![109; most.div_ceil(20) + 1];
    let meanings = t.meanings(&word);
    assert_eq!(meanings[0], Meaning::Zeros(0..20));
    assert_eq!(meanings[word.len() - 2], Meaning::Zeros(most.div_ceil(20) * 20 - 20..most));
    assert_eq!(meanings[word.len() - 1], Meaning::Nothing);
}

/// The open series (S, F) of a clip.
fn rows(t: &Tokenizer, clip: &Clip) -> Vec<f64> {
    let mut rows = vec![0.0; open_count(t.channels()) * clip.frames()];
    open(t.channels(), clip, 0..clip.frames(), clip.frames(), &mut rows);
    rows
}

/// The pelvis's turn about the vertical in one clip less that in another, radians, within half a turn.
fn turned(a: &Clip, b: &Clip, f: usize) -> f64 {
    let [a, b] = [a, b].map(|clip| Split::of(clip.pose(f)[0]).unwrap().turn);
    (b - a + PI).rem_euclid(TAU) - PI
}

/// What a change of a number in word `w` moves, beside what its meaning says of it: both as sums of squares.
fn moved(t: &Tokenizer, legend: &Legend, number: usize, w: usize, a: &Clip, b: &Clip) -> Vec<(f64, f64)> {
    let (l, n) = (t.frames_per_word(), a.frames());
    let series = &legend.series[legend.numbers[number].series];
    let own = w * l..(w + 1) * l;
    let square = |x: f64| x * x;
    let root = |f: usize| b.root()[f] - a.root()[f];
    let sum = |each: &dyn Fn(usize) -> f64| own.clone().map(each).sum::<f64>() / l as f64;
    match (series.name.as_str(), series.unit) {
        (name, Unit::MetresPerFrame) if name.contains("translation") => {
            vec![((1..n).map(|f| (root(f) - root(f - 1)).length_squared()).sum::<f64>() / l as f64, 1.0)]
        }
        (_, Unit::RadiansPerFrame) => {
            vec![((1..n).map(|f| square(turned(a, b, f) - turned(a, b, f - 1))).sum::<f64>() / l as f64, 1.0)]
        }
        (name, _) if name.contains("over the hop") || name.contains("at the first frame") => {
            let end = if name.contains("turn") { square(turned(a, b, n - 1)) } else { root(n - 1).length_squared() };
            vec![(end, 1.0)]
        }
        // heights are of the word alone, but for the lapped windows
        (name, _) if name.contains("height") => {
            vec![((0..n).map(|f| root(f).length_squared()).sum::<f64>() / l as f64, 1.0)]
        }
        (name, _) if name.contains("translation") => vec![(sum(&|f| root(f).length_squared()), 1.0)],
        (name, _) if name.contains("turn") => vec![(sum(&|f| square(turned(a, b, f))), 1.0)],
        _ => {
            let (x, y) = (rows(t, a), rows(t, b));
            let change = |row: usize, f: usize| y[row * n + f] - x[row * n + f];
            let joints = open_joints(t.channels());
            if let Fitted::Lapped(lapped) = &t.fitted
                && series.name.starts_with("component")
            {
                // in the metric of the joints' positions, together with the height
                let of = |f: usize| (0..joints.len()).map(|row| change(row, f)).chain([root(f).y]).collect::<Vec<_>>();
                let all = (0..n).map(|f| lapped.weigh(&of(f)).into_iter().map(square).sum::<f64>());
                return vec![(all.sum::<f64>() / l as f64, 1.0)];
            }
            let arm = |joint: usize| if series.unit == Unit::Metres { lever_arms()[joint] } else { 1.0 };
            let of = |joint: usize| {
                let own = (0..joints.len()).filter(|&row| joints[row] == joint);
                own.map(|row| (0..n).map(|f| square(change(row, f) * arm(joint))).sum::<f64>()).sum::<f64>()
            };
            series.joints.iter().map(|&(joint, share)| (of(joint) / l as f64, share)).collect()
        }
    }
}

#[test]
fn values_are_what_decoding_gives() {
    for (name, t) in &all() {
        let (l, legend) = (t.frames_per_word(), t.legend());
        let words = t.encode(&calm(6 * l.max(4))).unwrap().words;
        let whole = t.decode(&words, UncodedPose::Identity).unwrap();
        let (w, mut checked) = (words.len() / 2, 0);
        for at in (0..words.word(w).len()).step_by(1 + words.word(w).len() / 40) {
            let mut word = words.word(w).to_vec();
            let before = t.meanings(&word)[at].clone();
            // the next bin, or the other sign
            word[at] ^= 1;
            let (Meaning::Value { number, value }, after) = (before, t.meanings(&word)[at].clone()) else { continue };
            let Meaning::Value { number: same, value: changed } = after else { continue };
            let mut other = words.slice(0..w);
            other.push(&word);
            words.slice(w + 1..words.len()).iter().for_each(|word| other.push(word));
            let other = t.decode(&other, UncodedPose::Identity).unwrap();
            let change: f64 = changed - value;
            // a large one may take a rotation vector beyond half a turn, where its twin is nearer to the frame before
            if change.abs() > 0.3 {
                continue;
            }
            for (found, share) in moved(t, &legend, number, w, &whole, &other) {
                let expected = share * change * change;
                let what = &legend.series[legend.numbers[number].series].name;
                assert!((found - expected).abs() <= 1e-6 * expected + 1e-12, "{name}, {what}: {found} {expected}");
            }
            assert_eq!(number, same);
            checked += 1;
        }
        assert!(checked > 8, "{name}: {checked}");
    }
}

/// A frame's degrees by hand: 90 bins of 4 degrees, the middle one centred on 0.
#[test]
fn a_frame_by_hand() {
    let (_, t) = presets().into_iter().find(|(name, _)| *name == "uniform, headings").unwrap();
    let legend = t.legend();
    let names: Vec<&str> = legend.series.iter().map(|series| series.name.as_str()).collect();
    let expected = ["translation x, step", "translation y, height", "translation z, step", "pelvis turn, step"];
    assert_eq!(
        (&names[..4], names[4], names[6], legend.word),
        (&expected[..], "pelvis tilt x", "left_knee x", "frame")
    );
    let mut word = t.neutral();
    (word[3], word[7]) = (46, 40);
    let degrees = |at: usize| match t.meanings(&word)[at] {
        Meaning::Value { value, .. } => value.to_degrees(),
        _ => f64::NAN,
    };
    assert!((degrees(3) - 4.0).abs() < 1e-9 && (degrees(7) + 20.0).abs() < 1e-9 && degrees(8) == 0.0);
    let mut words = Words::new();
    words.push(&word);
    let clip = t.decode(&words, UncodedPose::Identity).unwrap();
    let Meaning::Value { value: height, .. } = t.meanings(&word)[1] else { panic!("no height") };
    assert!((clip.root()[0].y - height).abs() < 1e-12);
}
