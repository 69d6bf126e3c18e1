//! For tests: clips, and a library that reads them in a process of its own, which is this test program.

use crate::library::Library;
use crate::library::child::{Limits, read_file};
use crate::library::reader::Reader;
use crate::library::upload::added;
use crate::project::Project;
use crate::project::document::Change;
use kinelm_motion::{Clip, Motion, format, synth};
use std::path::Path;
use std::sync::Arc;

const CHILD: &str = "KINELM_STUDIO_CHILD";

/// Reads by this test program, whose test below is the other end.
pub fn reader() -> Reader {
    let program = std::env::current_exe().unwrap();
    let args = ["--exact", "fixture::reads_where_it_is_the_child"].map(Into::into).to_vec();
    Reader { program, args, env: vec![(CHILD.into(), "1".into())], limits: Limits::default() }
}

/// Not a test of its own: the process that reads files for the others.
#[test]
fn reads_where_it_is_the_child() {
    if std::env::var_os(CHILD).is_some() {
        read_file().unwrap();
    }
}

/// Opens a project again that was just dropped: a process which another test is just starting may hold the lock's file
/// until it runs.
pub fn open_again(folder: &Path) -> Project {
    let mut tries = (0..100).map(|_| {
        let opened = Project::open(folder);
        if opened.is_err() {
            std::thread::sleep(std::time::Duration::from_millis(20));
        }
        opened
    });
    tries.find_map(Result::ok).unwrap()
}

/// A dance on SMPL's rig.
pub fn dance(seed: u64, seconds: f64, fps: f64) -> Clip {
    synth::corpus(seed, 1, seconds, fps).unwrap().remove(0).clip
}

/// Writes a clip; a GLB as if another program had made it, whose mesh is a user's.
pub fn save(path: &Path, clip: &Clip) {
    let mut bytes = format::to_bytes(path, &Motion::new(path, clip.clone())).unwrap();
    let own = b"\"generator\":\"kinelm ";
    if let Some(at) = bytes.windows(own.len()).position(|here| here == own) {
        bytes[at + own.len() - 7..][..6].copy_from_slice(b"sculpt");
    }
    std::fs::write(path, bytes).unwrap();
}

/// A project with these clips, all read.
pub fn library(folder: &Path, clips: &[(&str, Clip)]) -> (Arc<Project>, Arc<Library>) {
    let project = Arc::new(Project::open(folder).unwrap());
    for (name, clip) in clips {
        save(&folder.join("clips").join(name), clip);
    }
    let changes: Vec<Change> = clips.iter().map(|(name, _)| added(&project, Path::new("clips").join(name))).collect();
    project.plain(changes).unwrap();
    let library = Arc::new(Library::new(project.clone(), reader()));
    read(&project, &library);
    (project, library)
}

/// Reads all clips of a project.
pub fn read(project: &Project, library: &Library) {
    let ids: Vec<String> = project.read(|document| document.clips.iter().map(|clip| clip.id.clone()).collect());
    let left = std::sync::atomic::AtomicUsize::new(ids.len());
    library.read_soon(ids);
    library.read_on(&|_| {
        if left.fetch_sub(1, std::sync::atomic::Ordering::Relaxed) == 1 {
            library.end();
        }
    });
    library.begin_again();
}
