//! The formats of motion files, a row each: for reading, writing, messages, folders and help.

#[cfg(feature = "aist")]
use super::aist;
#[cfg(feature = "amass")]
use super::amass;
#[cfg(feature = "fbx")]
use super::fbx;
use super::{ReadOptions, amc, bvh, glb, json};
use crate::{FaultKind, FileError, Motion, Result};
use kinelm_store::SourcePos;
use std::path::Path;

/// The formats of motion files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Format {
    /// `.bvh`.
    Bvh,
    /// `.amc`, with an `.asf` beside it: read, not written.
    Amc,
    /// `.glb`, and `.vrm`, which is one: a VRM is written only with an animation embedded.
    Glb,
    /// `.vrma`: an animation of VRM's, which is a GLB too.
    Vrma,
    /// `.npz`: AMASS.
    Npz,
    /// `.pkl`: AIST++.
    Pickle,
    /// `.json`: a clip in this crate's own format.
    Json,
    /// `.fbx`: read, not written.
    Fbx,
}

/// A format: all that the rest of the crate needs to know of it.
#[derive(Debug)]
pub struct FormatInfo {
    /// The format.
    pub format: Format,
    /// Its name, for people.
    pub name: &'static str,
    /// The extensions of its files, in lower case.
    pub extensions: &'static [&'static str],
    /// The extensions of those that are written.
    pub(super) written: &'static [&'static str],
    /// Whether its bones are SMPL's own, whose left is left and whose length is known.
    pub(super) is_smpl: bool,
    /// The steps of [`super::parse`] after its reader.
    pub(super) then: &'static [Step],
    /// The feature of this crate that it needs; empty for a format that is always there.
    pub(super) feature: &'static str,
    /// Reads a motion; `None` in a build without the feature.
    pub(super) read: Option<Read>,
    /// Writes a motion; `None` for a format that is read only, and without the feature.
    pub(super) write: Option<Write>,
}

type Read = fn(&Path, &[u8], &ReadOptions) -> Result<Motion>;
type Write = fn(&Path, &Motion) -> Result<Vec<u8>>;

/// The extension of VRM's avatars, which are GLBs.
pub(super) const VRM: &str = "vrm";

/// A step after reading that several formats share.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Step {
    /// Drop the first frames.
    Skip,
    /// Take the clip out of a mirrored world.
    Mirror,
    /// Begin the clip at its motion root.
    Root,
    /// Doubt the size of the body.
    Size,
}

/// A function of a module that only some builds have.
macro_rules! of_feature {
    ($feature:literal, $function:expr) => {{
        #[cfg(feature = $feature)]
        let function = Some($function as _);
        #[cfg(not(feature = $feature))]
        let function = None;
        function
    }};
}

/// The defaults of a row: a format that is always there, with bones of its own, and read only.
const READ_ONLY: FormatInfo = FormatInfo {
    format: Format::Bvh,
    name: "",
    extensions: &[],
    written: &[],
    is_smpl: false,
    then: &[],
    feature: "",
    read: None,
    write: None,
};

