//! Body models: a user's own bone lengths and rest pelvis instead of the neutral skeleton's.
//!
//! This project includes and needs no body model. Licensed models of the SMPL family are read from an `.npz` with these
//! keys, all arrays of numbers (n joints, V vertices, B shape directions):
//!
//! | key | shape | |
//! |---|---|---|
//! | `v_template` | (V, 3) | the mean body's vertices, metres, y up, left side +x |
//! | `J_regressor` | (n, V) | joints from vertices, dense |
//! | or `J_regressor_data`, `_indices`, `_indptr`, `_shape` | | the same in scipy's CSR or CSC form (by `_format`, or the length of `_indptr`) |
//! | or `J_regressor_data`, `_row`, `_col`, `_shape` | | the same in scipy's COO form |
//! | `shapedirs` | (V, 3, B) | optional: what each shape coefficient adds |
//! | `betas` | (b) | optional: the shape; without it a motion file's is used |
//! | `kintree_table` | (2, n) | optional: parents in row 0 |
//! | `J` | (n, 3) | rest joints; used without a regressor or `v_template`, and then no shape is applied |
//!
//! n is 24 (SMPL) or more (SMPL+H 52, SMPL-X 55). Of more than 24, joints 0 to 21 are used; each hand is the mean of the
//! wrist's children, or as far from the wrist as on the neutral skeleton if there are none.

use super::ReadOptions;
use super::array::Array;
use super::npz::Npz;
use crate::error::{FaultKind, FileError};
use crate::{Error, Result, Skeleton, Vec3, smpl};
use kinelm_store::SourcePos;
use std::path::{Path, PathBuf};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::SystemTime;

/// Most joints and shape directions of a model.
const MAX_JOINTS: usize = 256;
const MAX_DIRECTIONS: usize = 1024;

/// Rest offsets and rest pelvis of a body.
#[derive(Debug, Clone, PartialEq)]
pub struct Body {
    /// SMPL's 24 joints.
    pub skeleton: Arc<Skeleton>,
    /// The rest pelvis, metres, in the model's axes.
    pub rest_pelvis: Vec3,
    /// Whether it comes from a body model.
    pub from_model: bool,
}

/// A body model, reduced to its rest joints.
#[derive(Debug, Clone, PartialEq)]
pub struct BodyModel {
    /// Joints of the mean body (n), metres.
    joints: Vec<Vec3>,
    /// What each shape coefficient adds to the joints (n, B).
    directions: Vec<Vec3>,
    /// B.
    shapes: usize,
    /// The shape stored in the model.
    betas: Option<Vec<f64>>,
    /// The joints whose mean is each hand (22, 23).
    hands: [Vec<usize>; 2],
}

impl BodyModel {
    /// Loads a model from a file.
    ///
    /// # Errors
    /// [`kinelm_store::Error::Io`], and those of [`BodyModel::parse`].
    pub fn load(path: &Path) -> Result<Self> {
        BodyModel::parse(path, &kinelm_store::input::bytes(path).map_err(Error::io(path))?)
    }

    /// Parses a model; `path` is used in messages.
    ///
    /// # Errors
    /// [`FaultKind::KeyMissing`] without joints; [`FaultKind::BodyModelBad`] for a skeleton other than SMPL's or joints that are
    /// not finite; [`FaultKind::Shape`] for arrays that don't fit each other; those of [`Npz::open`] and [`Npz::array`].
    pub fn parse(path: &Path, bytes: &[u8]) -> Result<Self> {
        let npz = Npz::open(path, bytes)?;
        let (joints, directions, shapes) = match regressor(&npz)? {
            Some(weights) if npz.has("v_template") => regress(&npz, &weights)?,
            _ => (points(&npz.array("J")?)?, vec![], 0),
        };
        let bad = |found: String, expected: &str| {
            Err(FileError::new(SourcePos::file(path), FaultKind::BodyModelBad, found, expected).into())
        };
        let n = joints.len();
        if !(22..=MAX_JOINTS).contains(&n) || n == 23 {
            return bad(format!("{n} joints"), "SMPL's 24, SMPL+H's 52 or SMPL-X's 55");
        }
        let parents = match npz.optional("kintree_table")? {
            None => None,
            Some(table) if table.shape() == [2, n] => Some(table.integers()?),
            Some(table) => return Err(table.shape_fault(&format!("(2, {n})"))),
        };
        // the models share the body's 22 joints; SMPL's own hands follow, or others' face and fingers
        let own = if n == 24 { 24 } else { 22 };
        if let Some(p) = &parents
            && let Some(j) = (1..own).find(|&j| p[j] != i64::from(smpl::PARENTS[j]))
        {
            return bad(format!("kintree_table: joint {j} on joint {}", p[j]), "SMPL's joints in their order");
        }
        if let Some(j) = joints.iter().chain(&directions).position(|p| !p.is_finite()) {
            return bad(format!("joint {} at no finite place", j % n), "positions in metres");
        }
        let hand = |wrist: i64| match &parents {
            _ if n == 24 => vec![wrist as usize + 2],
            Some(p) => (22..n).filter(|&j| p[j] == wrist).collect(),
            None => vec![],
        };
        let betas = npz.optional("betas")?.map(|b| b.reals()).transpose()?;
        Ok(BodyModel { hands: [hand(20), hand(21)], joints, directions, shapes, betas })
    }

