//! Comparison with numpy (scripts/reference/features.py), and values by hand.

use super::*;
use crate::synth;

fn golden() -> (JointPositions, serde_json::Value) {
    let text = include_str!("../../../tests/golden/features.json");
    let golden: serde_json::Value = serde_json::from_str(text).unwrap();
    let numbers = |value: &serde_json::Value| -> Vec<f64> {
        value.as_array().unwrap().iter().map(|x| x.as_f64().unwrap()).collect()
    };
    let rows = golden["places"].as_array().unwrap();
    let positions =
        rows.iter().flat_map(|row| numbers(row).chunks(3).map(Vec3::from_slice).collect::<Vec<_>>()).collect();
    let [humerus, shoulders, hips] = numbers(&golden["lengths"])[..] else { panic!("three lengths") };
    let fps = golden["fps"].as_f64().unwrap();
    (JointPositions { positions, fps, lengths: Lengths { humerus, shoulders, hips } }, golden)
}

#[test]
fn features_are_those_of_numpy() {
    let (positions, golden) = golden();
    for (form, name) in [(Formulas::Compat, "compat"), (Formulas::Fixed, "fixed")] {
        let of = |kind: &str, found: &[f64]| {
            let wanted = golden[format!("{kind}_{name}")].as_array().unwrap();
            assert_eq!(wanted.len(), found.len());
            for (i, (wanted, found)) in wanted.iter().zip(found).enumerate() {
                let wanted = wanted.as_f64().unwrap();
                assert!((wanted - found).abs() <= 1e-9 * wanted.abs().max(1.0), "{kind} {name} {i}: {found}, {wanted}");
            }
        };
        of("kinetic", &kinetic(&positions, form));
        of("geometric", &geometric(&positions, form));
    }
}

/// A dance moved, rotated and resampled.
fn changed(clip: &Clip, by: Vec3, turn: f64) -> Clip {
    let turn = crate::Quat::from_rotation_y(turn);
    let root = clip.root().iter().map(|p| turn * *p + by).collect();
    let mut rotations = clip.rotations().to_vec();
    rotations.iter_mut().step_by(24).for_each(|pelvis| *pelvis = turn * *pelvis);
    Clip::new(clip.skeleton().clone(), clip.fps(), root, rotations).unwrap()
}

#[test]
fn fixed_features_don_t_see_where_one_dances_and_compat_ones_do() {
    let clip = synth::corpus(4, 1, 4.0, 60.0).unwrap().remove(0).clip;
    let there = changed(&clip, Vec3::new(5.0, 0.0, 3.0), 1.2);
    let [here, there] = [&clip, &there].map(|clip| JointPositions::of(clip).unwrap());
    for (a, b) in kinetic(&here, Formulas::Fixed).iter().zip(kinetic(&there, Formulas::Fixed)) {
        assert!((a - b).abs() < 1e-6, "{a} {b}");
    }
    for (a, b) in geometric(&here, Formulas::Fixed).into_iter().zip(geometric(&there, Formulas::Fixed)) {
        assert!((a - b).abs() < 0.02, "{a} {b}");
    }
    let faster = |positions: &JointPositions| kinetic(positions, Formulas::Compat)[2];
    assert!(faster(&there) > 3.0 * faster(&here), "it grows with the way from the middle of the room");
}

#[test]
fn a_body_that_stands_moves_nothing() {
    let clip = synth::corpus(4, 1, 1.0, 20.0).unwrap().remove(0).clip;
    let still = clip.slice(3..4);
    let root = vec![still.root()[0]; 30];
    let still = Clip::new(still.skeleton().clone(), 20.0, root, still.pose(0).repeat(30)).unwrap();
    let positions = JointPositions::of(&still).unwrap();
    assert!(kinetic(&positions, Formulas::Fixed).iter().all(|x| (x - 1e-3f64.ln()).abs() < 1e-9));
    let shares = geometric(&positions, Formulas::Fixed);
    assert!([0, 1, 4, 5, 9, 10, 11, 12, 13, 21, 22, 31].iter().all(|&i| shares[i] == 0.0));
    assert!(JointPositions::of(&still.slice(0..1)).unwrap_err().to_string().contains("two frames"));
}
