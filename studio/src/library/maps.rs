//! Skeleton maps that the user has written: files of the project's folder `maps/`.
//!
//! They are named `maps/NAME.toml`, as a timeline has it, and nothing else is opened as a map.

use crate::project::dances::{free_name, plain_name};
use crate::project::{MAPS, Project};
use crate::{Error, Result};
use kinelm_motion::rig::SkeletonMap;
use kinelm_store::{files, owned};
use std::fs;
use std::path::{Path, PathBuf};

/// The most bytes of a map.
pub const MOST_BYTES: usize = 256 << 10;
/// The most maps that are listed.
const MOST_MAPS: usize = 1000;

/// The maps of a project's folder, as `maps/NAME.toml`.
pub fn names(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder.join(MAPS)).into_iter().flatten().flatten();
    let named = entries.filter_map(|entry| Some(format!("{MAPS}/{}", entry.file_name().to_str()?)));
    // names that aren't plain, and links, are no maps: `own` opens nothing outside the folder
    let mut all: Vec<String> = named.filter(|name| own(folder, name).is_some()).take(MOST_MAPS).collect();
    all.sort();
    all
}

/// Whether a clip may be read with a map: a built-in one or one of the project.
pub fn is_known(folder: &Path, map: &str) -> bool {
    SkeletonMap::builtin(map).is_some() || own(folder, map).is_some()
}

/// A map as the reader takes it: the name of a built-in one, or the text of one of the project.
///
/// # Errors
/// A map that is neither, or can't be read.
pub fn resolved(folder: &Path, map: &str) -> Result<String> {
    if SkeletonMap::builtin(map).is_some() {
        return Ok(map.into());
    }
    let path = own(folder, map).ok_or_else(|| unknown(map))?;
    let bytes = owned::bytes(folder, map, MOST_BYTES as u64)?.ok_or_else(|| unknown(map))?;
    let text = String::from_utf8(bytes).map_err(|_| no_text(&path))?;
    // again, though `keep` has checked it: the user may have edited the file
    check(&path, &text)?;
    Ok(text)
}

/// A map that a clip can't be read with.
pub fn unknown(map: &str) -> Error {
    let last = map.rsplit(['/', '\\']).next().unwrap_or_default();
    let built_in: Vec<&str> = SkeletonMap::names().collect();
    let expected = format!("a built-in map ({}), or one of the project: drop its .toml in", built_in.join(", "));
    Error::invalid_parameter("map", plain_name(last), expected)
}

/// Stores a map under the name that the page gives it; it replaces none. Its name, as [`names`] has it.
///
/// # Errors
/// A text that is no map, or a long one; I/O errors.
pub fn keep(project: &Project, called: &str, bytes: &[u8]) -> Result<String> {
    // either separator: a browser on another system may send a path
    let last = called.rsplit(['/', '\\']).next().unwrap_or_default();
    let stem = plain_name(last.rsplit_once('.').map_or(last, |(stem, _)| stem));
    let text = str::from_utf8(bytes).map_err(|_| no_text(Path::new(&stem)))?;
    check(Path::new(&format!("{stem}.toml")), text)?;
    let folder = project.folder().join(MAPS);
    fs::create_dir_all(&folder).map_err(Error::io(&folder))?;
    let name = free_name(&stem, ".toml", |name| folder.join(name).symlink_metadata().is_err());
    files::write_whole(&owned::path(project.folder(), Path::new(MAPS).join(&name))?, bytes)?;
    Ok(format!("{MAPS}/{name}"))
}

fn no_text(path: &Path) -> Error {
    Error::file(path, "bytes that are no UTF-8", "a skeleton map", "save it as UTF-8")
}

fn check(path: &Path, text: &str) -> Result<()> {
    if text.len() > MOST_BYTES {
        let (needs, limit) = (format!("{} bytes", text.len()), format!("{MOST_BYTES} bytes"));
        return Err(Error::limit("the map", needs, limit, "a map of 24 joints takes some thousand"));
    }
    SkeletonMap::parse(text, path)?;
    Ok(())
}

/// The file of a map of the project; `None` for a link.
fn own(folder: &Path, map: &str) -> Option<PathBuf> {
    let name = map.strip_prefix(MAPS)?.strip_prefix('/')?;
    let is_plain = files::is_plain(name) && name.ends_with(".toml");
    let is_folder = folder.join(MAPS).symlink_metadata().is_ok_and(|found| found.is_dir());
    let path = folder.join(MAPS).join(name);
    (is_plain && is_folder && path.symlink_metadata().is_ok_and(|found| found.is_file())).then_some(path)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn maps_are_named_and_nothing_else_is_opened() {
        let dir = tempfile::tempdir().unwrap();
        let project = Project::open(dir.path()).unwrap();
        let folder = project.folder();
        let text = SkeletonMap::builtin("cmu").unwrap().to_toml().replace("\"cmu\"", "\"mine\"");
        assert_eq!(names(folder), [""; 0]);
        assert_eq!(keep(&project, "../../my rig.toml", text.as_bytes()).unwrap(), "maps/my rig.toml");
        assert_eq!(keep(&project, "my rig.TOML", text.as_bytes()).unwrap(), "maps/my rig-2.toml");
        assert_eq!(names(folder), ["maps/my rig-2.toml", "maps/my rig.toml"]);
        assert_eq!(resolved(folder, "maps/my rig.toml").unwrap(), text);
        assert_eq!(resolved(folder, "mixamo").unwrap(), "mixamo");
        fs::write(folder.join("secret.toml"), &text).unwrap();
        for map in ["secret.toml", "maps/../secret.toml", "/etc/passwd", "maps", "maps/", "maps/none.toml", &text] {
            assert!(!is_known(folder, map), "{map}");
            assert!(resolved(folder, map).unwrap_err().to_string().contains("drop its .toml in"), "{map}");
        }
        assert!(keep(&project, "a.toml", b"name = 3\n").is_err() && keep(&project, "a.toml", &[0xff]).is_err());
        let long = format!("{text}#{}", "x".repeat(MOST_BYTES));
        assert_eq!(keep(&project, "a.toml", long.as_bytes()).unwrap_err().status(), 413);
        assert_eq!(names(folder).len(), 2);
    }

    #[test]
    #[cfg(unix)]
    fn a_link_is_no_map() {
        let dir = tempfile::tempdir().unwrap();
        fs::create_dir(dir.path().join(MAPS)).unwrap();
        let text = SkeletonMap::builtin("cmu").unwrap().to_toml();
        fs::write(dir.path().join("elsewhere.toml"), text).unwrap();
        std::os::unix::fs::symlink(dir.path().join("elsewhere.toml"), dir.path().join("maps/a.toml")).unwrap();
        assert!(names(dir.path()).is_empty() && resolved(dir.path(), "maps/a.toml").is_err());
    }
}
