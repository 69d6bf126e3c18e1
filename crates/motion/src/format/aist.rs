//! AIST++: a pickled dict of numpy arrays, 60 frames per second, y up; and the dicts of dance generators that learned
//! from it.
//!
//! `smpl_trans / smpl_scaling` is in metres; the pelvis is at the body's rest pelvis plus that, as in AMASS. Generators
//! such as EDGE write `smpl_trans` in metres without `smpl_scaling`, 30 frames per second.

use super::array::Array;
use super::npz::list;
use super::pickle::{Pickle, Value};
use super::smpl_arrays::{Vectors, translations};
use super::{Axes, ReadOptions, Up, body_model};
use crate::error::{FaultKind, FileError};
use crate::rig::map_if_any;
use crate::{Clip, Error, Motion, Result, Source, Warning};
use kinelm_store::SourcePos;
use std::path::Path;

/// AIST++'s rate, frames per second.
pub const FPS: f64 = 60.0;
/// The rate of dance generators, which their dicts don't state, frames per second.
pub(crate) const GENERATED_FPS: f64 = 30.0;

/// Reads a motion: `smpl_poses` (F, 72) or (F, 24, 3), `smpl_trans` (F, 3), `smpl_scaling` of one element. Without
/// `smpl_scaling` it is a dance generator's, in metres.
///
/// The clip is on SMPL-24, at [`FPS`], for a generator's at `GENERATED_FPS` with a warning, or at the rate in the
/// options.
///
/// # Errors
/// [`FaultKind::PickleRefused`] for a pickle that names or calls anything but numpy's arrays; [`FaultKind::PickleBad`] for a
/// damaged one; [`FaultKind::KeyMissing`], [`FaultKind::Shape`], [`FaultKind::Dtype`], [`FaultKind::ObjectArray`],
/// [`FaultKind::NotFinite`], [`FaultKind::ScaleBad`]; [`FaultKind::NoMotion`] for a pickle of anything but a dict;
/// [`FaultKind::NotThisFormat`]; those of a body model.
pub fn read(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Motion> {
    // a pickle of protocol 0 has no magic, so only what is clearly another format is refused here
    if [&b"PK\x03\x04"[..], b"\x93NUMPY", b"HIERARCHY", b"{"].iter().any(|start| bytes.starts_with(start)) {
        let found = super::sniff(bytes);
        return Err(FileError::new(SourcePos::file(path), FaultKind::NotThisFormat, found, "a pickle").into());
    }
    let pickle = Pickle::parse(path, bytes)?;
    let top = pickle.top();
    let Some(keys) = top.keys() else {
        let e =
            FileError::new(SourcePos::file(path), FaultKind::NoMotion, top.kind(), "a dict of smpl_poses, smpl_trans");
        return Err(e.into());
    };
    let array = |key: &str| -> Result<_> {
        let fault = |kind, found: String| Error::from(FileError::new(SourcePos::file(path), kind, found, key));
        let value: Value = top.get(key).ok_or_else(|| fault(FaultKind::KeyMissing, list(&keys)))?;
        let found = || format!("{key}: {}", value.kind());
        value.array(key).unwrap_or_else(|| Err(fault(FaultKind::Dtype, found())))
    };
    let (poses, trans) = (array("smpl_poses")?, array("smpl_trans")?);
    let mut warnings = Vec::new();
    let (scale, fps) = match top.get("smpl_scaling") {
        Some(_) => (scale(&array("smpl_scaling")?)?, FPS),
        None => {
            let what = format!(
                "no smpl_scaling: a dance generator's, in metres, which states no rate: read at {GENERATED_FPS}; give \
                 `fps_source` if that is wrong"
            );
            warnings.extend(options.fps_source.is_none().then_some(Warning { kind: "rate_assumed", what }));
            (1.0, GENERATED_FPS)
        }
    };
    let vectors = Vectors::new(&poses, &[72])?;
    let positions = translations(&trans, vectors.frames)?;
    let body = body_model::body(options, &[])?;
    let metres = options.unit.metres().unwrap_or(1.0);
    let root = positions.iter().map(|&t| body.rest_pelvis + t / scale * metres).collect();
    let mut rotations = Vec::with_capacity(vectors.frames * 24);
    for f in 0..vectors.frames {
        for j in 0..24 {
            rotations.push(vectors.rotation(f, 3 * j, j)?);
        }
    }
    let clip = Clip::new(body.skeleton, options.fps_source.unwrap_or(fps), root, rotations)?;
    let found = map_if_any(&clip, options.map.as_deref())?;
    let (axes, doubt) = Axes::of_body(&clip, Up::Y, options, found.as_ref());
    warnings.extend(doubt);
    let clip = axes.to_y_up(clip)?;
    let source = Source::Aist { scaling: scale, rest_pelvis: body.rest_pelvis, body_model: body.from_model, axes };
    Ok(Motion::read(path, clip, source, warnings, found))
}

fn scale(scaling: &Array) -> Result<f64> {
    match scaling.real()? {
        scale if scale.is_finite() && scale > 0.0 => Ok(scale),
        scale => Err(scaling.fault(FaultKind::ScaleBad, scale.to_string(), "a number above 0")),
    }
}

/// Whether an `ignore_list.txt` in the file's folder or the folder above it lists this file.
///
/// The list has one name per line, without extension. AIST++ publishes one of sequences whose reconstruction failed.
///
/// # Errors
/// [`kinelm_store::Error::Io`] when a list exists and can't be read.
pub fn ignored(path: &Path) -> Result<bool> {
    let Some(name) = path.file_stem() else { return Ok(false) };
    let folder = path.parent().unwrap_or(Path::new(""));
    for place in [Some(folder), folder.parent()].into_iter().flatten() {
        let file = place.join("ignore_list.txt");
        match kinelm_store::input::bytes(&file) {
            Ok(text) => {
                let text = String::from_utf8_lossy(&text);
                if text.lines().any(|line| line.trim() == name.to_string_lossy()) {
                    return Ok(true);
                }
            }
            Err(e) if e.kind() == std::io::ErrorKind::NotFound => {}
            Err(e) => return Err(Error::io(file)(e)),
        }
    }
    Ok(false)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_generators_dict_without_scaling() {
        let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/golden/aist/protocol4.pkl");
        let bytes = std::fs::read(&golden).unwrap();
        let key = b"smpl_scaling";
        let at = bytes.windows(key.len()).position(|w| w == key).unwrap();
        let mut other = bytes.clone();
        other[at..at + key.len()].copy_from_slice(b"full_pose_at");
        let read_at = |fps_source| {
            let options = ReadOptions { fps_source, ..Default::default() };
            read(&golden, &other, &options).unwrap()
        };
        let (own, given) = (read_at(None), read_at(Some(20.0)));
        assert_eq!((own.clip.fps(), own.warnings[0].kind, given.clip.fps()), (30.0, "rate_assumed", 20.0));
        assert!(given.warnings.iter().all(|w| w.kind != "rate_assumed"), "{:?}", given.warnings);
        assert!(matches!(own.source, Source::Aist { scaling: 1.0, .. }));
        let scaled = read(&golden, &bytes, &ReadOptions::default()).unwrap();
        let Source::Aist { scaling, rest_pelvis, .. } = scaled.source else { panic!() };
        let [a, b] = [&own, &scaled].map(|m| m.clip.root()[1] - rest_pelvis);
        assert!((a - b * scaling).length() < 1e-9 * a.length(), "{a} {b}");
    }

    #[test]
    fn compressed_pickles_are_named_with_a_way_out() {
        for start in [&b"\x78\x9c\x01"[..], b"\x1f\x8b\x08", b"BZh9", b"\xfd7zXZ\0", b"\x04\x22\x4d\x18"] {
            let e = read(Path::new("a.pkl"), start, &ReadOptions::default()).unwrap_err();
            assert_eq!(e.fault(), Some(FaultKind::NotThisFormat));
            assert!(e.to_string().contains("compressed") && e.to_string().contains("joblib.load"), "{e}");
        }
        let wrapped = b"\x80\x02cjoblib.numpy_pickle\nNumpyArrayWrapper\n.";
        let e = read(Path::new("a.pkl"), wrapped, &ReadOptions::default()).unwrap_err();
        assert!(e.fault() == Some(FaultKind::PickleRefused) && e.to_string().contains("joblib.load"), "{e}");
    }

    #[test]
    fn lists_beside_the_file_and_beside_its_folder() {
        let dir = tempfile::tempdir().unwrap();
        let motions = dir.path().join("motions");
        std::fs::create_dir(&motions).unwrap();
        let bad = motions.join("gBR_sBM_cAll_d04_mBR0_ch01.pkl");
        assert!(!ignored(&bad).unwrap());
        std::fs::write(dir.path().join("ignore_list.txt"), "gBR_sBM_cAll_d04_mBR0_ch01\r\nother\n").unwrap();
        assert!(ignored(&bad).unwrap());
        assert!(!ignored(&motions.join("gBR_sBM_cAll_d04_mBR0_ch02.pkl")).unwrap());
        std::fs::write(motions.join("ignore_list.txt"), "gBR_sBM_cAll_d04_mBR0_ch02").unwrap();
        assert!(ignored(&motions.join("gBR_sBM_cAll_d04_mBR0_ch02.pkl")).unwrap());
        assert!(!ignored(Path::new("/")).unwrap());
    }
}
