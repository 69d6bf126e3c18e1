//! AMASS: reads SMPL, SMPL+H and SMPL-X motions in `.npz`; writes SMPL+H.
//!
//! AMASS has z up, unless the options give another axis: (x, y, z) becomes (x, z, -y). `trans` is not the pelvis: SMPL
//! rotates the body about its rest pelvis and then adds `trans`, so the pelvis is at `rest_pelvis + trans`. Without a body
//! model the rest pelvis is [`smpl::REST_PELVIS`] and the bones are the neutral skeleton's. Fingers, jaw and eyes are dropped.

use super::array::Array;
use super::body_model;
use super::npz::{Npz, Values, Writer, list};
use super::options::{ReadOptions, is_rate};
use super::smpl_arrays::{Vectors, translations};
use super::{Axes, Up};
use crate::error::{FaultKind, FileError, compact};
use crate::resample::{FEWEST_FPS, MOST_FPS};
use crate::rig::map_if_any;
use crate::rotation::exp_map;
use crate::{Clip, Motion, Quat, Result, Source, Vec3, Warning, smpl};
use kinelm_store::SourcePos;
use std::f64::consts::FRAC_1_SQRT_2;
use std::path::Path;

/// Columns of SMPL+H's `poses`.
const SMPLH: usize = 156;
/// Columns of SMPL-X's `poses`.
const SMPLX: usize = 165;
/// Columns of SMPL's `poses`, which has hand joints.
const SMPL: usize = 72;

/// From AMASS's axes to a clip's: -90 degrees about x.
const TURN: Quat = Quat::from_xyzw(-FRAC_1_SQRT_2, 0.0, 0.0, FRAC_1_SQRT_2);

/// Reads a motion: `poses` of (F, 156), (F, 165) or (F, 72), or SMPL-X's `root_orient` (F, 3) and `pose_body` (F, 63);
/// `trans` (F, 3); `mocap_framerate` or `mocap_frame_rate`; optional `betas`, `gender`, `surface_model_type`.
///
/// The clip is on SMPL-24. If the file has fingers instead of hand joints, joints 22 and 23 are identity. The file may lack
/// its rate if the options give one.
///
/// # Errors
/// [`FaultKind::NoMotion`] for a file without poses (`shape.npz`, `neutral_stagei.npz`); [`FaultKind::KeyMissing`],
/// [`FaultKind::Shape`], [`FaultKind::Dtype`], [`FaultKind::Truncated`], [`FaultKind::ObjectArray`],
/// [`FaultKind::RateBad`], [`FaultKind::NotFinite`]; those of a body model.
pub fn read(path: &Path, bytes: &[u8], options: &ReadOptions) -> Result<Motion> {
    let npz = Npz::open(path, bytes)?;
    let (rotations, frames, width) = poses(path, &npz)?;
    let positions = translations(&npz.array("trans")?, frames)?;
    let fps = match options.fps_source {
        Some(fps) => fps,
        None => rate(&npz)?,
    };
    let mut warnings = Vec::new();
    let mut text = |key| optional_text(&npz, key, &mut warnings);
    let (gender, surface) = (text("gender"), text("surface_model_type"));
    let model = match (surface.as_str(), width) {
        ("smplx", _) | ("", SMPLX) => "SMPL-X".into(),
        ("smplh", _) | ("", SMPLH) => "SMPL+H".into(),
        ("smpl", _) | ("", _) => "SMPL".into(),
        _ => surface,
    };
    let betas = betas(&npz)?;
    let body = body_model::body(options, &betas)?;
    let metres = options.unit.metres().unwrap_or(1.0);
    let root = positions.iter().map(|&t| body.rest_pelvis + t * metres).collect();
    let clip = Clip::new(body.skeleton, fps, root, rotations)?;
    let found = map_if_any(&clip, options.map.as_deref())?;
    let (axes, doubt) = Axes::of_body(&clip, Up::Z, options, found.as_ref());
    warnings.extend(doubt);
    let clip = axes.to_y_up(clip)?;
    let (rest_pelvis, body_model) = (body.rest_pelvis, body.from_model);
    let source = Source::Amass { model, gender, betas: betas.len(), rest_pelvis, body_model, axes };
    Ok(Motion::read(path, clip, source, warnings, found))
}

