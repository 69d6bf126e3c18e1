//! Hips of recorded motion don't flip: no clip of the sets on hand is named, at its own rate and at a tokenizer's.

use kinelm_motion::format::{self, ReadOptions};
use kinelm_motion::resample::{Method, resample};
use kinelm_spectral::filter::hips::flips;
use std::path::{Path, PathBuf};

/// Every n-th clip of the large sets, in path order; all with `KINELM_ALL_SHARED_FILES`.
const NTH: usize = 20;

fn files(folder: &Path, all: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        match path.is_dir() {
            true => files(&path, all),
            false if path.extension().is_some_and(|e| e == "bvh") => all.push(path),
            false => {}
        }
    }
}

#[test]
fn no_recorded_dancer_flips() {
    let mut checked = 0;
    for (set, nth) in [("cmu-dance", 1), ("bandai-1", NTH), ("bandai-2", NTH)] {
        let Some(folder) = kinelm_shared_data::set(set, "flips_shared") else { return };
        let mut paths = Vec::new();
        files(&folder, &mut paths);
        paths.sort();
        let nth = if std::env::var_os("KINELM_ALL_SHARED_FILES").is_some() { 1 } else { nth };
        for path in paths.iter().step_by(nth) {
            let motion = format::read(path, &ReadOptions::default()).unwrap();
            let hips = motion.humanoid().unwrap().pose().unwrap().joints[0].unwrap();
            let slow = resample(&motion.clip, 20.0, Method::Auto).unwrap();
            for clip in [&motion.clip, &slow] {
                assert_eq!(flips(clip, hips), [], "{} at {} fps", path.display(), clip.fps());
            }
            checked += 1;
        }
    }
    println!("{checked} clips checked");
    assert!(checked > 40);
}
