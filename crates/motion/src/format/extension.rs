//! The formats of motion files by the extensions of their names: one list for reading, messages, folders and help.

use crate::{FaultKind, FileError, Result};
use kinelm_store::SourcePos;
use std::path::Path;

/// The formats of motion files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Format {
    /// `.amc`, with an `.asf` beside it: read, not written.
    Amc,
    /// `.bvh`.
    Bvh,
    /// `.npz`: AMASS.
    Npz,
    /// `.pkl`: AIST++.
    Pickle,
    /// `.json`: a clip in this crate's own format.
    Json,
    /// `.glb`, and `.vrm`, which is one: a VRM is read only.
    Glb,
    /// `.fbx`: read, not written.
    Fbx,
}

impl Format {
    /// The extensions of motion files that are read, in lower case, with their formats. A build without the feature of a
    /// format knows its extension too, and says so.
    pub const EXTENSIONS: [(&str, Format); 8] = [
        ("bvh", Format::Bvh),
        ("amc", Format::Amc),
        ("glb", Format::Glb),
        ("vrm", Format::Glb),
        ("npz", Format::Npz),
        ("pkl", Format::Pickle),
        ("json", Format::Json),
        ("fbx", Format::Fbx),
    ];
    /// The extensions of motion files that are written.
    pub const WRITTEN: [&str; 4] = ["bvh", "npz", "json", "glb"];

    /// The format by the file's extension, in any letter case.
    pub fn of_name(path: &Path) -> Option<Format> {
        let extension = path.extension()?.to_str()?;
        Format::EXTENSIONS.iter().find(|(name, _)| name.eq_ignore_ascii_case(extension)).map(|(_, format)| *format)
    }

    /// The format by the file's extension.
    ///
    /// # Errors
    /// [`FaultKind::NotThisFormat`] with the extensions that this build reads.
    pub fn of(path: &Path) -> Result<Format> {
        let found = match path.extension() {
            Some(e) => format!("the extension .{}", e.to_string_lossy()),
            None => "no extension".into(),
        };
        Format::of_name(path).ok_or_else(|| {
            let fault = FileError::new(SourcePos::file(path), FaultKind::NotThisFormat, found, Format::read_list());
            fault.help(Format::way_out(path)).into()
        })
    }

    /// How a file that isn't read becomes one that is, by its extension; empty for any other.
    pub fn way_out(path: &Path) -> &'static str {
        let extension = path.extension().unwrap_or_default().to_ascii_lowercase();
        match extension.to_str() {
            Some("c3d") => {
                "a C3D holds markers, not joints: let the capture system solve it onto a skeleton, and export BVH"
            }
            Some("asf") => "an ASF is a skeleton without motion: give the .amc files beside it",
            Some("gltf") => "a .gltf has its numbers in other files: export it as glTF Binary, one .glb",
            _ => "",
        }
    }

    /// The extensions that this build reads, as `.bvh, .amc or .json`.
    pub fn read_list() -> String {
        listed(Format::read_extensions())
    }

    /// The extensions that this build reads.
    fn read_extensions() -> impl Iterator<Item = &'static str> {
        let is_built = |format: Format| match format {
            Format::Npz => cfg!(feature = "amass"),
            Format::Pickle => cfg!(feature = "aist"),
            Format::Fbx => cfg!(feature = "fbx"),
            Format::Amc | Format::Bvh | Format::Json | Format::Glb => true,
        };
        Format::EXTENSIONS.into_iter().filter(move |(_, format)| is_built(*format)).map(|(name, _)| name)
    }
}

/// Extensions as `.bvh, .npz or .json`.
pub(super) fn listed(extensions: impl IntoIterator<Item = &'static str>) -> String {
    let all: Vec<String> = extensions.into_iter().map(|name| format!(".{name}")).collect();
    match all.as_slice() {
        [some @ .., last] if !some.is_empty() => format!("{} or {last}", some.join(", ")),
        _ => all.concat(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_not_read_is_refused_with_the_list_and_a_way_out() {
        let said = |name: &str| Format::of(Path::new(name)).unwrap_err().to_string();
        let all = listed(Format::read_extensions());
        assert!(all.starts_with(".bvh, .amc, .glb, .vrm, .npz, .pkl"), "{all}");
        for (name, help) in [("a.C3D", "markers, not joints"), ("a.gltf", "one .glb"), ("a.asf", ".amc"), ("a", "")] {
            assert!(said(name).contains(help) && said(name).contains(&all), "{}", said(name));
        }
        assert_eq!(listed(Format::WRITTEN), ".bvh, .npz, .json or .glb");
        assert!(Format::WRITTEN.iter().all(|name| Format::EXTENSIONS.iter().any(|(known, _)| known == name)));
        for (name, format) in Format::EXTENSIONS {
            assert_eq!(Format::of_name(Path::new(&format!("a.{}", name.to_uppercase()))), Some(format));
        }
    }
}
