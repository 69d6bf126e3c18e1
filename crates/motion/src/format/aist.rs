//! AIST++: a pickled dict of numpy arrays, 60 frames per second, y up.
//!
//! `smpl_trans / smpl_scaling` is in metres; the pelvis is at the body's rest pelvis plus that, as in AMASS.

use super::npz::list;
use super::pickle::{Pickle, Value};
use super::smpl_arrays::{Vectors, translations};
use super::{ReadOptions, body_model};
use crate::error::{FaultKind, FileError};
use crate::{Clip, Error, Motion, Result, Source};
use kinelm_store::SourcePos;
use std::path::Path;

/// AIST++'s rate, frames per second.
pub const FPS: f64 = 60.0;

/// Reads a motion: `smpl_poses` (F, 72) or (F, 24, 3), `smpl_trans` (F, 3), `smpl_scaling` of one element.
///
/// The clip is on SMPL-24, at [`FPS`] or the rate in the options.
///
/// # Errors
/// [`FaultKind::PickleRefused`] for a pickle that names or calls anything but numpy's arrays; [`FaultKind::PickleBad`] for a
/// damaged one; [`FaultKind::KeyMissing`], [`FaultKind::Shape`], [`FaultKind::Dtype`], [`FaultKind::ObjectArray`],
/// [`FaultKind::NotFinite`], [`FaultKind::ScaleBad`]; [`FaultKind::NoMotion`] for a pickle of anything but a dict;
/// [`FaultKind::NotThisFormat`]; those of a body model.
pub fn read(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Motion> {
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
    let (poses, trans, scaling) = (array("smpl_poses")?, array("smpl_trans")?, array("smpl_scaling")?);
    let scale = scaling.real()?;
    if !(scale.is_finite() && scale > 0.0) {
        return Err(scaling.fault(FaultKind::ScaleBad, scale.to_string(), "a number above 0"));
    }
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
    let clip = Clip::new(body.skeleton, options.fps_source.unwrap_or(FPS), root, rotations)?;
    let source = Source::Aist { scaling: scale, rest_pelvis: body.rest_pelvis, body_model: body.from_model };
    Ok(Motion { path: path.to_owned(), clip, source, warnings: vec![] })
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
