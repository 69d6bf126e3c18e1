use super::*;
use kinelm_model::run::LIMITS;
use kinelm_motion::joints::EIGHTEEN;
use kinelm_motion::{Quat, Vec3, synth};

fn dance(seconds: f64) -> Clip {
    synth::corpus(4, 1, seconds, 20.0).unwrap().remove(0).clip
}

fn scorer() -> Scorer {
    Scorer::new(&EIGHTEEN).unwrap()
}

/// Limits of a dance, and its windows.
fn limits(scorer: &Scorer) -> (Limits, Vec<Measures>) {
    let windows = scorer.windows(&dance(30.0));
    let weighted: Vec<(Measures, f64)> = windows.iter().map(|found| (found.clone(), 1.0)).collect();
    (Limits::of(&weighted), windows)
}

/// A clip with other roots and rotations.
fn changed(clip: &Clip, root: impl Fn(usize, Vec3) -> Vec3, joint: impl Fn(usize, usize, Quat) -> Quat) -> Clip {
    let roots = clip.root().iter().enumerate().map(|(f, p)| root(f, *p)).collect();
    let rotations = clip.rotations().iter().enumerate().map(|(i, q)| joint(i / 24, i % 24, *q)).collect();
    Clip::new(clip.skeleton().clone(), clip.fps(), roots, rotations).unwrap()
}

#[test]
fn windows_that_limits_were_made_of_never_do_what_none_does() {
    let scorer = scorer();
    let (limits, windows) = limits(&scorer);
    assert_eq!(windows.len(), 29, "two seconds each, a second apart");
    for found in &windows {
        assert!(limits.never(found).iter().all(Option::is_none), "{found:?}");
    }
    let mut scores: Vec<f64> = windows.iter().map(|found| scorer.score(found, &limits)).collect();
    scores.sort_by(f64::total_cmp);
    assert!(scores[scores.len() / 2] < 1.0, "{scores:?}");
}

#[test]
fn each_fault_costs() {
    let scorer = scorer();
    let (limits, _) = limits(&scorer);
    let clip = dance(6.0);
    let block = 40..80;
    let score = |clip: &Clip| scorer.score(&scorer.measures(clip, block.clone()), &limits);
    let (own, keep) = (score(&clip), |_: usize, p: Vec3| p);
    let snaps = |f: usize, j: usize, q: Quat| if j == 16 && f == 60 { Quat::from_rotation_z(2.5) * q } else { q };
    let bends = |f: usize, j: usize, q: Quat| if j == 4 && f > 40 { Quat::from_rotation_x(3.1) } else { q };
    let same = |_: usize, _: usize, q: Quat| q;
    let still = |f: usize| clip.pose(f.min(39)).to_vec();
    let stands = Clip::new(
        clip.skeleton().clone(),
        clip.fps(),
        (0..clip.frames()).map(|f| clip.root()[f.min(39)]).collect(),
        (0..clip.frames()).flat_map(still).collect(),
    )
    .unwrap();
    for (name, worse) in [
        ("leans", changed(&clip, keep, |_, j, q| if j == 0 { Quat::from_rotation_x(0.7) * q } else { q })),
        ("snaps", changed(&clip, keep, snaps)),
        ("bends", changed(&clip, keep, bends)),
        ("sinks", changed(&clip, |_, p| p - Vec3::Y * 0.3, same)),
        ("falls", changed(&clip, |f, p| if f > 50 { Vec3::new(p.x, 0.1, p.z) } else { p }, same)),
        ("stands", stands),
        ("flies", changed(&clip, |f, p| p + Vec3::X * 0.6 * f as f64, same)),
    ] {
        assert!(score(&worse) > own + 1.0, "{name}: {} beside {own}", score(&worse));
    }
}

#[test]
fn a_snap_into_the_first_frame_counts_and_what_comes_before_does_not() {
    let (scorer, clip) = (scorer(), dance(6.0));
    let turned = |from: usize| {
        let turn =
            move |f: usize, j: usize, q: Quat| if j == 17 && f >= from { Quat::from_rotation_y(2.0) * q } else { q };
        scorer.measures(&changed(&clip, |_, p| p, turn), 40..80)
    };
    let own = scorer.measures(&clip, 40..80);
    assert_eq!(own.snap_share, 0.0);
    assert_eq!(turned(40).snap_share, 1.0 / 40.0);
    assert!(turned(40).most.turn_deg[17] > own.most.turn_deg[17] + 60.0);
    assert_eq!(turned(39).snap_share, 0.0);
    // without anything before it the first step is within
    assert_eq!(scorer.measures(&clip, 0..1).speed_cm_s, 0.0);
}

#[test]
fn a_file_of_limits_is_read_as_it_was_written() {
    let dir = tempfile::tempdir().unwrap();
    let (limits, _) = limits(&scorer());
    assert_eq!(Limits::load(dir.path()).unwrap(), Limits::default());
    let path = dir.path().join(LIMITS);
    std::fs::write(&path, limits.to_json()).unwrap();
    assert_eq!(Limits::load(dir.path()).unwrap(), limits);
    for (text, says) in [
        (limits.to_json().replace("\"version\": 1", "\"version\": 2"), "version 2"),
        ("{".into(), "EOF"),
        (limits.to_json().replacen("\"spread\": ", "\"spread\": -", 1), "spreads above 0"),
        (limits.to_json().replace("\"turn_deg\": [", "\"turn_deg\": [1.0,"), "25"),
    ] {
        std::fs::write(&path, text).unwrap();
        let error = Limits::load(dir.path()).unwrap_err().to_string();
        assert!(error.contains(says) && error.contains(LIMITS), "{error}");
    }
}

#[test]
fn the_weight_of_a_corpus_decides_what_is_usual() {
    let scorer = scorer();
    let slow = Measures { speed_cm_s: 10.0, ..scorer.windows(&dance(6.0)).remove(0) };
    let fast = Measures { speed_cm_s: 100.0, ..slow.clone() };
    let usual = |weight: f64| Limits::of(&[(slow.clone(), 1.0), (fast.clone(), weight)]).usual(&slow)[5].1.unwrap();
    assert_eq!((usual(9.0).from.unwrap(), usual(0.1).to), (100f64.ln(), 10f64.ln()));
    assert_eq!(Limits::of(&[]), Limits::default());
}
