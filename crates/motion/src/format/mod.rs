//! Motion files: detected by name and first bytes, read into a [`Motion`], and written.
//!
//! BVH, AMC, JSON and GLB are always available, `.npz` with the feature `amass`, `.pkl` with `aist`, `.fbx` with `fbx`.

#[cfg(feature = "aist")]
pub mod aist;
#[cfg(feature = "amass")]
pub mod amass;
pub mod amc;
#[cfg(feature = "amass")]
pub mod array;
#[cfg(feature = "amass")]
pub mod body_model;
pub mod bvh;
#[cfg(feature = "fbx")]
pub mod fbx;
mod floor;
pub mod glb;
mod importer;
pub mod json;
#[cfg(feature = "amass")]
pub mod npy;
#[cfg(feature = "amass")]
pub mod npz;
mod options;
#[cfg(feature = "amass")]
pub mod pickle;
mod posed;
pub mod positions;
pub mod rate;
mod rest;
#[cfg(feature = "amass")]
mod smpl_arrays;
mod sniff;
pub mod source;
mod up;

pub use floor::{floor_height, resolve_floor};
pub use importer::Importer;
pub use options::{BvhPosition, ReadOptions, RestFrame, Unit};
pub use rate::{RateDoubt, RateDoubts};
pub use rest::{has_rest_frame, smeared_frames};
pub use sniff::sniff;
pub use source::{Motion, Source};
pub use up::{Axes, Up, UpSource, standing_axis};

use crate::error::compact;
use crate::resample::{FEWEST_FPS, MOST_FPS};
use crate::rig::{SkeletonMap, made_to_stand, recognise};
use crate::{Error, FaultKind, FileError, Result, Warning};
use kinelm_store::Subject;
use kinelm_store::{SourcePos, files, input};
use options::{check_skip, is_rate};
use positions::Positions;
use std::io::Read;
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
    /// The format by the file's extension, in any letter case.
    pub fn of_name(path: &Path) -> Option<Format> {
        let extension = path.extension()?.to_str()?.to_ascii_lowercase();
        Some(match extension.as_str() {
            "amc" => Format::Amc,
            "bvh" => Format::Bvh,
            "npz" => Format::Npz,
            "pkl" => Format::Pickle,
            "json" => Format::Json,
            "glb" | "vrm" => Format::Glb,
            "fbx" => Format::Fbx,
            _ => return None,
        })
    }

    /// The format by the file's extension.
    ///
    /// # Errors
    /// [`FaultKind::NotThisFormat`] with the supported extensions.
    pub fn of(path: &Path) -> Result<Format> {
        let found = match path.extension() {
            Some(e) => format!("the extension .{}", e.to_string_lossy()),
            None => "no extension".into(),
        };
        let expected = ".bvh, .amc, .glb, .npz, .pkl or .json";
        Format::of_name(path).ok_or_else(|| {
            let fault = FileError::new(SourcePos::file(path), FaultKind::NotThisFormat, found, expected);
            let is = |extension: &str| path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension));
            let help = if is("c3d") {
                "a C3D holds markers, not joints: let the capture system solve it onto a skeleton, and export BVH"
            } else if is("asf") {
                "an ASF is a skeleton without motion: give the .amc files beside it"
            } else {
                ""
            };
            fault.help(help).into()
        })
    }
}