/// The formats, in the order in which messages list them.
pub const FORMATS: &[FormatInfo] = &[
    FormatInfo {
        format: Format::Bvh,
        name: "BVH",
        extensions: &["bvh"],
        written: &["bvh"],
        // its reader takes the other steps itself
        then: &[Step::Size],
        read: Some(bvh::read),
        write: Some(|_, motion| bvh::to_bytes(motion)),
        ..READ_ONLY
    },
    FormatInfo {
        format: Format::Amc,
        name: "AMC",
        extensions: &["amc"],
        then: &[Step::Skip, Step::Mirror, Step::Root, Step::Size],
        read: Some(amc::read),
        ..READ_ONLY
    },
    FormatInfo {
        format: Format::Glb,
        name: "GLB",
        extensions: &["glb", VRM],
        written: &["glb"],
        then: &[Step::Skip],
        read: Some(glb::read),
        write: Some(|path, motion| glb::motion_to_bytes(path, motion, None)),
        ..READ_ONLY
    },
    FormatInfo {
        format: Format::Vrma,
        name: "VRM animation",
        extensions: &["vrma"],
        written: &["vrma"],
        then: &[Step::Skip],
        read: Some(glb::read_vrma),
        write: Some(glb::motion_to_vrma),
        ..READ_ONLY
    },
    FormatInfo {
        format: Format::Npz,
        name: "AMASS",
        extensions: &["npz"],
        written: &["npz"],
        is_smpl: true,
        then: &[Step::Skip, Step::Root, Step::Size],
        feature: "amass",
        read: of_feature!("amass", amass::read),
        write: of_feature!("amass", |_: &Path, motion: &Motion| amass::write(&motion.clip)),
    },
    FormatInfo {
        format: Format::Pickle,
        name: "AIST++",
        extensions: &["pkl"],
        is_smpl: true,
        then: &[Step::Skip, Step::Root, Step::Size],
        feature: "aist",
        read: of_feature!("aist", aist::read),
        ..READ_ONLY
    },
    FormatInfo {
        format: Format::Json,
        name: "JSON",
        extensions: &["json"],
        written: &["json"],
        then: &[Step::Skip, Step::Root, Step::Size],
        read: Some(json::read),
        write: Some(|_, motion| json::to_bytes(motion)),
        ..READ_ONLY
    },
    FormatInfo {
        format: Format::Fbx,
        name: "FBX",
        extensions: &["fbx"],
        then: &[Step::Skip, Step::Mirror],
        feature: "fbx",
        read: of_feature!("fbx", fbx::read),
        ..READ_ONLY
    },
];

impl Format {
    /// The extensions of motion files that are written, most used first.
    pub const WRITTEN: [&str; 5] = ["bvh", "npz", "json", "glb", "vrma"];

    /// The extensions of motion files that are read, in lower case. A build without the feature of a format knows its
    /// extension too, and says so.
    pub fn extensions() -> impl Iterator<Item = &'static str> {
        FORMATS.iter().flat_map(|info| info.extensions.iter().copied())
    }

    /// The format by the file's extension, in any letter case.
    pub fn of_name(path: &Path) -> Option<Format> {
        let extension = path.extension()?.to_str()?;
        let is_own = |info: &&FormatInfo| info.extensions.iter().any(|own| own.eq_ignore_ascii_case(extension));
        FORMATS.iter().find(is_own).map(|info| info.format)
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

    /// Its row.
    pub fn info(self) -> &'static FormatInfo {
        FORMATS.iter().find(|info| info.format == self).expect("every format has a row")
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
        let built = FORMATS.iter().filter(|info| info.read.is_some());
        listed(built.flat_map(|info| info.extensions.iter().copied()))
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
        let all = Format::read_list();
        assert!(all.starts_with(".bvh, .amc, .glb, .vrm, .vrma, .npz, .pkl"), "{all}");
        for (name, help) in [("a.C3D", "markers, not joints"), ("a.gltf", "one .glb"), ("a.asf", ".amc"), ("a", "")] {
            assert!(said(name).contains(help) && said(name).contains(&all), "{}", said(name));
        }
        assert_eq!(listed(Format::WRITTEN), ".bvh, .npz, .json, .glb or .vrma");
        for info in FORMATS {
            assert_eq!(info.format.info().name, info.name);
            for name in info.extensions {
                assert_eq!(Format::of_name(Path::new(&format!("a.{}", name.to_uppercase()))), Some(info.format));
            }
        }
    }

    #[test]
    fn what_a_row_writes_is_listed_once() {
        let mut written: Vec<&str> = FORMATS.iter().flat_map(|info| info.written.iter().copied()).collect();
        let mut listed = Format::WRITTEN.to_vec();
        written.sort_unstable();
        listed.sort_unstable();
        assert_eq!(written, listed);
        for info in FORMATS {
            assert!(info.written.iter().all(|name| info.extensions.contains(name)), "{}", info.name);
            assert!(info.written.is_empty() || info.write.is_some() || info.read.is_none(), "{}", info.name);
        }
    }
}