/// An AMASS SMPL+H file of a clip on SMPL-24: `poses` (F, 156) f64 with the fingers 0, `trans` (F, 3), `betas` 16 zeros,
/// `gender` neutral, `mocap_framerate`. [`read`] reproduces rotations and positions to 1e-9, except for joints 22 and 23
/// and the bone lengths, which the format doesn't store.
///
/// # Errors
/// [`Invalid`](kinelm_store::Error::Invalid) when the joints are not SMPL's 24: retarget the clip first.
pub fn write(clip: &Clip) -> Result<Vec<u8>> {
    smpl::check_rig("a clip for AMASS", clip.skeleton())?;
    let frames = clip.frames();
    let mut poses = vec![0.0; frames * SMPLH];
    let mut trans = Vec::with_capacity(frames * 3);
    for (f, row) in poses.chunks_exact_mut(SMPLH).enumerate() {
        // SMPL+H has fingers in the place of SMPL's hand joints, 22 and 23
        for (j, &q) in clip.pose(f)[..22].iter().enumerate() {
            // only the root's rotation is in the world's axes; the others are relative to their parents
            let q = if j == 0 { TURN.conjugate() * q } else { q };
            row[j * 3..j * 3 + 3].copy_from_slice(&exp_map::to_vector(q).to_array());
        }
        trans.extend((theirs(clip.root()[f]) - smpl::REST_PELVIS).to_array());
    }
    let mut npz = Writer::new();
    npz.add("poses", &[frames, SMPLH], Values::F64(&poses))?;
    npz.add("trans", &[frames, 3], Values::F64(&trans))?;
    npz.add("betas", &[16], Values::F64(&[0.0; 16]))?;
    npz.add("gender", &[], Values::Text(&["neutral".into()]))?;
    npz.add("mocap_framerate", &[], Values::F64(&[clip.fps()]))?;
    npz.finish()
}

fn theirs(p: Vec3) -> Vec3 {
    Vec3::new(p.x, -p.z, p.y)
}

/// Rotations (F, 24), F, and the number of columns.
fn poses(path: &Path, npz: &Npz) -> Result<(Vec<Quat>, usize, usize)> {
    if npz.has("poses") {
        let array = npz.array("poses")?;
        let vectors = Vectors::new(&array, &[SMPLH, SMPLX, SMPL])?;
        let joints = if vectors.width == SMPL { 24 } else { 22 };
        let rotations = rows(vectors.frames, joints, |f, j| vectors.rotation(f, 3 * j, j))?;
        return Ok((rotations, vectors.frames, vectors.width));
    }
    if npz.has("root_orient") || npz.has("pose_body") {
        let (root, body) = (npz.array("root_orient")?, npz.array("pose_body")?);
        let (root, vectors) = (Vectors::new(&root, &[3])?, Vectors::new(&body, &[63])?);
        if vectors.frames != root.frames {
            return Err(body.shape_fault(&format!("({}, 63), as root_orient has it,", root.frames)));
        }
        let rotation = |f, j| if j == 0 { root.rotation(f, 0, 0) } else { vectors.rotation(f, 3 * j - 3, j) };
        return Ok((rows(root.frames, 22, rotation)?, root.frames, SMPLX));
    }
    let e = FileError::new(SourcePos::file(path), FaultKind::NoMotion, list(npz.keys()), "poses");
    let stills = "shape.npz and neutral_stagei.npz hold a body and no motion";
    let positions = "positions alone hold no rotations";
    Err(e.help(if npz.has("positions") { positions } else { stills }).into())
}

/// Rotations (F, 24): the first `joints` from the file, the others identity.
fn rows(frames: usize, joints: usize, rotation: impl Fn(usize, usize) -> Result<Quat>) -> Result<Vec<Quat>> {
    let mut rotations = Vec::with_capacity(frames * 24);
    for f in 0..frames {
        for j in 0..24 {
            rotations.push(if j < joints { rotation(f, j)? } else { Quat::IDENTITY });
        }
    }
    Ok(rotations)
}

fn rate(npz: &Npz) -> Result<f64> {
    let array = match npz.optional("mocap_framerate")? {
        Some(array) => array,
        None => npz.optional("mocap_frame_rate")?.ok_or_else(|| npz.missing("mocap_framerate or mocap_frame_rate"))?,
    };
    match array.real()? {
        fps if is_rate(fps) => Ok(fps),
        fps => {
            let expected = format!("frames per second of at least {FEWEST_FPS}, at most {MOST_FPS}");
            Err(array.fault(FaultKind::RateBad, compact(fps), &expected))
        }
    }
}

/// The first row of `betas`; empty if the file has none.
fn betas(npz: &Npz) -> Result<Vec<f64>> {
    let Some(array) = npz.optional("betas")? else { return Ok(vec![]) };
    let mut values = array.reals()?;
    values.truncate(array.shape().last().copied().unwrap_or(1));
    match values.iter().position(|b| !b.is_finite()) {
        None => Ok(values),
        Some(i) => Err(array.fault(FaultKind::NotFinite, format!("{} at {i}", values[i]), "shape numbers")),
    }
}

/// Text that doesn't concern the motion: a fault is only a warning.
fn optional_text(npz: &Npz, key: &str, warnings: &mut Vec<Warning>) -> String {
    match npz.optional(key).and_then(|a| a.as_ref().map(Array::text).transpose()) {
        Ok(text) => text.unwrap_or_default(),
        Err(e) => {
            warnings.push(Warning { kind: "text_unreadable", what: e.to_string() });
            String::new()
        }
    }
}
