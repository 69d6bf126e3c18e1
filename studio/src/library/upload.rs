//! An upload in pieces: into a temporary file first, which is whole and synced before it has its name.

use super::is_taken;
use crate::project::dances::{free_name, plain_name};
use crate::project::document::{Change, ClipRecord, Reading};
use crate::project::{CLIPS, Project};
use crate::{Error, Result};
use kinelm_corpus::music::library::EXTENSIONS as SOUNDS;
use kinelm_motion::format::Format;
use kinelm_store::owned;
use kinelm_store::part::PartFile;
use std::path::{Path, PathBuf};
use std::sync::Mutex;

/// The most bytes of a file.
pub const MOST_BYTES: u64 = 512 << 20;

/// Held while a free name is found and taken, so that two uploads don't take one.
static NAMING: Mutex<()> = Mutex::new(());

/// A file that is coming. Dropped before it is whole, it leaves nothing.
#[derive(Debug)]
pub struct Upload {
    part: PartFile,
    bytes: u64,
    name: String,
}

/// The name of an upload, from the page's name for it: its last part, with the extension of a known kind.
///
/// # Errors
/// A kind of file that isn't read.
pub fn name_of(called: &str) -> Result<String> {
    let last = called.rsplit(['/', '\\']).next().unwrap_or_default();
    let path = Path::new(last);
    let extension = path.extension().and_then(|e| e.to_str()).unwrap_or_default();
    if !is_taken(path) || extension.is_empty() {
        let expected = format!("motion ({}) or music (.{})", Format::read_list(), SOUNDS.join(", ."));
        return Err(Error::file(plain_name(last), "a file of another kind", expected, Format::way_out(path)));
    }
    let stem = plain_name(path.file_stem().and_then(|s| s.to_str()).unwrap_or_default());
    Ok(format!("{stem}.{}", extension.to_ascii_lowercase()))
}

impl Upload {
    /// Begins an upload.
    ///
    /// # Errors
    /// Those of [`name_of`]; I/O errors.
    pub fn begin(project: &Project, called: &str) -> Result<Upload> {
        let name = name_of(called)?;
        let part = PartFile::create(&owned::path(project.folder(), Path::new(CLIPS).join(&name))?)?;
        Ok(Upload { part, bytes: 0, name })
    }

    /// Adds a piece.
    ///
    /// # Errors
    /// More bytes than a file may have; I/O errors.
    pub fn write(&mut self, piece: &[u8]) -> Result<()> {
        self.bytes += piece.len() as u64;
        if self.bytes > MOST_BYTES {
            let (needs, limit) = (format!("more than {} MB", MOST_BYTES >> 20), format!("{} MB", MOST_BYTES >> 20));
            return Err(Error::limit(&self.name, needs, limit, "cut it into shorter ones"));
        }
        Ok(self.part.write(piece)?)
    }

    /// Gives the file its name in the project's clips. `None` for a skeleton, which belongs to clips beside it.
    ///
    /// # Errors
    /// An empty file; I/O errors.
    pub fn finish(self, project: &Project) -> Result<Option<Change>> {
        if self.bytes == 0 {
            return Err(Error::file(&self.name, "no bytes", "a file", "upload it again"));
        }
        // the slow part first, without the lock: the name is found and taken at once then
        self.part.sync()?;
        let folder = project.folder().join(CLIPS);
        let _naming = NAMING.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        let (stem, extension) = self.name.rsplit_once('.').unwrap_or((&self.name, ""));
        let name = free_name(stem, &format!(".{extension}"), |name| !folder.join(name).exists());
        self.part.name(&owned::path(project.folder(), Path::new(CLIPS).join(&name))?)?;
        // AMC files find their skeleton beside them by name
        if extension == "asf" {
            return Ok(None);
        }
        Ok(Some(added(project, Path::new(CLIPS).join(&name))))
    }
}

