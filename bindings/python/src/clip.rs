//! Clips.

use crate::error::{library, motion, wrong};
use crate::options::{Reading, free};
use crate::pool::detach;
use kinelm::generate::request::PromptRequest;
use kinelm::motion::convert::{ConvertOptions, TargetRig, convert};
use kinelm::motion::feet::{FixedParts, lock};
use kinelm::motion::format::{self, ReadOptions, RestFrame};
use kinelm::motion::resample::check_fps;
use kinelm::motion::{Motion, Quat, Skeleton, Vec3, smpl};
use kinelm::store::files::write_whole;
use kinelm::view::{Figure, page};
use numpy::{IntoPyArray, PyArray2, PyArray3, PyReadonlyArray2, PyReadonlyArray3, ToPyArray};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use rayon::prelude::*;
use std::borrow::Cow;
use std::path::PathBuf;
use std::sync::Arc;

/// A motion: a skeleton of J joints, a rate, and for each of F frames the root's position in metres and the joints' local
/// rotations as unit quaternions (x, y, z, w); y is up.
#[pyclass(frozen, module = "kinelm", from_py_object)]
#[derive(Clone)]
pub struct Clip(pub Motion);

#[pymethods]
impl Clip {
    /// A clip of arrays: offsets (J, 3), root (F, 3), rotations (F, J, 4); `fps` is 0.001 to 10,000.
    #[new]
    #[pyo3(signature = (names, parents, offsets, root, rotations, fps))]
    fn new(
        names: Vec<String>,
        parents: Vec<Option<usize>>,
        offsets: PyReadonlyArray2<'_, f64>,
        root: PyReadonlyArray2<'_, f64>,
        rotations: PyReadonlyArray3<'_, f64>,
        fps: f64,
    ) -> PyResult<Clip> {
        check_fps(fps).map_err(motion)?;
        let vectors = |name: &str, array: &PyReadonlyArray2<'_, f64>| -> PyResult<Vec<Vec3>> {
            let view = array.as_array();
            if view.ncols() != 3 {
                return Err(wrong(format!("{name} has {} columns; expected 3", view.ncols())));
            }
            Ok(view.rows().into_iter().map(|row| Vec3::new(row[0], row[1], row[2])).collect())
        };
        let turns = rotations.as_array();
        if turns.shape()[2] != 4 {
            return Err(wrong(format!("rotations have {} numbers each; expected 4: x, y, z, w", turns.shape()[2])));
        }
        let quat = |q: numpy::ndarray::ArrayView1<'_, f64>| Quat::from_xyzw(q[0], q[1], q[2], q[3]);
        let turns = turns.outer_iter().flat_map(|frame| frame.outer_iter().map(quat).collect::<Vec<_>>()).collect();
        let skeleton = Skeleton::new(names, parents, vectors("offsets", &offsets)?, Vec::new()).map_err(motion)?;
        let clip =
            kinelm::motion::Clip::new(Arc::new(skeleton), fps, vectors("root", &root)?, turns).map_err(motion)?;
        Ok(Clip(Motion::new("clip.json", clip)))
    }

    /// Reads a motion file: .bvh .amc .fbx .glb .vrm .vrma .npz .pkl .json. `fps_source` is its true rate where the file's is
    /// wrong, `skip` the frames left out at its beginning; `up` ("y", "z", ..), `unit` ("m", "cm", "mm", "in", "0.0725 m", ..)
    /// and `map` (a skeleton map's name, file or text) are found out if not given; `root` takes a figure or joint, `take` an
    /// animation; `mirror_axis` ("x", "y", "z") undoes the mirror of a left-handed file.
    #[staticmethod]
    #[pyo3(signature = (path, **reading))]
    fn read(py: Python<'_>, path: PathBuf, reading: Option<&Bound<'_, PyDict>>) -> PyResult<Clip> {
        let options = Reading::of(reading, RestFrame::Keep)?;
        py.detach(|| format::read(&path, &options)).map(Clip).map_err(motion)
    }

    /// Writes the clip, by the name's extension: .bvh .glb .vrma .npz .json. A file that is there is replaced only with `force`.
    #[pyo3(signature = (path, *, force=false))]
    fn write(&self, py: Python<'_>, path: PathBuf, force: bool) -> PyResult<()> {
        py.detach(|| {
            let bytes = format::to_bytes(&path, &self.0).map_err(motion)?;
            free(&path, force)?;
            write_whole(&path, &bytes).map_err(library)
        })
    }

    /// The clip on another rig: "smpl", that of another clip, or that of a motion file. `map` is the clip's skeleton map,
    /// `rig_map` the other rig's.
    #[pyo3(signature = (rig, *, map=None, rig_map=None))]
    fn retarget(
        &self,
        py: Python<'_>,
        rig: &Bound<'_, PyAny>,
        map: Option<String>,
        rig_map: Option<String>,
    ) -> PyResult<Clip> {
        let rig = match rig.extract::<Clip>() {
            Ok(clip) => {
                mapped(&clip.0, rig_map.as_deref()).and_then(|motion| TargetRig::of_motion(motion.into_owned()))
            }
            Err(_) => {
                let name: PathBuf = rig.extract()?;
                TargetRig::load(&name.to_string_lossy(), &ReadOptions { map: rig_map, ..ReadOptions::default() })
            }
        }
        .map_err(motion)?;
        let options = ConvertOptions { rig: Some(rig), ..ConvertOptions::default() };
        py.detach(|| convert(mapped(&self.0, map.as_deref())?.into_owned(), &options)).map(Clip).map_err(motion)
    }

    /// The clip at another rate, interpolated smoothly and low-passed where it gets slower.
    fn resample(&self, py: Python<'_>, fps: f64) -> PyResult<Clip> {
        let options = ConvertOptions { fps: Some(fps), ..ConvertOptions::default() };
        py.detach(|| convert(self.0.clone(), &options)).map(Clip).map_err(motion)
    }

    /// Frames `start` to `stop`, exclusive.
    fn slice(&self, start: usize, stop: usize) -> PyResult<Clip> {
        let frames = self.0.clip.frames();
        if start > stop || stop > frames {
            return Err(wrong(format!("frames {start} to {stop} of a clip that has {frames}")));
        }
        Ok(Clip(self.0.clone().with_clip(self.0.clip.slice(start..stop))))
    }

    /// The clip with feet locked where they are in contact with the floor, and the body on it.
    fn lock_feet(&self, py: Python<'_>) -> PyResult<Clip> {
        py.detach(|| {
            let floor_m = self.0.floor()?.height_m;
            lock(&self.0.clip, self.0.humanoid()?, floor_m, FixedParts::default())
        })
        .map(|(clip, _)| Clip(self.0.clone().with_clip(clip)))
        .map_err(motion)
    }

    /// The joints that SMPL's correspond to, by SMPL's names.
    fn humanoid<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let joints = py.detach(|| Ok(self.0.humanoid()?.pose()?.joints)).map_err(motion)?;
        let found = PyDict::new(py);
        for (smpl, joint) in smpl::NAMES.iter().zip(joints) {
            if let Some(joint) = joint {
                found.set_item(smpl, &self.0.clip.skeleton().names()[joint])?;
            }
        }
        Ok(found)
    }

    #[getter]
    fn fps(&self) -> f64 {
        self.0.clip.fps()
    }

    #[getter]
    fn frames(&self) -> usize {
        self.0.clip.frames()
    }

    /// Seconds.
    #[getter]
    fn duration(&self) -> f64 {
        self.0.clip.duration_s()
    }

    /// Names of the joints.
    #[getter]
    fn joints(&self) -> Vec<String> {
        self.0.clip.skeleton().names().to_vec()
    }

    /// The index of each joint's parent; None for the root.
    #[getter]
    fn parents(&self) -> Vec<Option<usize>> {
        self.0.clip.skeleton().parents().to_vec()
    }

    /// What was odd about the file: (kind, text).
    #[getter]
    fn warnings(&self) -> Vec<(String, String)> {
        self.0.warnings.iter().map(|w| (w.kind.to_owned(), w.what.clone())).collect()
    }

    /// (J, 3) offsets from the parents, metres.
    #[getter]
    fn offsets<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        self.0.clip.skeleton().offsets_view().to_pyarray(py)
    }

    /// (F, 3) positions of the root, metres.
    #[getter]
    fn root<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f64>> {
        self.0.clip.root_view().to_pyarray(py)
    }

    /// (F, J, 4) local rotations as unit quaternions x, y, z, w.
    #[getter]
    fn rotations<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray3<f64>> {
        self.0.clip.rotations_view().to_pyarray(py)
    }

    /// (F, J, 3) positions of the joints in the world, metres, as f64 or, on request, f32.
    #[pyo3(signature = (*, dtype="float64"))]
    fn positions<'py>(&self, py: Python<'py>, dtype: &str) -> PyResult<Bound<'py, PyAny>> {
        match dtype {
            "float64" => Ok(positions(py, &self.0.clip).into_any()),
            "float32" => {
                let narrow = py.detach(|| self.0.clip.positions_array().mapv(|x| x as f32));
                Ok(narrow.into_pyarray(py).into_any())
            }
            _ => Err(wrong(format!("dtype is {dtype:?}; expected \"float64\" or \"float32\""))),
        }
    }

    /// The page on which the clip plays, as HTML.
    fn page(&self, py: Python<'_>) -> PyResult<String> {
        let title = self.0.path.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        py.detach(|| page(&[Figure::new(title, &self.0.clip)])).map_err(|e| wrong(e.to_string()))
    }

    /// The clip plays in a notebook.
    fn _repr_html_(&self, py: Python<'_>) -> PyResult<String> {
        // `&` first, or it would escape the escapes
        let page = self.page(py)?.replace('&', "&amp;").replace('"', "&quot;");
        Ok(format!("<iframe srcdoc=\"{page}\" width=\"100%\" height=\"480\" style=\"border:0\"></iframe>"))
    }

    fn __len__(&self) -> usize {
        self.0.clip.frames()
    }

    fn __repr__(&self) -> String {
        let clip = &self.0.clip;
        format!("<kinelm.Clip: {} frames of {} joints at {} fps>", clip.frames(), clip.joints(), clip.fps())
    }
}

