//! The BVH reader and writer on recorded motion.

use kinelm_motion::format::{self, ReadOptions, RestFrame, bvh};
use kinelm_motion::rotation::angle_between;
use kinelm_motion::{Clip, Motion, Source};
use std::path::{Path, PathBuf};

/// Every `step`-th file of a set; all of them if the variable is set.
fn files(folder: &Path, step: usize) -> Vec<PathBuf> {
    fn walk(folder: &Path, all: &mut Vec<PathBuf>) {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                walk(&path, all);
            } else if path.extension().is_some_and(|e| e == "bvh") {
                all.push(path);
            }
        }
    }
    let mut all = Vec::new();
    walk(folder, &mut all);
    all.sort();
    let step = if std::env::var_os("KINELM_ALL_SHARED_FILES").is_some() { 1 } else { step };
    all.into_iter().step_by(step).collect()
}

fn parse(name: &str, bytes: &[u8]) -> Motion {
    bvh::read(Path::new(name), bytes, &ReadOptions::default()).unwrap()
}

/// Largest distance of joints, metres, and largest angle between local rotations, degrees.
fn differences(a: &Clip, b: &Clip) -> (f64, f64) {
    assert_eq!((a.frames(), a.joints(), a.fps()), (b.frames(), b.joints(), b.fps()));
    let distance = a.positions().iter().zip(b.positions()).map(|(p, q)| p.distance(q)).fold(0.0, f64::max);
    let turned = a.rotations().iter().zip(b.rotations()).map(|(p, q)| angle_between(*p, *q)).fold(0.0, f64::max);
    (distance, turned.to_degrees())
}

/// Read, write, read: with the file's own numbers, and through rotations.
fn round_trip(path: &Path) {
    let name = path.display().to_string();
    let first = parse(&name, &std::fs::read(path).unwrap());
    let written = bvh::to_bytes(&first).unwrap();
    let again = parse(&name, &written);
    let (distance, turned) = differences(&first.clip, &again.clip);
    assert!(distance < 1e-4 && turned < 1e-4, "{name}: own numbers {distance} m {turned} degrees");
    assert!(bvh::to_bytes(&again).unwrap() == written, "{name}: write, read, write");

    let mut touched = first.clone();
    let q = touched.clip.rotations().iter().map(|q| -*q).collect();
    touched.clip = Clip::new(first.clip.skeleton().clone(), first.clip.fps(), first.clip.root().to_vec(), q).unwrap();
    let written = bvh::to_bytes(&touched).unwrap();
    let again = parse(&name, &written);
    let (distance, turned) = differences(&first.clip, &again.clip);
    assert!(distance < 1e-4 && turned < 1e-4, "{name}: rotations {distance} m {turned} degrees");
    assert!(bvh::to_bytes(&again).unwrap() == written, "{name}: write, read, write of rotations");
}

#[test]
fn round_trips() {
    for (set, step) in [("cmu-dance", 1), ("bandai-1", 10), ("bandai-2", 100)] {
        let Some(folder) = kinelm_shared_data::set(set, "round_trips") else { continue };
        let files = files(&folder, step);
        assert!(!files.is_empty());
        files.iter().for_each(|f| round_trip(f));
    }
}

#[test]
fn rest_frames_are_found_in_cmu_alone() {
    for (set, step, flagged) in [("cmu-dance", 4, true), ("bandai-1", 20, false), ("bandai-2", 200, false)] {
        let Some(folder) = kinelm_shared_data::set(set, "rest_frames_are_found_in_cmu_alone") else { continue };
        for path in files(&folder, step) {
            let keep = format::read(&path, &ReadOptions::default()).unwrap();
            assert_eq!(format::has_rest_frame(&keep), flagged, "{}", path.display());
            let drop = format::read(&path, &ReadOptions { rest: RestFrame::Drop, ..Default::default() }).unwrap();
            assert_eq!(drop.clip.frames(), keep.clip.frames() - usize::from(flagged));
            assert_eq!(drop.warnings.iter().any(|w| w.kind == "rest_frame"), flagged);
            let Source::Bvh(source) = &drop.source else { panic!("a BVH") };
            assert!(source.is_untouched(&drop.clip));
        }
    }
}

#[test]
fn every_number_is_that_of_the_standard_library() {
    for (set, step) in [("cmu-dance", 7), ("bandai-1", 40), ("bandai-2", 400)] {
        let Some(folder) = kinelm_shared_data::set(set, "every_number_is_that_of_the_standard_library") else {
            continue;
        };
        for path in files(&folder, step) {
            let bytes = std::fs::read(&path).unwrap();
            let options = ReadOptions::default();
            let head = bvh::parse_header(&path, &bytes, &options).unwrap();
            let (numbers, _) = head.rows(&path, &bytes, &options).unwrap();
            let text = std::str::from_utf8(&bytes[head.rows_at..]).unwrap();
            let std = text.split_ascii_whitespace().map(|w| w.parse::<f64>().unwrap().to_bits());
            assert!(numbers.iter().map(|v| v.to_bits()).eq(std), "{}", path.display());
        }
    }
}

#[test]
fn positions_are_those_of_the_clip_where_both_have_a_joint() {
    for (set, step, count) in [("cmu-dance", 20, 57), ("bandai-1", 60, 27), ("bandai-2", 600, 27)] {
        let Some(folder) = kinelm_shared_data::set(set, "positions_are_those_of_the_clip_where_both_have_a_joint")
        else {
            return;
        };
        for path in files(&folder, step) {
            let m = format::read(&path, &ReadOptions::default()).unwrap();
            let p = format::positions(&path, &ReadOptions::default()).unwrap();
            assert_eq!((p.joints.len(), p.positions.len() / count, p.fps), (count, m.clip.frames(), m.clip.fps()));
            let clip = m.clip.positions();
            for (j, name) in m.clip.skeleton().names().iter().enumerate() {
                let n = p.joints.iter().position(|n| n == name).unwrap();
                for f in 0..m.clip.frames() {
                    let distance = clip[f * m.clip.joints() + j].distance(p.positions[f * count + n]);
                    // a bone has one length in the clip, while its channels round differently in each frame
                    assert!(distance < 0.001, "{} frame {f} {name}: {distance}", path.display());
                }
            }
        }
    }
}
