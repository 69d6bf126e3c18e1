//! Tokenizers.

use crate::clip::{Clip, mapped};
use crate::error::library;
use crate::options::free;
use kinelm::corpus::load::model_clip;
use kinelm::motion::format::ReadOptions;
use kinelm::motion::{Motion, joints};
use kinelm::tokenizer::TokenizerConfig;
use numpy::{PyArray1, PyReadonlyArray1};
use pyo3::prelude::*;
use std::path::PathBuf;

/// Turns clips into ids and back: a frame is a word, each component of a joint's rotation a character.
#[pyclass(frozen, module = "kinelm")]
pub struct Tokenizer(pub kinelm::tokenizer::Tokenizer);

/// A clip as this tokenizer takes it: on SMPL-24, at its rate, above its floor.
fn taken(
    motion: &Motion,
    config: &TokenizerConfig,
    map: Option<String>,
    floor: Option<f64>,
) -> PyResult<kinelm::motion::Clip> {
    let motion = mapped(motion, map.as_deref()).map_err(crate::error::motion)?;
    model_clip(&motion, &ReadOptions { floor, ..ReadOptions::default() }, config.into()).map_err(library)
}

#[pymethods]
impl Tokenizer {
    /// Fits a tokenizer to clips: `joints` are those coded, as "18" or a list of groups and names; `bins` of each character.
    #[staticmethod]
    #[pyo3(signature = (clips, *, joints="18", fps=20.0, bins=360, map=None, floor=None))]
    fn fit(
        py: Python<'_>,
        clips: Vec<Clip>,
        joints: &str,
        fps: f64,
        bins: u32,
        map: Option<String>,
        floor: Option<f64>,
    ) -> PyResult<Tokenizer> {
        let selection = joints::parse(joints).map_err(crate::error::motion)?;
        let config = TokenizerConfig::uniform(&selection.joints, fps, bins);
        py.detach(|| {
            let clips =
                clips.iter().map(|clip| taken(&clip.0, &config, map.clone(), floor)).collect::<PyResult<Vec<_>>>()?;
            kinelm::tokenizer::Tokenizer::fit(&clips, config).map(Tokenizer).map_err(library)
        })
    }

    /// Reads a tokenizer.json.
    #[staticmethod]
    fn load(path: PathBuf) -> PyResult<Tokenizer> {
        kinelm::tokenizer::Tokenizer::load(path).map(Tokenizer).map_err(library)
    }

    /// Writes a tokenizer.json. A file that is there is replaced only with `force`.
    #[pyo3(signature = (path, *, force=false))]
    fn save(&self, path: PathBuf, force: bool) -> PyResult<()> {
        free(&path, force)?;
        self.0.save(path).map_err(library)
    }

    /// The ids of a clip on any rig, at any rate. `floor` is its height in metres, found out if not given.
    #[pyo3(signature = (clip, *, map=None, floor=None))]
    fn encode<'py>(
        &self,
        py: Python<'py>,
        clip: &Clip,
        map: Option<String>,
        floor: Option<f64>,
    ) -> PyResult<Bound<'py, PyArray1<u32>>> {
        let ids = py.detach(|| {
            let clip = taken(&clip.0, self.0.config(), map, floor)?;
            let encoded = self.0.encode(&clip).map_err(library)?;
            self.0.ids_of_words(&encoded.words).map_err(library)
        })?;
        Ok(PyArray1::from_vec(py, ids))
    }

    /// The clip of ids, on SMPL-24. Any ids decode: what no word can hold is replaced by the nearest that it can.
    fn decode(&self, py: Python<'_>, ids: PyReadonlyArray1<'_, u32>) -> PyResult<Clip> {
        let ids = ids.as_array().to_vec();
        let clip = py.detach(|| {
            let words = self.0.words_of_ids(&ids).words;
            self.0.decode(&words, self.0.uncoded_pose()).map_err(library)
        })?;
        Ok(Clip(Motion::new("decoded.json", clip)))
    }

    /// How many ids there are.
    #[getter]
    fn vocabulary(&self) -> u32 {
        self.0.vocabulary().len()
    }

    /// Frames per second.
    #[getter]
    fn fps(&self) -> f64 {
        self.0.fps()
    }

    /// Ids of a word, its space included; None where words differ in length.
    #[getter]
    fn tokens_per_word(&self) -> Option<usize> {
        self.0.tokens_per_word()
    }

    fn __repr__(&self) -> String {
        format!("<kinelm.Tokenizer: {} ids, {} fps>", self.0.vocabulary().len(), self.0.fps())
    }
}
