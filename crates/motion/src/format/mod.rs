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
mod contact;
#[cfg(feature = "fbx")]
pub mod fbx;
mod figure;
mod floor;
mod formats;
pub mod glb;
mod importer;
pub mod json;
mod keys;
mod motion_root;
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
mod rates;
mod reflect;
mod rest;
mod size;
#[cfg(feature = "amass")]
mod smpl_arrays;
mod sniff;
pub mod source;
mod stand;
mod up;

pub(crate) use floor::known_floor;
pub use floor::{floor_and_doubts, floor_height, resolve_floor};
pub use formats::{FORMATS, Format, FormatInfo};
pub use importer::Importer;
pub use options::{BvhPosition, ReadOptions, RestFrame, Unit};
pub use rate::RateDoubt;
pub use rates::{FileRate, RateDoubts, RateGroup};
pub use reflect::MirrorAxis;
pub use rest::{has_rest_frame, smeared_frames};
pub(crate) use sniff::sniff;
pub use source::{Changed, Motion, Source};
pub use stand::standing_axis;
pub use up::{Axes, Up, UpSource};

use crate::error::compact;
use crate::resample::{FEWEST_FPS, MOST_FPS, check_fps};
use crate::rig;
use crate::{Error, FaultKind, FileError, Result};
use formats::Step;
use kinelm_store::{SourcePos, Subject, files, input};
use options::{check_skip, is_rate};
use positions::Positions;
use std::io::Read;
use std::path::Path;

/// Reads a motion file.
///
/// The extension decides the format, and the first bytes must agree. Then `fps_source` replaces the rate, `skip` drops
/// frames, and, if `skip` is 0, a leading rest-pose frame is detected, reported as the warning `rest_frame`, and kept or
/// dropped as `rest` says. If the rate was not given, it is doubted when the body falls too fast ([`RateDoubt`]).
///
/// # Errors
/// [`kinelm_store::Error::Io`]; [`Error::File`] with position and kind for a faulty file;
/// [`Invalid`](kinelm_store::Error::Invalid) for a rate out of range; [`Error::Clip`] when no frame is left after `skip`.
///
/// ```
/// use kinelm_motion::format::{self, ReadOptions};
///
/// let folder = tempfile::tempdir()?;
/// let path = folder.path().join("two.bvh");
/// std::fs::write(&path, "HIERARCHY\nROOT hips { OFFSET 0 0 0 CHANNELS 1 Xrotation End Site { OFFSET 0 1 0 } }\n\
///                        MOTION\nFrames: 2\nFrame Time: 0.05\n0\n90\n")?;
/// let options = ReadOptions { unit: format::Unit::METRE, ..ReadOptions::default() };
/// let motion = format::read(&path, &options)?;
/// assert_eq!((motion.clip.frames(), motion.clip.fps()), (2, 20.0));
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub fn read(path: &Path, options: &ReadOptions) -> Result<Motion> {
    let format = Format::of(path).map_err(|e| with_content_kind(e, path))?;
    check(path, format.info(), options)?;
    parse(path, &input::bytes(path).map_err(Error::io(path))?, options)
}