/// Reads a motion file.
///
/// The extension decides the format, and the first bytes must agree. Then `fps_source` replaces the rate, `skip` drops
/// frames, and, if `skip` is 0, a leading rest-pose frame is detected, reported as the warning `rest_frame`, and kept or
/// dropped as `rest` says. If the rate was not given, it is doubted when the body falls too fast ([`RateDoubt`]).
///
/// # Errors
/// [`kinelm_store::Error::Io`]; [`Error::File`] with position and kind for a faulty file;
/// [`Invalid`](kinelm_store::Error::Invalid) for a rate out of range; [`Unsupported`](kinelm_store::Error::Unsupported) for
/// `up` if the format defines its own axes; [`Error::Clip`] when no frame is left after `skip`.
///
/// ```
/// use kinelm_motion::format::{self, ReadOptions};
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("two.bvh");
/// std::fs::write(&path, "HIERARCHY\nROOT hips { OFFSET 0 0 0 CHANNELS 1 Xrotation End Site { OFFSET 0 1 0 } }\n\
///                        MOTION\nFrames: 2\nFrame Time: 0.05\n0\n90\n")?;
/// let options = ReadOptions { unit: format::Unit::Metre, ..ReadOptions::default() };
/// let motion = format::read(&path, &options)?;
/// assert_eq!((motion.clip.frames(), motion.clip.fps()), (2, 20.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn read(path: &Path, options: &ReadOptions) -> Result<Motion> {
    let format = Format::of(path).map_err(|e| with_content_kind(e, path))?;
    check_rate(options)?;
    check_up(path, format, options)?;
    parse(path, &input::bytes(path).map_err(Error::io(path))?, options)
}

