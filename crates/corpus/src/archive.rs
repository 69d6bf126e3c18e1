//! Motion files inside a tar archive, read where they lie: data sets come so, as WebDataset's shards do.

use kinelm_store::input;
use std::collections::HashMap;
use std::fs;
use std::io::{self, ErrorKind};
use std::path::{Component, Path, PathBuf};
use tar::Archive;

/// Bytes of a header, and of what files are filled up to.
const BLOCK: u64 = 512;
/// The extension of an archive.
const EXTENSION: &str = "tar";

/// A file inside an archive.
#[derive(Debug, Clone, PartialEq)]
pub struct Member {
    /// The archive.
    pub archive: PathBuf,
    /// Where its bytes begin.
    at: u64,
    /// How many there are.
    length: u64,
}

/// The files of an archive.
#[derive(Debug, Default)]
pub struct Members {
    /// Each with its path in the archive, `/` between parts; in the archive's order. Of equal paths the last, as unpacking
    /// leaves it.
    pub files: Vec<(String, Member)>,
    /// Why what follows these can't be read, if so.
    pub fault: Option<String>,
}

/// Whether a file is an archive, by its name.
pub fn is_archive(path: &Path) -> bool {
    path.extension().is_some_and(|extension| extension.eq_ignore_ascii_case(EXTENSION))
}

/// Lists an archive: its headers alone are read. Hidden files and all but plain files are left out.
///
/// # Errors
/// I/O errors of opening it. Headers that can't be read are the [`Members::fault`].
pub fn members(archive: &Path) -> io::Result<Members> {
    let mut all = Members::default();
    let mut places: HashMap<String, usize> = HashMap::new();
    let file = input::open(archive)?;
    let (whole, mut end) = (file.metadata()?.len(), 0);
    let mut tar = Archive::new(file);
    for entry in tar.entries_with_seek()? {
        let found = entry.and_then(|entry| {
            let path = entry.path()?.into_owned();
            let length = entry.size();
            Ok((path, entry.header().entry_type().is_file(), entry.raw_file_position(), length))
        });
        let (path, is_file, at, length) = match found {
            Ok(found) => found,
            Err(e) => {
                all.fault = Some(e.to_string());
                break;
            }
        };
        end = at.saturating_add(length).next_multiple_of(BLOCK);
        let parts: Vec<String> = path
            .components()
            .filter_map(|part| match part {
                Component::Normal(part) => Some(part.to_string_lossy().into_owned()),
                _ => None,
            })
            .collect();
        if !is_file || parts.is_empty() || parts.iter().any(|part| part.starts_with('.')) {
            continue;
        }
        let member = (parts.join("/"), Member { archive: archive.to_owned(), at, length });
        match places.get(&member.0) {
            Some(&place) => all.files[place] = member,
            None => {
                places.insert(member.0.clone(), all.files.len());
                all.files.push(member);
            }
        }
    }
    // blocks of zeros end an archive; one that is cut before a header has none
    if all.fault.is_none() && end >= whole {
        all.fault = Some("it has no end, as one that is cut".into());
    }
    Ok(all)
}

impl Member {
    /// Its bytes.
    ///
    /// # Errors
    /// I/O errors; an archive that ends before the file does.
    pub fn bytes(&self) -> io::Result<Vec<u8>> {
        self.first(u64::MAX)
    }

    /// Its first bytes, `most` at most.
    ///
    /// # Errors
    /// As [`Member::bytes`].
    pub fn first(&self, most: u64) -> io::Result<Vec<u8>> {
        let (wanted, has) = (self.length.min(most), fs::metadata(&self.archive)?.len());
        if has.saturating_sub(self.at) < wanted {
            let path = self.archive.display();
            let what = format!("{path} has {has} bytes and ends before this file does: copy it again");
            return Err(io::Error::new(ErrorKind::UnexpectedEof, what));
        }
        input::part(&self.archive, self.at, wanted)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use tar::{Builder, EntryType, Header};

    fn archive(files: &[(&str, &[u8])]) -> Vec<u8> {
        let mut tar = Builder::new(Vec::new());
        for (path, bytes) in files {
            let mut header = Header::new_gnu();
            header.set_size(bytes.len() as u64);
            header.set_entry_type(if path.ends_with('/') { EntryType::Directory } else { EntryType::Regular });
            tar.append_data(&mut header, path, *bytes).unwrap();
        }
        tar.into_inner().unwrap()
    }

    #[test]
    fn files_are_read_where_they_lie() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.TAR");
        let long = format!("{}/x.bvh", "folder".repeat(30));
        let all: [(&str, &[u8]); 6] = [
            ("d/", b""),
            ("d/b.bvh", b"old"),
            (".hidden/c.bvh", b"c"),
            ("a.bvh", b""),
            (&long, b"far"),
            ("d/b.bvh", b"newer"),
        ];
        let bytes = archive(&all);
        std::fs::write(&path, &bytes).unwrap();
        let found = members(&path).unwrap();
        let read: Vec<_> = found.files.iter().map(|(name, member)| (name.as_str(), member.bytes().unwrap())).collect();
        assert_eq!(read, [("d/b.bvh", b"newer".to_vec()), ("a.bvh", vec![]), (&long, b"far".to_vec())]);
        assert_eq!(found.files[0].1.first(3).unwrap(), b"new");
        assert!(is_archive(&path) && !is_archive(Path::new("a.tar.gz")) && found.fault.is_none());
        // cut inside the last file, and inside a header
        std::fs::write(&path, &bytes[..bytes.len() - 1536]).unwrap();
        let cut = members(&path).unwrap();
        let e = cut.files[0].1.bytes().map_err(|e| e.to_string());
        assert!(cut.fault.is_some() || e.is_err_and(|e| e.contains("ends before")));
        std::fs::write(&path, &bytes[..700]).unwrap();
        assert!(members(&path).unwrap().fault.is_some());
        // cut before a header: that of the folder, which has no bytes, is whole
        std::fs::write(&path, &bytes[..512]).unwrap();
        assert!(members(&path).unwrap().fault.unwrap().contains("no end"));
    }
}
