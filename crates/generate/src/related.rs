//! Files that are viewed together: a generated dance and the clips that it follows, as its sidecar says.

use crate::provenance::{self, Provenance};
use kinelm_motion::format::ReadOptions;
use kinelm_store::hash;
use std::path::{Path, PathBuf};

/// A file to view.
#[derive(Debug, Clone)]
pub struct ViewedFile {
    /// The file.
    pub path: PathBuf,
    /// How it is read.
    pub options: ReadOptions,
    /// Files with the same number are shown at their positions relative to each other.
    pub world: Option<usize>,
    /// The file's height that is on the floor of that world, metres: a dance that follows a clip has its floor at 0,
    /// wherever the clip's is.
    pub floor_m: f64,
    /// The parts that were generated, seconds, where the rest was given.
    pub generated_s: Vec<[f64; 2]>,
    /// Lines to print.
    pub notes: Vec<String>,
}

/// The files of a page, which are read with `options`. A clip that one of the dances follows is read as it was for that dance,
/// and is in one world with it.
pub fn related(paths: &[&Path], options: Vec<ReadOptions>) -> Vec<ViewedFile> {
    let known: Vec<Option<Provenance>> = paths.iter().map(|path| provenance_of(path)).collect();
    let mut all = Vec::new();
    for ((path, options), provenance) in paths.iter().zip(options).zip(&known) {
        let generated_s = provenance.as_ref().map(|provenance| provenance.generated_s.clone()).unwrap_or_default();
        let path = path.to_path_buf();
        all.push(ViewedFile { path, options, world: None, floor_m: 0.0, generated_s, notes: Vec::new() });
    }
    for (n, provenance) in known.iter().enumerate().filter_map(|(n, provenance)| Some((n, provenance.as_ref()?))) {
        let followed = followed(provenance);
        for m in (0..known.len()).filter(|&m| m != n && known[m].is_none()) {
            let read = followed.iter().find(|(hash, _)| is_file(paths[m], hash));
            let Some((_, read)) = read else { continue };
            if all[m].world.is_none() {
                all[m].options = read.clone();
                let note = format!("{}: read as {} followed it", paths[m].display(), provenance.output.file);
                all[m].notes.push(note);
            }
            let world = all[m].world.or(all[n].world).unwrap_or(m);
            // a dance without a placement starts at the origin, wherever its prompt does
            if provenance.request.placement.is_some() {
                (all[m].world, all[n].world) = (Some(world), Some(world));
                let known = provenance.read.floor.zip(read.floor);
                (all[n].floor_m, all[m].floor_m) = known.unwrap_or_default();
            }
        }
    }
    all
}

/// The sidecar of a dance that hasn't changed since.
fn provenance_of(path: &Path) -> Option<Provenance> {
    // what is wrong with a sidecar is reported when the clip is read
    provenance::find(path).ok().flatten().filter(|provenance| is_file(path, &provenance.output.sha256))
}

/// The hashes of the clips that a dance follows, and how they were read: its prompt, or the clips of its timeline.
fn followed(provenance: &Provenance) -> Vec<(String, ReadOptions)> {
    let Some(prompt) = &provenance.request.prompt else { return Vec::new() };
    match &prompt.timeline {
        // a clip that is gone can't be compared
        Some(timeline) => {
            let clips = timeline.clips.values();
            clips.filter_map(|clip| Some((hash::of_file(&clip.file).ok()?, clip.options()))).collect()
        }
        None => provenance.prompt_sha256.iter().map(|hash| (hash.clone(), prompt.read.clone())).collect(),
    }
}

fn is_file(path: &Path, sha256: &str) -> bool {
    hash::of_file(path).is_ok_and(|found| found == sha256)
}
