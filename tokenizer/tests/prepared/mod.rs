//! Clips of the shared sets as the tokenizer takes them, with their splits.

use kinelm_motion::format::{ReadOptions, read};
use kinelm_motion::resample::{Method, resample};
use kinelm_motion::{Clip, retarget};
use rayon::prelude::*;
use std::path::{Path, PathBuf};

/// The rows of a set's split list: path, split, true rate.
fn rows(set: &str, folder: &Path) -> Vec<(PathBuf, String, Option<f64>)> {
    let text = std::fs::read_to_string(kinelm_shared_data::split_csv(set)).expect("the set has a split list");
    let mut lines = text.lines().map(|l| l.split(',').collect::<Vec<_>>());
    let header = lines.next().expect("a header");
    let fps = header.iter().position(|&c| c == "fps");
    let row = |r: Vec<&str>| {
        let rate = fps.map(|i| r[i].parse().expect("a rate"));
        (folder.join(r[0]).with_extension("bvh"), r[1].to_string(), rate)
    };
    lines.map(row).collect()
}

/// A set's clips at 20 frames per second, without their first `skip` frames, and which split each is of; `None` where the
/// set isn't on hand.
pub fn clips(set: &str, test: &str, skip: usize) -> Option<Vec<(Clip, String)>> {
    let folder = kinelm_shared_data::set(set, test)?;
    let prepare = |(path, split, fps_source): &(PathBuf, String, Option<f64>)| {
        let options = ReadOptions { fps_source: *fps_source, skip, ..Default::default() };
        let motion = read(path, &options).expect("the set's files are good");
        let smpl = retarget::to_smpl(&motion).expect("the rig is known");
        (resample(&smpl, 20.0, Method::Auto).expect("a good rate"), split.clone())
    };
    Some(rows(set, &folder).par_iter().map(prepare).collect())
}
