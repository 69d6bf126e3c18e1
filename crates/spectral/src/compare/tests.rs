//! Each made-up change is named by its own figure.

use super::*;
use kinelm_motion::format::{self, ReadOptions};
use kinelm_motion::retarget::Retarget;
use kinelm_motion::{Source, Vec3, smpl, synth};

fn dance(seed: u64) -> Clip {
    synth::corpus(seed, 1, 20.0, 30.0).unwrap().remove(0).clip
}

fn compared(teacher: &Clip, student: Clip) -> Comparison {
    let motions = [("teacher.bvh", teacher.clone()), ("student.bvh", student)].map(|(n, c)| Motion::new(n, c));
    compare(&motions[0], &motions[1], &CompareOptions::default()).unwrap().report
}

/// Lag in frames, tempo to 2 %, mirrored.
fn named(report: &Comparison) -> (i64, i64, bool) {
    (report.lag_frames, (50.0 * (report.tempo - 1.0)).round() as i64, report.mirrored)
}

#[test]
fn a_copy_differs_in_nothing() {
    let teacher = dance(3);
    let report = compared(&teacher, teacher.clone());
    assert_eq!((named(&report), report.frames), ((0, 0, false), 600));
    assert_eq!((report.distance_cm, report.moments.len()), (0.0, 0));
    assert!((report.cosine.unwrap() - 1.0).abs() < 1e-6 && report.other_image_cm > 5.0, "{report}");
}

#[test]
fn place_and_heading_do_not_count() {
    let teacher = dance(3);
    let turned = crate::interpolate::align::turned(&teacher, 2.0).unwrap();
    let root = turned.root().iter().map(|p| *p + Vec3::new(3.0, 0.1, -2.0)).collect();
    let away = Clip::new(teacher.skeleton().clone(), 30.0, root, turned.rotations().to_vec()).unwrap();
    let report = compared(&teacher, away);
    assert!(named(&report) == (0, 0, false) && report.distance_cm < 1e-3, "{report}");
}

#[test]
fn a_mirrored_student_is_only_mirrored() {
    for seed in 1..6 {
        let teacher = dance(seed);
        let report = compared(&teacher, mirror(&teacher).unwrap());
        assert!(named(&report) == (0, 0, true) && report.distance_cm < 1e-3, "seed {seed}: {report}");
    }
}

#[test]
fn a_late_student_is_only_late() {
    for seed in 1..6 {
        let teacher = dance(seed);
        for lag in [-30, -13, -1, 1, 7, 30_i64] {
            let by = lag.unsigned_abs() as usize;
            // late: the student's clip has something else first; early: it begins in the midst of the dance
            let student = if lag < 0 {
                teacher.slice(by..teacher.frames())
            } else {
                let first = dance(seed + 10).slice(200..200 + by);
                let root = first.root().iter().chain(teacher.root()).copied().collect();
                let turns = first.rotations().iter().chain(teacher.rotations()).copied().collect();
                Clip::new(teacher.skeleton().clone(), 30.0, root, turns).unwrap()
            };
            let report = compared(&teacher, student);
            assert!(named(&report) == (lag, 0, false) && report.distance_cm < 1e-3, "seed {seed}, {lag}: {report}");
        }
    }
}

#[test]
fn a_faster_student_is_only_faster() {
    for seed in 1..6 {
        let teacher = dance(seed);
        for tempo in [0.8, 0.9, 0.96, 1.04, 1.1, 1.25] {
            let report = compared(&teacher, teacher.clone().with_fps(30.0 * tempo).unwrap());
            let off = (report.tempo / tempo - 1.0).abs();
            assert!(off < 0.02 && !report.mirrored, "seed {seed}, {tempo}: {report}");
            assert!(report.lag_frames.abs() <= 1 && report.distance_cm < 2.0, "seed {seed}, {tempo}: {report}");
        }
    }
}

/// cm between a dance and itself on another rig: spines of fewer joints bend at other places.
const RIG_CM: f64 = 2.0;

