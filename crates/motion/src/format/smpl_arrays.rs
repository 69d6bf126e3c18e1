//! Shared by AMASS and AIST++: arrays of SMPL's rotation vectors and translations.

use super::array::Array;
use crate::error::FaultKind;
use crate::rotation::exp_map;
use crate::{Quat, Result, Vec3, smpl};

/// Rotation vectors, one row per frame.
pub(super) struct Vectors<'a> {
    array: &'a Array<'a>,
    /// F, the number of frames.
    pub frames: usize,
    /// Columns.
    pub width: usize,
    values: Vec<f64>,
}

impl<'a> Vectors<'a> {
    /// Checks for the shape (F, W) or (F, W/3, 3), with W one of `widths`.
    ///
    /// # Errors
    /// [`FaultKind::Shape`] for any other shape, [`FaultKind::Dtype`] for elements that are no numbers.
    pub fn new(array: &'a Array, widths: &[usize]) -> Result<Self> {
        let (frames, width) = match *array.shape() {
            [f, w] if widths.contains(&w) => (f, w),
            // before the product, which a hostile shape would overflow
            [f, j, 3] if j < 1000 && widths.contains(&(j * 3)) => (f, j * 3),
            _ => {
                let flat: Vec<String> = widths.iter().map(|w| format!("(F, {w})")).collect();
                let w = widths[0];
                return Err(array.shape_fault(&format!("{} or (F, {}, 3) and so on", flat.join(" or "), w / 3)));
            }
        };
        Ok(Vectors { array, frames, width, values: array.reals()? })
    }

    /// The rotation in columns `column .. column + 3` of a frame, of any vector length. `joint` is used in messages.
    ///
    /// # Errors
    /// [`FaultKind::NotFinite`] with frame and joint.
    pub fn rotation(&self, frame: usize, column: usize, joint: usize) -> Result<Quat> {
        let at = frame * self.width + column;
        let v = Vec3::from_slice(&self.values[at..at + 3]);
        let q = exp_map::from_vector(v);
        // a vector so long that its angle overflows has no direction either
        if v.is_finite() && q.is_finite() {
            return Ok(q);
        }
        let found = format!("({}, {}, {}) at frame {frame}, joint {joint} ({})", v.x, v.y, v.z, smpl::NAMES[joint]);
        Err(self.array.fault(FaultKind::NotFinite, found, "a rotation vector"))
    }
}

/// Translations (F, 3).
///
/// # Errors
/// [`FaultKind::Shape`], [`FaultKind::Dtype`], [`FaultKind::NotFinite`] with the frame.
pub(super) fn translations(array: &Array, frames: usize) -> Result<Vec<Vec3>> {
    if array.shape() != [frames, 3] {
        return Err(array.shape_fault(&format!("({frames}, 3)")));
    }
    let positions: Vec<Vec3> = array.reals()?.chunks_exact(3).map(Vec3::from_slice).collect();
    match positions.iter().position(|p| !p.is_finite()) {
        None => Ok(positions),
        Some(f) => {
            let found = format!("({}, {}, {}) at frame {f}", positions[f].x, positions[f].y, positions[f].z);
            Err(array.fault(FaultKind::NotFinite, found, "a place in metres"))
        }
    }
}
