//! Floor detection on recorded motion of people who dance on a floor.

use kinelm_motion::format::{self, ReadOptions, RestFrame};
use kinelm_motion::rig::{Humanoid, map_for};
use std::path::PathBuf;

/// Every `nth` clip of a set, in path order.
fn clips(set: &str, nth: usize) -> Vec<PathBuf> {
    let Some(folder) = kinelm_shared_data::set(set, "floor_shared") else { return Vec::new() };
    let (mut found, mut folders) = (Vec::new(), vec![folder]);
    while let Some(folder) = folders.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            match path.is_dir() {
                true => folders.push(path),
                false if path.extension().is_some_and(|e| e == "bvh") => found.push(path),
                false => {}
            }
        }
    }
    found.sort();
    found.into_iter().step_by(nth).collect()
}

#[test]
fn floors_of_the_shared_sets() {
    for (set, nth, reach_m) in [("cmu-dance", 1, 0.2), ("bandai-1", 6, 0.1), ("bandai-2", 60, 0.1)] {
        let (mut doubted, paths) = (0, clips(set, nth));
        for path in &paths {
            let motion = format::read(path, &ReadOptions { rest: RestFrame::Drop, ..Default::default() }).unwrap();
            let map = map_for(motion.clip.skeleton(), None).unwrap();
            let floor = Humanoid::with_map(motion.clip.skeleton(), &map).floor(&motion.clip).unwrap();
            assert!(floor.height_m.abs() < reach_m, "{}: {floor:?}", path.display());
            doubted += usize::from(!floor.doubts.is_empty());
        }
        assert!(20 * doubted <= paths.len(), "{set}: {doubted} of {} floors are in doubt", paths.len());
    }
}