#[test]
fn another_rig_changes_little() {
    for (set, file) in [("cmu-dance", "salsa/03.bvh"), ("bandai-1", "dataset-1_bow_active_001.bvh")] {
        let Some(dir) = kinelm_shared_data::set(set, "compare::another_rig") else { return };
        let other = format::read(&dir.join(file), &ReadOptions::default()).unwrap();
        let teacher = dance(4);
        let way = Retarget::new(other.humanoid().unwrap(), smpl::neutral()).unwrap();
        let student = other.clone().with_clip(way.to_rig(&teacher).unwrap()).with_source(Source::Plain);
        let report =
            compare(&Motion::new("teacher.bvh", teacher), &student, &CompareOptions::default()).unwrap().report;
        eprintln!("{set}: {:.3} cm", report.distance_cm);
        assert!(named(&report) == (0, 0, false) && report.distance_cm < RIG_CM, "{set}: {report}");
    }
}

#[test]
fn a_joint_that_errs_is_found_when_it_errs() {
    let teacher = dance(2);
    let mut turns = teacher.rotations().to_vec();
    for frame in 300..345 {
        turns[frame * 24 + 18] = kinelm_motion::Quat::from_rotation_z(1.2) * turns[frame * 24 + 18];
    }
    let student = Clip::new(teacher.skeleton().clone(), 30.0, teacher.root().to_vec(), turns).unwrap();
    let report = compared(&teacher, student);
    assert_eq!(named(&report), (0, 0, false));
    let first: Vec<&str> = report.joints[..2].iter().map(|joint| joint.joint).collect();
    assert_eq!(first, ["left_hand", "left_wrist"]);
    let [moment] = &report.moments[..] else { panic!("{report}") };
    assert!((moment.at_s[0] - 10.75).abs() < 0.5 && moment.joint.joint == "left_hand", "{report}");
}

#[test]
fn the_path_is_the_nearest_of_all() {
    let joints: Vec<usize> = (1..24).collect();
    let [a, b] = [dance(3).slice(100..140), dance(5).slice(60..110)].map(|clip| BodyPoses::of(&clip, &joints));
    let line = nearest_line(&a, &b, 20);
    let found = path(&a, &b, line, 60).unwrap();
    // every cell of the matrix, by the definition
    let mut best = vec![vec![0.0; b.frames()]];
    for row in 0..found.student.len() {
        let reached = |j: usize| match row {
            0 => 0.0,
            _ => (0..=2).filter_map(|step| best[row].get(j.checked_sub(step)?)).copied().fold(f64::INFINITY, f64::min),
        };
        let next = (0..b.frames()).map(|j| reached(j) + a.distance(found.from + row, &b, j)).collect();
        best.push(next);
    }
    let least = best[found.student.len()].iter().copied().fold(f64::INFINITY, f64::min);
    let sum =
        |path: &Path| -> f64 { path.student.iter().enumerate().map(|(n, &j)| a.distance(path.from + n, &b, j)).sum() };
    assert!((sum(&found) - least).abs() < 1e-9, "{} {least}", sum(&found));
    assert!(found.student.windows(2).all(|pair| (0..=2).contains(&(pair[1] - pair[0]))));
    let narrow = path(&a, &b, line, 3).unwrap();
    let off = narrow.student.iter().enumerate().map(|(n, &j)| (j as i64 - line.at(narrow.from + n)).abs());
    assert!(off.max().unwrap() <= 3 && sum(&narrow) >= sum(&found));
    // the joints' mean is the frame's distance
    let each: f64 = a.distances(5, &b, 9).sum::<f64>() / 23.0;
    assert!((each - a.distance(5, &b, 9)).abs() < 1e-6);
}

#[test]
fn a_part_of_the_teachers_dance_is_found_where_it_is() {
    let teacher = dance(4);
    for lag in [1, 9, 18, 29] {
        for length in [60, 240] {
            let report = compared(&teacher, teacher.slice(lag..lag + length));
            assert_eq!(named(&report), (-(lag as i64), 0, false), "{length} frames: {report}");
            assert!(report.distance_cm < 1e-9 && report.at_limit == [false; 2], "{report}");
        }
    }
}

#[test]
fn what_lies_beyond_the_search_is_said() {
    let teacher = dance(4);
    let late = compared(&teacher, teacher.slice(45..400));
    assert!(late.at_limit[0] && late.to_string().contains("30 frames, at the limit of the search"), "{late}");
    let times: Vec<f64> = (0..400).map(|f| 1.4 * f as f64).collect();
    let fast = compared(&teacher, kinelm_motion::resample::at_frames(&teacher, &times).unwrap());
    assert!(fast.at_limit[1] && fast.tempo <= TEMPI[1], "{fast}");
}