/// Reads a motion from the bytes of a file. `path` gives the format and is used in messages.
///
/// # Errors
/// Those of [`read`] except for I/O errors.
pub fn parse(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Motion> {
    let info = Format::of(path)?.info();
    check(path, info, options)?;
    let read = info.read.ok_or_else(|| left_out(path, info))?;
    let mut motion = read(path, bytes, options)?;
    if info.then.contains(&Step::Skip) {
        motion = skipped(motion, options)?;
    }
    // nothing to do without one: these formats are y up
    if info.then.contains(&Step::Mirror) && options.mirror_axis.is_some() {
        let (clip, found) = (motion.clip.clone(), motion.found().cloned());
        let clip = Axes::OWN.mirrored(options.mirror_axis).to_y_up(clip)?;
        motion = motion.with_clip(clip).with_found(found);
    }
    if info.then.contains(&Step::Root) {
        motion = rooted(motion, options)?;
    }
    let fps = motion.clip.fps();
    if !is_rate(fps) {
        let (found, expected) =
            (compact(fps), format!("frames per second of at least {FEWEST_FPS}, at most {MOST_FPS}"));
        let fault = FileError::new(SourcePos::file(path), FaultKind::RateBad, found, expected);
        return Err(fault.help("give the true rate as `fps_source`").into());
    }
    // after the root is chosen: the rest frame is recognised by the root's rotation
    let mut motion = rest::handle_rest_frame(motion, options);
    // after frames were dropped, which may have changed the reference pose
    let of_rig = motion.known().map(|humanoid| rig::warnings(&motion.clip, humanoid));
    motion.warnings.extend(of_rig.into_iter().flatten());
    if info.then.contains(&Step::Size) {
        let unit_m = match &motion.source {
            Source::Bvh(bvh) => bvh.rig.unit_m,
            _ => options.unit.metres().unwrap_or(1.0),
        };
        let doubt = size::doubt(&motion.clip, motion.map(), unit_m);
        motion.warnings.extend(doubt);
        // its bones are SMPL's, whatever the unit of the path
        let path_doubt = info.is_smpl.then(|| size::path_doubt(&motion.clip, unit_m));
        motion.warnings.extend(path_doubt.flatten());
    }
    // a body of a wrong size falls at a wrong rate too
    let is_doubted = motion.warnings.iter().any(|w| w.kind == "size_doubted");
    if options.fps_source.is_none() && !is_doubted {
        motion.warnings.extend(RateDoubt::of(&motion.clip).map(|doubt| doubt.warning()));
    }
    Ok(motion)
}

/// A motion whose joints are in the file as they are, from the joint that `root` of the options names, else from its motion
/// root.
fn rooted(motion: Motion, options: &ReadOptions) -> Result<Motion> {
    let (rig, given) = (motion.clip.skeleton(), options.map.as_deref());
    let named = |name: &String| {
        let unknown = || {
            let found = format!("no joint {name:?}");
            FileError::new(SourcePos::file(&motion.path), FaultKind::RootUnknown, found, "a joint of the file")
                .help(format!("there are {}", rig.names().join(", ")))
        };
        rig.find(name).ok_or_else(unknown)
    };
    let joint = options.root.as_ref().map(named).transpose()?;
    let mut found = motion.found().cloned();
    let joint = motion_root::choose(&motion.clip, joint, &mut found, given, |_| false)?;
    if joint == 0 {
        return Ok(motion);
    }
    let clip = motion_root::from_joint(&motion.clip, joint, motion_root::path_of(&motion.clip, joint))?;
    let found = motion_root::map_below(&clip, found, given)?;
    Ok(motion.with_clip(clip).with_found(found))
}

/// The error of a format that this build doesn't include.
fn left_out(path: &Path, info: &FormatInfo) -> Error {
    let expected = format!("a build of kinelm-motion with its feature `{}`", info.feature);
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
    let format = Format::of(path)?;
    check(path, format.info(), options)?;
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

/// Checks that the source rate is in range, and that no mirror is given for bones that are SMPL's own, which no program
/// mirrors.
fn check(path: &Path, info: &FormatInfo, options: &ReadOptions) -> Result<()> {
    if let Some(fps) = options.fps_source.filter(|f| !is_rate(*f)) {
        let (found, expected) = (compact(fps), format!("frames per second, {FEWEST_FPS} to {MOST_FPS}"));
        return Err(Error::invalid_parameter("fps_source", found, expected));
    }
    if options.mirror_axis.is_some() && info.is_smpl {
        let why = "its bones are SMPL's, whose left is left; `mirror_axis` is for files with bones of their own";
        let what = Subject::of_parameter("mirror_axis").with(format!("of {}", path.display()));
        return Err(Error::unsupported(what, why));
    }
    Ok(())
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
/// that the format can't hold, or whose rate no reader takes.
pub fn to_bytes(path: &Path, motion: &Motion) -> Result<Vec<u8>> {
    check_fps(motion.clip.fps())?;
    let info = Format::of(path)?.info();
    check_written(path, info, motion)?;
    info.write.ok_or_else(|| left_out(path, info))?(path, motion)
}

/// Checks whether a dance on the rig of a motion can be written to `path`, before it is made: into the file of its character,
/// if it has one.
///
/// # Errors
/// Those of [`to_bytes`] that don't depend on the dance: an animation's name that is taken or not there, and a character on
/// which none can be put.
pub fn check_place(path: &Path, rig: &Motion) -> Result<()> {
    let format = Format::of(path)?;
    check_written(path, format.info(), rig)?;
    match &rig.source {
        Source::Glb(source) if format == Format::Glb => glb::check_place(path, source),
        _ => Ok(()),
    }
}

/// Checks that a motion is written under a name: one with an extension that is written, or a VRM's that is embedded in.
fn check_written(path: &Path, info: &FormatInfo, motion: &Motion) -> Result<()> {
    let extension = path.extension().unwrap_or_default();
    if info.written.iter().any(|name| extension.eq_ignore_ascii_case(name)) {
        return Ok(());
    }
    let is_vrm = extension.eq_ignore_ascii_case(formats::VRM);
    match motion.avatar().filter(|_| is_vrm) {
        Some(avatar) if avatar.embed => return Ok(()),
        Some(_) => {
            let why = "players of VRM ignore an animation inside a VRM; write a .vrma, the animation of this avatar, or \
                       embed it all the same (`embed`)";
            return Err(Error::unsupported(path.display().to_string(), why));
        }
        None => {}
    }
    let (found, expected) = (extension.to_string_lossy(), formats::listed(Format::WRITTEN));
    let (found, expected) = (format!("the extension .{found}"), format!("a {expected} to write"));
    let fault = FileError::new(SourcePos::file(path), FaultKind::NotThisFormat, found, expected);
    let help = if is_vrm { "a .vrm is an avatar: a .vrma animates it, whatever its rig" } else { "" };
    Err(fault.help(help).into())
}

/// The content of a file to which an edited clip is written: what is not `changed` is as in `bytes`, the file that was read,
/// where that is kept: in a BVH of a BVH, and in a GLB of one with a mesh.
///
/// # Errors
/// Those of [`to_bytes`]; other joints or flags than the clip's.
pub fn edited_to_bytes(path: &Path, motion: &Motion, changed: &Changed, bytes: &[u8]) -> Result<Vec<u8>> {
    let format = Format::of(path)?;
    check_written(path, format.info(), motion)?;
    match (&motion.source, format) {
        (Source::Bvh(source), Format::Bvh) => source.spliced(bytes, &motion.clip, changed),
        (Source::Glb(_), Format::Glb) => glb::motion_to_bytes(path, motion, Some(changed)),
        _ => to_bytes(path, motion),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const BVH: &str = "HIERARCHY\nROOT a { OFFSET 0 0 0 CHANNELS 1 Xrotation End Site { OFFSET 0 1 0 } }\nMOTION\nFrames: 2\n\
                       Frame Time: 0.05\n1\n2\n";

    #[test]
    fn a_rate_that_no_reader_takes_is_not_written() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.bvh");
        std::fs::write(&path, BVH).unwrap();
        let mut motion = read(&path, &ReadOptions { unit: Unit::METRE, ..ReadOptions::default() }).unwrap();
        for fps in [1e300, 2e4, 1e-4] {
            motion.clip = motion.clip.with_fps(fps).unwrap();
            for name in ["b.bvh", "b.json", "b.glb", "b.npz"] {
                let e = to_bytes(Path::new(name), &motion).unwrap_err().to_string();
                assert!(e.contains("0.001 to 10000"), "{name} at {fps}: {e}");
            }
        }
    }

    #[test]
    fn names_and_first_bytes_must_agree() {
        let folder = tempfile::tempdir().unwrap();
        let file = |name: &str, bytes: &[u8]| {
            let path = folder.path().join(name);
            std::fs::write(&path, bytes).unwrap();
            path
        };
        let options = ReadOptions { unit: Unit::METRE, ..Default::default() };
        let message = |path: &Path| read(path, &options).unwrap_err().to_string();
        assert_eq!(read(&file("a.BvH", BVH.as_bytes()), &options).unwrap().clip.frames(), 2);
        let e = message(&file("a.txt", BVH.as_bytes()));
        assert!(
            e.contains("not_this_format")
                && e.contains("found the extension .txt, expected .bvh, .amc, .glb")
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
        let with = |fps, skip| ReadOptions { unit: Unit::METRE, fps_source: fps, skip, ..Default::default() };
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
        assert!(write(&folder.path().join("b.fbx"), &m).is_err());
    }
}