/// Reads a motion from the bytes of a file. `path` gives the format and is used in messages.
///
/// # Errors
/// Those of [`read`] except for I/O errors.
pub fn parse(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Motion> {
    let format = Format::of(path)?;
    check_rate(options)?;
    check_up(path, format, options)?;
    let motion = match format {
        Format::Amc => skipped(amc::read(path, bytes, options)?, options)?,
        Format::Bvh => bvh::read(path, bytes, options)?,
        #[cfg(feature = "amass")]
        Format::Npz => skipped(amass::read(path, bytes, options)?, options)?,
        #[cfg(not(feature = "amass"))]
        Format::Npz => return Err(left_out(path, "amass")),
        #[cfg(feature = "aist")]
        Format::Pickle => skipped(aist::read(path, bytes, options)?, options)?,
        #[cfg(not(feature = "aist"))]
        Format::Pickle => return Err(left_out(path, "aist")),
        #[cfg(feature = "fbx")]
        Format::Fbx => skipped(fbx::read(path, bytes, options)?, options)?,
        #[cfg(not(feature = "fbx"))]
        Format::Fbx => return Err(left_out(path, "fbx")),
        Format::Json => match sniff(bytes) {
            "JSON" | "text" => skipped(json::read(path, bytes, options)?, options)?,
            other => {
                return Err(
                    FileError::new(SourcePos::file(path), FaultKind::NotThisFormat, other, "a clip as JSON").into()
                );
            }
        },
        Format::Glb => skipped(glb::read(path, bytes, options)?, options)?,
    };
    let fps = motion.clip.fps();
    if !is_rate(fps) {
        let (found, expected) =
            (compact(fps), format!("frames per second of at least {FEWEST_FPS}, at most {MOST_FPS}"));
        let fault = FileError::new(SourcePos::file(path), FaultKind::RateBad, found, expected);
        return Err(fault.help("give the true rate as `fps_source`").into());
    }
    let mut motion = rest::handle_rest_frame(motion, options);
    if options.map.is_none() {
        let rig = motion.clip.skeleton();
        motion.warnings.extend(match SkeletonMap::detect(rig.names()) {
            Some(map) => made_to_stand(map, &motion.clip).map(|map| Warning {
                kind: "rest_pose",
                what: format!("no body stands in the rig's rest pose, as the map {} needs it: its reference pose is made from the clip", map.name),
            }),
            None => recognise(rig, Some(&motion.clip)).and_then(|found| found.warning()),
        });
    }
    if options.fps_source.is_none() {
        motion.warnings.extend(RateDoubt::of(&motion.clip).map(|doubt| doubt.warning()));
    }
    Ok(motion)
}

/// The error of a format that this build doesn't include.
#[cfg(not(all(feature = "amass", feature = "aist", feature = "fbx")))]
fn left_out(path: &Path, feature: &str) -> Error {
    let expected = format!("a build of kinelm-motion with its feature `{feature}`");
    FileError::new(SourcePos::file(path), FaultKind::NotThisFormat, "a format that this build leaves out", expected)
        .into()
}

/// Adds the detected kind of content to the error of an unknown extension.
fn with_content_kind(error: Error, path: &Path) -> Error {
    let mut head = [0; 512];
    match (error, input::open(path).and_then(|mut file| file.read(&mut head))) {
        (Error::File(e), Ok(_)) if !e.help.is_empty() => e.into(),
        (Error::File(e), Ok(n)) => e.help(format!("the file looks like {}", sniff(&head[..n]))).into(),
        (_, Err(e)) => Error::io(path)(e),
        (e, _) => e,
    }
}

/// Positions of all joints and end sites of a motion file. For BVH they follow the file's own channels and order, with no
/// joint folded; for other formats, the clip's skeleton (for AMASS and AIST++ the neutral one or the body model's).
///
/// # Errors
/// Those of [`read`].
pub fn positions(path: &Path, options: &ReadOptions) -> Result<Positions> {
    check_rate(options)?;
    let format = Format::of(path)?;
    check_up(path, format, options)?;
    match format {
        Format::Bvh => bvh::positions(path, &input::bytes(path).map_err(Error::io(path))?, options),
        _ => Ok(Positions::from_clip(&read(path, options)?.clip)),
    }
}

/// Drops the first `skip` frames.
fn skipped(motion: Motion, options: &ReadOptions) -> Result<Motion> {
    if options.skip == 0 {
        return Ok(motion);
    }
    let frames = motion.clip.frames();
    check_skip(&motion.path, options.skip, frames)?;
    Ok(motion.slice(options.skip..frames))
}

/// Checks that the source rate is in range.
fn check_rate(options: &ReadOptions) -> Result<()> {
    if let Some(fps) = options.fps_source.filter(|f| !is_rate(*f)) {
        let (found, expected) = (compact(fps), format!("frames per second, {FEWEST_FPS} to {MOST_FPS}"));
        return Err(Error::invalid("`fps_source`", found, expected));
    }
    Ok(())
}

/// Refuses `up` for formats that define their own axes.
fn check_up(path: &Path, format: Format, options: &ReadOptions) -> Result<()> {
    let own = match format {
        Format::Amc | Format::Bvh | Format::Json => return Ok(()),
        Format::Glb => "a GLB has y up",
        Format::Npz => "an AMASS file has z up",
        Format::Pickle => "an AIST++ file has y up",
        Format::Fbx => "an FBX states its up axis",
    };
    if options.up == Up::Auto {
        return Ok(());
    }
    let why = format!("{own}, always; `up` is for BVH, AMC and JSON");
    let what = Subject::of_parameter("up").with(format!("{} of {}", options.up, path.display()));
    Err(Error::unsupported(what, why))
}

/// Writes a motion file in the format of its extension, atomically.
///
/// # Errors
/// [`kinelm_store::Error::Io`] and those of [`to_bytes`].
pub fn write(path: &Path, motion: &Motion) -> Result<()> {
    Ok(files::write_whole(path, &to_bytes(path, motion)?)?)
}

/// The content that [`write()`] writes.
///
/// # Errors
/// [`FaultKind::NotThisFormat`] for an extension that can't be written; [`Invalid`](kinelm_store::Error::Invalid) for a clip
/// that the format can't hold.
pub fn to_bytes(path: &Path, motion: &Motion) -> Result<Vec<u8>> {
    match Format::of(path)? {
        Format::Bvh => bvh::to_bytes(motion),
        #[cfg(feature = "amass")]
        Format::Npz => amass::write(&motion.clip),
        #[cfg(not(feature = "amass"))]
        Format::Npz => Err(left_out(path, "amass")),
        Format::Json => match motion.source {
            Source::Json(axes) => Ok(json::write(axes.restored(&motion.clip)?.as_ref())),
            _ => Ok(json::write(&motion.clip)),
        },
        Format::Glb if !is_vrm(path) => {
            glb::to_bytes(&[(&path.file_stem().unwrap_or_default().to_string_lossy(), &motion.clip)])
        }
        Format::Amc | Format::Pickle | Format::Fbx | Format::Glb => {
            let found = format!("the extension .{}", path.extension().unwrap_or_default().to_string_lossy());
            let expected = "a .bvh, .npz, .json or .glb to write";
            Err(FileError::new(SourcePos::file(path), FaultKind::NotThisFormat, found, expected).into())
        }
    }
}

/// A VRM is a GLB with an avatar that we don't make.
fn is_vrm(path: &Path) -> bool {
    path.extension().is_some_and(|e| e.eq_ignore_ascii_case("vrm"))
}

#[cfg(test)]
mod tests {
    use super::*;

    const BVH: &str = "HIERARCHY\nROOT a { OFFSET 0 0 0 CHANNELS 1 Xrotation End Site { OFFSET 0 1 0 } }\nMOTION\nFrames: 2\n\
                       Frame Time: 0.05\n1\n2\n";

    #[test]
    fn names_and_first_bytes_must_agree() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            path
        };
        let options = ReadOptions { unit: Unit::Metre, ..Default::default() };
        let message = |path: &Path| read(path, &options).unwrap_err().to_string();
        assert_eq!(read(&file("a.BvH", BVH.as_bytes()), &options).unwrap().clip.frames(), 2);
        let e = message(&file("a.txt", BVH.as_bytes()));
        assert!(
            e.contains("not_this_format")
                && e.contains(".bvh, .amc, .glb, .npz, .pkl or .json")
                && e.contains("looks like a BVH"),
            "{e}"
        );
        let e = message(&file("b.bvh", b"PK\x03\x04poses.npy"));
        assert!(e.contains("not_bvh") && e.contains("an npz archive"), "{e}");
        for name in ["c.npz", "c.pkl", "c.json"] {
            let e = message(&file(name, BVH.as_bytes()));
            assert!(e.contains("BVH") || e.contains("HIERARCHY"), "{name}: {e}");
        }
        assert!(matches!(
            read(&folder.path().join("none.bvh"), &options),
            Err(Error::Store(kinelm_store::Error::Io { .. }))
        ));
        assert!(matches!(
            read(&folder.path().join("none"), &options),
            Err(Error::Store(kinelm_store::Error::Io { .. }))
        ));
    }

    #[test]
    fn the_rate_and_the_first_frames() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bvh");
        std::fs::write(&path, BVH).unwrap();
        let with = |fps, skip| ReadOptions { unit: Unit::Metre, fps_source: fps, skip, ..Default::default() };
        let m = read(&path, &with(Some(60.0), 1)).unwrap();
        assert_eq!((m.clip.fps(), m.clip.frames()), (60.0, 1));
        for fps in [0.0, -1.0, f64::NAN, f64::INFINITY] {
            assert_eq!(read(&path, &with(Some(fps), 0)).unwrap_err().kind(), kinelm_store::Kind::Call);
        }
        // a replaced rate is written; the numbers are still the file's own
        let out = folder.path().join("b.bvh");
        write(&out, &m).unwrap();
        let text = std::fs::read_to_string(&out).unwrap();
        assert!(text.ends_with("Frames: 1\nFrame Time: 0.0166666667\n2.000000\n"), "{text}");
        let markers = folder.path().join("a.C3D");
        std::fs::write(&markers, [2, 0x50]).unwrap();
        let message = read(&markers, &ReadOptions::default()).unwrap_err().to_string();
        assert!(message.contains("a C3D holds markers, not joints"), "{message}");
        assert!(write(&folder.path().join("b.fbx"), &m).is_err());
    }
}