/// Reads motion files on all threads, as `Clip.read` does each; the clips are in the order of the paths. The first path that
/// can't be read raises its error.
#[pyfunction]
#[pyo3(signature = (paths, **reading))]
pub fn read_many(py: Python<'_>, paths: Vec<PathBuf>, reading: Option<&Bound<'_, PyDict>>) -> PyResult<Vec<Clip>> {
    let options = Reading::of(reading, RestFrame::Keep)?;
    detach(py, || {
        let all: Vec<_> = paths.par_iter().map(|path| format::read(path, &options)).collect();
        all.into_iter().map(|read| read.map(Clip).map_err(motion)).collect()
    })
}

/// A prompt: a motion file, or a clip in memory.
#[derive(FromPyObject)]
#[allow(clippy::large_enum_variant, reason = "one a call, and a box is nothing that Python converts to")]
pub enum Prompt {
    /// A clip.
    Clip(Clip),
    /// A path.
    File(PathBuf),
}

impl Prompt {
    /// The request of it, `read` by these options; of a clip every frame is its own, none a rest pose in front.
    pub fn request(self, read: ReadOptions) -> PyResult<PromptRequest> {
        Ok(match self {
            Prompt::File(path) => PromptRequest { read, ..PromptRequest::of(path) },
            Prompt::Clip(clip) => {
                // JSON has all digits of every number
                let bytes = format::to_bytes("clip.json".as_ref(), &clip.0).map_err(motion)?;
                let read = ReadOptions { rest: RestFrame::Keep, ..read };
                PromptRequest { read, bytes: Some(bytes.into()), ..PromptRequest::of("clip.json") }
            }
        })
    }
}

/// A motion with its skeleton map, if one is given.
pub fn mapped<'a>(motion: &'a Motion, map: Option<&str>) -> kinelm::motion::Result<Cow<'a, Motion>> {
    map.map_or(Ok(Cow::Borrowed(motion)), |map| motion.clone().with_map(map).map(Cow::Owned))
}

/// (F, J, 3) positions of a clip's joints.
pub fn positions<'py>(py: Python<'py>, clip: &kinelm::motion::Clip) -> Bound<'py, PyArray3<f64>> {
    py.detach(|| clip.positions_array()).into_pyarray(py)
}
