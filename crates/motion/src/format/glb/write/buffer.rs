//! The binary part of a GLB, with its views and accessors.

use crate::{Error, Result};
use kinelm_store::Subject;
use serde_json::{Value, json};

/// The use of a buffer view.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Target {
    /// Animation or matrices.
    None,
    /// Vertex attributes.
    Vertices = 34962,
    /// Triangle indices.
    Corners = 34963,
}

/// glTF component types.
const U16: u32 = 5123;
const U32: u32 = 5125;
const F32: u32 = 5126;

/// A binary buffer with its views and accessors.
#[derive(Debug, Default)]
pub struct Buffer {
    bytes: Vec<u8>,
    /// Whether a number is beyond single precision.
    not_finite: bool,
    views: Vec<Value>,
    accessors: Vec<Value>,
    /// Bytes, views and accessors that a file has already, which these come after.
    before: [usize; 3],
}

impl Buffer {
    /// A buffer that continues one of so many bytes, views and accessors.
    pub fn after(bytes: usize, views: usize, accessors: usize) -> Buffer {
        Buffer { before: [bytes, views, accessors], ..Buffer::default() }
    }

    /// Adds (N, C) floats, C by `kind` (`SCALAR`, `VEC3`, `VEC4`, `MAT4`). Returns the index of the accessor, which has the
    /// minimum and maximum of each component if `bounds`.
    pub fn floats(&mut self, numbers: &[f32], kind: (&str, usize), target: Target, bounds: bool) -> usize {
        let (name, width) = kind;
        self.not_finite |= numbers.iter().any(|x| !x.is_finite());
        let bytes = numbers.iter().flat_map(|x| x.to_le_bytes()).collect();
        let mut accessor = json!({"componentType": F32, "count": numbers.len() / width, "type": name});
        if bounds {
            let each = |pick: fn(f32, f32) -> f32| -> Vec<f32> {
                let of = |c: usize| numbers.iter().skip(c).step_by(width).copied().reduce(pick).unwrap_or(0.0);
                (0..width).map(of).collect()
            };
            accessor["min"] = each(f32::min).into();
            accessor["max"] = each(f32::max).into();
        }
        self.add(bytes, accessor, target)
    }

    /// Adds the joints (V, 4) of vertices.
    pub fn joints(&mut self, joints: &[[u16; 4]]) -> usize {
        let bytes = joints.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        self.add(bytes, json!({"componentType": U16, "count": joints.len(), "type": "VEC4"}), Target::Vertices)
    }

    /// Adds triangles (T, 3).
    pub fn corners(&mut self, corners: &[[u32; 3]]) -> usize {
        let bytes = corners.iter().flatten().flat_map(|x| x.to_le_bytes()).collect();
        self.add(bytes, json!({"componentType": U32, "count": 3 * corners.len(), "type": "SCALAR"}), Target::Corners)
    }

    fn add(&mut self, bytes: Vec<u8>, mut accessor: Value, target: Target) -> usize {
        let [before, views, accessors] = self.before;
        let mut view = json!({"buffer": 0, "byteOffset": before + self.bytes.len(), "byteLength": bytes.len()});
        if target != Target::None {
            view["target"] = (target as u32).into();
        }
        self.bytes.extend(bytes);
        accessor["bufferView"] = (views + self.views.len()).into();
        self.views.push(view);
        self.accessors.push(accessor);
        accessors + self.accessors.len() - 1
    }

    /// Its views, its accessors and its bytes; `what` names them in an error.
    ///
    /// # Errors
    /// [`Unsupported`](kinelm_store::Error::Unsupported) for numbers beyond single precision.
    pub fn parts(self, what: &str) -> Result<(Vec<Value>, Vec<Value>, Vec<u8>)> {
        if self.not_finite {
            return Err(beyond(what.to_owned()));
        }
        Ok((self.views, self.accessors, self.bytes))
    }
}

/// The error of a number beyond the 32-bit floats of a GLB.
pub fn beyond(what: impl Into<Subject>) -> Error {
    Error::unsupported(what, "beyond what a GLB holds, 3.4e38 m; is the unit right (`unit`)?")
}