    /// B, the number of shape coefficients; 0 if the joints are fixed.
    pub fn shapes(&self) -> usize {
        self.shapes
    }

    /// The body with a shape: the model's own `betas` if it has any, else the given ones. Coefficients beyond the model's are
    /// ignored; missing ones are 0.
    ///
    /// # Errors
    /// [`Invalid`](kinelm_store::Error::Invalid) when a position is not finite.
    pub fn body(&self, betas: &[f64]) -> Result<Body> {
        let betas = self.betas.as_deref().unwrap_or(betas);
        let place = |j: usize| {
            let shape = betas.iter().zip(self.directions.get(j * self.shapes..).unwrap_or_default());
            shape.take(self.shapes).fold(self.joints[j], |p, (&b, &d)| p + d * b)
        };
        let mut positions: Vec<Vec3> = (0..22).map(place).collect();
        for (side, amid) in self.hands.iter().enumerate() {
            let sum = amid.iter().fold(Vec3::ZERO, |p, &j| p + place(j));
            let neutral = positions[20 + side] + smpl::neutral().offsets()[22 + side];
            positions.push(if amid.is_empty() { neutral } else { sum / amid.len() as f64 });
        }
        let parents: Vec<Option<usize>> = smpl::PARENTS.iter().map(|&p| usize::try_from(p).ok()).collect();
        let offset = |j: usize| parents[j].map_or(Vec3::ZERO, |p| positions[j] - positions[p]);
        let offsets = (0..24).map(offset).collect();
        let names = smpl::NAMES.map(String::from).to_vec();
        let rest_pelvis = positions[0];
        if !rest_pelvis.is_finite() {
            return Err(Error::invalid(
                "the pelvis of the body model with these betas",
                rest_pelvis,
                "a finite position",
            ));
        }
        let skeleton = Arc::new(Skeleton::new(names, parents, offsets, Vec::new())?);
        Ok(Body { skeleton, rest_pelvis, from_model: true })
    }
}

/// The body for the options and a motion file's shape: the neutral one without a body model.
///
/// The last model is cached, so that a folder of motions reads it once.
///
/// # Errors
/// Those of [`BodyModel::load`] and [`BodyModel::body`].
pub fn body(options: &ReadOptions, betas: &[f64]) -> Result<Body> {
    type Seen = (PathBuf, Option<SystemTime>, u64);
    static LAST: Mutex<Option<(Seen, Arc<BodyModel>)>> = Mutex::new(None);
    let Some(path) = &options.body_model else {
        return Ok(Body { skeleton: smpl::neutral(), rest_pelvis: smpl::REST_PELVIS, from_model: false });
    };
    let about = std::fs::metadata(path).map_err(Error::io(path))?;
    // path alone would serve a model that was replaced while the program runs
    let seen = (path.clone(), about.modified().ok(), about.len());
    let mut last = LAST.lock().unwrap_or_else(PoisonError::into_inner);
    let model = match last.as_ref().filter(|(s, _)| *s == seen) {
        Some((_, model)) => model.clone(),
        None => {
            let model = Arc::new(BodyModel::load(path)?);
            *last = Some((seen, model.clone()));
            model
        }
    };
    drop(last);
    model.body(betas)
}

/// The weights of a joint regressor as (joint, vertex, weight).
struct Weights {
    joints: usize,
    vertices: usize,
    entries: Vec<(usize, usize, f64)>,
}

/// The regressor in any of its forms; `None` without one, or if it is a Python object and `J` exists.
fn regressor(npz: &Npz) -> Result<Option<Weights>> {
    if npz.has("J_regressor_data") {
        return sparse(npz).map(Some);
    }
    let dense = match npz.optional("J_regressor") {
        Ok(Some(dense)) => dense,
        Ok(None) => return Ok(None),
        // official models pickle the regressor as a scipy object, which is never run; their `J` is enough
        Err(e) if e.fault() == Some(FaultKind::ObjectArray) && npz.has("J") => return Ok(None),
        Err(e) => return Err(e),
    };
    let &[joints, vertices] = dense.shape() else { return Err(dense.shape_fault("(n, V)")) };
    let weights = dense.reals()?;
    let entries = weights.iter().enumerate().filter(|(_, w)| **w != 0.0);
    let entries = entries.map(|(i, &w)| (i / vertices, i % vertices, w)).collect();
    Ok(Some(Weights { joints, vertices, entries }))
}