/// The change that takes a file into the library.
pub fn added(project: &Project, file: PathBuf) -> Change {
    let name = file.file_stem().unwrap_or_default().to_string_lossy().into_owned();
    let clip = ClipRecord { id: project.new_id('c'), name, file, reading: Reading::default() };
    Change::Clip { before: None, after: Some(Box::new(clip)) }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::fs;

    fn open() -> (tempfile::TempDir, Project) {
        let dir = tempfile::tempdir().unwrap();
        let project = Project::open(dir.path()).unwrap();
        (dir, project)
    }

    #[test]
    fn names_lead_nowhere() {
        for (called, expected) in [
            ("../../../etc/cron.d/evil.BVH", "evil.bvh"),
            ("C:\\dances\\my dance.fbx", "my dance.fbx"),
            ("a\0b\n.bvh", "a_b_.bvh"),
            ("...bvh", "unnamed.bvh"),
            ("nul.bvh", "_nul.bvh"),
            ("song.MP3", "song.mp3"),
        ] {
            assert_eq!(name_of(called).unwrap(), expected);
        }
        for called in ["", "a", "evil.exe", "index.html", ".bvh", "a.bvh/", "a.toml"] {
            assert!(name_of(called).unwrap_err().to_string().contains("motion (.bvh"), "{called}");
        }
        assert!(name_of("a.gltf").unwrap_err().to_string().contains("export it as glTF Binary"));
    }

    #[test]
    fn the_page_looks_for_the_same_kinds_in_folders() {
        let page = include_str!("../../web/drop.js");
        let list = page.split("const READ = /\\.(").nth(1).unwrap().split(')').next().unwrap();
        let mut known: Vec<&str> = Format::extensions().chain(SOUNDS).chain(["asf"]).collect();
        let mut found: Vec<&str> = list.split('|').collect();
        known.sort_unstable();
        found.sort_unstable();
        assert_eq!(found, known);
    }

    #[test]
    fn a_file_is_whole_or_not_there_and_replaces_none() {
        let (dir, project) = open();
        let names = || {
            let mut all: Vec<String> = fs::read_dir(dir.path().join(CLIPS))
                .unwrap()
                .map(|entry| entry.unwrap().file_name().into_string().unwrap())
                .collect();
            all.sort();
            all
        };
        let mut upload = Upload::begin(&project, "a.bvh").unwrap();
        upload.write(b"half").unwrap();
        assert_eq!(names().len(), 1);
        drop(upload);
        assert_eq!(names(), [""; 0]);
        for n in 0..3 {
            let mut upload = Upload::begin(&project, "x/a.bvh").unwrap();
            upload.write(format!("{n}").as_bytes()).unwrap();
            let Some(Change::Clip { after: Some(clip), .. }) = upload.finish(&project).unwrap() else { panic!() };
            assert_eq!(fs::read_to_string(project.path(&clip.file)).unwrap(), n.to_string());
        }
        assert_eq!(names(), ["a-2.bvh", "a-3.bvh", "a.bvh"]);
        assert!(Upload::begin(&project, "b.bvh").unwrap().finish(&project).is_err());
        let mut skeleton = Upload::begin(&project, "07.asf").unwrap();
        skeleton.write(b"x").unwrap();
        assert_eq!(skeleton.finish(&project).unwrap(), None);
        fs::write(dir.path().join(CLIPS).join("a.bvh.1-00112233445566ff.part"), "left").unwrap();
        drop(project);
        crate::fixture::open_again(dir.path());
        assert_eq!(names(), ["07.asf", "a-2.bvh", "a-3.bvh", "a.bvh"]);
    }

    #[test]
    fn too_many_bytes_are_refused() {
        let (_dir, project) = open();
        let mut upload = Upload::begin(&project, "a.bvh").unwrap();
        upload.bytes = MOST_BYTES;
        assert_eq!(upload.write(b"x").unwrap_err().status(), 413);
    }
}