fn sparse(npz: &Npz) -> Result<Weights> {
    let key = |part: &str| format!("J_regressor_{part}");
    let part = |name: &str| npz.array(&key(name));
    let (data, shape) = (part("data")?, part("shape")?);
    let (weights, sizes) = (data.reals()?, indices(&shape)?);
    let &[joints, vertices] = sizes.as_slice() else { return Err(shape.shape_fault("(2,)")) };
    let (rows, columns) = if npz.has(&key("row")) {
        (indices(&part("row")?)?, indices(&part("col")?)?)
    } else {
        let (inner, starts) = (indices(&part("indices")?)?, part("indptr")?);
        let starts = (indices(&starts)?, starts);
        let by_row = match npz.optional(&key("format"))? {
            Some(format) => format.text()? == "csr",
            None => starts.0.len() == joints + 1,
        };
        let outer = unpacked(&starts.0, inner.len()).ok_or_else(|| {
            starts.1.fault(
                FaultKind::Shape,
                "starts that don't fit the indices",
                "ascending starts, the last their number",
            )
        })?;
        if by_row { (outer, inner) } else { (inner, outer) }
    };
    let inside = |(&r, &c): (&usize, &usize)| r < joints && c < vertices;
    if rows.len() != weights.len() || columns.len() != weights.len() || !rows.iter().zip(&columns).all(inside) {
        return Err(data.fault(
            FaultKind::Shape,
            "positions that don't fit",
            format!("one in ({joints}, {vertices}) a weight"),
        ));
    }
    let entries = rows.into_iter().zip(columns).zip(weights).map(|((r, c), w)| (r, c, w)).collect();
    Ok(Weights { joints, vertices, entries })
}

/// The row of each entry, from the starts of the rows.
fn unpacked(starts: &[usize], entries: usize) -> Option<Vec<usize>> {
    if starts.first() != Some(&0) || starts.last() != Some(&entries) || !starts.is_sorted() {
        return None;
    }
    Some(starts.windows(2).enumerate().flat_map(|(row, w)| std::iter::repeat_n(row, w[1] - w[0])).collect())
}

fn indices(array: &Array) -> Result<Vec<usize>> {
    let whole = array.integers()?.into_iter().map(usize::try_from).collect::<std::result::Result<_, _>>();
    whole.map_err(|_| array.fault(FaultKind::Shape, "a negative index", "0 or more"))
}

fn points(array: &Array) -> Result<Vec<Vec3>> {
    match array.shape() {
        [_, 3] => Ok(array.reals()?.chunks_exact(3).map(Vec3::from_slice).collect()),
        _ => Err(array.shape_fault("(n, 3)")),
    }
}

/// Joints of the mean body (n), what each shape coefficient adds (n, B), and B.
fn regress(npz: &Npz, weights: &Weights) -> Result<(Vec<Vec3>, Vec<Vec3>, usize)> {
    let template = npz.array("v_template")?;
    if template.shape() != [weights.vertices, 3] || weights.joints > MAX_JOINTS {
        let joints = weights.joints;
        return Err(
            template.shape_fault(&format!("({}, 3), as J_regressor has it for {joints} joints,", weights.vertices))
        );
    }
    let vertices = points(&template)?;
    let mut joints = vec![Vec3::ZERO; weights.joints];
    for &(j, v, w) in &weights.entries {
        joints[j] += vertices[v] * w;
    }
    let Some(shapedirs) = npz.optional("shapedirs")? else { return Ok((joints, vec![], 0)) };
    let &[v, 3, b] = shapedirs.shape() else { return Err(shapedirs.shape_fault("(V, 3, B)")) };
    if v != weights.vertices || b > MAX_DIRECTIONS {
        return Err(shapedirs.shape_fault(&format!("({}, 3, B), B at most {MAX_DIRECTIONS},", weights.vertices)));
    }
    let values = shapedirs.reals()?;
    let mut directions = vec![Vec3::ZERO; weights.joints * b];
    for &(j, v, w) in &weights.entries {
        for (k, d) in directions[j * b..(j + 1) * b].iter_mut().enumerate() {
            let axis = |a: usize| values[(v * 3 + a) * b + k];
            *d += Vec3::new(axis(0), axis(1), axis(2)) * w;
        }
    }
    Ok((joints, directions, b))
}
